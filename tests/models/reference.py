"""Every term of the log-posterior in plain numpy, slow and obvious.

Numbers in brackets are those of ``docs/explanation/model.md``. Nothing here calls a compiled
kernel."""

from __future__ import annotations

import math
from collections import namedtuple
from itertools import combinations, product

import numpy as np
from scipy.special import digamma, expit
from scipy.stats import multivariate_normal, norm

from imapper_prob.models.kernels.intersection import DISPLACED, PROBABILITIES
from imapper_prob.models.kernels.path import DOF
from imapper_prob.models.log_posterior import State
from imapper_prob.models.problem import TERMS, Problem
from imapper_prob.models.settings import (
    LEVEL,
    LOWEST_CAMERA,
    NEAREST,
    NOTHING_IN_SIGHT,
    OPAQUE,
    STEEPEST_CAMERA,
)
from imapper_prob.models.skeleton import HEAD, LANK, LHIP, LKNE, MIRROR, PELV, RANK, RHIP, RKNE

Array = np.ndarray
Box = namedtuple("Box", ("centre", "half", "yaw", "item", "label", "facing"))
"""A cuboid in the world, metres and radians; label and facing are of its object."""
Scene = namedtuple("Scene", ("item_of", "joints", "boxes"))
"""Item that covers a frame, -1 if free; joints (T, 16, 3), metres; list of boxes."""


def reference(problem: Problem, state: State) -> dict[str, float]:
    """The summands of (3) by name; the first is -inf outside the support."""
    values, item_of = dict.fromkeys(TERMS, 0.0), items_by_frame(problem, state)
    if item_of is None:
        return values | {"camera": -math.inf}
    scene, values["path"] = scene_of(problem, state, item_of)
    covariance = np.linalg.inv(problem.camera_precision)
    values["camera"] = multivariate_normal.logpdf(state.camera, problem.camera_mean, covariance)
    values["assignment"] = sum(problem.log_rate[scenelet] for scenelet, _ in state.items)  # (5)
    terms = detections, free_pose, smoothness, collision, motion, ground, support
    for term in (placement, *terms) if problem.likelihood else (placement,):
        values[term.__name__] = term(problem, state, scene)
    return values


def camera_axes(phi: Array) -> Array:
    """World frame, (1): right, depth and up as rows, along the axes of the world."""
    (cp, sp), (cr, sr) = ((np.cos(angle), np.sin(angle)) for angle in (phi[0], phi[4]))
    aside, level = np.array([1.0, 0.0, 0.0]), np.array([0.0, -sp, cp])
    return np.stack([cr * aside + sr * level, [0.0, cp, sp], -sr * aside + cr * level])


def in_view(phi: Array, points: Array) -> tuple[Array, Array, Array]:
    """Right, depth and up in the camera frame of points (..., 3) of the world, metres."""
    right, depth, up = np.moveaxis((points - [0.0, 0.0, phi[1]]) @ camera_axes(phi).T, -1, 0)
    return right, np.maximum(depth, NEAREST), up


def turned(points: Array, yaw: float) -> Array:
    """Points (..., 3) rotated about the z axis."""
    c, s = np.cos(yaw), np.sin(yaw)
    return points @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


def items_by_frame(problem: Problem, state: State) -> Array | None:
    """State: (T,) which item covers a frame, -1 if none; nothing if the state is impossible."""
    pitch, height, _, _, roll = state.camera
    if not (height > LOWEST_CAMERA and max(abs(pitch), abs(roll)) < STEEPEST_CAMERA):
        return None
    item_of, free = np.full(problem.n_frames, -1), set(range(problem.n_frames))
    for i, (scenelet, start) in enumerate(state.items):
        own = np.arange(start, start + problem.lengths[scenelet])
        if not free.issuperset(own) or problem.path_starts[own[1:]].any():
            return None
        free -= set(own)
        item_of[own] = i
    return item_of


