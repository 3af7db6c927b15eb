"""Things cannot be in each other nor the floor, in torch (``docs/model.md`` 15-17)."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from imapper_prob.models.batched.layout import Layout
from imapper_prob.models.batched.place import Boxes
from imapper_prob.models.batched.tensors import ProblemTensors
from imapper_prob.models.energy.intersection import DISPLACED, PROBABILITIES
from imapper_prob.models.limits import LEVEL
from imapper_prob.models.skeleton import HEAD, LANK, LHIP, LKNE, PELV, RANK, RHIP, RKNE

__all__ = ["collision_depths", "depth_below_floor", "displaced_cost", "motion_depths"]

_BELOW_PELVIS = 0.05
"""Metres below the pelvis where the trunk begins: above the seat."""


def collision_depths(tensors: ProblemTensors, boxes: Boxes) -> Tensor:
    """How deep objects of any two items are in each other on the floor.

    Returns (S, 1, k k) metres for the pairs of k items. Two of one label that face the same way,
    if that has a front, are one object seen twice and do not count.
    """
    n = boxes.present.shape[1]
    a, b = torch.triu_indices(n, n, 1, device=boxes.present.device)
    merges = math.cos(tensors.problem.merge_angle)
    aligned = (boxes.facing[:, a] - boxes.facing[:, b]).cos() > merges
    alike = boxes.label[:, a] == boxes.label[:, b]
    one = alike & (aligned | ~tensors.label_front[boxes.label[:, a]])
    counts = (
        boxes.present[:, a] & boxes.present[:, b] & (boxes.item[:, a] != boxes.item[:, b]) & ~one
    )
    low, high = (boxes.centre[..., 2] + sign * boxes.half[..., 2] for sign in (-1, 1))
    level = torch.minimum(high[:, a], high[:, b]) - torch.maximum(low[:, a], low[:, b]) > LEVEL

    # Separating axes: the sides of either rectangle.
    apart = boxes.centre[:, b, :2] - boxes.centre[:, a, :2]
    turn = boxes.yaw[:, b] - boxes.yaw[:, a]
    c, s = turn.cos().abs(), turn.sin().abs()
    depths = []
    for own, other in ((a, b), (b, a)):
        cy, sy = boxes.yaw[:, own].cos(), boxes.yaw[:, own].sin()
        along = (cy * apart[..., 0] + sy * apart[..., 1]).abs()
        across = (cy * apart[..., 1] - sy * apart[..., 0]).abs()
        hx, hy = boxes.half[:, own, 0], boxes.half[:, own, 1]
        ox, oy = boxes.half[:, other, 0], boxes.half[:, other, 1]
        depths += [hx + c * ox + s * oy - along, hy + s * ox + c * oy - across]
    depth = torch.stack(depths).amin(0).clamp_min(0.0)
    depth = torch.where(counts & level, depth, 0.0)
    item = boxes.item.clamp_min(0)
    k = int(item.max()) + 1 if item.numel() else 1
    low_item, high_item = (
        torch.minimum(item[:, a], item[:, b]),
        torch.maximum(item[:, a], item[:, b]),
    )
    pairs = depth.new_zeros(len(depth), k * k)
    return pairs.scatter_add(1, k * low_item + high_item, depth)[:, None]


def _columns(joints: Tensor) -> Tensor:
    """Trunk, thighs and shins as upright lines (x, y, low, high): (S, T, 5, 4) metres."""
    trunk = torch.cat([joints[:, :, [PELV]], joints[:, :, [HEAD], 2:]], -1)
    trunk = trunk - trunk.new_tensor([0.0, 0.0, _BELOW_PELVIS, 0.0])
    upper, lower = joints[:, :, [RHIP, RKNE, LHIP, LKNE]], joints[:, :, [RKNE, RANK, LKNE, LANK]]
    middle = 0.5 * (upper[..., :2] + lower[..., :2])
    low = torch.minimum(upper[..., 2:], lower[..., 2:])
    high = torch.maximum(upper[..., 2:], lower[..., 2:])
    return torch.cat([trunk, torch.cat([middle, low, high], -1)], 2)


def motion_depths(tensors: ProblemTensors, layout: Layout, joints: Tensor, boxes: Boxes) -> Tensor:
    """How deep the body stands in the objects of each item, but in frames of its own.

    Returns (S, T, k) metres. Of trunk, thighs and shins the deepest counts, in frames with any
    detection.
    """
    columns = _columns(joints)
    n_states, n_frames, n_columns, _ = columns.shape
    n_boxes = boxes.present.shape[1]
    with torch.no_grad():
        # Pairs of a column and a box that may touch; all others have no depth.
        asked = tensors.used.any(1)[:, None] & boxes.present[:, None]
        asked = asked & (boxes.item[:, None] != layout.item_of[..., None])
        gap = columns[..., None, :2] - boxes.centre[:, None, None, :, :2]
        reach = (boxes.half[..., :2] ** 2).sum(-1)[:, None, None]
        touching = asked[:, :, None] & ((gap**2).sum(-1) < reach)
        state, frame, column, box = touching.nonzero().unbind(1)
    moment = state * n_frames + frame
    owner = state * n_boxes + box
    x, y, low, high = columns.flatten(0, 2).index_select(0, moment * n_columns + column).unbind(1)
    cx, cy, cz = boxes.centre.flatten(0, 1).index_select(0, owner).unbind(1)
    hx, hy, hz = boxes.half.flatten(0, 1).index_select(0, owner).unbind(1)
    c, s = (f.flatten().index_select(0, owner) for f in (boxes.yaw.cos(), boxes.yaw.sin()))
    dx, dy = x - cx, y - cy
    u, v = (c * dx + s * dy).abs(), (c * dy - s * dx).abs()
    aside = torch.minimum(hx - u, hy - v)
    upright = torch.minimum(cz + hz - low, high - (cz - hz))
    depth = torch.minimum(aside, upright).clamp_min(0.0)
    deepest = joints.new_zeros(n_states * n_frames * n_boxes)
    deepest = deepest.scatter_reduce(0, moment * n_boxes + box, depth, "amax")
    deepest = deepest.view(n_states, n_frames, n_boxes)
    by_item = deepest.new_zeros(n_states, n_frames, layout.present.shape[1])
    item = boxes.item.clamp_min(0)[:, None].expand_as(deepest)
    return by_item.scatter_add(2, item, deepest)


def displaced_cost(depths: Tensor, *, spread: float, unit: float) -> Tensor:
    """E_m of ``depths`` (S, T, k) metres or E_c of (S, 1, k k): (S,) nats.

    See :func:`imapper_prob.models.energy.intersection.displaced_cost`.
    """
    displaced = depths.new_tensor(DISPLACED) * spread
    sums = (depths[..., None] - displaced).clamp_min(0.0).sum(1)
    return -(depths.new_tensor(PROBABILITIES).log() - unit * sums).logsumexp(-1).sum(1)


def depth_below_floor(tensors: ProblemTensors, joints: Tensor) -> Tensor:
    """How deep each frame's lowest joint is below the floor, summed over frames: (S,) metres.

    In frames with any detection.
    """
    depth = (-joints[..., 2].amin(-1)).clamp_min(0.0)
    return torch.where(tensors.used.any(1), depth, 0.0).sum(1)
