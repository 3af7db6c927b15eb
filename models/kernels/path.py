"""The path of the pelvis with free frames marginalised and drawn, and jumps of the pose.

Equations (6) to (8) and (14) of ``docs/explanation/model.md``.

The static path is an estimate with slow errors: for seconds it is too near or too far by the same
ratio. In units of its standard deviation, e_t = (g_t - centre_t) / scale_t, the error is the
stationary AR(2) process of :mod:`imapper_prob.models.path_prior`. Frames inside a scenelet have
fixed values, the others are free. Steps inside a scenelet are left out, because its motion is
given: its first frame is one more step, and the process continues from its last two frames. At the
first frame of each person nothing is known. Within a stay the error along the view is constant
after the first :attr:`~imapper_prob.models.problem.Problem.stay_steps` frames.

:func:`update_path` computes the log density with all free frames marginalised, and a path drawn
from their conditional distribution as a function of standard normal variables. If these stay the
same while scenelets move, the path changes as little as possible. :func:`pose_jump` is the paper's
L_s for the other joints; it is used where motions of different origin meet (a static pose and a
scenelet, or two scenelets).
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import digamma

from imapper_prob.models.calibrated import calibrated
from imapper_prob.models.jit import inlined, inner_inlined
from imapper_prob.models.kernels.cache import ADDED, Cache
from imapper_prob.models.problem import Problem
from imapper_prob.models.skeleton import N_JOINTS, PELV

__all__ = ["DOF", "draw_segment", "pose_jump", "update_path"]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Ints = NDArray[np.int64]
_LOG_2PI = math.log(2 * math.pi)
_STILL = 1e-9
"""A free frame counts as unmoved if its bearing and log depth changed by less than this since they
were last computed: a few nanometres, a hundredth of the precision of lines of sight. The
log-posterior changes by less than 1e-6 nats."""


@inlined
def draw_segment(
    starts: Flags,
    stay: Ints,
    stay_steps: int,
    centres: Array,
    scales: Array,
    means: Array,
    draws: Array,
    camera: Array,
    latent: Array,
    first: int,
    last: int,
    pelvis: Array,
    left: int,
    right: int,
    steps: Ints,
    free_path: Array,
) -> float:
    """Marginalise the free frames of the path between two scenelets, and draw them.

    Parameters
    ----------
    starts, stay, stay_steps, centres, scales, means, draws
        ``path_starts``, ``path_stay``, ``stay_steps``, ``path_centre``, ``path_scale``,
        ``path_mean`` and ``path_draw`` of a problem.
    camera : (5,) float
    latent : (T, 2) float
        Standard normal variables of the draw.
    first, last : int
        The free frames are ``first`` to ``last - 1``.
    pelvis : (S, 6) float
        Bearing and log depth of the pelvis in a scenelet's first frame, and in its last two.
    left, right : int
        Slots of the scenelets before and after; -1 for none.
    steps : (T,) int
        Workspace.
    free_path : (T, 2) float
        Output: bearing and log depth in the free frames.

    Returns
    -------
    float
        Log density of the first frame of ``right`` given what precedes it, nats.
    """
    # The same pixels, with another focal length and body size.
    shrunk, offset = math.exp(-camera[2]), camera[2] + camera[3]
    bearing, bearing_before, depth, depth_before = 0.0, 0.0, 0.0, 0.0
    # From frame `cut` on, nothing is known of the scenelet before.
    cut = first
    if left >= 0:
        t = first - 1
        bearing_before = (pelvis[left, 2] / shrunk - centres[t - 1, 0]) / scales[t - 1, 0]
        depth_before = (pelvis[left, 3] - offset - centres[t - 1, 1]) / scales[t - 1, 1]
        bearing = (pelvis[left, 4] / shrunk - centres[t, 0]) / scales[t, 0]
        depth = (pelvis[left, 5] - offset - centres[t, 1]) / scales[t, 1]
        while cut < len(starts) and cut <= last and not starts[cut]:
            cut += 1
    # Deviations of the next two frames from their prediction, and the number of known ones.
    near, far, depth_near, depth_far = 0.0, 0.0, 0.0, 0.0
    evidence, ahead, depth_ahead = 0.0, 0, 0
    own = 1
    for t in range(first, min(last + 1, len(starts))):
        goes_on = t > first and stay[t] >= 0 and stay[t] == stay[t - 1] and not starts[t]
        own = own + 1 if goes_on else 1
        before = steps[t - first - 1] if t > first else 0
        steps[t - first] = before + 1 if own <= stay_steps else before
    if right >= 0:
        row = last - first + 1 if last < cut else 0
        depth_row = steps[last - first] if last < cut else 0
        width, depth_width = shrunk * scales[last, 0], scales[last, 1]
        near = (pelvis[right, 0] - shrunk * centres[last, 0]) / width
        near -= means[0, row, 0] * bearing + means[0, row, 1] * bearing_before
        depth_near = (pelvis[right, 1] - offset - centres[last, 1]) / depth_width
        depth_near -= means[1, depth_row, 0] * depth + means[1, depth_row, 1] * depth_before
        doubt, depth_doubt = draws[0, row, 0, 2], draws[1, depth_row, 0, 2]
        evidence -= _LOG_2PI + math.log(doubt * width * depth_doubt * depth_width)
        evidence -= 0.5 * ((near / doubt) ** 2 + (depth_near / depth_doubt) ** 2)
        ahead, depth_ahead = 1, 1
    for t in range(last - 1, first - 1, -1):
        if t + 1 == len(starts) or starts[t + 1]:
            ahead, depth_ahead = 0, 0
        row = t - first + 1 if t < cut else 0
        depth_row = steps[t - first] if t < cut else 0
        error = draws[0, row, ahead, 0] * near + draws[0, row, ahead, 1] * far
        error += draws[0, row, ahead, 2] * latent[t, 0]
        near, far = error, near
        error += means[0, row, 0] * bearing + means[0, row, 1] * bearing_before
        free_path[t, 0] = shrunk * (centres[t, 0] + scales[t, 0] * error)
        if depth_ahead == 0 or steps[t - first] != steps[t - first + 1]:
            k = depth_ahead
            error = draws[1, depth_row, k, 0] * depth_near + draws[1, depth_row, k, 1] * depth_far
            error += draws[1, depth_row, k, 2] * latent[t, 1]
            depth_near, depth_far = error, depth_near
            depth_ahead = min(depth_ahead + 1, 2)
        error = depth_near + means[1, depth_row, 0] * depth + means[1, depth_row, 1] * depth_before
        free_path[t, 1] = offset + centres[t, 1] + scales[t, 1] * error
        ahead = min(ahead + 1, 2)
    return evidence


@inner_inlined
def update_path(
    problem: Problem,
    cache: Cache,
    n: int,
    n_old: int,
    camera: Array,
    latent: Array,
    latent_before: Array,
    anew: bool,
) -> float:
    """Find the frames that moved, draw the free ones among them, and evaluate the path.

    Parameters
    ----------
    problem : Problem
    cache : Cache
        Its scenelets have slots.
    n, n_old : int
        Numbers of scenelets of the proposal and of the current state.
    camera : (5,) float
    latent, latent_before : (T, 2) float
        Standard normal variables of the proposal and of the current state.
    anew : bool
        Whether nothing can be reused: another camera, or no current state.

    Returns
    -------
    float
        Log density of the path with free frames marginalised, nats.
    """
    n_frames = len(problem.lift)
    before, after, cover, role = cache.slots[0], cache.slots[1], cache.cover, cache.role
    pose_at, moved, rows = cache.pose_at, cache.moved, cache.pose_row
    path, free_path = cache.path, cache.free_path
    for t in range(n_frames):
        moved[t] = 0
        rows[t] = t + n_frames * np.int64(pose_at[t])
    evidence = 0.0
    for i in range(n + 1):
        left, right = after[i - 1] if i > 0 else -1, after[i] if i < n else -1
        first = cache.items[left, 2] if left >= 0 else 0
        last = cache.items[right, 1] if right >= 0 else n_frames
        old = -1
        for k in range(n_old + 1):
            old_left, old_right = before[k - 1] if k > 0 else -1, before[k] if k < n_old else -1
            if not anew and old_left == left and old_right == right:
                old = k
        for t in range(first, last):
            cover[1, t] = -1
            if latent[t, 0] != latent_before[t, 0] or latent[t, 1] != latent_before[t, 1]:
                old = -1
        if old >= 0:
            cache.evidence[1, i] = cache.evidence[0, old]
        else:
            cache.evidence[1, i] = draw_segment(
                problem.path_starts, problem.path_stay, problem.stay_steps,
                problem.path_centre, problem.path_scale, problem.path_mean, problem.path_draw,
                camera, latent, first, last, cache.pelvis, left, right, cache.emission_rows,
                free_path,
            )  # fmt: skip
            for t in range(first, last):
                now = rows[t]
                x, y = free_path[t, 0], free_path[t, 1]
                if (
                    anew
                    or cover[0, t] >= 0
                    or abs(x - path[now, 0]) > _STILL
                    or abs(y - path[now, 1]) > _STILL
                ):
                    moved[t] = 1
                    rows[t] = 2 * t + n_frames - now
                    path[rows[t], 0], path[rows[t], 1] = x, y
        evidence += cache.evidence[1, i]
        if right >= 0:
            for t in range(last, cache.items[right, 2]):
                cover[1, t] = right
                if role[right] == ADDED:
                    moved[t] = 1
                    rows[t] = 2 * t + n_frames - rows[t]
    return evidence


DOF: Final = calibrated("joints.jump_dof")
"""Degrees of freedom of a joint's step between a static pose and a scenelet."""
_USUAL_JUMP: Final = float(
    (N_JOINTS - 1) * (DOF + 3) / 2 * (digamma((DOF + 3) / 2) - digamma(DOF / 2))
)
"""Expected cost in nats of all joints but the pelvis if their steps follow the model, so that a
scenelet that joins the motion as well as true ones neither gains nor loses."""


