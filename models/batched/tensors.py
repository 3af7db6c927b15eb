"""A problem as tensors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from imapper_prob.models.problem import Problem

__all__ = ["ProblemTensors", "to_tensors"]


@dataclass(frozen=True, eq=False)
class ProblemTensors:
    """The arrays of a :class:`Problem` on one device, the densities as their logarithms.

    Logarithms, because densities of far-off detections underflow in single precision. Shapes
    and units are those of :class:`Problem` where nothing is said; its plain numbers are read
    from ``problem``.
    """

    problem: Problem
    keypoints: Tensor
    used: Tensor
    log_confidence: Tensor  # (T, 16, 2)
    squared_scale: Tensor  # (T, 16, 2) square pixels
    error_dof: Tensor
    log_static: Tensor  # (2, T, 16, 2)
    path_centre: Tensor
    path_scale: Tensor
    path_starts: Tensor
    path_mean: Tensor  # (T + 1, 2, 2) rows first
    path_draw: Tensor  # (T + 1, 3, 2, 3) rows first, then how many frames ahead are known
    lift: Tensor
    poses: Tensor
    path_facing: Tensor
    free_cost: Tensor
    stays: Tensor
    lowered: Tensor
    joints: Tensor
    joint_facing: Tensor
    joint_first: Tensor
    boxes: Tensor
    box_first: Tensor
    box_label: Tensor
    box_yaw: Tensor
    label_front: Tensor
    log_rate: Tensor
    camera_mean: Tensor
    camera_precision: Tensor


def to_tensors(
    problem: Problem,
    *,
    dtype: torch.dtype = torch.float64,
    device: torch.device | str = "cpu",
) -> ProblemTensors:
    """Put a problem on a device; ``dtype`` is that of all that is not an index.

    Raises
    ------
    ValueError
        The problem is one of the published energy, which this executor does not compute.
    """
    if problem.of_paper:
        raise ValueError("the published energy has no batched evaluation")

    def real(array: np.ndarray) -> Tensor:
        return torch.tensor(array, dtype=dtype, device=device)

    def integer(array: np.ndarray) -> Tensor:
        return torch.tensor(array, dtype=torch.int64, device=device)

    smallest = np.finfo(np.float64).tiny
    return ProblemTensors(
        problem=problem,
        keypoints=real(problem.keypoints),
        used=torch.tensor(problem.used, device=device),
        log_confidence=real(np.log(problem.confidence_density)),
        squared_scale=real(problem.error_scale**2),
        error_dof=real(problem.error_dof),
        log_static=real(np.log(np.maximum(problem.static_density, smallest))),
        path_centre=real(problem.path_centre),
        path_scale=real(problem.path_scale),
        path_starts=torch.tensor(problem.path_starts, device=device),
        path_mean=real(problem.path_mean.transpose(1, 0, 2)),
        path_draw=real(problem.path_draw.transpose(1, 2, 0, 3)),
        lift=real(problem.lift),
        poses=real(problem.poses),
        path_facing=real(problem.path_facing),
        free_cost=real(problem.free_cost),
        stays=real(problem.stays),
        lowered=integer(problem.lowered),
        joints=real(problem.joints),
        joint_facing=real(problem.joint_facing),
        joint_first=integer(problem.joint_first),
        boxes=real(problem.boxes),
        box_first=integer(problem.box_first),
        box_label=integer(problem.box_label),
        box_yaw=real(problem.box_yaw),
        label_front=torch.tensor(problem.label_front, device=device),
        log_rate=real(problem.log_rate),
        camera_mean=real(problem.camera_mean),
        camera_precision=real(problem.camera_precision),
    )
