"""A stretch drawn anew: draws are worth what they are said to be, and the posterior stays."""

from __future__ import annotations

import math
from functools import cache, partial
from itertools import islice

import numpy as np
import pytest

from imapper_prob.models.log_posterior import State, empty_state, log_posterior
from imapper_prob.models.problem import Problem
from imapper_prob.models.settings import ModelSettings
from imapper_prob.samplers.pools import log_arrangements
from imapper_prob.samplers.reversible_jump import Drawn, Mixture, sample
from imapper_prob.sampling.chain import tempering_split
from imapper_prob.sampling.moves import PlacementWalk
from imapper_prob.sampling.proposals import Candidates
from imapper_prob.sampling.redraw import StretchRedraw
from tests.models import worlds
from tests.sampling.tables import visited
from tests.sampling.test_moves import chain_error, exact_counts

FRAMES = 40
WALK = PlacementWalk(turn_about=0.2, yaw=0.3)
"""Under the prior, or what is nearly that, yaws are anything: wider than tables are made for."""


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
def move(likelihood: float = 1.0) -> StretchRedraw:
    problem = crowded()._replace(likelihood=likelihood)
    return StretchRedraw(problem, visited(problem, candidates(problem)), tries=8)


def ways(count: int) -> float:
    """What is due to the places that so many elements have in a pool, nats, but for a constant."""
    size = move().pool
    return count * math.log(size) - log_arrangements(size, count)


def misfits(likelihood: float, power: float) -> tuple[np.ndarray, int]:
    """Nats by which draws are worth more or less than they are said to be, less the median of each
    pool; and how often two scenelets of a draw have no gap between them."""
    rng, found, flush = np.random.default_rng(0), [], 0
    redraw = move(likelihood)
    problem, state = redraw.problem, empty_state(redraw.problem)
    for _ in range(60):
        offset = np.array([0.01, 0.05, -0.02, 0.03, 0.02]) * rng.standard_normal(5)
        state = State(
            problem.camera_mean + offset, state.items, state.placements, state.sizes, state.latent
        )
        begin = int(rng.integers(-10, FRAMES - 5))
        drawn = redraw.beside(rng, state, begin, begin + 22, power=power)
        if drawn is None or not drawn.others:
            continue
        pool = [(state, drawn.log_present), *drawn.others]
        worth = []
        for other, log_q in pool:
            starts = other.items[:, 1]
            ends = starts + problem.lengths[other.items[:, 0]]
            count = int(((starts >= begin) & (ends <= begin + 22)).sum())
            worth.append(tempering_split(problem, other).at(power) - log_q - ways(count))
        found.append(np.array(worth) - np.median(worth))
        for other, _ in drawn.others:
            ends = other.items[:-1, 1] + problem.lengths[other.items[:-1, 0]]
            flush += int((ends == other.items[1:, 1]).sum())
        state = drawn.others[0][0]
    return np.concatenate(found), flush


@pytest.mark.parametrize("power", [1.0, 0.3])
def test_without_the_likelihood_draws_are_worth_just_what_they_are_said_to_be(power: float) -> None:
    """Path, places, sizes and odds of a sequence are those of its elements and of its pairs."""
    nats, flush = misfits(0.0, power)
    assert len(nats) > 300
    assert flush > 2
    np.testing.assert_allclose(nats, 0.0, atol=1e-7)


def test_with_it_they_are_worth_that_but_for_what_is_hidden_twice_and_the_like() -> None:
    nats, flush = misfits(1.0, 1.0)
    assert flush > 2
    assert 0.0 < np.sqrt(np.mean(nats**2)) < 0.3


def test_scenelets_that_are_not_in_the_table_stay() -> None:
    rng, state = np.random.default_rng(0), empty_state(crowded())
    state = state.with_item(0, 8, np.array([0.0, 4.0, 0.0]))
    problem, everything = crowded(), candidates(crowded())
    table = visited(problem, everything)
    kept = table.items[:, 1] != 8
    some = table._replace(
        starting=np.searchsorted(table.items[kept, 1], np.arange(FRAMES + 2)),
        **{
            name: np.ascontiguousarray(getattr(table, name)[kept])
            for name in ("items", "ends", "where", "heights", "sharp", "flat")
        },
    )
    partly = StretchRedraw(problem, some)
    assert move().beside(rng, state, 0, 30, power=1.0) is not None
    assert partly.beside(rng, state, 0, 30, power=1.0) is None
    # It does not lie wholly in here.
    assert partly.beside(rng, state, 9, 30, power=1.0) is not None


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


@pytest.mark.parametrize("off", [0.0, -2.0])
def test_the_prior_of_the_number_of_scenelets_comes_back(off: float) -> None:
    """Numbers change by this move alone; all scenelets at all starts are in the table.

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

    # Depths and bearings as narrow as places scatter where something was seen.
    settings = ModelSettings(
        likelihood=0.0, scenelet_rate=0.3, start_bearing=0.02, start_log_depth=0.1
    )
    problem = worlds.problem(20, settings=settings)
    table = visited(problem, candidates(problem))
    assert len(table.items) == 3 * 15
    chain = sample(
        np.random.default_rng(5),
        empty_state(problem),
        log_density_fn=partial(log_posterior, problem),
        mixture=Mixture((Off(problem, table), WALK), (0.4, 0.6)),
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
