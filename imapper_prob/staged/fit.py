"""Independent fits: every scenelet of the library to every regularly spaced window.

The paper's first stage (Monszpart et al. 2019, section 5): the placement of one scenelet
that best reprojects onto the detections of one window, nothing else considered. Here by
batched Gauss-Newton on bearing, log depth and yaw with Student-t weights, from four yaws; or,
with the published energy, with squared residuals times confidence, its L_r.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import Final

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from imapper_prob.models.camera import Camera
from imapper_prob.models.errors import InputError
from imapper_prob.models.path import StaticPath
from imapper_prob.models.pose import facing
from imapper_prob.models.problem import Problem

__all__ = ["FitSettings", "Fits", "fit_windows", "static_world"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

_BATCH: Final = 512
"""Scenelets at once: what is worked out of them stays in a processor's cache (4.8 s for the demo
clip where all 1,814 at once take 8)."""

_SYMMETRIC: Final = [[0, 1, 2], [1, 3, 4], [2, 4, 5]]
"""Where the upper triangle's entries stand in a symmetric matrix."""


_USUAL_ERROR: Final = 15 / 1955
"""Of a detection in normalised image coordinates: 15 px at i3DB's focal length."""


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
    settings = settings or FitSettings()
    try:
        torch.empty(1, device=settings.device)
    except (RuntimeError, AssertionError) as error:  # what torch raises where there is none
        reason = str(error).splitlines()[0]
        raise InputError(f"device {settings.device!r}: not here ({reason}); use cpu") from error
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        return _fit_windows(problem, path, fps, settings, progress)
    finally:
        torch.set_num_threads(threads)


def _fit_windows(
    problem: Problem,
    path: StaticPath,
    fps: float,
    settings: FitSettings,
    progress: Callable[[str, float], None] | None,
) -> Fits:
    n_frames = problem.n_frames
    centres = np.arange(0, n_frames, max(1, round(settings.stride * fps)))
    lengths = problem.lengths
    fitter = _SquaredFitter if problem.of_paper else _Fitter
    screening = fitter(problem, settings.screening_frame_step, settings.device)
    fitting = fitter(problem, settings.frame_step, settings.device)
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
        bearing, log_depth, turn = theta[0].T
        floor = np.stack([bearing, np.ones_like(bearing)], -1) * np.exp(log_depth)[:, None]
        placements[w, index] = np.concatenate([floor, turn[:, None]], -1)
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


def _level(problem: Problem) -> Array:
    """(T, 16, 2) the detections as the mean camera would see them without its roll, pixels."""
    roll, centre = problem.camera_mean[4], np.array([problem.cx, problem.cy])
    focal = np.array([problem.fx, problem.fy])
    c, s = np.cos(roll), np.sin(roll)
    turned = (problem.keypoints - centre) / focal @ np.array([[c, -s], [s, c]])
    result: Array = turned * focal + centre
    return result


