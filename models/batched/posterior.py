"""The log-posterior of many states of one problem, with gradients.

On a CPU, call ``torch.set_num_threads(1)`` first: the operations are small, and waking a second
thread for each costs more than it does. This is left to the caller, being a setting of the whole
process. Batches of two to four thousand frames in all are the fastest there, larger ones leave
the cache; with twenty boxes in view a gradient holds 50 KiB a frame in double precision.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from imapper_prob.models.batched.detections import by_frame, summed_over_swaps
from imapper_prob.models.batched.facing import log_yaw_density
from imapper_prob.models.batched.intersections import (
    collision_depths,
    depth_below_floor,
    displaced_cost,
    motion_depths,
)
from imapper_prob.models.batched.layout import lay_out
from imapper_prob.models.batched.path import draw_path, pose_free_frames
from imapper_prob.models.batched.place import of_items, place_boxes, place_motions
from imapper_prob.models.batched.smoothness import pose_jumps
from imapper_prob.models.batched.support import unsupported
from imapper_prob.models.batched.tensors import ProblemTensors
from imapper_prob.models.energy.intersection import BOTH
from imapper_prob.models.limits import LOWEST_CAMERA, STEEPEST_CAMERA

__all__ = ["log_posterior_batch", "terms_batch"]


def terms_batch(
    tensors: ProblemTensors,
    camera: Tensor,
    items: Tensor,
    placements: Tensor,
    sizes: Tensor,
    latent: Tensor,
) -> Tensor:
    """The terms of the log-posterior of S states.

    Parameters
    ----------
    tensors : ProblemTensors
        The problem; everything else is on its device and of its precision.
    camera : (S, 5)
        Pitch (rad), elevation (m), log focal scale, log body scale, roll (rad).
    items : (S, k, 2) int
        Scenelet and start frame, in any order; each state its own. Where a state has fewer
        than k, scenelet -1 fills up, with any start, placement and size.
    placements : (S, k, 3)
        x, y (m), yaw (rad) of each scenelet's local frame in the world.
    sizes : (S, k)
        Log size of each scenelet's person, on top of the body scale.
    latent : (S, T, 2)
        Standard normal numbers of the path.

    Returns
    -------
    (S, 11)
        Values of :data:`imapper_prob.models.compiled.TERMS`, nats. Outside the support the
        first is -inf and the rest 0, with gradients of 0.
    """
    problem, layout = tensors.problem, lay_out(tensors, items)
    steepest = camera[:, [0, 4]].abs().amax(1)
    inside = layout.admissible & (camera[:, 1] > LOWEST_CAMERA) & (steepest < STEEPEST_CAMERA)
    camera = torch.where(inside[:, None], camera, tensors.camera_mean)

    offset = camera - tensors.camera_mean
    quadratic = ((offset @ tensors.camera_precision) * offset).sum(1)
    rates = torch.where(layout.present, tensors.log_rate[layout.scenelet], 0.0)

    spread = problem.size_spread
    size_density = -0.5 * ((sizes / spread) ** 2 + math.log(2 * math.pi * spread**2))
    size_prior = torch.where(layout.present, size_density, 0.0).sum(1)

    yaw_density = log_yaw_density(tensors, layout, placements[..., 2])
    yaw_prior = torch.where(layout.present, yaw_density, 0.0).sum(1)

    body = (camera[:, 3, None] + of_items(sizes, layout.item_of)).exp()
    joints = place_motions(tensors, layout, placements, body)
    evidence, jacobian, path = draw_path(tensors, layout, camera, latent, joints)
    joints = pose_free_frames(tensors, layout, camera, path, joints)
    boxes = place_boxes(tensors, layout, placements, (camera[:, 3, None] + sizes).exp())

    weight = problem.frame_weight * problem.likelihood
    detections = summed_over_swaps(
        by_frame(tensors, layout, camera, body, joints, boxes),
        tensors.path_starts,
        weight=weight,
        begins=problem.swap_begins,
        ends=problem.swap_ends,
    )
    free = torch.where(layout.covered, 0.0, tensors.free_cost).sum(1)
    collision = displaced_cost(
        collision_depths(tensors, boxes),
        spread=BOTH * problem.furniture_spread,
        unit=problem.collision_cost,
    )
    motion = displaced_cost(
        motion_depths(tensors, layout, joints, boxes),
        spread=problem.furniture_spread,
        unit=problem.motion_cost * weight,
    )
    jumps = pose_jumps(tensors, layout, camera, joints)
    values = torch.stack(
        [
            problem.camera_constant - 0.5 * quadratic,
            rates.sum(1),
            jacobian + yaw_prior + size_prior,
            evidence,
            detections,
            -weight * free,
            -problem.smoothness_cost * problem.likelihood * jumps,
            -problem.likelihood * collision,
            -motion,
            -problem.motion_cost * weight * depth_below_floor(tensors, joints),
            -problem.likelihood * unsupported(tensors, layout, items[..., 1]),
        ],
        1,
    )
    outside = values.new_tensor([-torch.inf, *[0.0] * 10])
    return torch.where(inside[:, None], values, outside)


def log_posterior_batch(
    tensors: ProblemTensors,
    camera: Tensor,
    items: Tensor,
    placements: Tensor,
    sizes: Tensor,
    latent: Tensor,
) -> Tensor:
    """log pi of S states, (S,), up to the constant of the clip: the sum of its terms.

    Parameters as for :func:`terms_batch`.
    """
    return terms_batch(tensors, camera, items, placements, sizes, latent).sum(1)
