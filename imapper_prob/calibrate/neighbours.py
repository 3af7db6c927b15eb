"""How often detections say the same thing of which scenelet it is.

The model adds up the log-densities of joints and frames as if none knew of another. But a
motion that is not quite this person's is wrong in many joints at once and for as long as it
lasts. How much such a sum exaggerates is seen between the scenelet nearest to the truth and
those next to it: along the way from one to another the score, which would have the expected
information for its variance, is larger by the number of detections that count as one. To divide
by that number is the magnitude adjustment of a composite likelihood (Pauli, Racugno and Ventura,
Bayesian composite marginal likelihoods, Statistica Sinica 21, 2011).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.energy.detections import DetectionModel
from imapper_prob.models.scene import Clip, Truth
from imapper_prob.models.skeleton import DETECTED, PELV

__all__ = ["Neighbours", "neighbours", "repeats"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Neighbours:
    """The scenelet nearest to a stretch of the true motion, and others, as the camera sees them.

    Parameters
    ----------
    frames : (m,) int
        Annotated ones that the nearest covers.
    pixels : (m, 14, 2) float
        Where its joints are seen.
    per_metre : (m, 14) float
        Pixels that a metre across the viewing ray is there.
    apart : (k, m, 14, 2) float
        Pixels from its joints to those of the others; NaN where another does not cover a frame.
    """

    frames: NDArray[np.intp]
    pixels: Array
    per_metre: Array
    apart: Array


def neighbours(truth: Truth, poses: Sequence[tuple[int, Array]]) -> Neighbours:
    """Lay scenelets upon the true motion and look at them.

    Parameters
    ----------
    truth : Truth
    poses : sequence of (int, (n, 16, 3) float)
        First frame, and joints relative to the pelvis, turned as the person is, in metres; the
        nearest scenelet first.
    """
    known: NDArray[np.bool_] = np.all(np.isfinite(truth.joints), axis=(1, 2))
    looks = []
    for first, pose in poses:
        frames = first + np.flatnonzero(known[first : first + len(pose)])
        joints, own = truth.joints[frames], pose[frames - first]
        pelvis = joints[:, [PELV]]
        laid = own + pelvis + (joints - own - pelvis).mean((0, 1))
        looks.append((frames, laid[:, list(DETECTED)]))
    frames, nearest = looks[0]
    pixels = truth.camera.project(nearest)
    others = np.full((len(looks) - 1, *pixels.shape), np.nan)
    for other, (covered, laid) in zip(others, looks[1:], strict=True):
        _, here, there = np.intersect1d(frames, covered, return_indices=True)
        other[here] = truth.camera.project(laid[there])
    depth = truth.camera.to_camera(nearest)[..., 1]
    return Neighbours(frames, pixels, truth.camera.fx / depth, others - pixels)


def repeats(
    beside: Neighbours,
    clip: Clip,
    truth: Truth,
    *,
    detections: DetectionModel,
    tolerance: float,
    track: int = 0,
) -> Array:
    """Squared scores over what independent detections would have, from one scenelet to others.

    Parameters
    ----------
    beside : Neighbours
    clip : Clip
    truth : Truth
        Says which joints are hidden.
    detections : DetectionModel
    tolerance : float
        Metres an axis by which a pose differs from its scenelet's.

    Returns
    -------
    (at most k,) float
        Of the scenelets that some detection tells from the nearest one; with a mean of one if no
        two detections knew of each other.
    """
    joints = list(DETECTED)
    confidence = clip.tracks[track].confidences[beside.frames][:, joints]
    error = clip.tracks[track].keypoints[beside.frames][:, joints] - beside.pixels
    seen = np.where(np.asarray(truth.hidden)[beside.frames][:, joints], 0, 1)[..., None]
    scale, dof = (
        np.take_along_axis(table, seen, -1)[..., 0]
        for table in detections.error_tables(confidence, image_height=clip.camera.height)
    )
    used = (confidence > 0) & np.isfinite(error).all(-1)
    error = np.where(used[..., None], error, 0.0)
    variance = scale**2 + (tolerance * beside.per_metre) ** 2
    listened = (dof + 2) / (dof * variance + (error**2).sum(-1))
    score = listened[..., None] * error
    information = np.where(used, (dof + 2) / ((dof + 4) * variance), 0.0)
    along = np.nan_to_num(beside.apart)
    total = (score * along).sum((1, 2, 3))
    expected = (information * (along**2).sum(-1)).sum((1, 2))
    result: Array = total[expected > 0] ** 2 / expected[expected > 0]
    return result
