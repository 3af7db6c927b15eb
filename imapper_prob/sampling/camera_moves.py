"""Moves of camera and body; scenelets are reprojected so that they look the same.

Of a pelvis whose height over the floor is a known part of the body, the image and the size of
the body in it leave no choice: they are three numbers, and so are x, y and log size. A camera
that looks a degree lower has the same look some percent nearer. The solver fits with one camera
and chains have many; moves that ignore this propose what no longer fits.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.log_posterior import State
from imapper_prob.models.problem import Problem
from imapper_prob.models.skeleton import PELV
from imapper_prob.samplers.reversible_jump import Proposal

__all__ = [
    "AdaptedCameraWalk",
    "CameraFrame",
    "CameraWalk",
    "CompensatedCameraWalk",
    "DepthScale",
    "FocalScale",
    "GroundPose",
    "middle_heights",
    "reproject",
]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


class ImagePelvis(NamedTuple):
    """Of a scenelet's middle frame: tangents of the pelvis to the right of the image's centre and
    above it, and the body's scale as part of its depth; all at the nominal focal length."""

    right: float
    up: float
    apparent: float


class GroundPose(NamedTuple):
    """Where a scenelet stands, metres, and the log size of its person."""

    x: float
    y: float
    size: float


class CameraFrame:
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

    def look(self, x: float, y: float, size: float, height: float) -> ImagePelvis | None:
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
        return ImagePelvis(by * right, by * up, by * body)

    def stand(self, look: ImagePelvis, height: float) -> GroundPose | None:
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
        return GroundPose(x * depth, y * depth, size)

    def log_volume(self, look: ImagePelvis, size: float) -> float:
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


def reproject(
    before: CameraFrame,
    after: CameraFrame,
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


# ------------------------------------------------------------------------------------------------
# Moves of what is known of camera and body, phi; of most, the scenelets go along.


@dataclass(frozen=True)
class CameraWalk:
    """The nuisance parameters alone, a step of their prior's shape; symmetric."""

    factor: Array
    scales: tuple[float, ...] = (0.1, 0.4, 1.2)
    name: str = "camera"
    reverse: str = "camera"

    def propose(self, rng: np.random.Generator, state: State) -> Proposal[State]:
        """Walk phi; ``factor`` (5, 5) is the Cholesky factor of the prior's covariance."""
        scale = self.scales[int(rng.integers(len(self.scales)))]
        step = scale * self.factor @ rng.standard_normal(len(self.factor))
        return Proposal(replace(state, camera=state.camera + step), 0.0)


@dataclass(frozen=True)
class CompensatedCameraWalk:
    """The same step, and every scenelet stands where it looks as before.

    A camera that looks lower has everything nearer, what is far off most of all: with the camera
    alone or all depths by one factor that is never reached. Each scenelet keeps the image of its
    pelvis and the size of its person there, so the Jacobian is the product of what
    (x, y, log size) are of a look, new over old (:mod:`~imapper_prob.sampling.camera_moves`).
    """

    problem: Problem
    factor: Array
    scales: tuple[float, ...] = (0.1, 0.4, 1.2)
    name: str = "camera-carry"
    reverse: str = "camera-carry"
    _heights: list[float] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_heights", middle_heights(self.problem).tolist())

    def propose(self, rng: np.random.Generator, state: State) -> Proposal[State] | None:
        """Walk phi; impossible where a scenelet would have nowhere to stand."""
        scale = self.scales[int(rng.integers(len(self.scales)))]
        camera = state.camera + scale * self.factor @ rng.standard_normal(len(self.factor))
        found = reproject(
            CameraFrame(state.camera), CameraFrame(camera),
            self._heights, state.items, state.placements, state.sizes,
        )  # fmt: skip
        if found is None:
            return None
        placements, sizes, log_jacobian = found
        changed = replace(state, camera=camera, placements=placements, sizes=sizes)
        return Proposal(changed, log_jacobian)


@dataclass(frozen=True)
class AdaptedCameraWalk(CompensatedCameraWalk):
    """The same, with the shape that camera and body have in the posterior, as far as it is known.

    What the clip says of height, pitch and body is a ridge far narrower than the prior. The scale
    is about 2.4 over the root of the number of coordinates, the best for a Gaussian of this shape
    (Roberts, Gelman & Gilks 1997), and a third of that for where the ridge bends.
    """

    scales: tuple[float, ...] = (0.35, 1.0)
    name: str = "camera-adapted"
    reverse: str = "camera-adapted"


@dataclass(frozen=True)
class DepthScale:
    """Body scale, camera height and the distance of everything together.

    A larger body further away, seen from higher up, looks the same; without this move the
    largest uncertainty of the problem would be crossed in many small steps. The camera's
    elevation and (x, y) of k placements grow by e^d, so the Jacobian is e^((2 k + 1) d).
    """

    scales: tuple[float, ...] = (0.01, 0.04)
    name: str = "depth-scale"
    reverse: str = "depth-scale"

    def propose(self, rng: np.random.Generator, state: State) -> Proposal[State]:
        """Scale body and distances."""
        scale = self.scales[int(rng.integers(len(self.scales)))]
        step = scale * float(rng.standard_normal())
        camera, placements = state.camera.copy(), state.placements.copy()
        camera[1] *= math.exp(step)
        camera[3] += step
        placements[:, :2] *= math.exp(step)
        changed = replace(state, camera=camera, placements=placements)
        return Proposal(changed, (2 * state.n_scenelets + 1) * step)


@dataclass(frozen=True)
class FocalScale:
    """Focal length and the depth of everything together.

    Seen through a longer lens and from further away things look the same but for perspective,
    which says little. Where the focal length was assumed this is most of the doubt of depth.
    The tangent of the pitch shrinks, so that the horizon stays where it was; the angle is small
    and stands for it. Depths y of k placements grow by e^d and the pitch shrinks by it, so the
    Jacobian is e^((k - 1) d).

    Parameters
    ----------
    spread : float
        Standard deviation of the log focal length in the prior, the unit of ``scales``.
    """

    spread: float
    scales: tuple[float, ...] = (0.2, 0.8)
    name: str = "focal-scale"
    reverse: str = "focal-scale"

    def propose(self, rng: np.random.Generator, state: State) -> Proposal[State]:
        """Scale focal length and depths."""
        scale = self.spread * self.scales[int(rng.integers(len(self.scales)))]
        step = scale * float(rng.standard_normal())
        camera, placements = state.camera.copy(), state.placements.copy()
        camera[0] *= math.exp(-step)
        camera[2] += step
        placements[:, 1] *= math.exp(step)
        changed = replace(state, camera=camera, placements=placements)
        return Proposal(changed, (state.n_scenelets - 1) * step)
