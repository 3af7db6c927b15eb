"""The pelvis path: evidence of its Gaussian chain, and the path drawn (``docs/model.md`` 6-10).

The recursions of :mod:`imapper_prob.models.chain`, both coordinates and all frames at once.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from imapper_prob.models.batched.layout import Layout
from imapper_prob.models.batched.scan import second_order_scan
from imapper_prob.models.batched.tensors import ProblemTensors
from imapper_prob.models.limits import NEAREST
from imapper_prob.models.skeleton import PELV

__all__ = ["draw_path", "in_view", "pose_free_frames"]

_LOG_2PI = math.log(2 * math.pi)


def in_view(camera: Tensor, points: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Right, depth and up (S, T, ...) of points (S, T, ..., 3) in camera axes, metres (eq. 1).

    A point nearer than the least depth, or behind the camera, counts as being there.
    """
    pitch, height, roll = (camera[:, i].reshape(-1, *[1] * (points.ndim - 2)) for i in (0, 1, 4))
    x, y, z = points[..., 0], points[..., 1], points[..., 2] - height
    depth = (pitch.cos() * y + pitch.sin() * z).clamp_min(NEAREST)
    level = pitch.cos() * z - pitch.sin() * y
    right, up = roll.cos() * x + roll.sin() * level, roll.cos() * level - roll.sin() * x
    return right, depth, up


def _known_before(tensors: ProblemTensors, covered: Tensor) -> tuple[Tensor, Tensor]:
    """Last frame under a scenelet before each one, and how many frames ago, both (S, T) int.

    -1 where there is none; 0 frames ago where there is none since a start.
    """
    frames = torch.arange(covered.shape[1], device=covered.device)
    last = torch.where(covered, frames, -1).cummax(1).values
    last = torch.cat([torch.full_like(last[:, :1], -1), last[:, :-1]], 1)
    start = torch.where(tensors.path_starts, frames, 0).cummax(0).values
    return last, torch.where(last >= start, frames - last, 0)


def _known_ahead(tensors: ProblemTensors, covered: Tensor) -> Tensor:
    """How many of the frames that follow each one say of it, (S, T) int, at most two."""
    n = covered.shape[1]
    frames = torch.arange(n, device=covered.device)

    def next_of(flags: Tensor) -> Tensor:
        earliest = torch.where(flags, frames, n).flip(-1).cummin(-1).values.flip(-1)
        return torch.cat([earliest[..., 1:], torch.full_like(earliest[..., :1], n)], -1)

    scenelet, start = next_of(covered), next_of(tensors.path_starts)
    return torch.where(scenelet < start, scenelet - frames, start - 1 - frames).clamp_max(2)


def _at(values: Tensor, frames: Tensor) -> Tensor:
    """``values`` (S, T, 2) in the frames (S, T); in the first where there is none such."""
    return values.gather(1, frames.clamp_min(0)[..., None].expand(-1, -1, 2))


def draw_path(
    tensors: ProblemTensors, layout: Layout, camera: Tensor, latent: Tensor, joints: Tensor
) -> tuple[Tensor, Tensor, Tensor]:
    """Integrate the free frames out, and draw them.

    Parameters
    ----------
    camera : (S, 5)
    latent : (S, T, 2)
        Standard normal numbers of the draw.
    joints : (S, T, 16, 3)
        Motion in the world in covered frames, metres.

    Returns
    -------
    evidence : (S,)
        Log-density of the pelvis at the scenelets, free frames integrated out.
    placement : (S,)
        Log-Jacobian from (bearing, log depth) to the floor.
    path : (S, T, 2)
        Bearing and log depth of the pelvis in all frames.
    """
    covered, begins = layout.covered[..., None], layout.begins[..., None]
    pelvis = joints[:, :, PELV]
    right, depth, _ = in_view(camera, pelvis)
    fixed = torch.stack([right / depth, depth.log()], -1)
    tilt = camera[:, :1].cos().log() + camera[:, 4:].cos().log()
    jacobian = tilt - 2 * depth.log()
    placement = torch.where(layout.begins, jacobian, 0.0).sum(1)

    # The same pixels under another focal length and body size.
    shrunk, further = (-camera[:, 2]).exp(), camera[:, 2] + camera[:, 3]
    unit = torch.stack([shrunk, torch.ones_like(shrunk)], -1)[:, None]
    offset = torch.stack([torch.zeros_like(further), further], -1)[:, None]
    centre, scale = unit * tensors.path_centre + offset, unit * tensors.path_scale
    error = torch.where(covered, (fixed - centre) / scale, 0.0)

    last, since = _known_before(tensors, layout.covered)
    mean = tensors.path_mean[since]
    expected = mean[..., 0] * _at(error, last) + mean[..., 1] * _at(error, last - 1)
    deviation = tensors.path_draw[since, 0, :, 2]
    gap = error - expected
    arrival = -0.5 * (_LOG_2PI + (gap / deviation) ** 2) - (deviation * scale).log()
    evidence = torch.where(begins, arrival, 0.0).sum((1, 2))

    # Backwards: each frame given those that follow, a scenelet's first among them.
    draw = tensors.path_draw[since, _known_ahead(tensors, layout.covered)]
    drawn = torch.where(begins, gap, torch.where(covered, 0.0, draw[..., 2] * latent))
    near, far = (torch.where(covered, 0.0, draw[..., k]) for k in range(2))
    errors = expected + second_order_scan(near.flip(1), far.flip(1), drawn.flip(1)).flip(1)
    path = torch.where(covered, fixed, centre + scale * errors)
    return evidence, placement, path


def pose_free_frames(
    tensors: ProblemTensors, layout: Layout, camera: Tensor, path: Tensor, joints: Tensor
) -> Tensor:
    """The motion in the world (S, T, 16, 3): ``joints``, and each free frame's pose on ``path``."""
    pitch, height, log_focal, log_body, roll = (camera[:, i, None, None] for i in range(5))
    depth = path[..., 1, None].exp()
    pose = log_body.exp()[..., None] * tensors.poses
    right = path[..., 0, None] * depth + pose[..., 0]
    y = depth + pose[..., 1]
    up = tensors.lift[:, None] / log_focal.exp() * depth + pose[..., 2]
    x, z = roll.cos() * right - roll.sin() * up, roll.sin() * right + roll.cos() * up
    free = torch.stack(
        [x, pitch.cos() * y - pitch.sin() * z, pitch.sin() * y + pitch.cos() * z + height], -1
    )
    return torch.where(layout.covered[..., None, None], joints, free)
