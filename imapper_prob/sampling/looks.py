"""What a scenelet looks like, and where it has to stand to look like that through another camera.

Of a pelvis whose height over the floor is a known part of the body, the image and the size of
the body in it leave no choice: they are three numbers, and so are x, y and log size. A camera
that looks a degree lower has the same look some percent nearer. The solver fits with one camera
and chains have many; moves that ignore this propose what no longer fits.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.problem import Problem
from imapper_prob.models.skeleton import PELV

__all__ = ["Look", "Stand", "View", "middle_heights", "seen_alike"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


class Look(NamedTuple):
    """Of a scenelet's middle frame: tangents of the pelvis to the right of the image's centre and
    above it, and the body's scale as part of its depth; all at the nominal focal length."""

    right: float
    up: float
    apparent: float


class Stand(NamedTuple):
    """Where a scenelet stands, metres, and the log size of its person."""

    x: float
    y: float
    size: float


class View:
    """One camera.

    Parameters
    ----------
    camera : (5,) float
        phi: pitch (rad), elevation (m), log focal scale, log body scale, roll (rad).
    """

    def __init__(self, camera: Array) -> None:
        pitch, self.elevation, log_focal, self.log_body, roll = camera.tolist()
        cp, sp, cr, sr = math.cos(pitch), math.sin(pitch), math.cos(roll), math.sin(roll)
        # The camera's axes in the world: to the right, forward, up.
        self._right = (cr, -sp * sr, cp * sr)
        self._forward = (0.0, cp, sp)
        self._up = (-sr, -sp * cr, cp * cr)
        self._focal = math.exp(log_focal)

    def look(self, x: float, y: float, size: float, height: float) -> Look | None:
        """How somebody looks whose pelvis is ``height`` of the reference body above (x, y).

        None behind the camera.
        """
        body = math.exp(self.log_body + size)
        z = body * height - self.elevation
        depth = self._forward[1] * y + self._forward[2] * z
        if depth <= 0:
            return None
        right, up = (a[0] * x + a[1] * y + a[2] * z for a in (self._right, self._up))
        by = self._focal / depth
        return Look(by * right, by * up, by * body)

    def stand(self, look: Look, height: float) -> Stand | None:
        """Where and how large somebody is who looks so; None where that is nowhere ahead."""
        right, up = look.right / self._focal, look.up / self._focal
        x, y, z = (
            right * r + f + up * u
            for r, f, u in zip(self._right, self._forward, self._up, strict=True)
        )
        # Body times height is as far above the floor as the ray has come down to.
        drop = look.apparent / self._focal * height - z
        if not drop * self.elevation > 0 or y <= 0:
            return None
        depth = self.elevation / drop
        size = math.log(look.apparent / self._focal * depth) - self.log_body
        return Stand(x * depth, y * depth, size)

    def log_volume(self, look: Look, size: float) -> float:
        """log |d(right, up, log apparent) / d(x, y, size)|.

        That is f^2 h / depth^3 for a focal scale f and an elevation h: rays meet the plane in
        which the pelvis is at the angle h less its height over the depth, and larger people
        raise it.
        """
        depth = self._focal * math.exp(self.log_body + size) / look.apparent
        return math.log(self._focal**2 * abs(self.elevation) / depth**3)


def middle_heights(problem: Problem) -> Array:
    """(L,) height of the pelvis in each scenelet's middle frame, metres of the reference body."""
    middles = problem.joint_first[:-1] + problem.lengths // 2
    heights: Array = problem.joints[middles, PELV, 2]
    return heights


def seen_alike(
    before: View,
    after: View,
    heights: Sequence[float],
    items: Ints,
    placements: Array,
    sizes: Array,
) -> tuple[Array, Array, float] | None:
    """Where scenelets stand that look through one camera as they did through another.

    Parameters
    ----------
    before, after : View
    heights : sequence of L float
        :func:`middle_heights`.
    items : (k, 2) int
    placements : (k, 3) float
    sizes : (k,) float
        Of the scenelets, as a state has them.

    Returns
    -------
    placements : (k, 3) float
    sizes : (k,) float
    log_jacobian : float
        Of (x, y, log size) after over before.

    None where one of them would have nowhere to stand.
    """
    placements, sizes, log_jacobian = placements.copy(), sizes.copy(), 0.0
    for k, scenelet in enumerate(items[:, 0].tolist()):
        height, size = heights[scenelet], float(sizes[k])
        x, y, _ = placements[k].tolist()
        look = before.look(x, y, size, height)
        stand = None if look is None else after.stand(look, height)
        if look is None or stand is None:
            return None
        log_jacobian += before.log_volume(look, size) - after.log_volume(look, stand.size)
        placements[k, :2] = stand.x, stand.y
        sizes[k] = stand.size
    return placements, sizes, log_jacobian
