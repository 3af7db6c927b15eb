"""Fit all scenelets to one window at once, by torch.

Batched Gauss-Newton with Student-t weights, or with the squared residuals of the published energy,
for :mod:`imapper_prob.solver.fits`.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import combinations_with_replacement
from typing import ClassVar, Final

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from imapper_prob.models.errors import InputError
from imapper_prob.models.problem import Problem
from imapper_prob.models.settings import NEAREST

__all__ = ["SquaredWindowFitter", "WindowFitter", "device_named", "one_thread"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

_BATCH: Final = 512
"""Scenelets per batch on a CPU, so that intermediate results stay in its cache. Other devices
process all at once."""

_SYMMETRIC: Final = [[0, 1, 2], [1, 3, 4], [2, 4, 5]]
"""Indices of the upper triangle's entries in a symmetric matrix."""

_DAMPING: Final = [100.0, 25.0, 1.0]
"""Precisions that keep steps of windows with few joints small: .1 of bearing (tangent), .2 log m,
1 rad; chosen."""
_LONGEST_STEP: Final = [0.1, 0.3, 0.6]
"""Longest step in bearing (tangent), log depth and yaw (rad); chosen."""
_USUAL_ERROR: Final = 15 / 1955
"""Usual error of a detection in normalised image coordinates: 15 px at i3DB's focal length."""


@contextmanager
def one_thread() -> Iterator[None]:
    """Restrict torch to one thread inside the block.

    Yields
    ------
    None
    """
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


def device_named(name: str) -> torch.device:
    """Get a torch device by name.

    Parameters
    ----------
    name : str
        Such as ``"cpu"`` or ``"cuda:1"``.

    Returns
    -------
    torch.device

    Raises
    ------
    InputError
        torch has no such device.
    """
    try:
        return torch.empty(1, device=name).device
    except (RuntimeError, AssertionError) as error:  # torch raises either for a missing device
        reason = str(error).splitlines()[0]
        raise InputError(f"device {name!r}: not here ({reason}); use cpu") from error


def _level(problem: Problem) -> Array:
    """(T, 16, 2) the detections rotated so that the mean camera has no roll, pixels."""
    roll, centre = problem.camera_mean[4], np.array([problem.cx, problem.cy])
    focal = np.array([problem.fx, problem.fy])
    c, s = np.cos(roll), np.sin(roll)
    turned = (problem.keypoints - centre) / focal @ np.array([[c, -s], [s, c]])
    result: Array = turned * focal + centre
    return result


class WindowFitter:
    """Fits scenelets to windows; holds the tensors that all windows share.

    Parameters
    ----------
    problem : Problem
    frame_step : int
        Every how many frames of a scenelet are compared.
    device : torch.device
        Device on which the fits are computed.
    """

    unseen_on_path: ClassVar = False
    """Whether scenelets are placed on the path in windows without any detection."""

    def __init__(self, problem: Problem, frame_step: int, device: torch.device) -> None:
        self.device = device
        lengths = problem.lengths
        longest = int(lengths.max())
        # Frames are counted from the centre, so that all scenelets of a window are aligned.
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
        self.joints = torch.from_numpy(joints).to(device)
        self.present = torch.from_numpy(present).to(device)
        self.problem = problem
        self.keypoints = _level(problem)
        self.focal = float(np.exp(problem.camera_mean[2]))
        self.tolerance = self._tensor(problem.pose_tolerance)

    def __call__(self, centre: int, index: Ints, start: Array, steps: int) -> tuple[Array, Array]:
        """Fit scenelets to the window around the frame ``centre``.

        ``start`` (S, len(index), 3) has bearing, log depth and yaw; returns their final values and
        the cost (S, len(index)) per confident joint.
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
        size = _BATCH if self.device.type == "cpu" else len(index)
        for first in range(0, len(index), size):
            batch = slice(first, first + size)
            args = (self.joints[index[batch]], target, scale, dof, weight[batch])
            for _ in range(steps):
                theta[:, batch], cost[:, batch] = self._step(theta[:, batch], *args)
        joint_count = weight.sum((1, 2)).cpu().double().numpy()
        fitted = cost.cpu().double().numpy() / np.maximum(joint_count, 1.0)
        fitted[:, joint_count == 0] = np.inf
        return theta.cpu().double().numpy(), fitted

    def _tensor(self, values: Array) -> Tensor:
        """Convert to single precision on the device."""
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
        """One damped step for (starts, scenelets, 3); the returned cost is that before the step."""
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
        depth = (cp * y + sp * lz).clamp(min=NEAREST)
        up = -sp * y + cp * lz
        du = problem.cx + fx * x / depth - target[..., 0]
        dv = problem.cy - fy * up / depth - target[..., 1]
        cost, irls = self._loss(du, dv, depth, scale, dof, weight)
        gradient, normal = [], []
        # Derivatives of the floor position (x, y) by bearing, log depth and yaw.
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
        matrix = matrix + torch.diag(torch.tensor(_DAMPING, device=self.device))
        step = torch.linalg.solve(matrix, torch.stack(gradient, -1))
        limit = torch.tensor(_LONGEST_STEP, device=self.device)
        return theta - step.clamp(-limit, limit), cost.sum((-1, -2))

    def _confidence(self, frames: Ints) -> Array:
        """(F, 16) weights of the detections in some frames."""
        sure: Array = self.problem.confidence_density[frames].argmax(-1)
        return sure

    def _loss(
        self, du: Tensor, dv: Tensor, depth: Tensor, scale: Tensor, dof: Tensor, weight: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Cost of residuals in pixels at a depth in metres, and their weights."""
        fx = self.problem.fx * self.focal
        variance = scale**2 + (fx * self.tolerance / depth) ** 2
        squared = (du**2 + dv**2) / variance
        cost = ((dof / 2 + 1) * (squared / dof).log1p() + variance.log()) * weight
        return cost, weight * (dof + 2) / (dof + squared) / variance


class SquaredWindowFitter(WindowFitter):
    """Fits with the published energy: L_r = sum c |Pi q - u|^2 over the compared frames.

    Parameters
    ----------
    problem : Problem
    frame_step : int
        Every how many frames of a scenelet are compared.
    device : torch.device
    """

    unseen_on_path: ClassVar = True
    # Only the path determines the placement then; its smoothness is evaluated later.

    def _confidence(self, frames: Ints) -> Array:
        return self.problem.confidences[frames]

    def _loss(
        self, du: Tensor, dv: Tensor, depth: Tensor, scale: Tensor, dof: Tensor, weight: Tensor
    ) -> tuple[Tensor, Tensor]:
        del depth, scale, dof
        unit = _USUAL_ERROR * self.problem.fx
        return weight * (du**2 + dv**2) / (2 * unit**2), weight / unit**2
