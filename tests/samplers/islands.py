"""A target that no local move can cross: labels, each with two narrow places far apart.

A state is a label and a place on the line. Local moves change the label where it stands or
walk a little; between two islands the posterior falls by some 400 nats.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.integrate import quad

from imapper_prob.samplers.reversible_jump import Mixture, Proposal
from imapper_prob.samplers.tempering import POSTERIOR, LogDensityParts

State = tuple[int, float]

# Prior of the labels; centres and weights of each label's islands. All widths are equal.
LABELS = (0.5, 0.2, 0.3)
CENTRES = ((-4.0, 6.0), (-7.0, 2.0), (-1.0, 9.0))
WEIGHTS = ((0.7, 0.3), (1.0, 1.5), (0.5, 2.5))
PRIOR_WIDTH, WIDTH = 5.0, 0.1
START: State = (0, CENTRES[0][0])
N_CELLS = 6


def log_normal(x: float, width: float) -> float:
    return -0.5 * (x / width) ** 2 - math.log(width * math.sqrt(2 * math.pi))


def target(state: State) -> LogDensityParts:
    label, x = state
    logs = [
        math.log(weight) + log_normal(x - centre, WIDTH)
        for weight, centre in zip(WEIGHTS[label], CENTRES[label], strict=True)
    ]
    top = max(logs)
    likelihood = top + math.log(sum(math.exp(value - top) for value in logs))
    return LogDensityParts(math.log(LABELS[label]) + log_normal(x, PRIOR_WIDTH), likelihood)


def cell(state: State) -> int:
    """Which of the six islands a state of the posterior is on."""
    label, x = state
    low, high = CENTRES[label]
    return 2 * label + (x > (low + high) / 2)


def masses() -> np.ndarray:
    """(6,) evidence of each island, by quadrature."""

    def density(x: float, label: int) -> float:
        return math.exp(target((label, x)).at(POSTERIOR))

    return np.array(
        [
            quad(density, centre - 1, centre + 1, args=(label,), points=[centre], epsabs=0)[0]
            for label, centres in enumerate(CENTRES)
            for centre in centres
        ]
    )


@dataclass(frozen=True)
class Walk:
    name = "walk"
    reverse = "walk"
    scales = (0.1, 1.0)

    def propose(self, rng, state):
        label, x = state
        return Proposal((label, x + rng.choice(self.scales) * rng.standard_normal()), 0.0)

    def log_proposal_density(self, old, new):
        if old[0] != new[0]:
            return -math.inf
        return math.log(sum(math.exp(log_normal(new[1] - old[1], s)) / 2 for s in self.scales))


@dataclass(frozen=True)
class Relabel:
    name = "relabel"
    reverse = "relabel"

    def propose(self, rng, state):
        return Proposal((int(rng.integers(len(LABELS))), state[1]), 0.0)

    def log_proposal_density(self, old, new):
        return -math.log(len(LABELS)) if old[1] == new[1] else -math.inf


MIXTURE = Mixture((Walk(), Relabel()), (0.7, 0.3))
