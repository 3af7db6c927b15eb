"""How somebody looks through a camera, and where somebody stands who looks so.

Of a pelvis whose height over the floor is a known part of the body, the image and the size of
the body in it leave no choice: they are three numbers, and so are x, y and log size. A camera
that looks a degree lower has the same look some percent nearer. The solver fits with one camera
and chains have many; moves that ignore this propose what no longer fits.

A look is (right, up, apparent) of a scenelet's pelvis: tangents to the right of the image's centre
and above it, and the body's scale as part of its depth; all at the nominal focal length. Where
there is no look, or nowhere to stand, the third number is not a number.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.problem import Problem
from imapper_prob.models.skeleton import PELV
from imapper_prob.sampling.jit import compiled
from imapper_prob.sampling.scene import Scene

__all__ = ["log_volume", "look", "middle_heights", "reprojected", "stand"]

Array = NDArray[np.float64]
Look = tuple[float, float, float]


@compiled
def look(camera: Array, x: float, y: float, size: float, height: float) -> Look:
    """How somebody looks whose pelvis is ``height`` of the reference body above (x, y).

    Parameters
    ----------
    camera : (5,) float
        Pitch (rad), elevation (m), log focal scale, log body scale, roll (rad).
    x, y : float
        Metres.
    size : float
        Log size of the person.
    height : float
        Metres of the reference body.

    Returns
    -------
    right, up, apparent : float
        The last is NaN behind the camera.
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
def stand(camera: Array, seen: Look, height: float) -> tuple[float, float, float]:
    """Where and how large somebody is who looks so.

    Parameters
    ----------
    camera : (5,) float
    seen : right, up, apparent
    height : float
        Metres of the reference body.

    Returns
    -------
    x, y, size : float
        Metres, and the log size; the last is NaN where that is nowhere ahead.
    """
    cp, sp, cr, sr = (
        math.cos(camera[0]), math.sin(camera[0]), math.cos(camera[4]), math.sin(camera[4]),
    )  # fmt: skip
    by = math.exp(-camera[2])
    right, up, apparent = by * seen[0], by * seen[1], by * seen[2]
    rise = sr * right + cr * up
    ahead = cp - sp * rise
    # Body times height is as far above the floor as the ray has come down to.
    drop = apparent * height - (sp + cp * rise)
    if not drop * camera[1] > 0.0 or ahead <= 0.0:
        return 0.0, 0.0, math.nan
    depth = camera[1] / drop
    x = (cr * right - sr * up) * depth
    return x, ahead * depth, math.log(apparent * depth) - camera[3]


@compiled
def log_volume(camera: Array, apparent: float, size: float) -> float:
    """log |d(right, up, log apparent) / d(x, y, size)|.

    That is f^2 h / depth^3 for a focal scale f and an elevation h: rays meet the plane in
    which the pelvis is at the angle h less its height over the depth, and larger people
    raise it.

    Parameters
    ----------
    camera : (5,) float
    apparent : float
        Of the look.
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
def reprojected(
    heights: Array, scene: Scene, before: Array, after: Array, which: NDArray[np.bool_]
) -> tuple[Array, Array, float]:
    """Where scenelets stand that look through one camera as they did through another.

    Parameters
    ----------
    heights : (L,) float
        :func:`middle_heights`.
    scene : Scene
    before, after : (5,) float
        Cameras.
    which : (k,) bool
        Scenelets of the scene that are meant; the others stay.

    Returns
    -------
    placements : (k, 3) float
    sizes : (k,) float
    log_jacobian : float
        Of (x, y, log size) after over before; NaN where one of them would have nowhere to stand.
    """
    placements, sizes, log_jacobian = scene.placements.copy(), scene.sizes.copy(), 0.0
    for k in range(len(sizes)):
        if not which[k]:
            continue
        height = heights[scene.items[k, 0]]
        seen = look(before, placements[k, 0], placements[k, 1], sizes[k], height)
        x, y, size = stand(after, seen, height)
        log_jacobian += log_volume(before, seen[2], sizes[k]) - log_volume(after, seen[2], size)
        placements[k, 0], placements[k, 1], sizes[k] = x, y, size
    return placements, sizes, log_jacobian
