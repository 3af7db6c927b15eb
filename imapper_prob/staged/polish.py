"""A whole scene made as probable as it can be: camera, placements and sizes at once.

Each scenelet stands on the floor, so where the camera looks and how far away everybody is hang
together: moving one scenelet at a time, or the camera alone, gets nowhere. The paper minimises
its energy by L-BFGS (Monszpart et al. 2019, section 5), and so does this, in units in which all
unknowns are about as uncertain.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from imapper_prob.models.posterior import State, log_posterior
from imapper_prob.models.problem import Problem
from imapper_prob.models.view import to_floor, to_view

__all__ = ["polish"]

Array = NDArray[np.float64]

_UNITS = np.array([0.01, 0.06, 0.1, 0.05])
"""Of bearing, log depth, yaw (rad), and of log size at the same look: their usual doubt."""
_STEP = 0.02
"""Of differences, in these units: much more than rounding, much less than a kink is wide."""
_NOWHERE = 1e6
"""Nats of a state outside the support, for a search that wants finite numbers."""
_ITERATIONS = 40
_FAR = 20.0
"""Log metres, farther than which a step of the search is outside the support anyway."""


def polish(problem: Problem, state: State) -> State:
    """The most probable state near one, with the same scenelets at the same times."""
    spread = np.sqrt(np.diag(np.linalg.inv(problem.camera_precision)))

    def scene(theta: Array) -> State:
        camera: Array = state.camera + spread * theta[:5]
        where = home + theta[5:].reshape(-1, 4) * _UNITS
        where[:, 3] += where[:, 1]
        where[:, 1] = np.minimum(where[:, 1], _FAR)
        return State(camera, state.items, *to_floor(where), state.latent)

    def cost(theta: Array) -> float:
        return -max(log_posterior(problem, scene(theta)), -_NOWHERE)

    def slope(theta: Array) -> Array:
        steps = _STEP * np.eye(len(theta))
        ahead = np.array([cost(theta + step) for step in steps])
        behind = np.array([cost(theta - step) for step in steps])
        slopes: Array = (ahead - behind) / (2 * _STEP)
        return slopes

    home = to_view(state.placements, state.sizes)
    home[:, 3] -= home[:, 1]
    start = np.zeros(5 + home.size)
    found = minimize(cost, start, jac=slope, method="L-BFGS-B", options={"maxiter": _ITERATIONS})
    return scene(found.x) if found.fun < cost(start) else state
