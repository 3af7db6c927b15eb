"""Continuing an existing run: checks, and the command that does so."""

from __future__ import annotations

import dataclasses
import math
import shlex
from typing import TYPE_CHECKING, Any, Final

from imapper_prob.models.errors import InputError

if TYPE_CHECKING:
    import argparse
    from collections.abc import Iterator, Sequence

    from imapper_prob.config import Config
    from imapper_prob.results.folders import Earlier
    from imapper_prob.sampling.blocks import Block, Limits

__all__ = [
    "config_to_go_on", "how_to_go_on", "nothing_to_do", "require_same_input", "words_of_block",
]  # fmt: skip

_OF_LENGTH: Final = ("sample.steps", "sample.draws", "sample.last_step")
"""Settings in which a continued run may differ from the earlier one."""
_LIMITS: Final = ("--steps", "--minutes", "--until")
_USUAL: Final = 10
"""Minutes to continue for if the time needed cannot be estimated."""
_LONGEST: Final = 24 * 60
"""Minutes above which no command to continue is suggested."""


def config_to_go_on(
    earlier: Earlier, asked: Config, *, steps: int | None, limits: Limits
) -> Config:
    """Settings with which an earlier run continues.

    Parameters
    ----------
    earlier : Earlier
    asked : Config
        The earlier run's settings, overridden by the user's options.
    steps : int, optional
        Total number of steps that the user asks for.
    limits : Limits

    Returns
    -------
    Config

    Raises
    ------
    InputError
        The options contradict the earlier run's settings, or ask for nothing more.
    """
    where, before = earlier.folder, earlier.config
    for name, value, other in _differences(before, asked):
        # Another path may lead to the same library; digests are compared later.
        if name != "library" and name not in _OF_LENGTH:
            raise InputError(
                f"{where}: holds a run with {name} = {value}, not {other}; leave that as it is, "
                "name another folder, or add --overwrite"
            )
    planned, made = before.sample.steps, before.sample.steps_made
    config = dataclasses.replace(asked, sample=before.sample)
    if steps is not None and (steps < planned or (limits.any and steps != planned)):
        raise InputError(
            f"--steps {steps}: {where} holds a run planned with {planned} steps; "
            + ("leave --steps out" if limits.any else "name more, or another folder")
        )
    if limits.any:
        return config
    if steps is not None and steps > made:
        sample = dataclasses.replace(before.sample, last_step=steps)
        return dataclasses.replace(config, sample=sample)
    if earlier.finished:
        raise InputError(
            f"{where}: holds a finished run of {made} steps, and no more is asked for; go on with "
            f"--minutes, --until good or --steps above {made}, name another folder, or add "
            "--overwrite"
        )
    return config


def nothing_to_do(earlier: Earlier, limits: Limits) -> bool:
    """Whether a run already has the quality that is asked for.

    Parameters
    ----------
    earlier : Earlier
    limits : Limits

    Returns
    -------
    bool
    """
    return earlier.finished and limits.until == "good" and earlier.good


def require_same_input(earlier: Earlier, clip_digest: str, library_digest: str, given: str) -> None:
    """Refuse to continue a run of another clip, library or statements.

    Parameters
    ----------
    earlier : Earlier
    clip_digest, library_digest : str
        Digests of the inputs of the command.
    given : str
        Statements as :func:`imapper_prob.models.statements.to_json` writes them; empty if none.

    Raises
    ------
    InputError
        Clip, library or statements differ from those of the run.
    """
    found = {"clip": clip_digest, "library": library_digest}
    kept = {"clip": earlier.clip_digest, "library": earlier.library_digest}
    for what, digest in found.items():
        if digest != kept[what]:
            raise InputError(
                f"{earlier.folder}: holds a run of another {what} (clip {earlier.clip}); give the "
                "same one with the same options, name another folder, or add --overwrite"
            )
    if given != earlier.given:
        raise InputError(
            f"{earlier.folder}: holds a run with other statements; give the same --given, name "
            "another folder, or add --overwrite"
        )


def words_of_block(number: int, block: Block) -> str:
    """A line on the quality reached after a block.

    Parameters
    ----------
    number : int
        From 1.
    block : Block

    Returns
    -------
    str
    """
    from imapper_prob.samplers.verdict import rounded_up

    found = block.measures
    known = "nobody knows how far off" if math.isnan(found.error) else (
        f"off by {rounded_up(found.error):.2f}"
    )  # fmt: skip
    parts = [
        f"probabilities {known}",
        *([f"R-hat {found.rhat:.2f}"] if found.rhat_of else []),
        *(
            [f"{found.effective_layouts:.0f} effective draws of layouts"]
            if math.isfinite(found.effective_layouts)
            else ["no layout in doubt"]
        ),
    ]
    said = f"block {number}, {block.steps} steps: {', '.join(parts)}"
    if not block.finished:
        return f"{said}; interrupted"
    if block.verdict.good:
        return f"{said}; good"
    if block.seconds_left <= 0:
        return f"{said}; the time is up"
    needed = block.seconds_to_good
    good = "" if math.isnan(needed) else f", good in about {_span(needed)}"
    return f"{said}; {_span(block.seconds_left)} left{good}"


def how_to_go_on(block: Block, options: argparse.Namespace) -> str:
    """The command that continues a run, and the expected time it needs.

    Parameters
    ----------
    block : Block
        The last block.
    options : argparse.Namespace
        Options of the command that was given, with its ``words``.

    Returns
    -------
    str
        A sentence, and the command on a separate line.
    """
    needed, verdict = block.seconds_to_good, block.verdict
    minutes = _USUAL if math.isnan(needed) else max(1, math.ceil(needed / 60))
    if verdict.disagreement is not None:
        minutes = max(_USUAL, math.ceil(block.seconds / 60))
        told = "Chains may come to agree if they go on, or not:"
    elif minutes > _LONGEST:
        return f"To be good it needs about {_span(needed)} more, too long to be worth it."
    elif math.isnan(needed):
        told = "Go on with"
    else:
        told = f"About {_span(needed)} more are needed; go on with"
    words = [*_without_limits(options.words), "--until", "good", "--minutes", str(minutes)]
    return f"{told}\n  imapper-prob {shlex.join(words)}"


def _without_limits(words: Sequence[str]) -> Iterator[str]:
    """The words of a command without options on its length or on overwriting."""
    skip = False
    for word in words:
        name, given, _ = word.partition("=")
        if skip:
            skip = False
        elif name in _LIMITS:
            skip = not given
        elif name != "--overwrite":
            yield word


def _span(seconds: float) -> str:
    if seconds < 90:
        return f"{max(1, round(seconds))} s"
    if seconds < 90 * 60:
        return f"{seconds / 60:.0f} min"
    return f"{seconds / 3600:.0f} h"


def _differences(before: Any, after: Any, name: str = "") -> Iterator[tuple[str, Any, Any]]:
    """Names of settings that differ, with both values."""
    for entry in dataclasses.fields(before):
        one, other = getattr(before, entry.name), getattr(after, entry.name)
        if dataclasses.is_dataclass(one):
            yield from _differences(one, other, f"{name}{entry.name}.")
        elif one != other:
            yield f"{name}{entry.name}", one, other
