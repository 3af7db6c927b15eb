"""Chains whose errors are known."""

from __future__ import annotations

import numpy as np


def two_states(rng: np.random.Generator, n: int, *, leave: tuple[float, float]) -> np.ndarray:
    """(n,) a chain on {0, 1} that leaves its states with these probabilities.

    It starts in its stationary distribution, P(1) = leave_0 / (leave_0 + leave_1).
    """
    state = int(rng.random() < leave[0] / sum(leave))
    states = np.zeros(n, int)
    for i, u in enumerate(rng.random(n)):
        states[i] = state
        if u < leave[state]:
            state = 1 - state
    return states


def two_states_error(n: int, *, leave: tuple[float, float]) -> float:
    """Standard error of the share of 1 in n steps: p (1 - p) (1 + r) / (1 - r) / n, rooted."""
    share, r = leave[0] / sum(leave), 1 - sum(leave)
    return float(np.sqrt(share * (1 - share) * (1 + r) / (1 - r) / n))


def autoregressive(
    rng: np.random.Generator, shape: tuple[int, int], *, correlation: float
) -> np.ndarray:
    """(C, N) stationary standard normal chains."""
    draws = rng.standard_normal(shape)
    for i in range(1, shape[1]):
        draws[:, i] *= np.sqrt(1 - correlation**2)
        draws[:, i] += correlation * draws[:, i - 1]
    return draws
