"""What the detector reports, sides swapped or not, in torch (``docs/model.md`` 11-13)."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from imapper_prob.models.batched.layout import Layout
from imapper_prob.models.batched.path import in_view
from imapper_prob.models.batched.place import Boxes
from imapper_prob.models.batched.scan import log_product
from imapper_prob.models.batched.sight import p_seen, sight_clearance
from imapper_prob.models.batched.tensors import ProblemTensors
from imapper_prob.models.skeleton import MIRROR, N_JOINTS

__all__ = ["by_frame", "summed_over_swaps"]


def _log_student(squared_error: Tensor, squared_scale: Tensor, dof: Tensor) -> Tensor:
    """Log-density a square pixel of a bivariate Student-t."""
    tail = (dof / 2 + 1) * (squared_error / (dof * squared_scale)).log1p()
    return -(2 * math.pi * squared_scale).log() - tail


def by_frame(
    tensors: ProblemTensors,
    layout: Layout,
    camera: Tensor,
    body: Tensor,
    joints: Tensor,
    boxes: Boxes,
) -> Tensor:
    """Log-likelihood of each frame's detections, as they are and with sides swapped: (S, T, 2).

    In nats, before the frame weight. ``camera`` (S, 5), ``body`` (S, T) how large the person
    is, ``joints`` (S, T, 16, 3) in the world.
    """
    problem = tensors.problem
    clearance = sight_clearance(camera[:, 1], joints, boxes)
    seen = p_seen(clearance, width=problem.sight_width, surprise=problem.surprise)
    log_share = torch.stack([(-seen).log1p(), seen.log()], -1)

    right, depth, up = in_view(camera, joints)
    focal = camera[:, 2, None, None].exp()
    pixels = torch.stack(
        [
            problem.cx + focal * problem.fx * right / depth,
            problem.cy - focal * problem.fy * up / depth,
        ],
        -1,
    )
    # A larger body differs by more: else distance alone would seem to fit better.
    loose = (focal * problem.fx * body[..., None] * problem.pose_tolerance / depth) ** 2

    covered = layout.covered[..., None, None]
    sides = []
    for side, of in enumerate((range(N_JOINTS), MIRROR)):
        is_at = list(of)
        error = ((pixels[:, :, is_at] - tensors.keypoints) ** 2).sum(-1)[..., None]
        scale = tensors.squared_scale + loose[:, :, is_at, None]
        posed = tensors.log_confidence + _log_student(error, scale, tensors.error_dof)
        density = torch.where(covered, posed, tensors.log_static[side])
        joint = (log_share[:, :, is_at] + density).logsumexp(-1)
        sides.append(torch.where(tensors.used, joint, 0.0).sum(-1))
    return torch.stack(sides, -1)


def summed_over_swaps(
    frames: Tensor, starts: Tensor, *, weight: float, begins: float, ends: float
) -> Tensor:
    """Log-likelihood of all frames, whichever are swapped: (S,) of ``frames`` (S, T, 2).

    ``log p(0) M_1 ... M_T 1`` with M_t the step into frame t times its two likelihoods. The
    chain starts in its own limit, which a step leaves as it is, and a step into a start leads
    to from wherever. Parameters as for
    :func:`imapper_prob.models.energy.swaps.summed_over_swaps`.
    """
    limit = frames.new_tensor([ends, begins]) / (begins + ends)
    onwards = frames.new_tensor([[1 - begins, begins], [ends, 1 - ends]])
    step = torch.where(starts[:, None, None], limit.expand(2, 2), onwards)
    weighted = weight * frames
    top = weighted.detach().amax(-1)
    product, log_scale = log_product(step * (weighted - top[..., None]).exp()[..., None, :])
    return top.sum(1) + log_scale + (limit @ product.sum(-1).T).log()
