"""What it costs that the pose jumps (:mod:`imapper_prob.models.energy.smoothness`), batched."""

from __future__ import annotations

import torch
from torch import Tensor

from imapper_prob.models.batched.layout import Layout
from imapper_prob.models.batched.tensors import ProblemTensors
from imapper_prob.models.energy.smoothness import DOF, USUAL_JUMP
from imapper_prob.models.skeleton import PELV

__all__ = ["pose_jumps"]


def pose_jumps(tensors: ProblemTensors, layout: Layout, camera: Tensor, joints: Tensor) -> Tensor:
    """Nats (S,) of independent joints, less the usual.

    ``joints`` (S, T, 16, 3) are the motions in the world, metres; ``camera`` (S, 5).
    """
    pose = joints - joints[:, :, PELV, None]
    squared = ((pose[:, 1:] - pose[:, :-1]) ** 2).sum(-1)
    scale2 = DOF * (tensors.problem.joint_step * camera[:, 3].exp()) ** 2
    nats = 0.5 * (DOF + 3.0) * (squared / scale2[:, None, None]).log1p().sum(-1) - USUAL_JUMP
    jumps = layout.item_of[:, 1:] != layout.item_of[:, :-1]
    jumps = jumps & ~tensors.path_starts[1:]
    return torch.where(jumps, nats, 0.0).sum(1)
