"""Fits: the best placement of every scenelet in every window, and its reprojection cost.

This is the paper's first stage (Monszpart et al. 2019, section 5): the placement of one scenelet
that best reprojects onto the detections of one window, without any other terms. It uses batched
Gauss-Newton on bearing, log depth and yaw with Student-t weights, started from four yaws. With the
published energy it uses squared residuals times confidence, its L_r.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.camera import Camera
from imapper_prob.models.errors import InputError
from imapper_prob.models.log_posterior import empty_state, frame_log_likelihood
from imapper_prob.models.path_prior import StaticPath
from imapper_prob.models.problem import Problem
from imapper_prob.models.settings import NEAREST
from imapper_prob.models.skeleton import PELV, THRX, facing
from imapper_prob.models.text import brief
from imapper_prob.models.view import to_floor
from imapper_prob.progress import Progress

if TYPE_CHECKING:
    from imapper_prob.solver.window_fits import WindowFitter

__all__ = ["Fits", "best_fits", "fit_windows", "free_pose_cost"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

_STRIDE: Final = 0.4
"""Seconds between the centres of neighbouring windows; chosen."""
_FRAME_STEP: Final = 2
_SCREENING_FRAME_STEP: Final = 4
"""Every how many frames of a scenelet are compared in the final fit and while screening; chosen:
neighbouring frames are redundant."""
_LEAST_DEPTH: Final = 0.3
"""Least distance in metres at which a search starts; chosen, nearer than anybody is filmed."""
_SCREENING_STEPS: Final = 3
_STEPS: Final = 6
"""Gauss-Newton steps from each yaw, and then from the best one; chosen."""


@dataclass(frozen=True)
class Fits:
    """The best placement of each scenelet in each window.

    Parameters
    ----------
    centres : (W,) int
        Middle frame of each window.
    placements : (W, L, 3) float
        x, y in metres, yaw in radians.
    cost : (W, L) float
        Negative log-likelihood per confident joint, nats; infinite if the scenelet does not fit
        into the clip or nothing was detected. With the published energy, L_r over the sum of
        confidences, in units of twice the squared error of a usual detection.
    """

    centres: Ints
    placements: Array
    cost: Array

    __repr__ = brief


def fit_windows(
    problem: Problem,
    path: StaticPath,
    *,
    fps: float,
    device: str = "cpu",
    squared: bool = False,
    progress: Progress | None = None,
) -> Fits:
    """Fit all scenelets to all windows at the mean of the camera prior.

    On a CPU it uses one thread: a window is too small for more, and the order of sums stays fixed.

    Parameters
    ----------
    problem : Problem
    path : StaticPath
    fps : float
        Frames per second.
    device : str
        The torch device: ``cpu``, ``cuda``, ``cuda:1``, ``mps``. Results on a CPU are reproducible;
        elsewhere the order of summation may vary.
    squared : bool
        Use the published L_r, squared residuals times confidence, instead of Student's t.
    progress : callable, optional
        Called with the name of a stage and its completed share.

    Returns
    -------
    Fits

    Raises
    ------
    InputError
        torch has no such device, or the library has no scenelet without objects and with an upright
        person.
    """
    if not squared:
        _bare(problem)  # free frames are compared with these
    # Importing torch takes seconds, and sampling or reading a run does not need it.
    from imapper_prob.solver.window_fits import (
        SquaredWindowFitter,
        WindowFitter,
        device_named,
        one_thread,
    )

    where = device_named(device)
    with one_thread():
        fitter = SquaredWindowFitter if squared else WindowFitter
        screening = fitter(problem, _SCREENING_FRAME_STEP, where)
        fitting = fitter(problem, _FRAME_STEP, where)
        return _fit_windows(problem, path, fps, screening, fitting, progress)


def _fit_windows(
    problem: Problem,
    path: StaticPath,
    fps: float,
    screening: WindowFitter,
    fitting: WindowFitter,
    progress: Progress | None,
) -> Fits:
    n_frames = problem.n_frames
    centres = np.arange(0, n_frames, max(1, round(_STRIDE * fps)))
    lengths = problem.lengths
    world = _static_world(problem, path)
    placements = np.zeros((len(centres), len(lengths), 3))
    cost = np.full((len(centres), len(lengths)), np.inf)
    for w, centre in enumerate(centres.tolist()):
        starts = centre - lengths // 2
        inside = (starts >= 0) & (starts + lengths <= n_frames)
        pelvis = world[centre, 6]
        yaw = float(np.median(np.unwrap(facing(world[max(0, centre - 2) : centre + 3]))))
        index = np.flatnonzero(inside)
        if (
            not inside.any()
            or not problem.used[starts[inside].min() : (starts + lengths)[inside].max()].any()
        ):
            if fitting.unseen_on_path:
                placements[w, index] = *pelvis[:2], yaw
            continue
        # The pelvis is at the local origin in the centre frame, so the search starts below the
        # path's.
        depth = max(pelvis[1], _LEAST_DEPTH)
        theta = np.tile([pelvis[0] / depth, np.log(depth), yaw], (4, len(index), 1))
        theta[..., 2] += np.arange(4)[:, None] * (np.pi / 2)
        theta, rough = screening(centre, index, theta, _SCREENING_STEPS)
        best = rough.argmin(0)
        theta = theta[best, np.arange(len(index))]
        theta, fitted = fitting(centre, index, theta[None], _STEPS)
        placements[w, index], _ = to_floor(np.pad(theta[0], ((0, 0), (0, 1))))
        cost[w, index] = fitted[0]
        if progress is not None:
            progress("fitting scenelets", (w + 1) / len(centres))
    return Fits(centres, placements, cost)


def _static_world(problem: Problem, path: StaticPath) -> Array:
    """(T, 16, 3) joints of the static path in the world of the mean camera."""
    pitch, elevation, focal, body, roll = problem.camera_mean
    depth = np.exp(path.estimate[:, 1] + focal + body)
    pelvis = np.stack([path.estimate[:, 0], np.ones_like(depth), path.lift], -1)
    pelvis[:, ::2] /= np.exp(focal)
    joints = depth[:, None, None] * pelvis[:, None] + np.exp(body) * path.poses
    camera = Camera(1, 1, 1.0, 1.0, 0.0, 0.0, pitch=pitch, roll=roll, elevation=elevation)
    return camera.to_world(joints)


# ------------------------------------------------------------------------------------------------
# The cost of a free frame's pose.
#
# The pose of a free frame comes from a lifter that has used the same frame, so its small residual
# is no evidence against a scenelet. So a free frame is evaluated as if the best motion without
# furniture (somebody who walks or stands about) had to explain it; an interaction must beat that.

_STANDING = 0.75
"""Least height in metres of the mid-hip of a standing person: .85 with straight legs, less with
legs bent as in walking."""
_LEANING = np.radians(30.0)
"""Largest angle of the trunk to the vertical, radians, of a person who does not bend down."""
_TRIED = 3
"""Fits per window that are evaluated exactly; the cost of the fit ranks them well."""


def _bare(problem: Problem) -> NDArray[np.int64]:
    """Scenelets without objects in which somebody stands or walks upright."""
    bare = np.flatnonzero((np.diff(problem.box_first) == 0) & _upright(problem))
    if len(bare) == 0:
        raise InputError(
            "the library has no scenelet without objects in which somebody stands or walks, to "
            "compare free frames with; add some, as in --library built-in,YOURS.npz"
        )
    return bare


def _upright(problem: Problem) -> NDArray[np.bool_]:
    """(L,) scenelets whose person stands or walks upright in most frames.

    Kneeling, squatting, bending down or sitting on the floor is explained by scenelets, which have
    prior odds; a frame outside all scenelets assumes none of these.
    """
    trunk = problem.joints[:, THRX] - problem.joints[:, PELV]
    upright = trunk[:, 2] > np.cos(_LEANING) * np.linalg.norm(trunk, axis=-1)
    upright &= problem.joints[:, PELV, 2] > _STANDING
    counts = np.add.reduceat(upright, problem.joint_first[:-1])
    result: NDArray[np.bool_] = counts > problem.lengths / 2
    return result


def free_pose_cost(problem: Problem, fits: Fits) -> NDArray[np.float64]:
    """(T,) nats by which each frame's own pose fits better than the best upright motion nearby.

    In each window, the best-fitting scenelet with an upright person and without objects represents
    the frames nearest to the window's centre. At the ends of a clip, where it does not reach, those
    that reach the frame are compared. Never negative; 0 in frames that no such scenelet reaches.

    Parameters
    ----------
    problem : Problem
    fits : Fits

    Returns
    -------
    (T,) float
        Nats.

    Raises
    ------
    InputError
        The library has no scenelet with an upright person and without objects.
    """
    bare = _bare(problem)
    own = frame_log_likelihood(problem, empty_state(problem))
    cost, frames = np.zeros(problem.n_frames), np.arange(problem.n_frames)
    away = np.full(problem.n_frames, np.inf)
    fitted = np.flatnonzero(np.isfinite(fits.cost[:, bare]).any(1))
    starts = fits.centres[:, None] - problem.lengths[bare] // 2
    stops = starts + problem.lengths[bare]
    for w in fitted.tolist():
        best, reached = _best_fitting(problem, fits, w, bare[np.isfinite(fits.cost[w, bare])])
        distance = np.abs(frames - fits.centres[w])
        mine = reached & (distance < away)
        cost[mine] = np.maximum(own[mine] - best[mine], 0.0)
        away[mine] = distance[mine]
    for t in np.flatnonzero(np.isinf(away)).tolist():
        reaching = np.isfinite(fits.cost[:, bare]) & (starts <= t) & (t < stops)
        windows = np.flatnonzero(reaching.any(1))
        if len(windows):
            w = int(windows[np.abs(fits.centres[windows] - t).argmin()])
            best, _ = _best_fitting(problem, fits, w, bare[reaching[w]])
            cost[t] = max(own[t] - best[t], 0.0)
    return cost


def _best_fitting(
    problem: Problem, fits: Fits, window: int, scenelets: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """(T,) log-likelihood of frames under the best of some scenelets in a window, and its frames.

    The scenelets with the least cost of the fit are evaluated exactly.
    """
    empty, frames = empty_state(problem), np.arange(problem.n_frames)
    order = np.argsort(fits.cost[window, scenelets], kind="stable")[:_TRIED]
    best, reached, best_total = np.zeros(0), np.zeros(0, bool), -np.inf
    for scenelet in scenelets[order].tolist():
        start = int(fits.centres[window] - problem.lengths[scenelet] // 2)
        state = empty.with_item(scenelet, start, fits.placements[window, scenelet])
        values = frame_log_likelihood(problem, state)
        inside = (frames >= start) & (frames < start + problem.lengths[scenelet])
        total = values[inside].sum()
        if total > best_total:
            best, reached, best_total = values, inside, total
    return best, reached


# ------------------------------------------------------------------------------------------------
# The fit of the best scenelet over each frame.
#
# The cost of a fit depends on the pixel scale and on which joints are confident. After subtraction
# of the expected cost of the right motion, with the same joints at the same distance, it is a pure
# number: about 0 if some scenelet is right.


def best_fits(problem: Problem, fits: Fits) -> Array:
    """Excess cost of the best scenelet over each frame, compared with the right motion.

    Parameters
    ----------
    problem : Problem
        Problem of one actor.
    fits : Fits
        Fits of the same actor.

    Returns
    -------
    (T,) float
        Nats per confident joint, on average over the scenelet's frames. NaN in frames without a
        detection, and where no scenelet was fitted.
    """
    expected, joints = _right_costs(problem)
    best = np.full(problem.n_frames, np.inf)
    lengths = np.unique(problem.lengths)
    own = [problem.lengths == length for length in lengths]
    for centre, cost in zip(fits.centres.tolist(), fits.cost, strict=True):
        for length, these in zip(lengths.tolist(), own, strict=True):
            start = centre - length // 2
            least = cost[these].min()
            if not np.isfinite(least):
                continue
            frames = slice(start, start + length)
            excess = least - expected[frames].sum() / max(joints[frames].sum(), 1.0)
            best[frames] = np.minimum(best[frames], excess)
    judged = problem.used.any(1) & np.isfinite(best)
    return np.where(judged, best, np.nan)


def _right_costs(problem: Problem) -> tuple[Array, Array]:
    """(T,) expected cost of the right motion in each frame, and (T,) number of joints it is of.

    For a bivariate Student-t error of scale s and nu degrees of freedom, the mean of (nu / 2 + 1)
    log(1 + r^2 / (nu s^2)) is 1 + 2 / nu.
    """
    weight = problem.used * problem.confidence_density.argmax(-1)
    focal = problem.fx * np.exp(problem.camera_mean[2])
    depth = np.exp(problem.path_centre[:, 1] + problem.camera_mean[2] + problem.camera_mean[3])
    loose = focal * problem.pose_tolerance / np.maximum(depth, NEAREST)[:, None]
    variance = problem.error_scale[..., 1] ** 2 + loose**2
    cost = np.log(variance) + 1.0 + 2.0 / problem.error_dof[..., 1]
    return (weight * cost).sum(1), weight.sum(1).astype(np.float64)