class _Fitter:
    """The tensors that all windows share."""

    def __init__(self, problem: Problem, frame_step: int, device: str) -> None:
        self.device = torch.device(device)
        lengths = problem.lengths
        longest = int(lengths.max())
        # Frames are counted from the centre, so that all scenelets of a window line up.
        offsets = np.arange(-(longest // 2), longest - longest // 2)
        self.offsets = offsets[offsets % frame_step == 0]
        body = np.exp(problem.camera_mean[3])
        joints = np.zeros((len(lengths), len(self.offsets), 16, 3), np.float32)
        present = np.zeros((len(lengths), len(self.offsets)), bool)
        for index, n in enumerate(lengths):
            own = self.offsets + n // 2
            present[index] = (own >= 0) & (own < n)
            first = problem.joint_first[index]
            joints[index, present[index]] = body * problem.joints[first + own[present[index]]]
        self.joints = torch.from_numpy(joints).to(self.device)
        self.present = torch.from_numpy(present).to(self.device)
        self.problem = problem
        self.keypoints = _level(problem)
        self.focal = float(np.exp(problem.camera_mean[2]))

    def __call__(self, centre: int, index: Ints, start: Array, steps: int) -> tuple[Array, Array]:
        """Fit scenelets to the window around ``centre``.

        From ``start`` (S, len(index), 3) bearing, log depth and yaw; returns where that led
        and the cost (S, len(index)) a confident joint.
        """
        problem = self.problem
        frames = np.clip(centre + self.offsets, 0, problem.n_frames - 1)
        confident = problem.used[frames] * self._confidence(frames)
        weight = self._tensor(confident)[None] * self.present[index, :, None]
        target = self._tensor(self.keypoints[frames])
        scale = self._tensor(problem.error_scale[frames, :, 1])
        dof = self._tensor(problem.error_dof[frames, :, 1])
        theta = self._tensor(start)
        cost = theta.new_zeros(theta.shape[:2])
        for first in range(0, len(index), _BATCH):
            batch = slice(first, first + _BATCH)
            args = (self.joints[index[batch]], target, scale, dof, weight[batch])
            for _ in range(steps):
                theta[:, batch], cost[:, batch] = self._step(theta[:, batch], *args)
        joint_count = weight.sum((1, 2)).cpu().double().numpy()
        fitted = cost.cpu().double().numpy() / np.maximum(joint_count, 1.0)
        fitted[:, joint_count == 0] = np.inf
        return theta.cpu().double().numpy(), fitted

    def _tensor(self, values: Array) -> Tensor:
        """In single precision, where the fits are done."""
        return torch.from_numpy(values.astype(np.float32)).to(self.device)

    def _step(
        self,
        theta: Tensor,
        joints: Tensor,
        target: Tensor,
        scale: Tensor,
        dof: Tensor,
        weight: Tensor,
    ) -> tuple[Tensor, Tensor]:
        """One damped step for (starts, scenelets, 3); the cost is that before the step."""
        problem = self.problem
        pitch, elevation = problem.camera_mean[:2]
        cp, sp = float(np.cos(pitch)), float(np.sin(pitch))
        fx, fy = problem.fx * self.focal, problem.fy * self.focal
        bearing, log_depth, yaw = (theta[..., i, None, None] for i in range(3))
        distance = log_depth.exp()
        c, s = yaw.cos(), yaw.sin()
        lx, ly, lz = joints[..., 0], joints[..., 1], joints[..., 2] - float(elevation)
        turned_x, turned_y = c * lx - s * ly, s * lx + c * ly
        x, y = turned_x + bearing * distance, turned_y + distance
        depth = (cp * y + sp * lz).clamp(min=0.1)
        up = -sp * y + cp * lz
        du = problem.cx + fx * x / depth - target[..., 0]
        dv = problem.cy - fy * up / depth - target[..., 1]
        cost, irls = self._loss(du, dv, depth, scale, dof, weight)
        gradient, normal = [], []
        # Movement of (x, y) on the floor with bearing, log depth and yaw.
        moves = ((distance, 0.0), (bearing * distance, distance), (-turned_y, turned_x))
        jacobians = []
        for mx, my in moves:
            d_depth = cp * my
            ju = fx * (mx - x * d_depth / depth) / depth
            jv = fy * (sp * my + up * d_depth / depth) / depth
            jacobians.append((ju, jv))
            gradient.append((irls * (ju * du + jv * dv)).sum((-1, -2)))
        for (au, av), (bu, bv) in combinations_with_replacement(jacobians, 2):
            normal.append((irls * (au * bu + av * bv)).sum((-1, -2)))
        matrix = torch.stack(normal, -1)[..., _SYMMETRIC]
        # The prior keeps a window of few joints near the path: .1 rad, .2 log m, 1 rad.
        matrix = matrix + torch.diag(torch.tensor([100.0, 25.0, 1.0], device=self.device))
        step = torch.linalg.solve(matrix, torch.stack(gradient, -1))
        limit = torch.tensor([0.1, 0.3, 0.6], device=self.device)
        return theta - step.clamp(-limit, limit), cost.sum((-1, -2))

    def _confidence(self, frames: Ints) -> Array:
        """(F, 16) weight of the detections of some frames."""
        sure: Array = self.problem.confidence_density[frames].argmax(-1)
        return sure

    def _loss(
        self, du: Tensor, dv: Tensor, depth: Tensor, scale: Tensor, dof: Tensor, weight: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Cost of residuals in pixels at a depth in metres, and their weights."""
        fx = self.problem.fx * self.focal
        variance = scale**2 + (fx * self.problem.pose_tolerance / depth) ** 2
        squared = (du**2 + dv**2) / variance
        cost = ((dof / 2 + 1) * (squared / dof).log1p() + variance.log()) * weight
        return cost, weight * (dof + 2) / (dof + squared) / variance


class _SquaredFitter(_Fitter):
    """Of the published energy: L_r = sum c |Pi q - u|^2 over the frames compared."""

    def _confidence(self, frames: Ints) -> Array:
        return self.problem.confidences[frames]

    def _loss(
        self, du: Tensor, dv: Tensor, depth: Tensor, scale: Tensor, dof: Tensor, weight: Tensor
    ) -> tuple[Tensor, Tensor]:
        del depth, scale, dof
        unit = _USUAL_ERROR * self.problem.fx
        return weight * (du**2 + dv**2) / (2 * unit**2), weight / unit**2
