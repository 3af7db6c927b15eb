"""Scenelets and their furniture, placed in the world."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from imapper_prob.models.batched.layout import Layout
from imapper_prob.models.batched.tensors import ProblemTensors

__all__ = ["Boxes", "of_items", "place_boxes", "place_motions"]


class Boxes(NamedTuple):
    """K boxes of each of S states, some of them absent."""

    centre: Tensor  # (S, K, 3) metres, world
    half: Tensor  # (S, K, 3) metres
    yaw: Tensor  # (S, K) radians
    facing: Tensor  # (S, K) yaw of the object the box is of
    label: Tensor  # (S, K) its category
    item: Tensor  # (S, K) the item it came with
    present: Tensor  # (S, K)


def of_items(values: Tensor, item: Tensor) -> Tensor:
    """Values (S, k, ...) of the items named by ``item`` (S, n): (S, n, ...); zeros for -1."""
    none = values.new_zeros(len(values), 1, *values.shape[2:])
    state = torch.arange(len(values), device=item.device)[:, None]
    return torch.cat([values, none], 1)[state, item]


def _turned(x: Tensor, y: Tensor, yaw: Tensor) -> tuple[Tensor, Tensor]:
    c, s = yaw.cos(), yaw.sin()
    return c * x - s * y, s * x + c * y


def place_motions(
    tensors: ProblemTensors, layout: Layout, placements: Tensor, body: Tensor
) -> Tensor:
    """Joints of covered frames in the world, metres: (S, T, 16, 3); free frames hold no meaning.

    Each frame's person is scaled by ``body`` (S, T) about the scenelet's origin on the floor.
    """
    local = tensors.joints[layout.joint_row]
    at = of_items(placements, layout.item_of)[:, :, None]
    x, y = _turned(local[..., 0], local[..., 1], at[..., 2])
    scale = body[..., None]
    return torch.stack([at[..., 0] + scale * x, at[..., 1] + scale * y, scale * local[..., 2]], -1)


def place_boxes(
    tensors: ProblemTensors, layout: Layout, placements: Tensor, bodies: Tensor
) -> Boxes:
    """Furniture of all items in the world, scaled as their people are by ``bodies`` (S, k)."""
    local = tensors.boxes[layout.box_row]
    at = of_items(placements, layout.box_item)
    scale = of_items(bodies, layout.box_item)
    x, y = _turned(local[..., 0], local[..., 1], at[..., 2])
    return Boxes(
        centre=torch.stack(
            [at[..., 0] + scale * x, at[..., 1] + scale * y, scale * local[..., 2]], -1
        ),
        half=scale[..., None] * local[..., 3:6],
        yaw=local[..., 6] + at[..., 2],
        facing=tensors.box_yaw[layout.box_row] + at[..., 2],
        label=tensors.box_label[layout.box_row],
        item=layout.box_item,
        present=layout.box_present,
    )
