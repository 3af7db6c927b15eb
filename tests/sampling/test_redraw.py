"""A stretch drawn anew: densities are those that draws have, and the posterior stays."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache, partial
from itertools import islice

import numpy as np
import pytest

from imapper_prob.models.log_posterior import State, empty_state, log_posterior
from imapper_prob.models.problem import Problem
from imapper_prob.models.settings import ModelSettings
from imapper_prob.samplers.reversible_jump import Drawn, Mixture, sample
from imapper_prob.sampling.moves import PlacementWalk
from imapper_prob.sampling.nodes import Nodes, find_nodes
from imapper_prob.sampling.proposals import Candidates
from imapper_prob.sampling.redraw import StretchRedraw
from tests.models import worlds
from tests.sampling.test_moves import chain_error, exact_counts

FRAMES = 40
WALK = PlacementWalk(turn_about=0.2, yaw=0.3)
"""Under the prior, or what is nearly that, yaws are anything: wider than nodes are made for."""


@cache
def crowded() -> Problem:
    """Forty frames in two films, with a stay, and a library of two lengths."""
    settings = ModelSettings(scenelet_rate=2.0, frame_weight=0.005)
    starts = np.zeros(FRAMES, bool)
    starts[30] = True
    problem = worlds.problem(
        FRAMES, settings=settings, scenelets=worlds.mixed_library(), starts=starts
    )
    lowered = problem.lowered.copy()
    lowered[1:3] = (1, 4)
    return problem._replace(stays=np.array([[8.0, 20.0, 2.5]]), lowered=lowered)


def candidates(problem: Problem, *, seed: int = 0) -> Candidates:
    """All scenelets in windows three frames apart, roughly where somebody walks."""
    rng, n = np.random.default_rng(seed), len(problem.lengths)
    centres = np.arange(3, problem.n_frames - 2, 3)
    shape = (len(centres), n)
    places = np.stack(
        [rng.normal(0, 0.3, shape), rng.uniform(3.6, 4.4, shape), rng.normal(0, 0.3, shape)], -1
    )
    return Candidates(centres, places, rng.normal(0, 0.03, shape), np.ones(shape))


@cache
def move(*, tries: int = 8) -> StretchRedraw:
    problem = crowded()
    return StretchRedraw(problem, find_nodes(problem, candidates(problem)), tries=tries)


def drawn_states(
    *, power: float, count: int, seed: int = 0
) -> Iterator[tuple[State, Drawn[State]]]:
    """States that draws lead to, and the draws beside each, of one stretch of frames."""
    rng = np.random.default_rng(0)
    state = empty_state(crowded())
    for _ in range(count):
        offset = np.array([0.01, 0.05, -0.02, 0.03, 0.02]) * rng.standard_normal(5)
        state = State(
            crowded().camera_mean + offset, state.items, state.placements, state.sizes, state.latent
        )
        begin = int(rng.integers(-10, FRAMES - 5))
        drawn = move().beside(rng, state, begin, begin + 22, power=power)
        if drawn is None:
            continue
        for other, log_q in drawn.others:
            again = move().beside(rng, other, begin, begin + 22, power=power)
            assert again is not None
            assert again.log_present == pytest.approx(log_q, abs=1e-9)
        assert drawn.others
        yield state, drawn
        state = drawn.others[0][0]


@pytest.mark.parametrize("power", [1.0, 0.4, 0.0])
def test_densities_are_restated_by_whoever_comes_next(power: float) -> None:
    """Whatever else is there: neighbours without a gap, another film, a stay that is held."""
    problem, flush, most, sides = crowded(), 0, 0, set[tuple[bool, bool]]()
    for state, drawn in drawn_states(power=power, count=60):
        for other, _ in drawn.others:
            ends = other.items[:-1, 1] + problem.lengths[other.items[:-1, 0]]
            flush += int((ends == other.items[1:, 1]).sum())
            most = max(most, other.n_scenelets)
        sides.add((state.n_scenelets > 0, drawn.others[0][0].n_scenelets > state.n_scenelets))
    assert flush > 10
    assert most >= 3
    assert len(sides) > 2


def test_stated_densities_are_normalised() -> None:
    """The mean of h / q over draws of q is one for any density h; here that at another power."""
    rng, weights = np.random.default_rng(3), []
    state = empty_state(crowded()).with_item(0, 0, np.array([-0.7, 4.0, 0.1]))
    for _ in range(250):
        drawn = move().beside(rng, state, 5, 30, power=1.0)
        assert drawn is not None
        for other, log_q in drawn.others:
            hot = move(tries=1).beside(rng, other, 5, 30, power=0.45)
            assert hot is not None
            weights.append(np.exp(hot.log_present - log_q))
    error = np.std(weights) / np.sqrt(len(weights))
    assert error < 0.1
    assert abs(np.mean(weights) - 1) < 4.5 * error


def test_scenelets_that_are_no_nodes_stay() -> None:
    rng, state = np.random.default_rng(0), empty_state(crowded())
    known = {tuple(item) for item in move().nodes.items.tolist()}
    scenelet, start = next((k, s) for k in range(3) for s in range(5, 20) if (k, s) not in known)
    state = state.with_item(scenelet, start, np.array([0.0, 4.0, 0.0]))
    assert move().beside(rng, state, 0, 30, power=1.0) is None
    # It does not lie wholly in here.
    assert move().beside(rng, state, start + 1, 30, power=1.0) is not None


def test_what_reaches_out_of_a_stretch_stays() -> None:
    rng, state = np.random.default_rng(0), empty_state(crowded())
    state = state.with_item(0, 2, np.array([-0.7, 4.0, 0.1])).with_item(3, 20, np.zeros(3) + 4.0)
    drawn = move().beside(rng, state, 5, 25, power=1.0)
    assert drawn is not None
    for other, _ in drawn.others:
        np.testing.assert_array_equal(other.items[0], state.items[0])
        np.testing.assert_array_equal(other.items[-1], state.items[-1])
        assert (other.items[1:-1, 1] >= 8).all()
        assert (other.items[1:-1, 1] + crowded().lengths[other.items[1:-1, 0]] <= 20).all()


def node_of(nodes: Nodes) -> set[tuple[int, int]]:
    return {(scenelet, start) for scenelet, start in nodes.items.tolist()}


@pytest.mark.parametrize("off", [0.0, 0.4])
def test_the_prior_of_the_number_of_scenelets_comes_back(off: float) -> None:
    """Numbers change by this move alone; all scenelets at all starts are nodes.

    They do not come back where what is there is said to be drawn more often than it is.
    """

    class Off(StretchRedraw):
        def draw(
            self, rng: np.random.Generator, state: State, /, *, power: float
        ) -> Drawn[State] | None:
            drawn = super().draw(rng, state, power=power)
            if drawn is None:
                return None
            return drawn._replace(log_present=drawn.log_present + off * state.n_scenelets)

    # Depths and bearings as narrow as nodes are where something was seen.
    settings = ModelSettings(
        likelihood=0.0, scenelet_rate=0.3, start_bearing=0.02, start_log_depth=0.1
    )
    problem = worlds.problem(20, settings=settings)
    nodes = find_nodes(problem, candidates(problem))
    assert len(nodes.items) == len(node_of(nodes)) == 3 * 15
    chain = sample(
        np.random.default_rng(5),
        empty_state(problem),
        log_density_fn=partial(log_posterior, problem),
        mixture=Mixture((Off(problem, nodes), WALK), (0.4, 0.6)),
    )
    draws = [at.state for at, _ in islice(chain, 500, 30_000)]
    counts, expected = np.array([s.n_scenelets for s in draws]), exact_counts(problem)
    scores = []
    for k in range(3):
        hit = (counts == k).astype(float)
        scores.append((hit.mean() - expected[k]) / chain_error(hit))
    sizes = np.array([s.sizes[0] for s in draws if s.n_scenelets == 1]) / problem.size_spread
    for values, mean in ((sizes, 0.0), (sizes**2, 1.0)):
        scores.append((values.mean() - mean) / chain_error(values))
    assert (np.abs(scores).max() < 4.5) == (off == 0.0), scores
