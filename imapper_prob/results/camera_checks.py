"""Whether the camera can be where the draws have it: people upright, feet on a level floor.

Lifted poses say what is upright, the static path where feet are: neither has been bent by any
scenelet. All of it is in the worlds of the draws' cameras.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2, norm

from imapper_prob.models.calibrated import calibrated, constants
from imapper_prob.models.camera import Camera
from imapper_prob.models.problem import Problem
from imapper_prob.models.scene import Clip
from imapper_prob.models.settings import ANKLE
from imapper_prob.models.skeleton import LANK, LHIP, LKNE, PELV, RANK, RHIP, RKNE, THRX
from imapper_prob.people import everybody
from imapper_prob.results.check import RATE, Check

__all__ = ["camera", "height", "slope", "upright"]

Array = NDArray[np.float64]

_NORMAL: Final = float(norm.isf(RATE / 2))
"""Standard deviations that a normal number exceeds as rarely, either way."""
_TRUNK_AND_THIGHS: Final = [THRX, RHIP, LHIP, RKNE, LKNE]
_STRAIGHT: Final = math.radians(30.0)
"""Between trunk and thighs of somebody on their feet, at most; 60 degrees and more in a seat."""
_UPRIGHT_PART: Final = 0.25
"""Part of those frames that must be upright; in the others one may lie, lean or reach."""
_LEAN: Final = math.radians(6.3)
"""Deviation over clips, either way, of how the most upright of that part leans and of what a lifter
makes of it: simulated clips of ``python -m lab.alarms``. On i3DB they lean by 3 to 7 degrees."""
_OVERTURNED: Final = 60.0
"""Degrees from which on no pitch is to blame: who films so steeply says so."""
_LEAST_SECONDS: Final = 1.2
"""Of frames of use, below which nothing is said: ``frames.correlation_time``."""


def upright(clip: Clip, problem: Problem, cameras: Array) -> Check:
    """Whether people on their feet are upright.

    On their feet is who has trunk and thighs in line; whether that line is vertical is not asked.
    It should be in a quarter of these frames, but for an error either way.

    Parameters
    ----------
    clip : Clip
        With lifted poses.
    problem : Problem
        Of everybody in it.
    cameras : (N, 5) float
        Those of draws.
    """
    people = everybody(clip)
    own = people.has_pose & ~people.interpolated
    poses = np.where(own[:, None, None], people.poses, 0.0)
    trunk = _unit(poses[:, THRX] - poses[:, PELV])
    thighs = _unit(poses[:, [RHIP, LHIP]].sum(1) - poses[:, [RKNE, LKNE]].sum(1))
    seen = _told(problem)[:, _TRUNK_AND_THIGHS].mean(1) > 0.5
    straight = own & seen & ((trunk * thighs).sum(1) > math.cos(_STRAIGHT))
    pitch, roll = calibrated("camera.pitch"), calibrated("camera.roll")
    either_way = math.sqrt(_LEAN**2 + (pitch**2 + roll**2) / 2)
    limit = math.degrees(either_way * math.sqrt(-2.0 * math.log(RATE)))
    if straight.sum() < _LEAST_SECONDS * clip.fps:
        return Check("upright", math.nan, limit, False, "Nobody is seen on their feet for long.")
    axis = _unit(trunk + thighs)[straight]
    up = np.median([_level(phi).rotation[2] for phi in cameras], axis=0)
    tilt = np.degrees(np.arccos(np.clip(axis @ _unit(up), -1.0, 1.0)))
    value = float(np.quantile(tilt, _UPRIGHT_PART))
    if not value > limit:
        return Check("upright", value, limit, False, f"People stand upright, to {value:.0f}°.")
    why = (
        "its pitch or roll is wrong: give --pitch in degrees (down is negative)"
        if value < _OVERTURNED
        else "the film lies on its side or the joints are upside down (pixels count downward from "
        "the top): turn them; unless the person lies down all the time"
    )
    sentence = (
        f"The camera cannot be right: whoever is on their feet leans by {value:.0f}° or more, "
        f"where {limit:.0f}° are rare. Probably {why}. Furniture and distances mean nothing."
    )
    return Check("upright", value, limit, True, sentence)


def _feet(problem: Problem, cameras: Array) -> tuple[Array, Array, Array]:
    """Of the lower seen ankle (T,): metres above the floor, metres of depth, and what it counts.

    Medians over the cameras. As in :mod:`imapper_prob.staged.calibration`: of hidden feet
    detectors make something up, and they count as far as the detector is sure of them.
    """
    index, ankles = np.arange(problem.n_frames), [RANK, LANK]
    guessed = _told(problem)[:, ankles] == 0
    world = np.array([_world(problem, phi)[:, ankles] for phi in cameras])
    up = np.median(world[..., 2], axis=0)
    lower = np.where(guessed & ~guessed.all(1, keepdims=True), np.inf, up).argmin(1)
    away = np.median(world[..., 1], axis=0)[index, lower]
    sure = (problem.used * problem.confidences)[:, ankles][index, lower]
    return up[index, lower], away, sure * ~guessed[index, lower]


def height(problem: Problem, cameras: Array, *, fps: float) -> Check:
    """Whether feet are where feet are, above the floor.

    Parameters
    ----------
    problem : Problem
    cameras : (N, 5) float
        Those of draws.
    fps : float
        Frames a second.
    """
    above, _, counts = _feet(problem, cameras)
    often = counts.sum() / max(1.0, calibrated("frames.correlation_time") * fps)
    limit = _NORMAL * math.hypot(calibrated("ankle.offset"), _median_error(often))
    if counts.sum() < _LEAST_SECONDS * fps:
        return Check("height", math.nan, limit, False, "Feet are hardly ever seen.")
    value = _median(above, counts) - ANKLE
    if not abs(value) > limit:
        return Check("height", value, limit, False, f"Feet are on the floor, to {value:+.2f} m.")
    where = "float above" if value > 0 else "have their feet below"
    sentence = (
        f"The camera cannot be right: people {where} the floor, by {abs(value):.2f} m in the "
        "median. Give --camera-height in metres, and --pitch in degrees (down is negative)."
    )
    return Check("height", value, limit, True, sentence)


def slope(problem: Problem, cameras: Array, *, fps: float) -> Check:
    """Whether the floor is level: feet further away are no higher; parameters as above."""
    above, away, counts = _feet(problem, cameras)
    nothing = Check("slope", math.nan, math.nan, False, "Too few feet are seen to say of a slope.")
    if counts.sum() < 2 * _LEAST_SECONDS * fps:
        return nothing
    middle = _median(away, counts)
    near, far = counts * (away <= middle), counts * (away > middle)
    if min(near.sum(), far.sum()) < 0.25 * counts.sum():
        return nothing
    apart = _median(away, far) - _median(away, near)
    seconds = max(1.0, calibrated("frames.correlation_time") * fps)
    # Who seems further away by a part of their depth has feet lower by that part of the camera's
    # height above them.
    sunk = calibrated("bias.log_depth") * float(np.median(cameras[:, 1]))
    error = math.hypot(
        *(
            math.hypot(_median_error(often), sunk / math.sqrt(max(often, 1.0)))
            for often in (near.sum() / seconds, far.sum() / seconds)
        )
    )
    pitch = float(np.std(cameras[:, 0]))
    limit = _NORMAL * math.hypot(error / max(apart, 1e-9), pitch)
    value = (_median(above, far) - _median(above, near)) / max(apart, 1e-9)
    if not abs(value) > limit:
        return Check("slope", value, limit, False, f"The floor is level, to {value:+.2f}.")
    way = "rises" if value > 0 else "falls"
    sentence = (
        f"The camera cannot be right: the floor {way} by {100 * abs(value):.0f} cm a metre away "
        f"from it. Give --pitch in degrees (down is negative), about "
        f"{abs(math.degrees(math.atan(value))):.0f}° {'lower' if value > 0 else 'higher'}, and "
        "--focal if it was guessed."
    )
    return Check("slope", value, limit, True, sentence)


def camera(nominal: Camera, cameras: Array) -> Check:
    """Whether the draws leave the camera about where it was said to be.

    In standard deviations of pitch, roll and log height as they were measured: the prior of the
    height is wider, so that a wrong one does little harm.

    Parameters
    ----------
    nominal : Camera
        As the clip says.
    cameras : (N, 5) float
        Those of draws.
    """
    pitch, elevation, _, _, roll = np.median(cameras, axis=0).tolist()
    usual = constants()
    apart = np.array(
        [
            (pitch - nominal.pitch) / calibrated("camera.pitch"),
            (roll - nominal.roll) / calibrated("camera.roll"),
            math.log(elevation / nominal.elevation)
            / float(np.asarray(usual["camera.log_elevation"].measured)),
        ]
    )
    value, limit = float(np.linalg.norm(apart)), math.sqrt(chi2.isf(RATE, len(apart)))
    found = (
        f"{elevation:.2f} m above the floor at a pitch of {math.degrees(pitch):.0f}° and a roll of "
        f"{math.degrees(roll):.0f}°"
    )
    if not value > limit:
        return Check("camera", value, limit, False, f"The camera is {found}, as was said.")
    said = (
        f"{nominal.elevation:.2f} m, {math.degrees(nominal.pitch):.0f}° and "
        f"{math.degrees(nominal.roll):.0f}°"
    )
    sentence = (
        f"The camera is not where it was said or assumed to be: what is seen puts it {found}, "
        f"where {said} were given. Measure --camera-height (metres) and --pitch (degrees, down is "
        "negative); one of them, or --focal, is wrong."
    )
    return Check("camera", value, limit, True, sentence)


def _told(problem: Problem) -> NDArray[np.int64]:
    """(T, 16) 1 of joints that are detected and more probably seen than hidden."""
    result: NDArray[np.int64] = problem.used * problem.confidence_density.argmax(-1)
    return result


def _level(phi: Array) -> Camera:
    return Camera(
        1, 1, 1.0, 1.0, 0.0, 0.0, pitch=float(phi[0]), roll=float(phi[4]), elevation=float(phi[1])
    )


def _world(problem: Problem, phi: Array) -> Array:
    """(T, 16, 3) joints of the static path in the world of a camera, metres."""
    focal, body = math.exp(phi[2]), math.exp(phi[3])
    depth = np.exp(problem.path_centre[:, 1]) * focal * body
    pelvis = np.stack(
        [problem.path_centre[:, 0] / focal, np.ones_like(depth), problem.lift / focal]
    )
    joints = (depth * pelvis).T[:, None] + body * problem.poses
    return _level(phi).to_world(joints)


def _unit(vectors: Array) -> Array:
    result: Array = vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-9)
    return result


def _median(values: Array, weights: Array) -> float:
    order = np.argsort(values)
    heap = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(heap, heap[-1] / 2)])


def _median_error(often: float) -> float:
    """Metres by which a median of so many independent heights of an ankle may be off.

    A Student-t of 2 degrees of freedom and scale s has 1 / (2 sqrt(2) s) for its density in the
    middle, and a median 1 / (2 sqrt(n)) of the inverse of that for its deviation.
    """
    return math.sqrt(2.0 / max(often, 1.0)) * calibrated("ankle.spread")
