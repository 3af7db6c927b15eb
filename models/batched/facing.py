"""Where a scenelet's person faces, given where the lifted poses face (``docs/model.md`` 10)."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from imapper_prob.models.batched.layout import Layout
from imapper_prob.models.batched.tensors import ProblemTensors

__all__ = ["log_yaw_density"]

_UNKNOWN = 1e-9
"""A mean of directions that is shorter has none."""


def log_yaw_density(tensors: ProblemTensors, layout: Layout, yaws: Tensor) -> Tensor:
    """Log density (S, k) of the scenelets' yaws (S, k), per radian."""
    seen, own = tensors.path_facing, tensors.joint_facing[layout.joint_row]
    along = (seen * own).sum(-1)
    aside = seen[..., 1] * own[..., 0] - seen[..., 0] * own[..., 1]
    # Sums over each item's frames; those of free frames come last, and are left out.
    n_items = yaws.shape[1]
    item = torch.where(layout.covered, layout.item_of, n_items)[..., None].expand(-1, -1, 2)
    total = yaws.new_zeros(len(yaws), n_items + 1, 2)
    total = total.scatter_add(1, item, torch.stack([along, aside], -1))[:, :n_items]
    length = total.norm(dim=-1)
    mean = total / length.clamp_min(_UNKNOWN)[..., None]
    near = math.exp(-tensors.problem.facing_spread)
    cosine = mean[..., 0] * yaws.cos() + mean[..., 1] * yaws.sin()
    density = (1 - near**2) / (2 * math.pi * (1 + near**2 - 2 * near * cosine))
    return torch.where(length < _UNKNOWN, -math.log(2 * math.pi), density.log())