@inlined
def pose_jump(joints: NDArray[np.float64], one: int, other: int, scale: float) -> float:
    """Cost of the change of pose between two frames, in nats of independent joints.

    Minus the log of a trivariate Student-t density of every joint's step relative to the pelvis,
    minus its expected value.

    Parameters
    ----------
    joints : (R, 3, 16) float
        World, metres.
    one, other : int
        Rows of the two frames.
    scale : float
        Metres per axis, for a body of the person's size. It grows with the body; otherwise a
        smaller body would seem to move more smoothly.

    Returns
    -------
    float
    """
    x = joints[other, 0, PELV] - joints[one, 0, PELV]
    y = joints[other, 1, PELV] - joints[one, 1, PELV]
    z = joints[other, 2, PELV] - joints[one, 2, PELV]
    sharpness = 1.0 / (DOF * scale * scale)
    product = 1.0
    for j in range(16):
        dx = joints[other, 0, j] - joints[one, 0, j] - x
        dy = joints[other, 1, j] - joints[one, 1, j] - y
        dz = joints[other, 2, j] - joints[one, 2, j] - z
        # No overflow: even a body of ten metres makes each of the sixteen factors only 10^4.
        product *= 1.0 + (dx * dx + dy * dy + dz * dz) * sharpness
    return 0.5 * (DOF + 3.0) * math.log(product) - _USUAL_JUMP
