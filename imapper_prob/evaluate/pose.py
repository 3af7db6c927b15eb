"""How far joints are from where they were: the three errors of the paper's table 2."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.evaluate.prediction import Prediction
from imapper_prob.evaluate.truth import TruthInView
from imapper_prob.models.errors import InputError
from imapper_prob.models.skeleton import LHIP, PELV, RHIP, SCORED

__all__ = ["SUBSETS", "PoseScore", "pose_scores"]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

SUBSETS: Final = ("all frames", "occluded joints", "occ3")
"""All annotated frames; only joints behind furniture; all joints of frames in which at least
three of the sixteen are, which is what the paper's table 2 scores."""

_MANY_HIDDEN: Final = 3


@dataclass(frozen=True)
class PoseScore:
    """Root mean square errors over joints and frames.

    Parameters
    ----------
    world : float
        In the axes of the camera, cm.
    local : float
        Relative to the pelvis, cm.
    pixels : float
        In the image.
    joints : int
        Joints in frames that were scored. 0 where there are none; the errors are then NaN.
    left_out : int
        Joints in frames that are known but about which the prediction says nothing.
    """

    world: float
    local: float
    pixels: float
    joints: int
    left_out: int


def pose_scores(prediction: Prediction, truth: TruthInView) -> dict[str, PoseScore]:
    """Errors of the fourteen scored joints by :data:`SUBSETS`.

    Raises
    ------
    InputError
        If the numbers of frames differ.
    """
    if len(prediction.joints) != len(truth.joints):
        raise InputError(
            f"{prediction.name}: has {len(prediction.joints)} frames, the truth of {truth.name} "
            f"has {len(truth.joints)}; the frames of a result must be those of its clip"
        )
    scored = list(SCORED)
    known = np.repeat(truth.known[:, None], len(scored), 1)
    hidden = truth.hidden[:, scored]
    many = (truth.hidden.sum(1) >= _MANY_HIDDEN)[:, None]
    squares = [
        ((a - b) ** 2).sum(-1)[:, scored]
        for a, b in (
            (prediction.joints, truth.joints),
            (_about_pelvis(prediction.joints), _about_pelvis(truth.joints)),
            (prediction.pixels, truth.pixels),
        )
    ]
    subsets = (known, known & hidden, known & many)
    return {name: _score(squares, s) for name, s in zip(SUBSETS, subsets, strict=True)}


def _about_pelvis(joints: Array) -> Array:
    """Relative to the pelvis, or to the middle of the hips where a joint set has none."""
    pelvis = joints[:, PELV]
    middle = joints[:, (RHIP, LHIP)].mean(1)
    return joints - np.where(np.isfinite(pelvis), pelvis, middle)[:, None]


def _score(squares: list[Array], wanted: Flags) -> PoseScore:
    there = wanted & np.isfinite(squares[0])
    world, local, pixels = (_root_mean(s[there & np.isfinite(s)]) for s in squares)
    count = int(there.sum())
    return PoseScore(100 * world, 100 * local, pixels, count, int(wanted.sum()) - count)


def _root_mean(squares: Array) -> float:
    return float(np.sqrt(squares.mean())) if squares.size else float("nan")
