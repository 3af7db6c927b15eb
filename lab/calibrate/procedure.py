"""Estimation of constants from clips with truth in three steps, and with each clip left out.

The same steps on simulated clips test whether the estimation recovers known constants. The
constants are written as a file and as a table of the documentation.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, replace
from typing import Final

import numpy as np

from imapper_prob.models.calibrated import Constant, Number
from imapper_prob.models.scene import Clip, Truth
from imapper_prob.models.scenelet import Library
from imapper_prob.models.settings import ModelSettings
from imapper_prob.simulate.clips import PITCH_SPREAD, simulate_clip, simulate_track
from lab.calibrate.constants import (
    FROM_FITS,
    FROM_PATH,
    FROM_TRUTH,
    KEPT,
    Estimator,
    estimate,
)
from lab.calibrate.estimators import jackknife_error
from lab.calibrate.evidence import Seen, detection_model, fit_library, look, place

__all__ = ["as_markdown", "as_toml", "calibrate", "in_use", "recover", "rounded", "without"]


_DIGITS = 3
"""Significant digits that are stored, more than four scenes can determine."""


def calibrate(scenes: Iterable[tuple[Clip, Truth]], library: Library) -> dict[str, Constant]:
    """Estimate all constants from at least two clips with ground truth.

    The static path and the fits for the later constants are made once, with the earlier constants
    estimated from all clips. Only the estimates are repeated with each clip left out.
    """
    found: dict[str, Constant] = {}
    evidence: Sequence[Seen] = [look(clip, truth) for clip, truth in scenes]
    found |= _estimated(FROM_TRUTH, evidence)
    placed = [place(seen, library, in_use(found)) for seen in evidence]
    found |= _estimated(FROM_PATH, placed)
    fitted = [fit_library(one, library, in_use(found)) for one in placed]
    return found | _estimated(FROM_FITS, fitted)


def in_use(found: Mapping[str, Constant]) -> dict[str, Number]:
    """The values that the program uses, by name."""
    return {name: constant.value for name, constant in found.items()}


def without(found: Mapping[str, Constant], scene: int) -> dict[str, Number]:
    """The values that the program would use without one of the scenes, by name."""
    return {
        name: constant.value if constant.kept else constant.folds[scene]
        for name, constant in found.items()
    }


def _estimated(estimators: Sequence[Estimator], evidence: Sequence[Seen]) -> dict[str, Constant]:
    whole = estimate(estimators, evidence)
    folds = [
        estimate(estimators, [*evidence[:k], *evidence[k + 1 :]]) for k in range(len(evidence))
    ]
    found = {}
    for e in estimators:
        own = tuple(rounded(fold[e.name]) for fold in folds)
        measured = rounded(whole[e.name])
        value, kept = KEPT.get(e.name, (measured, ""))
        error = jackknife_error([fold[e.name] for fold in folds])
        found[e.name] = Constant(
            value, e.unit, e.meaning, e.source, measured, rounded(error.tolist()), own, kept
        )
    return found


def rounded(value: Number | list[float]) -> Number:
    """Numbers rounded to the digits that are stored."""
    if isinstance(value, (tuple, list)):
        return tuple(float(np.format_float_positional(v, _DIGITS, fractional=False)) for v in value)
    return float(np.format_float_positional(value, _DIGITS, fractional=False))


_TOLD: Final = (
    "detections.seen_confidence", "detections.hidden_confidence",
    "detections.seen_error_scale", "detections.seen_error_dof",
    "detections.hidden_error_scale", "detections.hidden_error_dof",
    "path.pixel_scale", "path.pixel_dof", "side_flips.rate", "side_flips.length",
)  # fmt: skip
"""Constants with which the simulator draws detections."""


def recover(
    rng: np.random.Generator, library: Library, values: Mapping[str, Number], *, n_clips: int
) -> dict[str, tuple[Number, Number]]:
    """Simulate clips with known constants and estimate the constants from them.

    Parameters
    ----------
    rng : numpy.random.Generator
    library : Library
        Source of the clips' motions.
    values : mapping of str to float or tuple of float
        Constants with which detections are drawn.
    n_clips : int
        Number of clips, of 15 seconds.

    Returns
    -------
    dict of str to (known, found)
        Known and estimated values. The simulator's frames have independent errors and each clip a
        new camera, so correlation time and pitch are known, too.
    """
    model = detection_model(values)
    flips = {
        "side_flip_rate": values["side_flips.rate"],
        "side_flip_length": values["side_flips.length"],
    }
    settings = replace(ModelSettings(), **flips)  # type: ignore[arg-type]
    evidence = []
    for _ in range(n_clips):
        clip = simulate_clip(rng, library)
        truth = clip.truth
        assert truth is not None
        track = simulate_track(
            rng, truth.joints, truth.hidden, camera=truth.camera, fps=clip.fps,
            detections=model, settings=settings,
        )  # fmt: skip
        evidence.append(look(replace(clip, tracks=(track,)), truth))
    found = estimate(FROM_TRUTH, evidence)
    told = {name: values[name] for name in _TOLD}
    told |= {"frames.correlation_time": 1 / evidence[0].clip.fps, "camera.pitch": PITCH_SPREAD}
    return {name: (known, found[name]) for name, known in told.items()}


def as_toml(found: Mapping[str, Constant], *, heading: Iterable[str]) -> str:
    """The file that :mod:`imapper_prob.models.calibrated` reads, as text in order of name.

    Parameters
    ----------
    found : mapping of str to Constant
        By name, ``"group.name"``.
    heading : iterable of str
        Comment lines at its beginning.
    """
    blocks = ["\n".join(f"# {line}" for line in heading)]
    for name, constant in sorted(found.items()):
        lines = [f"[{name}]"]
        for field in fields(constant):
            value = getattr(constant, field.name)
            if value not in ("", ()):
                lines.append(f"{field.name} = {_toml(value)}")
        blocks.append("\n".join(lines))
    return "\n\n".join(blocks) + "\n"


def _toml(value: str | Number | tuple[Number, ...]) -> str:
    if isinstance(value, str):
        escaped = value.replace("\\", "\\\\").replace('"', '\\"')
        return f'"{escaped}"'
    if isinstance(value, tuple):
        return f"[{', '.join(_toml(v) for v in value)}]"
    return repr(value)


def as_markdown(found: Mapping[str, Constant]) -> str:
    """Tables of all constants: numbers, rows of numbers, and those known to the simulator."""
    found = dict(sorted(found.items()))
    numbers = {name: c for name, c in found.items() if not isinstance(c.value, tuple)}
    rows = {name: c for name, c in found.items() if isinstance(c.value, tuple)}
    parts = [
        _table(
            ("constant", "in use", "measured", "without each scene", "unit", "what, and how"),
            (
                (
                    f"`{name}`", _short(c.value), f"{_short(c.measured)} ± {_short(c.error)}",
                    ", ".join(_short(fold) for fold in c.folds), c.unit, _what(c),
                )
                for name, c in numbers.items()
            ),
        ),
        _table(
            ("constant", "in use", "error", "unit", "what, and how"),
            (
                (f"`{name}`", _short(c.value), _short(c.error), c.unit, _what(c))
                for name, c in rows.items()
            ),
        ),
        _table(
            ("constant", "told the simulator", "found again"),
            (
                (f"`{name}`", *(_short(number) for number in c.recovered))
                for name, c in found.items()
                if c.recovered
            ),
        ),
    ]  # fmt: skip
    return "\n".join(parts)


def _what(constant: Constant) -> str:
    why = f" **Kept:** {constant.kept}." if constant.kept else ""
    return f"{constant.meaning}: {constant.source}.{why}"


def _table(heading: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [heading, ["---"] * len(heading), *rows]
    return "".join(f"| {' | '.join(cells)} |\n" for cells in lines)


def _short(value: Number) -> str:
    """Numbers in the style of the table, such as ``.0122``."""
    if isinstance(value, tuple):
        return " ".join(_short(v) for v in value)
    return f"{value:.3g}".removeprefix("0") if value else "0"
