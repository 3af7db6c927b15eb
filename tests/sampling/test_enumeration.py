"""The scene sampler against exact numbers: every assignment of a tiny clip, by quadrature.

Eight frames, three scenelets of six frames: either no scenelet, or one of nine (scenelet,
start). Without furniture nothing depends on the drawn path, and with the camera held fixed
the evidence of each assignment is an integral over one placement.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.stats import norm

from imapper_prob.models.log_posterior import empty_state, log_posterior
from imapper_prob.models.problem import Problem
from imapper_prob.models.settings import ModelSettings
from imapper_prob.samplers.tempering import POSTERIOR
from imapper_prob.sampling.learning import learn
from imapper_prob.sampling.reference import Reference
from imapper_prob.sampling.steps import MOVES, SceneChain, scene_moves
from imapper_prob.sampling.visits import Visits
from tests.models import worlds
from tests.sampling.scenes import random_gains
from tests.sampling.test_moves import chain_error

N_FRAMES, STARTS = 8, (0, 1, 2)


def tiny() -> Problem:
    """A problem whose likelihood is flat enough for a coarse grid, and in two minds about k."""
    settings = ModelSettings(frame_weight=0.01, scenelet_rate=0.015, size_spread=0.03)
    library = worlds.library(objects=False)
    return worlds.problem(N_FRAMES, settings=settings, scenelets=library, seed=2, span=0.0)


@cache
def exact() -> np.ndarray:
    """(10,) probabilities: no scenelet, then scenelet by scenelet its starts 0, 1, 2."""
    problem = tiny()
    empty = empty_state(problem)
    # Out to where nothing is left. The prior of yaws has a peak a tenth of a radian wide: with
    # steps of a quarter it comes out a third too high.
    bearing = np.linspace(-0.25, 0.25, 25)
    log_depth = np.linspace(np.log(1.8), np.log(10.0), 25)
    yaw = np.linspace(-1.5, 1.5, 49)
    # Three points of Gauss and Hermite for the size of the person, of which nothing is abrupt.
    nodes, shares = np.polynomial.hermite_e.hermegauss(3)
    shares = shares / shares.sum() / norm.pdf(nodes) * problem.size_spread
    cell = (bearing[1] - bearing[0]) * (log_depth[1] - log_depth[0]) * (yaw[1] - yaw[0])
    evidence = [np.exp(log_posterior(problem, empty))]
    for scenelet in range(3):
        for start in STARTS:
            total = 0.0
            for r in log_depth:
                depth = np.exp(r)
                for b in bearing:
                    for a in yaw:
                        placement = np.array([b * depth, depth, a])
                        for node, share in zip(nodes, shares, strict=True):
                            size = node * problem.size_spread
                            state = empty.with_item(scenelet, start, placement, size)
                            # dx dy = depth^2 d(bearing) d(log depth)
                            total += share * np.exp(log_posterior(problem, state)) * depth**2
            evidence.append(total * cell)
    return np.array(evidence) / sum(evidence)


def learnt(problem: Problem) -> Reference:
    """Of two scenelets, each met once: the third one is drawn seldom, and so is no scenelet."""
    visits = Visits()
    for scenelet, start in ((0, 1), (2, 2)):
        visits.note(empty_state(problem).with_item(scenelet, start, np.array([0.0, 4.0, 0.1])))
    even = (np.ones((3, 3)) - np.eye(3)) / 2
    return learn(problem, random_gains(problem), even, visits)


@pytest.mark.slow
def test_every_assignment_has_its_exact_probability() -> None:
    """By all moves that leave the camera where it is."""
    problem = tiny()
    assert 0.1 < exact()[0] < 0.9
    moves = scene_moves(problem, learnt(problem), None)
    still = [name in ("replace", "shift", "placement", "path", "redraw") for name in MOVES]
    moves = moves._replace(weights=moves.weights * still)
    chain, rng = SceneChain(problem, moves, empty_state(problem)), np.random.default_rng(8)
    # Some have a probability of .003: enough visits to each that their spread is known.
    visited = []
    for _ in range(300_000):
        items = chain.advance(rng, POSTERIOR, 2)[0].state.items
        visited.append(0 if len(items) == 0 else 1 + 3 * int(items[0, 0]) + int(items[0, 1]))
    for which, probability in enumerate(exact()):
        hit = (np.array(visited[1000:]) == which).astype(float)
        score = (hit.mean() - probability) / chain_error(hit)
        assert abs(score) < 4.5, (which, hit.mean(), probability)
