"""The pelvis path: evidence of its Gaussian chain, and the path drawn (``docs/model.md`` 6-10).

The recursions of :mod:`imapper_prob.models.chain`, both coordinates and all frames at once.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from imapper_prob.models.batched.layout import Layout
from imapper_prob.models.batched.scan import affine_scan
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


def _before(after: Tensor, start: Tensor) -> Tensor:
    """What predicts each frame, from what follows it (S, T, 2)."""
    return torch.cat([start.expand(len(after), 1, 2), after[:, :-1]], 1)


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
        Log-Jacobian from (bearing, log depth) to the floor, and the uniform yaw.
    path : (S, T, 2)
        Bearing and log depth of the pelvis in all frames.
    """
    covered, begins = layout.covered[..., None], layout.begins[..., None]
    pelvis = joints[:, :, PELV]
    right, depth, _ = in_view(camera, pelvis)
    fixed = torch.stack([right / depth, depth.log()], -1)
    tilt = camera[:, :1].cos().log() + camera[:, 4:].cos().log()
    jacobian = tilt - 2 * depth.log() - _LOG_2PI
    placement = torch.where(layout.begins, jacobian, 0.0).sum(1)

    # The same pixels under another focal length and body size.
    shrunk, further = (-camera[:, 2]).exp(), camera[:, 2] + camera[:, 3]
    unit = torch.stack([shrunk, torch.ones_like(shrunk)], -1)[:, None]
    offset = torch.stack([torch.zeros_like(further), further], -1)[:, None]
    centre, scale = unit * tensors.path_centre + offset, unit * tensors.path_scale
    error = (fixed - centre) / scale

    memory = tensors.path_memory
    innovation = 1 - memory**2
    keep = torch.where(covered, 0.0, memory.expand_as(error))
    fresh = torch.zeros_like(memory)
    mean_after = affine_scan(keep, torch.where(covered, memory * error, 0.0), fresh)
    variance_after = affine_scan(keep**2, innovation.expand_as(error), fresh + 1)
    mean, variance = _before(mean_after, fresh), _before(variance_after, fresh + 1)
    arrival = -0.5 * (_LOG_2PI + variance.log() + (error - mean) ** 2 / variance) - scale.log()
    evidence = torch.where(begins, arrival, 0.0).sum((1, 2))

    # Backwards: a frame given the next, and the last given nothing.
    pull = memory * variance / (memory**2 * variance + innovation)
    pull = torch.cat([pull[:, :-1], torch.zeros_like(pull[:, -1:])], 1)
    stays = 1 - memory * pull
    drawn = stays * mean + (variance * stays).sqrt() * latent
    errors = affine_scan(
        torch.where(covered, 0.0, pull).flip(1),
        torch.where(covered, error, drawn).flip(1),
        fresh,
    ).flip(1)
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
