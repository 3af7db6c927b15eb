"""Stays during which nothing carries the person (`imapper_prob.models.energy.support`)."""

from __future__ import annotations

import torch
from torch import Tensor

from imapper_prob.models.batched.layout import Layout
from imapper_prob.models.batched.tensors import ProblemTensors

__all__ = ["unsupported"]


def unsupported(tensors: ProblemTensors, layout: Layout, start: Tensor) -> Tensor:
    """(S,) nats of the stays that no scenelet of a state holds; ``start`` is (S, k)."""
    lowered = tensors.lowered[layout.scenelet]
    first, end = start + lowered[..., 0], start + lowered[..., 1]
    stays = tensors.stays
    there = (layout.present & (first < end))[..., None]
    held = there & (first[..., None] < stays[:, 1]) & (end[..., None] > stays[:, 0])
    return torch.where(held.any(1), 0.0, stays[:, 2]).sum(1)
