"""Is there anything to be had from this clip? What is said before the verdict on the chains.

Chains agree as well on nonsense. Each check holds one thing that must be so against a limit that
a clip passes in 99 of 100 cases if the model is right: those of :mod:`imapper_prob.models.settings`
and the spreads of ``calibrated.toml`` say what is usual, ``docs/research/alarms.md`` how often
clips are alarmed that are right, and that are wrong. The draws are not touched.

``upright``      people on their feet are upright in the cameras of the draws
``height``       their feet are as high above the floor as feet are
``slope``        and no higher further away
``camera``       the camera is about where it was said to be
``prediction``   the draws predict such detections, and have a seat for who is off their feet
``resemblance``  some scenelet of the library looks like what is seen
``elsewhere``    the detector was on the person
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import binom

from imapper_prob.models.errors import InputError
from imapper_prob.models.posterior import State
from imapper_prob.models.problem import Problem
from imapper_prob.models.scene import Clip
from imapper_prob.models.text import readable
from imapper_prob.people import own_part
from imapper_prob.results.camera_checks import camera, height, slope, upright
from imapper_prob.results.check import RATE, Check
from imapper_prob.results.predictive import prediction
from imapper_prob.staged.elsewhere import frames_elsewhere

__all__ = [
    "Check", "alarms", "checks_of", "elsewhere", "elsewhere_frames", "from_json", "named",
    "resemblance", "to_json",
]  # fmt: skip

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

_LOOKED_AT: Final = 40
"""Draws, evenly spaced over the chains, that checks are made of."""


def checks_of(
    clip: Clip,
    problem: Problem,
    states: Sequence[State],
    best_fits: Array,
    *,
    rng: np.random.Generator,
) -> tuple[Check, ...]:
    """All checks, in the order in which their alarms are said.

    Parameters
    ----------
    clip : Clip
    problem : Problem
        Of everybody in it.
    states : sequence of State
        Draws.
    best_fits : (T,) float
        See :func:`imapper_prob.staged.resemblance.best_fits`.
    rng : Generator
        For the detections that are drawn.
    """
    chosen = np.linspace(0, len(states) - 1, min(_LOOKED_AT, len(states))).round().astype(int)
    drawn = [states[k] for k in chosen.tolist()]
    cameras = np.array([state.camera for state in drawn])
    return (
        upright(clip, problem, cameras),
        height(problem, cameras, fps=clip.fps),
        slope(problem, cameras, fps=clip.fps),
        camera(clip.camera, cameras),
        resemblance(best_fits, frame_weight=problem.frame_weight),
        prediction(problem, drawn, clip.camera, rng=rng),
        elsewhere(clip),
    )


def alarms(checks: Iterable[Check]) -> tuple[str, ...]:
    """The sentences of those that are alarmed."""
    return tuple(check.sentence for check in checks if check.alarmed)


def to_json(checks: Iterable[Check]) -> str:
    """As text for an attribute; NaN is null there."""
    rows = [
        {k: None if isinstance(v, float) and math.isnan(v) else v for k, v in asdict(c).items()}
        for c in checks
    ]
    return json.dumps(rows, allow_nan=False)


def from_json(text: str) -> tuple[Check, ...]:
    """What :func:`to_json` wrote.

    Raises
    ------
    InputError
        If it wrote something else.
    """
    try:
        return _from_rows(json.loads(text))
    except (AttributeError, LookupError, OverflowError, RecursionError, TypeError) as error:
        raise InputError(f"checks are not as they were written ({error})") from error
    except ValueError as error:
        raise InputError(f"checks are no JSON ({error})") from error


def _from_rows(rows: Iterable[Mapping[str, Any]]) -> tuple[Check, ...]:
    return tuple(
        Check(
            str(row["name"]),
            math.nan if row["value"] is None else float(row["value"]),
            math.nan if row["limit"] is None else float(row["limit"]),
            bool(row["alarmed"]),
            readable(str(row["sentence"])),
        )
        for row in rows
    )


_UNLIKE: Final = 0.64
"""Nats per confident joint from which a best fit is worse than right scenelets reach in 95 % of the
frames of simulated clips (``python -m lab.alarms --threshold``)."""
_UNLIKE_PART: Final = 0.05


def resemblance(best: Array, *, frame_weight: float) -> Check:
    """Whether the library has something that looks like what is seen.

    Parameters
    ----------
    best : (T,) float
        See :func:`imapper_prob.staged.resemblance.best_fits`.
    frame_weight : float
        One over the frames that say the same.
    """
    judged = best[np.isfinite(best)]
    independent = max(1, round(len(judged) * min(1.0, frame_weight)))
    limit = float(binom.isf(RATE, independent, _UNLIKE_PART)) / independent
    if not len(judged):
        return Check("resemblance", math.nan, limit, False, "Nothing says how well scenelets fit.")
    value = float(np.mean(judged > _UNLIKE))
    told = f"No scenelet of the library resembles {100 * value:.0f} % of the clip"
    if not value > limit:
        return Check("resemblance", value, limit, False, f"{told}.")
    sentence = (
        f"{told} ({100 * limit:.0f} % are rare): what is done there the program does not know, and "
        "what it says of furniture there is a guess. Check camera and joints; if they are right, "
        "add scenelets of such motions with --library."
    )
    return Check("resemblance", value, limit, True, sentence)


def elsewhere_frames(clip: Clip) -> tuple[Flags, ...]:
    """(T,) frames of each track in which the detector was on something else."""
    return tuple(frames_elsewhere(t, camera=clip.camera, fps=clip.fps) for t in clip.tracks)


def elsewhere(clip: Clip) -> Check:
    """Whether the detector was on its people all the time."""
    away = elsewhere_frames(clip)
    frames = int(sum(flags.sum() for flags in away))
    if not frames:
        return Check("elsewhere", 0.0, 0.0, False, "The detector was on the person throughout.")
    whose = [
        f"{named(clip.frame_ids[flags])}{f' of{own_part(clip, k)}' if len(away) > 1 else ''}"
        for k, flags in enumerate(away)
        if flags.any()
    ]
    sentence = (
        f"The detector was on something else in frame{'s' if frames > 1 else ''} "
        f"{'; '.join(whose)}: all joints jump there and back as nobody moves. These frames count "
        "as undetected."
    )
    return Check("elsewhere", float(frames), 0.0, True, sentence)


def named(frames: ArrayLike) -> str:
    """Frame numbers, ascending, in runs: ``"12-25, 70"``."""
    numbers = np.asarray(frames, np.int64)
    if not len(numbers):
        return "none"
    runs = np.split(numbers, np.flatnonzero(np.diff(numbers) > 1) + 1)
    return ", ".join(f"{run[0]}-{run[-1]}" if len(run) > 1 else f"{run[0]}" for run in runs)