def scene_of(problem: Problem, state: State, item_of: Array) -> tuple[Scene, float]:
    """Person and furniture in the world, and the evidence of the path, nats."""
    phi, joints, boxes = state.camera, np.full((problem.n_frames, 16, 3), np.nan), []
    for i, (scenelet, start) in enumerate(state.items):
        x, y, yaw = state.placements[i]
        scale, origin = np.exp(phi[3] + state.sizes[i]), np.array([x, y, 0.0])
        poses = problem.joints[slice(*problem.joint_first[scenelet : scenelet + 2])]
        joints[start : start + len(poses)] = scale * turned(poses, yaw) + origin
        for b in range(*problem.box_first[scenelet : scenelet + 2]):
            place, half, own = np.split(problem.boxes[b], [3, 6])
            label, facing = problem.box_label[b], problem.box_yaw[b] + yaw
            centre = scale * turned(place, yaw) + origin
            boxes.append(Box(centre, scale * half, own[0] + yaw, i, label, facing))
    right, depth, _ = in_view(phi, joints[:, PELV])
    known = np.stack([right / depth, np.log(depth)])
    paths = [path_of(problem, state, item_of, known[axis], axis) for axis in range(2)]
    for t in np.flatnonzero(item_of < 0):
        bearing, log_depth = (path[t] for path, _ in paths)
        pelvis = np.exp(log_depth) * np.array([bearing, 1.0, problem.lift[t] / np.exp(phi[2])])
        pose = pelvis + np.exp(phi[3]) * problem.poses[t]
        joints[t] = pose @ camera_axes(phi) + np.array([0.0, 0.0, phi[1]])
    return Scene(item_of, joints, boxes), sum(nats for _, nats in paths)


def path_of(problem: Problem, state: State, item_of: Array, known: Array, axis: int) -> tuple:
    """Path, (6) to (8), of bearing (axis 0) or log depth (1): drawn (T,), and evidence, nats."""
    n, (focal, body) = problem.n_frames, state.camera[2:4]
    centre, scale = problem.path_centre[:, axis], problem.path_scale[:, axis]
    # The same pixels under another focal length and body.
    factor, offset = (np.exp(-focal), 0.0) if axis == 0 else (1.0, focal + body)
    centre, scale = factor * centre + offset, factor * scale
    total, minus_product = problem.path_mean[axis, 1]  # r + s and -r s, as tabulated
    q = (1 + minus_product) * ((1 - minus_product) ** 2 - total**2) / (1 - minus_product)
    psi, stationary = np.ones(n + 2), np.ones(n + 2)
    psi[1], stationary[1] = total, total / (1 - minus_product)
    for row, k in product((psi, stationary), range(2, n + 2)):
        row[k] = total * row[k - 1] + minus_product * row[k - 2]

    stay = np.where(axis == 1, problem.path_stay, -1)
    goes_on = (stay >= 0) & (stay == np.roll(stay, 1)) & ~problem.path_starts

    def steps(known: int, t: int) -> int:
        """From a frame to a later one; along the view at most `stay_steps` in each stay."""
        runs = np.split(
            np.arange(known + 1, t + 1), np.flatnonzero(~goes_on[known + 2 : t + 1]) + 1
        )
        return sum(
            min(len(run), problem.stay_steps) if goes_on[run[1:]].any() else len(run)
            for run in runs
        )

    def covariance(k: int | None, apart: int) -> float:
        """Of the errors of two frames, the first of which is k frames after what is known."""
        return stationary[apart] if k is None else q * (psi[:k] @ psi[apart : apart + k])

    error, path, evidence, delta = (known - centre) / scale, known.copy(), 0.0, np.zeros(n)
    for t in range(n - 1, -1, -1):
        if item_of[t] >= 0 and t > 0 and item_of[t] == item_of[t - 1]:
            continue
        begin, a = max(np.flatnonzero(problem.path_starts[: t + 1])), t - 1
        while a >= 0 and item_of[a] < 0:
            a -= 1
        k, mean = (steps(a, t) if a >= begin else None), 0.0
        if k is not None:  # (7)
            mean = psi[k] * error[a] + minus_product * psi[k - 1] * error[a - 1]
        if item_of[t] >= 0:  # (8)
            delta[t] = error[t] - mean
            evidence += norm.logpdf(delta[t], 0.0, np.sqrt(covariance(k, 0))) - np.log(scale[t])
            continue
        # The frames that follow, up to a scenelet's first, by how many steps they are away.
        ahead: dict[int, int] = {}
        for u in range(t + 1, n):
            if problem.path_starts[u] or (u > t + 1 and item_of[u - 1] >= 0):
                break
            ahead.setdefault(steps(a, u) - steps(a, t), u)
        if 0 in ahead:
            delta[t], path[t] = delta[ahead[0]], centre[t] + scale[t] * (mean + delta[ahead[0]])
            continue
        apart = list(ahead)[:2]
        here = np.array([covariance(k, u) for u in apart])
        there = np.zeros((len(apart), len(apart)))
        for (i, u), (j, v) in product(enumerate(apart), repeat=2):
            there[i, j] = covariance(k and k + min(u, v), abs(u - v))
        weights = np.linalg.solve(there, here)
        noise = np.sqrt(covariance(k, 0) - weights @ here) * state.latent[t, axis]
        delta[t] = weights @ delta[[ahead[u] for u in apart]] + noise
        path[t] = centre[t] + scale[t] * (mean + delta[t])
    return path, evidence


