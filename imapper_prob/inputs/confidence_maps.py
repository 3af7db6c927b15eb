"""From a detector's own scores to the confidences that the detection tables are made for.

The tables (``docs/calibration.md``) were counted on one detector. Scores of another mean
something else, and are put on that scale first by a monotone map, one for each source.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imapper_prob.models.errors import InputError

__all__ = ["CONFIDENCE_MAPS", "confidence_map"]

Array = NDArray[np.float64]
Knots = tuple[tuple[float, float], ...]
Map = Callable[[ArrayLike], Array]

CONFIDENCE_MAPS: Final[dict[str, Knots]] = {
    # Values are confidences already.
    "identity": ((0.0, 0.0), (1.0, 1.0)),
    # Peaks of OpenPose's heat maps: .6 to .8 on joints in full view (fixtures: median .63),
    # where the tables expect .8 to .9; below .05 the program itself drops a point.
    "openpose": ((0.0, 0.0), (0.05, 0.02), (0.3, 0.5), (0.6, 0.82), (0.8, 0.88), (1.0, 0.95)),
    # Scores of MMPose, RTMPose and AlphaPose: no probabilities, and beyond 1 at times; their
    # own programs draw points from .3.
    "mmpose": ((0.0, 0.0), (0.1, 0.02), (0.3, 0.5), (0.6, 0.82), (0.9, 0.88), (1.2, 0.95)),
    # MediaPipe's visibility is high on hidden joints too. On three clips joints in plain view have
    # .75 and more, a leg behind the other .5 to .7. It ends where the tables hardly speak for
    # "seen" (.79: 1.2 to 1).
    "mediapipe": ((0.0, 0.02), (0.1, 0.05), (0.5, 0.15), (0.75, 0.5), (0.9, 0.72), (1.0, 0.79)),
}
"""Knots (score, confidence) of piecewise linear maps; outside of them the ends hold. All but
the first are judgement, for want of data with hidden joints marked. ``cpm`` is the fifth map,
:func:`_heat`."""

_HEAT_GAIN: Final = 5000.0
_HEAT_OFFSET: Final = -9.5
"""Logistic map that the authors of i3DB use for raw heat of convolutional pose machines."""


def confidence_map(name: str) -> Map:
    """A map by its name, or from knots written out.

    Parameters
    ----------
    name : str
        One of :data:`CONFIDENCE_MAPS`, ``"cpm"``, or ``"0:0,0.3:0.5,1:1"``: scores and
        confidences, both ascending.

    Returns
    -------
    callable
        Takes scores of any shape to confidences in [0, 1]. What is not above 0 stays a
        missing joint.

    Raises
    ------
    InputError
        There is no such map, or it does not ascend.
    """
    if name == "cpm":
        return _heat
    knots = CONFIDENCE_MAPS[name] if name in CONFIDENCE_MAPS else _written_out(name)
    at, value = np.array(knots).T

    def mapped(scores: ArrayLike) -> Array:
        finite = np.nan_to_num(np.asarray(scores, float), posinf=at[-1])
        return np.where(finite > 0, np.interp(finite, at, value), 0.0)

    return mapped


def _heat(scores: ArrayLike) -> Array:
    heat = np.clip(np.nan_to_num(np.asarray(scores, float)), 0.0, 0.1)
    return np.where(heat > 0, 1 / (1 + np.exp(-_HEAT_GAIN * heat - _HEAT_OFFSET)), 0.0)


def _written_out(text: str) -> Knots:
    number = r"\d*\.?\d+"
    pairs = [part.strip() for part in text.split(",")]
    if not all(re.fullmatch(f"{number}:{number}", pair) for pair in pairs):
        known = ", ".join(sorted([*CONFIDENCE_MAPS, "cpm"]))
        raise InputError(
            f"confidence map {text!r}: known are {known}, or knots such as 0:0,0.3:0.5,1:1"
        )
    knots = tuple((float(a), float(b)) for a, b in (pair.split(":") for pair in pairs))
    scores, confidences = np.array(knots).T
    if len(knots) < 2 or (np.diff(scores) <= 0).any() or (np.diff(confidences) < 0).any():
        raise InputError(f"confidence map {text!r}: two knots or more, scores ascending")
    if confidences.max() > 1:
        raise InputError(f"confidence map {text!r}: confidences are in [0, 1]")
    return knots
