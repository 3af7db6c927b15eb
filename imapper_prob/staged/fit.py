"""Independent fits: every scenelet of the library to every regularly spaced window.

The paper's first stage (Monszpart et al. 2019, section 5): the placement of one scenelet
that best reprojects onto the detections of one window, nothing else considered. Here by
batched Gauss-Newton on bearing, log depth and yaw with Student-t weights, from four yaws; or,
with the published energy, with squared residuals times confidence, its L_r.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.brief import brief
from imapper_prob.models.camera import Camera
from imapper_prob.models.path import StaticPath
from imapper_prob.models.pose import facing
from imapper_prob.models.problem import Problem
from imapper_prob.models.view import to_floor

if TYPE_CHECKING:
    from imapper_prob.staged.window_fitter import WindowFitter

__all__ = ["FitSettings", "Fits", "fit_windows", "static_world"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class FitSettings:
    """Parameters
    ----------
    stride : float
        Seconds between the starts of neighbouring windows.
    frame_step, screening_frame_step : int
        Every how manyeth frame of a scenelet is compared in the end, and while screening;
        neighbours say the same.
    screening_steps, steps : int
        Gauss-Newton steps from every yaw, and then from the best one.
    device : str
        Of torch: ``cpu``, ``cuda``, ``cuda:1``, ``mps``. Results on a CPU are the same in every
        run; elsewhere sums may be taken in another order.
    """

    stride: float = 0.4
    frame_step: int = 2
    screening_frame_step: int = 4
    screening_steps: int = 3
    steps: int = 6
    device: str = "cpu"


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
        Negative log-likelihood per confident joint, nats; infinite where the scenelet does
        not fit into the clip or nothing was detected. With the published energy L_r over the
        sum of confidences, in units of twice the square of a detection's usual error.
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
    settings: FitSettings | None = None,
    progress: Callable[[str, float], None] | None = None,
) -> Fits:
    """Fit all scenelets to all windows at the mean of the camera prior.

    On a CPU it runs on one thread: a window is too small for more, and sums keep their order.

    Raises
    ------
    InputError
        If torch has no such device.
    """
    # Torch takes seconds to load, and who reads a run or samples has no use for it.
    from imapper_prob.staged.window_fitter import (
        SquaredWindowFitter,
        WindowFitter,
        device_named,
        one_thread,
    )

    settings = settings or FitSettings()
    device = device_named(settings.device)
    with one_thread():
        fitter = SquaredWindowFitter if problem.of_paper else WindowFitter
        screening = fitter(problem, settings.screening_frame_step, device)
        fitting = fitter(problem, settings.frame_step, device)
        return _fit_windows(problem, path, fps, settings, screening, fitting, progress)


def _fit_windows(
    problem: Problem,
    path: StaticPath,
    fps: float,
    settings: FitSettings,
    screening: WindowFitter,
    fitting: WindowFitter,
    progress: Callable[[str, float], None] | None,
) -> Fits:
    n_frames = problem.n_frames
    centres = np.arange(0, n_frames, max(1, round(settings.stride * fps)))
    lengths = problem.lengths
    world = static_world(problem, path)
    placements = np.zeros((len(centres), len(lengths), 3))
    cost = np.full((len(centres), len(lengths)), np.inf)
    for w, centre in enumerate(centres.tolist()):
        starts = centre - lengths // 2
        inside = (starts >= 0) & (starts + lengths <= n_frames)
        pelvis = world[centre, 6]
        yaw = float(np.median(np.unwrap(facing(world[max(0, centre - 2) : centre + 3]))))
        index = np.flatnonzero(inside)
        if not inside.any() or not problem.used[starts[inside].min() : centre + 1].any():
            if problem.of_paper:
                # Nothing but the path says where it is; its smoothness is judged later.
                placements[w, index] = *pelvis[:2], yaw
            continue
        # Local pelvis at the centre is at the origin: the placement starts below the path's.
        depth = max(pelvis[1], 0.3)
        theta = np.tile([pelvis[0] / depth, np.log(depth), yaw], (4, len(index), 1))
        theta[..., 2] += np.arange(4)[:, None] * (np.pi / 2)
        theta, rough = screening(centre, index, theta, settings.screening_steps)
        best = rough.argmin(0)
        theta = theta[best, np.arange(len(index))]
        theta, fitted = fitting(centre, index, theta[None], settings.steps)
        placements[w, index], _ = to_floor(np.pad(theta[0], ((0, 0), (0, 1))))
        cost[w, index] = fitted[0]
        if progress is not None:
            progress("fitting scenelets", (w + 1) / len(centres))
    return Fits(centres, placements, cost)


def static_world(problem: Problem, path: StaticPath) -> Array:
    """(T, 16, 3) joints of the static path in the world of the mean camera."""
    pitch, elevation, focal, body, roll = problem.camera_mean
    depth = np.exp(path.estimate[:, 1] + focal + body)
    pelvis = np.stack([path.estimate[:, 0], np.ones_like(depth), path.lift], -1)
    pelvis[:, ::2] /= np.exp(focal)
    joints = depth[:, None, None] * pelvis[:, None] + np.exp(body) * path.poses
    camera = Camera(1, 1, 1.0, 1.0, 0.0, 0.0, pitch=pitch, roll=roll, elevation=elevation)
    return camera.to_world(joints)
