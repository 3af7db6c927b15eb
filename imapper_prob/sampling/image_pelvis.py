"""The pelvis of a person in the image of a camera, and the inverse: position and size from it.

If the height of the pelvis is a known multiple of the body's size, its image position and the
apparent size of the body determine x, y and log size: three numbers each. If the camera is tilted
by a degree, the same image belongs to a position some percent nearer. The solver uses one camera
and chains use many, so moves must account for this.

An image pelvis is (right, up, apparent): tangents to the right of the image centre and above it,
and the body scale divided by the depth; all at the nominal focal length. If there is no valid image
or position, the third number is NaN.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.problem import Problem
from imapper_prob.models.skeleton import PELV
from imapper_prob.models.view import floor_point, seen_point
from imapper_prob.sampling.jit import compiled, inner_inlined
from imapper_prob.sampling.scene import StateArrays

__all__ = [
    "log_image_jacobian",
    "middle_heights",
    "place_from_image",
    "project_pelvis",
    "reproject_pelvis",
    "reproject_placements",
]

Array = NDArray[np.float64]
ImagePelvis = tuple[float, float, float]


@compiled
def project_pelvis(camera: Array, x: float, y: float, size: float, height: float) -> ImagePelvis:
    """Image pelvis of a person at (x, y) whose pelvis has a given height in the reference body.

    Parameters
    ----------
    camera : (5,) float
        Pitch (rad), elevation (m), log focal scale, log body scale, roll (rad).
    x, y : float
        Metres.
    size : float
        Log size of the person.
    height : float
        Height of the pelvis in the reference body, metres.

    Returns
    -------
    right, up, apparent : float
        The last is NaN at or behind the camera.
    """
    cp, sp, cr, sr = (
        math.cos(camera[0]), math.sin(camera[0]), math.cos(camera[4]), math.sin(camera[4]),
    )  # fmt: skip
    body = math.exp(camera[3] + size)
    z = body * height - camera[1]
    depth = cp * y + sp * z
    if depth <= 0.0:
        return 0.0, 0.0, math.nan
    by = math.exp(camera[2]) / depth
    rise = cp * z - sp * y
    return by * (cr * x + sr * rise), by * (cr * rise - sr * x), by * body


@compiled
def place_from_image(camera: Array, seen: ImagePelvis, height: float) -> tuple[float, float, float]:
    """Position and size of a person with a given image pelvis.

    Parameters
    ----------
    camera : (5,) float
    seen : right, up, apparent
    height : float
        Height of the pelvis in the reference body, metres.

    Returns
    -------
    x, y, size : float
        Metres, and the log size; the last is NaN if there is no such position ahead of the camera.
    """
    cp, sp, cr, sr = (
        math.cos(camera[0]), math.sin(camera[0]), math.cos(camera[4]), math.sin(camera[4]),
    )  # fmt: skip
    by = math.exp(-camera[2])
    right, up, apparent = by * seen[0], by * seen[1], by * seen[2]
    rise = sr * right + cr * up
    ahead = cp - sp * rise
    # The depth at which the ray has the height of the pelvis above the floor.
    drop = apparent * height - (sp + cp * rise)
    if not drop * camera[1] > 0.0 or ahead <= 0.0:
        return 0.0, 0.0, math.nan
    depth = camera[1] / drop
    x = (cr * right - sr * up) * depth
    return x, ahead * depth, math.log(apparent * depth) - camera[3]


@compiled
def log_image_jacobian(camera: Array, apparent: float, size: float) -> float:
    """log |d(right, up, log apparent) / d(x, y, size)|.

    It is log(f^2 h / depth^3) for the focal scale f and the elevation h. Rays meet the plane of the
    pelvis at the angle (h - height) / depth, and a larger person raises that plane.

    Parameters
    ----------
    camera : (5,) float
    apparent : float
        Third number of the image pelvis.
    size : float
        Log size of the person.

    Returns
    -------
    float
    """
    log_depth = camera[2] + camera[3] + size - math.log(apparent)
    return float(2.0 * camera[2] + math.log(abs(camera[1])) - 3.0 * log_depth)


def middle_heights(problem: Problem) -> Array:
    """(L,) height of the pelvis in each scenelet's middle frame, metres of the reference body.

    Parameters
    ----------
    problem : Problem

    Returns
    -------
    (L,) float
    """
    middles = problem.joint_first[:-1] + problem.lengths // 2
    heights: Array = problem.joints[middles, PELV, 2]
    return heights


@compiled
def reproject_placements(
    heights: Array, scene: StateArrays, before: Array, after: Array, which: NDArray[np.bool_]
) -> tuple[Array, Array, float]:
    """Move scenelets so that their pelvis has the same image in another camera.

    Parameters
    ----------
    heights : (L,) float
        :func:`middle_heights`.
    scene : StateArrays
    before, after : (5,) float
        Camera parameters.
    which : (k,) bool
        Scenelets of the scene to move; the others stay.

    Returns
    -------
    placements : (k, 3) float
    sizes : (k,) float
    log_jacobian : float
        Log Jacobian of (x, y, log size), after over before; NaN if a scenelet has no valid
        position.
    """
    placements, sizes, log_jacobian = scene.placements.copy(), scene.sizes.copy(), 0.0
    for k in range(len(sizes)):
        if not which[k]:
            continue
        height = heights[scene.items[k, 0]]
        seen = project_pelvis(before, placements[k, 0], placements[k, 1], sizes[k], height)
        x, y, size = place_from_image(after, seen, height)
        log_jacobian += log_image_jacobian(before, seen[2], sizes[k]) - log_image_jacobian(
            after, seen[2], size
        )
        placements[k, 0], placements[k, 1], sizes[k] = x, y, size
    return placements, sizes, log_jacobian


@inner_inlined
def reproject_pelvis(height: float, where: Array, before: Array, after: Array) -> None:
    """Transform a position in place so that it has the same image in another camera, if possible.

    Parameters
    ----------
    height : float
        Height of the pelvis, metres of the reference body.
    where : (4,) float
        Bearing, log depth, yaw, log size.
    before : (5,) float
        Camera parameters.
    after : (5,) float
        Camera parameters.
    """
    x, y = floor_point(where[0], where[1])
    x, y, size = place_from_image(after, project_pelvis(before, x, y, where[3], height), height)
    if not math.isnan(size):
        where[0], where[1] = seen_point(x, y)
        where[3] = size