def placement(problem: Problem, state: State, scene: Scene) -> float:
    """Placement, facing and size, (9), (9a) and (10)."""
    total, (pitch, *_, roll) = 0.0, state.camera
    for i, (scenelet, start) in enumerate(state.items):
        _, depth, _ = in_view(state.camera, scene.joints[start, PELV])
        total += np.log(np.cos(roll) * np.cos(pitch) / depth**2)
        total += norm.logpdf(state.sizes[i], 0.0, problem.size_spread)
        own = problem.joint_facing[slice(*problem.joint_first[scenelet : scenelet + 2])]
        path = problem.path_facing[start : start + len(own)]
        mean = (path @ [1, 1j] * (own @ [1, -1j])).sum()
        rho = np.exp(-problem.facing_spread) if abs(mean) > 1e-9 else 0.0
        turn = np.cos(state.placements[i, 2] - np.angle(mean))
        total += np.log((1 - rho**2) / (2 * np.pi * (1 + rho**2 - 2 * rho * turn)))
    return total


def clearance(eye: Array, joints: Array, boxes: list[Box]) -> Array:
    """Visibility, v, metres: over each line of sight the least of max_i |p_i| - h_i."""
    least = np.full(joints.shape[:-1], NOTHING_IN_SIGHT)
    for box in boxes:
        start, end = (turned(p - box.centre, -box.yaw) for p in (eye, joints))
        # Six straight lines: the least of their greatest is at an end or where two of them meet.
        rises = np.concatenate([end - start, start - end], -1)
        begins = np.concatenate([start - box.half, -start - box.half])
        places = [np.zeros(least.shape), np.ones(least.shape)]
        for i, j in combinations(range(6), 2):
            gap = rises[..., i] - rises[..., j]
            places.append(np.clip((begins[j] - begins[i]) / np.where(gap, gap, np.inf), 0, 1))
        value = np.min([(begins + at[..., None] * rises).max(-1) for at in places], axis=0)
        thin = np.where(value < 0, max(1.0, OPAQUE / box.half.min()), 1.0)
        least = np.minimum(least, thin * value)
    return least


def frames(problem: Problem, state: State, scene: Scene) -> Array:
    """Detections, (11): (T, 2) log-density of each frame as it is, and with sides exchanged."""
    phi, epsilon = state.camera, problem.visibility_error
    v = clearance(np.array([0.0, 0.0, phi[1]]), scene.joints, scene.boxes)
    m = epsilon + (1 - 2 * epsilon) * expit(v / problem.sight_width)
    right, depth, up = in_view(phi, scene.joints)
    fx, fy = np.exp(phi[2]) * np.array([problem.fx, problem.fy])
    pixels = np.stack([problem.cx + fx * right / depth, problem.cy - fy * up / depth], -1)  # (2)
    result = np.zeros((problem.n_frames, 2))
    for t, k in np.argwhere(problem.used):
        for side, j in enumerate((k, MIRROR[k])):
            density, i = problem.static_density[side, t, k], scene.item_of[t]
            if i >= 0:
                sigma = np.exp(phi[3] + state.sizes[i]) * problem.pose_tolerance[j]
                rho = fx * sigma / depth[t, j]
                scale2, nu = problem.error_scale[t, k] ** 2 + rho**2, problem.error_dof[t, k]
                error2 = ((problem.keypoints[t, k] - pixels[t, j]) ** 2).sum()
                student = (1 + error2 / (nu * scale2)) ** (-(nu + 2) / 2)
                density = problem.confidence_density[t, k] * student / (2 * np.pi * scale2)
            result[t, side] += np.log([1 - m[t, j], m[t, j]] @ density)  # of hidden and of seen
    return result


def detections(problem: Problem, state: State, scene: Scene) -> float:
    """Left and right, (12), by the forward recursion over both values of s_t."""
    by_frame = problem.frame_weight * frames(problem, state, scene)
    begins, ends = problem.flip_begins, problem.flip_ends
    anew = np.log([[ends / (begins + ends), begins / (begins + ends)]] * 2)
    onwards, forward = np.log([[1 - begins, begins], [ends, 1 - ends]]), np.array([0.0, -np.inf])
    for begins_anew, frame in zip(problem.path_starts, by_frame, strict=True):
        forward = frame + np.logaddexp(*forward[:, None] + (anew if begins_anew else onwards))
    return np.logaddexp(*forward)


def free_pose(problem: Problem, _: State, scene: Scene) -> float:
    """Free frames, (13)."""
    return -problem.frame_weight * problem.free_cost[scene.item_of < 0].sum()


