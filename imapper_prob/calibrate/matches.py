"""What a library can say of a clip whose truth is known.

The scenelet nearest to the true motion is the one that ought to be found; how far it still is
from the truth, and from the free frames beside it, no model should be surprised by. How the
scenelets that *are* found differ in size is asked of the solver's own fits.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imapper_prob.calibrate.furniture import furniture_errors
from imapper_prob.calibrate.neighbours import Neighbours, neighbours
from imapper_prob.calibrate.observations import stretches
from imapper_prob.calibrate.sights import sights_past
from imapper_prob.models.path import StaticPath
from imapper_prob.models.pose import facing, turned
from imapper_prob.models.problem import Problem, resample
from imapper_prob.models.scene import Clip, Placement, Truth
from imapper_prob.models.scenelet import Library
from imapper_prob.models.skeleton import PELV
from imapper_prob.staged.fit import Fits

__all__ = ["FitErrors", "Nearest", "nearest_scenelets", "observe_fits"]

Array = NDArray[np.float64]

_EVERY = 0.6
"""Seconds between the windows that are matched with the truth."""
_FEWEST_KNOWN = 1 / 3
"""Part of a scenelet's frames that must be annotated."""
_BEST = 10
"""Fits of a window whose depths are averaged, and neighbours that are compared with the scenelet
nearest to the truth: the library holds many alike."""


@dataclass(frozen=True)
class Nearest:
    """The scenelets nearest to the true motion.

    Parameters
    ----------
    across : (n, 2) float
        Metres across the viewing ray, right and up, by which true joints differ from theirs
        when they are placed and turned as well as can be.
    jumps : (m, 16, 3) float
        Their first and last pose minus the static pose of the frame next to it, both
        relative to the pelvis, world axes, metres.
    turns : (n,) float
        Radians by which they are turned, when they are placed so, from where they would face as
        the static path does, both averaged over their frames.
    clearance, hidden : (j,) float, (j,) bool
        Of true joints of somebody who stays put: how far the furniture of a scenelet is from
        cutting their line of sight, metres, and whether the true pieces that it stands for do.
        Joints that something else hides are left out.
    furniture : (k, 2) float
        How far true furniture stands from where they say
        (:func:`imapper_prob.calibrate.furniture.furniture_errors`).
    beside : tuple of Neighbours
        Each with the ten that come next.
    """

    across: Array
    jumps: Array
    turns: Array
    clearance: Array
    hidden: NDArray[np.bool_]
    furniture: Array
    beside: tuple[Neighbours, ...]


def nearest_scenelets(clip: Clip, truth: Truth, path: StaticPath, library: Library) -> Nearest:
    """Find the scenelet nearest to the truth in regularly spaced windows."""
    joints = truth.joints - truth.joints[:, [PELV]]
    known: NDArray[np.bool_] = np.all(np.isfinite(joints), axis=(1, 2))
    static = truth.camera.to_world(path.joints)
    faces = np.exp(1j * facing(static))
    static = static - static[:, [PELV]]
    motions = [resample(s.joints, fps=s.fps, to_fps=clip.fps) for s in library]
    travels = [m[:, PELV] for m in motions]
    own_faces = [np.exp(1j * facing(m)) for m in motions]
    motions = [m - m[:, [PELV]] for m in motions]
    stays = {t for s in stretches(truth, clip.fps) for t in range(s.start, s.stop)}
    across, jumps, turns, placed, sights, beside = [], [], [], [], [], []
    for centre in range(0, clip.n_frames, round(_EVERY * clip.fps)):
        candidates = []
        for number, motion in enumerate(motions):
            first = centre - len(motion) // 2
            if first < 1 or first + len(motion) >= clip.n_frames:
                continue
            own = np.flatnonzero(known[first : first + len(motion)])
            if len(own) < _FEWEST_KNOWN * len(motion):
                continue
            yaw, gap = _turn(motion[own], joints[first + own])
            candidates.append((gap, number, first, yaw))
        if not candidates:
            continue
        candidates.sort()
        near = [
            (first, turned(motions[n], np.full(len(motions[n]), yaw)))
            for _, n, first, yaw in candidates[: _BEST + 1]
        ]
        beside.append(neighbours(truth, near))
        _, number, start, yaw = candidates[0]
        best = near[0][1]
        end = start + len(best)
        own = np.flatnonzero(known[start:end])
        apart = joints[start + own] - best[own]
        apart = (apart - apart.mean((0, 1))) @ truth.camera.rotation
        across.append(apart[..., [0, 2]].reshape(-1, 2))
        jumps += [best[0] - static[start - 1], best[-1] - static[end]]
        expected = (faces[start:end] * own_faces[number].conj()).mean()
        turns.append(np.angle(np.exp(1j * yaw) * expected.conj()))
        if centre in stays:
            for _, number, first, yaw in candidates[:_BEST]:
                own = np.flatnonzero(known[first : first + len(travels[number])])
                middle = truth.joints[first + own, PELV].mean(0)
                laid = _laid_upon(middle, yaw, travels[number][own])
                placed.append((library[number], laid))
                sights.append(sights_past(truth, library[number], laid, first + own))
    clearance, hidden = np.concatenate(sights, axis=1)
    return Nearest(
        np.concatenate(across),
        np.stack(jumps),
        np.array(turns),
        clearance,
        hidden.astype(bool),
        furniture_errors(truth, placed),
        tuple(beside),
    )


