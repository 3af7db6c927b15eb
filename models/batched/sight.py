"""Whether furniture stands between the camera and a joint, in torch.

The clearance of :mod:`imapper_prob.models.energy.occlusion`. Only pairs of a line of sight and
a box that can come near each other are worked out: all others have the clearance's cap, so that
this is exact.
"""

from __future__ import annotations

from itertools import product

import torch
from torch import Tensor

from imapper_prob.models.batched.place import Boxes
from imapper_prob.models.geometry import NOTHING_IN_SIGHT, OPAQUE
from imapper_prob.models.limits import NEAR_SIGHT

__all__ = ["p_seen", "sight_clearance"]

_LEVEL = 1e-12
"""Slopes whose sum is less than this, in metres along the whole line, never meet."""


@torch.no_grad()
def _in_sight(height: Tensor, joints: Tensor, boxes: Boxes) -> Tensor:
    """(S, T, 16, K) lines of sight and boxes that may come near each other.

    A box grown by the cap on every side has bounds of bearing x / y and slope
    (z - height) / y; a line outside them does not touch it, nor one that ends before it. A box
    that reaches beside or behind the camera has no bounds.
    """
    corners = torch.cartesian_prod(*[joints.new_tensor([-1.0, 1.0])] * 3)
    reach = (boxes.half[:, :, None] + NOTHING_IN_SIGHT) * corners  # (S, K, 8, 3)
    c, s = boxes.yaw.cos()[..., None], boxes.yaw.sin()[..., None]
    x = boxes.centre[..., 0, None] + c * reach[..., 0] - s * reach[..., 1]
    y = boxes.centre[..., 1, None] + s * reach[..., 0] + c * reach[..., 1]
    z = boxes.centre[..., 2, None] + reach[..., 2] - height[:, None, None]
    nearest = y.amin(-1)[:, None, None]
    around = nearest <= NEAR_SIGHT
    far = joints[..., 1].clamp_min(NEAR_SIGHT)
    near = nearest <= far[..., None]
    for corner, joint in ((x, joints[..., 0]), (z, joints[..., 2] - height[:, None, None])):
        view = (corner / y.clamp_min(NEAR_SIGHT))[:, None, None]
        line = (joint / far)[..., None]
        near &= around | ((line >= view.amin(-1)) & (line <= view.amax(-1)))
    return near & boxes.present[:, None, None]


def _lowest(start: Tensor, slope: Tensor, half: Tensor) -> Tensor:
    """Minimum over s in [0, 1] of ``max_i |start_i + s slope_i| - half_i``: (n,) of (3, n).

    The highest meeting point of a rising and a falling line, or the nearer end.
    """
    sign = torch.where(slope >= 0, 1.0, -1.0)
    steep, up, down = slope.abs(), sign * start - half, -sign * start - half
    with torch.no_grad():
        highest, where = torch.full_like(start[0], -torch.inf), torch.zeros_like(start[0])
        best = torch.zeros_like(where, dtype=torch.int64)
        for pair, (i, k) in enumerate(product(range(3), repeat=2)):
            total = steep[i] + steep[k]
            meet = torch.where(total > _LEVEL, (down[k] - up[i]) / total, 0.0)
            value = up[i] + steep[i] * meet
            higher = value > highest
            highest = torch.where(higher, value, highest)
            where = torch.where(higher, meet, where)
            best = torch.where(higher, pair, best)
        rising, falling = (best // 3)[None], (best % 3)[None]
    rise, fall = steep.gather(0, rising)[0], steep.gather(0, falling)[0]
    total = torch.where(rise + fall > _LEVEL, rise + fall, 1.0)
    between = (fall * up.gather(0, rising)[0] + rise * down.gather(0, falling)[0]) / total
    end = ((start + (where > 0) * slope).abs() - half).amax(0)
    return torch.where((where > 0) & (where < 1), between, end)


def sight_clearance(height: Tensor, joints: Tensor, boxes: Boxes) -> Tensor:
    """Smallest clearance in metres of the lines of sight from (0, 0, height).

    Parameters
    ----------
    height : (S,)
        Metres, of the camera.
    joints : (S, T, 16, 3)
        World, metres.

    Returns
    -------
    (S, T, 16)
        At most ``NOTHING_IN_SIGHT``; negative where a box hides the joint.
    """
    state, frame, joint, box = _in_sight(height, joints, boxes).nonzero().unbind(1)
    _, n_frames, n_joints, _ = joints.shape
    line = (state * n_frames + frame) * n_joints + joint
    owner = state * boxes.present.shape[1] + box

    def rows(table: Tensor, row: Tensor) -> Tensor:
        return torch.stack([c.flatten().index_select(0, row) for c in table.unbind(-1)])

    eye = torch.stack([torch.zeros_like(height), torch.zeros_like(height), height], -1)
    origin, half = rows(eye[:, None] - boxes.centre, owner), rows(boxes.half, owner)
    to_joint = rows(joints - eye[:, None, None], line)
    c, s = rows(torch.stack([boxes.yaw.cos(), boxes.yaw.sin()], -1), owner)

    def in_box(p: Tensor) -> Tensor:
        return torch.stack([c * p[0] + s * p[1], c * p[1] - s * p[0], p[2]])

    value = _lowest(in_box(origin), in_box(to_joint), half)
    deeper = (OPAQUE / half.amin(0)).clamp_min(1.0)
    value = torch.where(value < 0, value * deeper, value)
    free = joints.new_full((joints[..., 0].numel(),), NOTHING_IN_SIGHT)
    return free.scatter_reduce(0, line, value, "amin").view(joints.shape[:-1])


def p_seen(clearance: Tensor, *, width: float, surprise: float) -> Tensor:
    """m(v): a smooth step over the clearance, never quite 0 or 1."""
    step = (clearance / width).clamp(-30.0, 30.0).sigmoid()
    return surprise + (1 - 2 * surprise) * step
