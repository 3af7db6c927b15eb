"""Moves of what is known of camera and body, phi; of most, the scenelets go along."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.posterior import State
from imapper_prob.models.problem import Problem
from imapper_prob.samplers.kernel import Proposal
from imapper_prob.sampling.looks import View, middle_heights, seen_alike

__all__ = ["CameraCarry", "CameraWalk", "DepthScale", "FocalScale"]

Array = NDArray[np.float64]


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
class CameraCarry:
    """The same step, and every scenelet stands where it looks as before.

    A camera that looks lower has everything nearer, what is far off most of all: with the camera
    alone or all depths by one factor that is never reached. Each scenelet keeps the image of its
    pelvis and the size of its person there, so the Jacobian is the product of what
    (x, y, log size) are of a look, new over old (:mod:`~imapper_prob.sampling.looks`).
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
        found = seen_alike(
            View(state.camera), View(camera),
            self._heights, state.items, state.placements, state.sizes,
        )  # fmt: skip
        if found is None:
            return None
        placements, sizes, log_jacobian = found
        changed = replace(state, camera=camera, placements=placements, sizes=sizes)
        return Proposal(changed, log_jacobian)


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
