"""The published method (Monszpart et al. 2019, section 6): path, candidates, combinations.

In every frame the lifted skeleton a_t is placed at P_t = (x, y, z, theta) so that

    w_r sum_t sum_k c_tk |Pi T(P_t) a_tk - u_tk|^2 + w_s sum_t |p_t - p_(t-1)|^2

is minimal, where p is the pelvis. Frames without a reliable skeleton are occluded: those whose pose
is missing or impossible, and those whose joints move faster than in 95 % of the frames, as clipped
by a Winsorisation. They are not used in the fit, and their joints are interpolated linearly.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from imapper_prob.layouts import furniture_kinds
from imapper_prob.models.camera import Camera
from imapper_prob.models.log_posterior import State, empty_state
from imapper_prob.models.problem import Problem
from imapper_prob.models.published_terms import paper_energy
from imapper_prob.models.settings import NEAREST, PaperWeights
from imapper_prob.models.skeleton import DETECTED
from imapper_prob.models.view import to_floor, to_view
from imapper_prob.progress import Progress
from imapper_prob.solver.candidates import (
    Candidate,
    CharnessCurve,
    Fate,
    MaximumTable,
    Shortlisted,
    assigned,
)
from imapper_prob.solver.combinations import Combination, Combinations
from imapper_prob.solver.fits import Fits
from imapper_prob.solver.path_fit import Motion, Observations, pixel_residuals, solve_chain
from imapper_prob.solver.poses import ANCESTORS, LiftedBody

__all__ = [
    "NEARBY",
    "PublishedSettings",
    "combine_published",
    "fast_frames",
    "filter_published",
    "interpolated",
    "place_skeletons",
]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
_WINSORISED: Final = 0.05
"""Share of velocities that a Winsorisation clips (Monszpart et al. 2019, section 6)."""
_STEPS: Final = 40
"""Largest number of Gauss-Newton steps of the static path; chosen."""
_LEAST_GAIN: Final = 1e-9
"""Least gain in energy of a step after which the fit continues."""
_STEADY: Final = 1e-9
"""Added to the diagonal, so that frames without data stay where they are."""


def fast_frames(keypoints: Array, confidences: Array) -> Flags:
    """(T,) frames into which joints move at velocities that a 5 % Winsorisation clips.

    The velocity of a frame is the mean over the joints that it shares with the one before.

    Parameters
    ----------
    keypoints : (T, K, 2) float
        Pixels.
    confidences : (T, K) float
        0 without a detection.

    Returns
    -------
    (T,) bool
    """
    there = confidences > 0
    both = there[1:] & there[:-1]
    step = np.linalg.norm(np.diff(keypoints, axis=0), axis=-1)
    moved = both.any(1)
    speed = np.where(both, step, 0.0).sum(1)[moved] / both.sum(1)[moved]
    fast = np.zeros(len(keypoints), bool)
    if len(speed):
        limit = np.quantile(speed, 1 - _WINSORISED)
        fast[1 + np.flatnonzero(moved)[speed > limit]] = True
    return fast


def interpolated(values: Array, known: Flags) -> Array:
    """Interpolate unknown rows of ``values`` (T, ...) linearly from the known ones.

    Constant before the first and after the last known row; unchanged if no row is known.

    Parameters
    ----------
    values : (T, ...) float
    known : (T,) bool

    Returns
    -------
    (T, ...) float
    """
    frames = np.flatnonzero(known)
    if not len(frames):
        return np.array(values)
    flat = values.reshape(len(values), -1)
    t = np.arange(len(values))
    columns = [np.interp(t, frames, column) for column in flat[frames].T]
    return np.stack(columns, -1).reshape(values.shape)


def place_skeletons(observations: Observations, start: Array) -> Motion:
    """Minimise the energy, from ``start`` (T, 3): bearing, lift and log depth.

    Frames whose pose is not their own (see ``observations.body.known``) are interpolated.

    Parameters
    ----------
    observations : Observations
    start : (T, 3) float
        Bearing and lift (tangents), log depth (log m).

    Returns
    -------
    Motion
    """
    body, camera = observations.body, observations.camera
    known = body.known if body.known.any() else np.ones(len(start), bool)
    confidences = np.where(known[:, None], observations.confidences, 0.0)
    told = Observations(camera, observations.pixels, confidences, body, observations.fps)
    weights = PaperWeights()
    walk = weights.smoothness * np.array([1.0, 1.0, 1.0, 0.0])
    pelvis = Motion(start, body.bones).pelvis
    places = np.concatenate([interpolated(pelvis, known), np.zeros((len(start), 1))], 1)
    cost = _path_energy(told, places, walk)
    for _ in range(_STEPS):
        information, pull = _normal_equations(told, places)
        steps = np.diff(places, axis=0) * walk
        pull[:-1] += steps
        pull[1:] -= steps
        diagonal = np.arange(4)
        information[:, diagonal, diagonal] += _STEADY
        step = solve_chain(information, pull, walk)
        for halving in range(10):
            moved = places + 0.5**halving * step
            value = _path_energy(told, moved, walk)
            if value <= cost:
                break
        gain = cost - value
        if gain < 0:
            break
        places, cost = moved, value
        if gain < _LEAST_GAIN:
            break
    motion = _motion(body, camera, places)
    pelvis = interpolated(motion.pelvis, known)
    depth = np.maximum(pelvis[:, 1], NEAREST)
    place = np.stack([pelvis[:, 0] / depth, pelvis[:, 2] / depth, np.log(depth)], -1)
    return Motion(place, interpolated(motion.bones, known))


def _motion(body: LiftedBody, camera: Camera, places: Array) -> Motion:
    """Skeletons rotated by theta about the vertical, with the pelvis at (x, y, z) in camera
    axes."""
    x, y, z = places[:, :3].T
    y = np.maximum(y, NEAREST)
    place = np.stack([x / y, z / y, np.log(y)], -1)
    return Motion(place, _turned(body, camera, places[:, 3]))


def _turned(body: LiftedBody, camera: Camera, theta: Array) -> Array:
    c, s, zero, one = np.cos(theta), np.sin(theta), np.zeros_like(theta), np.ones_like(theta)
    turn = np.stack([c, -s, zero, s, c, zero, zero, zero, one], -1).reshape(-1, 3, 3)
    to_world = camera.rotation
    whole = to_world.T @ turn @ to_world
    bones: Array = body.bones @ whole.transpose(0, 2, 1)
    return bones


def _path_energy(told: Observations, places: Array, walk: Array) -> float:
    residuals = pixel_residuals(told, _motion(told.body, told.camera, places))
    residuals = residuals / (told.camera.fx, told.camera.fy)
    data = float((told.confidences * (residuals**2).sum(-1)).sum())
    return data + float((np.diff(places, axis=0) ** 2 * walk).sum())


def _normal_equations(told: Observations, places: Array) -> tuple[Array, Array]:
    """Gauss-Newton Hessian (T, 4, 4) and negative gradient (T, 4) of L_r, both times 1/2."""
    camera, motion = told.camera, _motion(told.body, told.camera, places)
    residuals = pixel_residuals(told, motion) / (camera.fx, camera.fy)
    branches = ANCESTORS[list(DETECTED)]
    offsets = branches @ motion.bones
    joints = motion.pelvis[:, None] + offsets
    depth = np.maximum(joints[..., 1], NEAREST)
    jacobian = np.zeros((*joints.shape[:2], 2, 3))
    jacobian[..., 0, 0] = 1 / depth
    jacobian[..., 0, 1] = -joints[..., 0] / depth**2
    jacobian[..., 1, 1] = joints[..., 2] / depth**2
    jacobian[..., 1, 2] = -1 / depth
    up = camera.rotation.T @ np.array([0.0, 0.0, 1.0])
    by_angle = np.cross(up, offsets)
    whole = np.concatenate([jacobian, (jacobian @ by_angle[..., None])], -1)
    weighted = whole * told.confidences[..., None, None]
    information = np.einsum("tkai,tkaj->tij", weighted, whole)
    pull = np.einsum("tkai,tka->ti", weighted, residuals)
    return information, pull


# ------------------------------------------------------------------------------------------------
# Candidates and combinations.
#
# At every window of T' (maxima of charness, and frames without a static skeleton) each fitted
# scenelet alone is put into the scene of static skeletons. Then
#
# 1. the 200 with the least w_r L_r + w_s L_s are kept,
# 2. their placement is optimised with w_m L_m added,
# 3. they are evaluated once with w_o L_o as well, and the best 3 are kept.
#
# All combinations of one of the three at every window, at most 3^5, are optimised under the whole
# energy and sorted by it. Priors are not used, and all scenelets have the size of the body.

_UNITS: Final = np.array([0.02, 0.05, 0.15])
"""Initial steps of a search in bearing, log depth and yaw (rad)."""
_STEP: Final = 0.01
"""Step of finite differences, in these units."""
NEARBY: Final = 1.6
"""Seconds between starts within which scenelets are nearby, about the length of a scenelet."""


@dataclass(frozen=True)
class PublishedSettings:
    """Parameters of the published method.

    Parameters
    ----------
    fitted : int
        Scenelets kept per window by L_r and L_s alone.
    kept : int
        Scenelets of these that are kept after L_m and L_o.
    scenes : int
        Scenes listed, the best first.
    evaluations : int
        Evaluations of the energy to place one scenelet.
    iterations : int
        L-BFGS iterations to place all scenelets of a combination; as in the released command files.
    """

    fitted: int = 200
    kept: int = 3
    scenes: int = 5
    evaluations: int = 60
    iterations: int = 15


def filter_published(
    problem: Problem,
    fits: Fits,
    curve: CharnessCurve,
    *,
    settings: PublishedSettings | None = None,
    progress: Progress | None = None,
) -> tuple[MaximumTable, ...]:
    """Select the three best scenelets of every window of T', and tell why others were rejected.

    In order of time. For each row, in nats at ``Problem.paper_nats``: ``fit`` is the gain in L_r
    and L_s before the placement is optimised, ``motion`` the change by L_m and this optimisation,
    and ``occlusion`` the change by L_o. Rows of fate ``FIT`` would not have been kept by L_r and
    L_s alone either.

    Parameters
    ----------
    problem : Problem
    fits : Fits
    curve : CharnessCurve
    settings : PublishedSettings, optional
    progress : callable, optional
        Called with the name of a stage and its completed share.

    Returns
    -------
    tuple of MaximumTable
    """
    settings = settings or PublishedSettings()
    tables = []
    windows = sorted(curve.maxima.tolist())
    for n, window in enumerate(windows):
        tables.append(_filtered(problem, fits, window, settings))
        if progress is not None:
            progress("filtering candidates", (n + 1) / len(windows))
    return tuple(tables)


def _filtered(
    problem: Problem, fits: Fits, window: int, settings: PublishedSettings
) -> MaximumTable:
    reprojected, walked, seen = (_weighted(problem, n) for n in (("L_r", "L_s"), _WALKED, _SEEN))
    empty, kinds = empty_state(problem), furniture_kinds(problem)
    bare = [_scene_energy(p, empty) for p in (reprojected, walked, seen)]
    found = []
    for scenelet in np.flatnonzero(fits.placements[window, :, 1] > 0).tolist():
        start = int(fits.centres[window]) - int(problem.lengths[scenelet]) // 2
        state = empty.with_item(scenelet, start, fits.placements[window, scenelet])
        value = _scene_energy(reprojected, state)
        if np.isfinite(value):
            found.append((value, scenelet, state))
    found.sort(key=lambda entry: entry[:2])
    rows = []
    for value, scenelet, state in found[: settings.fitted]:
        placed = _placed_one(walked, state, settings.evaluations)
        fit = bare[0] - value
        motion = bare[1] - _scene_energy(walked, placed) - fit
        occlusion = bare[2] - _scene_energy(seen, placed) - fit - motion
        gain = fit + motion + occlusion
        candidate = Candidate(
            scenelet, int(placed.items[0, 1]), placed.placements[0], 0.0, gain, kinds[scenelet],
            window,
        )  # fmt: skip
        rows.append(Shortlisted(candidate, fit, motion, occlusion, Fate.KEPT))
    rows.sort(key=lambda row: -row.candidate.gain)
    enough = rows[: settings.kept][-1].candidate.gain if rows else 0.0
    judged = tuple(
        Shortlisted(
            row.candidate, row.fit, row.motion, row.occlusion,
            Fate.KEPT if k < settings.kept else _fate(row, enough, rows, settings.kept),
        )
        for k, row in enumerate(rows)
    )  # fmt: skip
    return MaximumTable(window, len(found), judged)


_WALKED: Final = ("L_r", "L_s", "L_m")
_SEEN: Final = ("L_r", "L_s", "L_m", "L_o")
_ORDER: Final = ("L_r", "L_o", "L_s", "L_c", "L_m")
"""The terms in the order of ``Problem.paper_nats``."""


def _weighted(problem: Problem, names: Sequence[str]) -> Problem:
    """The problem with only some of the terms."""
    return problem._replace(paper_nats=problem.paper_nats * np.isin(_ORDER, names))


def _scene_energy(problem: Problem, state: State) -> float:
    """Weighted energy of a scene in nats; infinite outside the support."""
    return paper_energy(problem, state, weights=PaperWeights(*problem.paper_nats.tolist())).total


def _fate(row: Shortlisted, enough: float, rows: Sequence[Shortlisted], kept: int) -> Fate:
    """The step that removed a scenelet from the best few."""
    if sum(r.fit > row.fit for r in rows) >= kept and row.motion >= 0 and row.occlusion >= 0:
        return Fate.FIT
    missing = enough - row.candidate.gain
    if -row.motion >= missing:
        return Fate.MOTION
    return Fate.OCCLUSION if -row.occlusion >= missing else Fate.FIT


def _placed_one(problem: Problem, state: State, evaluations: int) -> State:
    """Optimise the placement of a single scenelet under the energy, by Nelder-Mead."""
    home = to_view(state.placements[0], 0.0)[:3]

    def moved(theta: Array) -> State:
        return state.with_placement(0, to_floor(np.append(theta, 0.0))[0])

    simplex = home + np.vstack([np.zeros(3), np.diag(_UNITS)])
    found = minimize(
        lambda theta: _scene_energy(problem, moved(theta)),
        home,
        method="Nelder-Mead",
        options={"maxfev": evaluations, "initial_simplex": simplex},
    )
    return moved(found.x)


def combine_published(
    problem: Problem,
    tables: Sequence[MaximumTable],
    *,
    fps: float,
    settings: PublishedSettings | None = None,
    progress: Progress | None = None,
) -> Combinations:
    """Optimise all combinations of the kept scenelets under the whole energy.

    If members overlap in time, the one with the better candidate stays, because a frame has at most
    one scenelet.

    Parameters
    ----------
    problem : Problem
    tables : sequence of MaximumTable
    fps : float
        Frames per second.
    settings : PublishedSettings, optional
    progress : callable, optional
        Called with the name of a stage and its completed share.

    Returns
    -------
    Combinations
    """
    settings = settings or PublishedSettings()
    groups = [[row.candidate for row in table.rows if row.fate is Fate.KEPT] for table in tables]
    groups = [group for group in groups if group]
    pool = tuple(c for group in groups for c in group)
    first = np.concatenate([[0], np.cumsum([len(group) for group in groups])]).astype(int)
    chosen = {
        _apart(problem, pool, [int(first[g]) + k for g, k in enumerate(ranks)])
        for ranks in product(*(range(len(group)) for group in groups))
    }
    nothing = _scene_energy(problem, empty_state(problem))
    tried, states = [], {}
    for n, members in enumerate(sorted(chosen)):
        state = assigned(empty_state(problem), [pool[k] for k in members])
        before = nothing - _scene_energy(problem, state)
        states[members] = _placed_all(problem, state, settings.iterations)
        tried.append(
            Combination(members, before, nothing - _scene_energy(problem, states[members]))
        )
        if progress is not None:
            progress("combining", (n + 1) / len(chosen))
    tried.sort(key=lambda c: (-c.gain, c.members))
    ranked = [states[c.members] for c in tried]
    best = _diverse(ranked, NEARBY * fps, settings.scenes)
    return Combinations(pool, tuple(tried), -np.inf, (), tuple(best))


def _apart(problem: Problem, pool: Sequence[Candidate], members: list[int]) -> tuple[int, ...]:
    """Members without those that overlap a better one, in order of time."""
    taken: list[int] = []
    for k in sorted(members, key=lambda k: -pool[k].gain):
        begin, end = pool[k].start, pool[k].start + problem.lengths[pool[k].scenelet]
        if all(
            end <= pool[other].start
            or begin >= pool[other].start + problem.lengths[pool[other].scenelet]
            for other in taken
        ):
            taken.append(k)
    return tuple(sorted(taken, key=lambda k: pool[k].start))


def _placed_all(problem: Problem, state: State, iterations: int) -> State:
    """Optimise all placements under the whole energy, by L-BFGS."""
    if not state.n_scenelets:
        return state
    home = to_view(state.placements, state.sizes)

    def scene(theta: Array) -> State:
        where = home.copy()
        where[:, :3] += theta.reshape(-1, 3) * _UNITS
        placements, _ = to_floor(where)
        return State(state.camera, state.items, placements, state.sizes, state.latent)

    def cost(theta: Array) -> float:
        return _scene_energy(problem, scene(theta))

    def slope(theta: Array) -> Array:
        here = cost(theta)
        slopes: Array = np.array([cost(theta + d) - here for d in _STEP * np.eye(len(theta))])
        return slopes / _STEP

    start = np.zeros(3 * len(home))
    found = minimize(cost, start, jac=slope, method="L-BFGS-B", options={"maxiter": iterations})
    return scene(found.x) if found.fun < cost(start) else state


def _diverse(ranked: Sequence[State], frames: float, count: int) -> list[State]:
    """The best scene, then the best ones that share no scenelet at nearby times with those before.

    If there are no more such scenes, those that share fewest.
    """
    chosen: list[State] = list(ranked[:1])
    left = list(ranked[1:])
    while left and len(chosen) < count:
        shared = [sum(_shared(state, other, frames) for other in chosen) for state in left]
        chosen.append(left.pop(int(np.argmin(shared))))
    return chosen


def _shared(one: State, other: State, frames: float) -> int:
    """Number of scenelets of one scene that the other has at a nearby time."""
    same = one.items[:, None, 0] == other.items[None, :, 0]
    near = np.abs(one.items[:, None, 1] - other.items[None, :, 1]) < frames
    return int((same & near).any(1).sum())