def _turn(motion: Array, joints: Array) -> tuple[float, float]:
    """Yaw that brings a motion (n, 16, 3) nearest to another, and the mean square gap left."""
    along = float((motion[..., :2] * joints[..., :2]).sum())
    aside = float((motion[..., 0] * joints[..., 1] - motion[..., 1] * joints[..., 0]).sum())
    level = float((motion[..., 2] * joints[..., 2]).sum())
    squares = float((motion**2).sum() + (joints**2).sum())
    return np.arctan2(aside, along), (squares - 2 * (np.hypot(along, aside) + level)) / len(motion)


def _laid_upon(middle: Array, yaw: float, travel: Array) -> Placement:
    """The placement that brings a travelling pelvis (n, 3), turned, to a mean place (3,)."""
    turned_only = Placement(0.0, 0.0, yaw).apply(travel.mean(0))
    x, y = (middle - turned_only)[:2].tolist()
    return Placement(x, y, yaw)


@dataclass(frozen=True)
class FitErrors:
    """The solver's independent fits held against the truth.

    Parameters
    ----------
    sizes : tuple of (k,) float
        Log of fitted over true depth in each stretch in which somebody stays put: what the
        size of the scenelet's person would have to make up for. The scene's median, which is
        the camera's and the body's business, is taken off.
    free_cost : (T,) float
        Nats a free frame pays for its pose.
    """

    sizes: tuple[Array, ...]
    free_cost: Array


def observe_fits(clip: Clip, truth: Truth, problem: Problem, fits: Fits) -> FitErrors:
    """Hold the best fits of every window against the truth; the free cost is the problem's."""
    frames = np.arange(clip.n_frames)
    known = np.isfinite(truth.joints).all((1, 2))
    depth = truth.camera.to_camera(truth.joints[known])[:, PELV, 1]
    true = np.interp(frames, frames[known], depth)[fits.centres]
    pitch, elevation, _, body = problem.camera_mean[:4]
    middles = problem.joint_first[:-1] + problem.lengths // 2
    height = np.exp(body) * problem.joints[middles, PELV, 2] - elevation
    fitted = np.cos(pitch) * fits.placements[..., 1] + np.sin(pitch) * height
    order = np.argsort(fits.cost, axis=1, kind="stable")[:, :_BEST]
    usable = np.isfinite(np.take_along_axis(fits.cost, order, 1)).all(1)
    ratio = np.log(np.take_along_axis(fitted, order, 1).clip(0.1) / true[:, None]).mean(1)
    ratio -= np.median(ratio[usable])
    sizes = []
    for stretch in stretches(truth, clip.fps):
        inside = usable & (fits.centres >= stretch.start) & (fits.centres < stretch.stop)
        if inside.any():
            sizes.append(ratio[inside])
    return FitErrors(tuple(sizes), problem.free_cost)