def smoothness(problem: Problem, state: State, scene: Scene) -> float:
    """Smoothness, (14)."""
    nats, nu = 0.0, DOF
    usual = 15 * (nu + 3) / 2 * (digamma((nu + 3) / 2) - digamma(nu / 2))
    for t in range(1, problem.n_frames):
        if scene.item_of[t] != scene.item_of[t - 1] and not problem.path_starts[t]:
            pose, before = (scene.joints[u] - scene.joints[u, PELV] for u in (t, t - 1))
            step2 = ((pose - before) ** 2).sum(-1) / np.exp(2 * state.camera[3])
            nats += ((nu + 3) / 2 * np.log1p(step2 / (nu * problem.joint_step**2))).sum() - usual
    return -problem.smoothness_cost * nats


def displaced(depths: list[float], spread: float, unit: float) -> float:
    """-log <exp(-unit sum max(0, d - delta))> of (15) and (16), delta on five nodes."""
    costs = [unit * sum(max(0.0, d - z * spread) for d in depths) for z in DISPLACED]
    return -np.logaddexp.reduce(np.log(PROBABILITIES) - costs)


def depth_on_floor(one: Box, other: Box) -> float:
    """By how little two level boxes have to move on the floor to part; 0 if they are apart."""
    tops, bottoms = ([b.centre[2] + sign * b.half[2] for b in (one, other)] for sign in (1, -1))
    if min(tops) - max(bottoms) <= LEVEL:
        return 0.0
    corners, depths = np.array([*product((-1, 1), (-1, 1), (0,))]), []
    for yaw in (one.yaw, one.yaw + np.pi / 2, other.yaw, other.yaw + np.pi / 2):
        axis = turned(np.array([1.0, 0.0, 0.0]), yaw)
        reach = sum((turned(b.half * corners, b.yaw) @ axis).max() for b in (one, other))
        depths.append(reach - abs((one.centre - other.centre) @ axis))
    return max(0.0, min(depths))


def collision(problem: Problem, state: State, scene: Scene) -> float:
    """Objects in each other, (15)."""
    depths = dict.fromkeys(combinations(range(len(state.items)), 2), 0.0)
    for one, other in combinations(scene.boxes, 2):
        aligned = np.cos(one.facing - other.facing) > np.cos(problem.merge_angle)
        once = one.label == other.label and (aligned or not problem.label_front[one.label])
        if one.item != other.item and not once:
            depths[one.item, other.item] += depth_on_floor(one, other)
    spread = np.sqrt(2) * problem.furniture_spread
    return -sum(displaced([d], spread, problem.collision_cost) for d in depths.values())


def depth_in(box: Box, pose: Array) -> float:
    """How deep the deepest of trunk, thighs and shins of a pose (16, 3) is in a box, metres."""
    columns = [(pose[PELV, :2], pose[PELV, 2] - 0.05, pose[HEAD, 2])]
    for part in pose[[[RHIP, RKNE], [RKNE, RANK], [LHIP, LKNE], [LKNE, LANK]]]:
        columns.append((part[:, :2].mean(0), part[:, 2].min(), part[:, 2].max()))
    deepest, (bottom, top) = 0.0, (box.centre[2] + sign * box.half[2] for sign in (-1, 1))
    for place, low, high in columns:
        u, v, _ = np.abs(turned(np.append(place, 0.0) - box.centre, -box.yaw))
        deepest = max(deepest, min(top - low, high - bottom, box.half[0] - u, box.half[1] - v))
    return deepest


def motion(problem: Problem, state: State, scene: Scene) -> float:
    """Motion through objects, (16)."""
    cost, unit = 0.0, problem.frame_weight * problem.motion_cost
    for i in range(len(state.items)):
        others = scene.joints[problem.used.any(1) & (scene.item_of != i)]
        own = [box for box in scene.boxes if box.item == i]
        depths = [sum(depth_in(box, pose) for box in own) for pose in others]
        cost += displaced(depths, problem.furniture_spread, unit)
    return -cost


def ground(problem: Problem, _: State, scene: Scene) -> float:
    lowest = scene.joints[problem.used.any(1), :, 2].min(1, initial=0.0)
    return problem.motion_cost * problem.frame_weight * lowest.sum()  # (17)


def support(problem: Problem, state: State, _: Scene) -> float:
    """Support, (17a)."""
    off_feet = {t for k, start in state.items for t in range(*(problem.lowered[k] + start))}
    return -sum(b for first, end, b in problem.stays if off_feet.isdisjoint(np.arange(first, end)))
