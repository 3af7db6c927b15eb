"""The scene sampler against exact numbers: every assignment of a tiny clip, by quadrature.

Eight frames, three scenelets of six frames: either no scenelet, or one of nine (scenelet,
start). Without furniture nothing depends on the drawn path, and with the camera held fixed
the evidence of each assignment is an integral over one placement.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from itertools import islice

import numpy as np
import pytest
from scipy.stats import norm

from imapper_prob.models.log_posterior import State, empty_state, log_posterior
from imapper_prob.models.problem import Problem
from imapper_prob.models.settings import ModelSettings
from imapper_prob.samplers.reversible_jump import ChainState, Mixture, StepInfo, sample
from imapper_prob.sampling.learning import learn
from imapper_prob.sampling.moves import (
    Birth,
    Death,
    PathRefresh,
    PlacementWalk,
    ReplaceNearby,
    ReplaceSimilar,
    Shift,
)
from imapper_prob.sampling.proposals import Candidates, Proposals
from imapper_prob.sampling.reference import Reference
from imapper_prob.sampling.reference_moves import StretchRedraw
from imapper_prob.sampling.replace_moves import Replace, ReplaceAndShift
from imapper_prob.sampling.visits import Visits
from tests.models import worlds
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
    yaw = np.linspace(-1.5, 1.5, 61)
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


def candidates() -> Candidates:
    """All three in the middle of every start."""
    places = np.tile([0.0, 4.0, 0.0], (3, 3, 1))
    weights = np.array([[1.0, 1, 2]] * 3)
    return Candidates(np.array(STARTS) + 3, places, np.zeros((3, 3)), weights)


@pytest.mark.slow
def test_every_assignment_has_its_exact_probability() -> None:
    problem = tiny()
    expected = exact()
    assert 0.1 < expected[0] < 0.9
    proposals = Proposals(problem, candidates())
    even = (np.ones((3, 3)) - np.eye(3)) / 2
    moves = (
        Birth(proposals),
        Death(proposals),
        ReplaceNearby(proposals),
        Replace(proposals),
        ReplaceAndShift(proposals, reach=1),
        ReplaceSimilar(problem, even),
        Shift(problem),
        PlacementWalk(),
        PathRefresh(),
    )
    chain = sample(
        np.random.default_rng(8),
        empty_state(problem),
        log_density_fn=lambda s: log_posterior(problem, s),
        mixture=Mixture(moves, (0.2, 0.15, 0.1, 0.05, 0.05, 0.1, 0.1, 0.2, 0.1)),
    )
    check(chain, steps=150_000)


def learnt(problem: Problem) -> Reference:
    """Of two scenelets, each met once: the third one is drawn seldom, and so is no scenelet."""
    visits = Visits()
    for scenelet, start in ((0, 1), (2, 2)):
        visits.note(empty_state(problem).with_item(scenelet, start, np.array([0.0, 4.0, 0.1])))
    even = (np.ones((3, 3)) - np.eye(3)) / 2
    return learn(problem, candidates(), even, visits)


@pytest.mark.slow
def test_every_assignment_has_its_exact_probability_by_draws_of_a_reference() -> None:
    problem = tiny()
    chain = sample(
        np.random.default_rng(8),
        empty_state(problem),
        log_density_fn=lambda s: log_posterior(problem, s),
        mixture=Mixture(
            (StretchRedraw(learnt(problem)), PlacementWalk(turn_about=0.2, yaw=0.3)), (0.5, 0.5)
        ),
    )
    # Some have a probability of .003: enough visits to each that their spread is known.
    check(chain, steps=400_000)


def check(chain: Iterator[tuple[ChainState[State], StepInfo]], *, steps: int) -> None:
    """Assert that a chain is in each assignment as often as it should be."""
    visited = []
    for at, _ in islice(chain, 1000, steps):
        items = at.state.items
        visited.append(0 if len(items) == 0 else 1 + 3 * int(items[0, 0]) + int(items[0, 1]))
    for which, probability in enumerate(exact()):
        hit = (np.array(visited) == which).astype(float)
        score = (hit.mean() - probability) / chain_error(hit)
        assert abs(score) < 4.5, (which, hit.mean(), probability)
