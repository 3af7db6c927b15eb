"""Tempering crosses what a cold chain cannot, and arrives at the exact answer."""

from __future__ import annotations

import math
from functools import partial
from itertools import islice, pairwise

import numpy as np
import pytest

from imapper_prob.samplers import tempering
from imapper_prob.samplers.ladder import SwapTable, best_rungs, power_ladder
from imapper_prob.samplers.reversible_jump import Mixture, Proposal, StepInfo, sample, step
from imapper_prob.samplers.tempering import (
    POSTERIOR,
    PRIOR,
    LogDensityParts,
    Rung,
    TemperedDensity,
    TemperingState,
    resized,
    start,
    temper,
)
from tests.samplers import islands, polynomials
from tests.samplers.frequencies import chi_square
from tests.samplers.kernel_chain import KernelChain
from tests.samplers.rounds import check_rounds

# A right sampler falls below by chance once in a thousand seeds; wrong ones are far below.
PASS, FAIL = 1e-3, 1e-6
KERNEL = partial(step, mixture=islands.MIXTURE)
CHAIN_AT = partial(KernelChain, islands.target, KERNEL)
BETAS = power_ladder(6)
EXACT = islands.masses() / islands.masses().sum()


def cells(*, seed: int, rounds: int = 3_000) -> np.ndarray:
    """(rounds,) islands that the coldest rung is on; all rungs start on the same one."""
    rngs = np.random.default_rng(seed).spawn(len(BETAS) + 1)
    options = {"chain_at": CHAIN_AT, "steps_per_swap": 4}
    at = start([islands.START] * len(BETAS), target=islands.target, betas=BETAS)
    *_, last = islice(temper(rngs, at, adapt=True, **options), 300)
    chain = temper(rngs, last.state, **options)
    return np.array([islands.cell(item.state.chains[-1].state) for item in islice(chain, rounds)])


@pytest.mark.slow
def test_finds_all_islands_in_their_proportions():
    assert chi_square(cells(seed=1), EXACT) > PASS


def test_a_cold_chain_stays_on_the_island_it_started_on(rng):
    chain = sample(
        rng,
        islands.START,
        log_density_fn=TemperedDensity(islands.target, POSTERIOR),
        mixture=islands.MIXTURE,
    )
    visited = {islands.cell(at.state) for at, _ in islice(chain, 50_000)}
    assert visited == {islands.cell(islands.START)}


def test_every_ratio_is_that_of_both_directions(rng):
    hot = TemperedDensity(islands.target, Rung(0.01))
    table = check_rounds(rng, islands.START, hot, islands.MIXTURE, n=500)
    assert all(rate > 0.1 for rate in table.rates().values())


def cold_only(densities, gap, hot, cold):
    """Forgets what the swap does to the hot chain."""
    return densities[hot][gap + 1] - densities[cold][gap + 1]


def always(densities, gap, hot, cold):
    return 0.0


def with_priors(parts, rungs):
    """Forgets that priors are not tempered."""
    return [[rung.beta * part.at(Rung(1.0)) for rung in rungs] for part in parts]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("of", "wrong"),
    [
        ("_log_densities", with_priors),
        ("_log_swap_ratio", cold_only),
        ("_log_swap_ratio", always),
    ],
)
def test_the_same_test_fails_a_wrong_swap_ratio(monkeypatch, of, wrong):
    monkeypatch.setattr(tempering, of, wrong)
    assert chi_square(cells(seed=1), EXACT) < FAIL


def test_draws_of_the_prior_take_the_place_of_its_steps():
    """The coldest of two rungs gets every other state from independent draws."""
    target = partial(_normal, centre=1.0)
    seen = []

    def independent(rng):
        seen.append(rng.standard_normal())
        return seen[-1]

    at = start([0.0, 0.0], target=target, betas=(0.0, 1.0))
    rngs = np.random.default_rng(3).spawn(3)
    chain_at = partial(KernelChain, target, _stay)
    chain = temper(rngs, at, chain_at=chain_at, steps_per_swap=1, independent=independent)
    items = list(islice(chain, 20_000))
    assert len(seen) == 20_000
    assert {item.steps[0][0].move for item in items} == {"independent"}
    cold = np.array([item.state.chains[-1].state for item in items])
    assert set(cold) <= {0.0, *seen}
    # Posterior: normal, precision 2, mean half. About every third draw is accepted.
    error = cold.std() * np.sqrt(6 / len(cold))
    assert abs(cold.mean() - 0.5) < 4.5 * error
    assert abs(cold.var() - 0.5) < 4.5 * np.sqrt(2) * 0.5 * np.sqrt(6 / len(cold))


def test_draws_outside_the_support_are_not_taken(rng):
    def target(x):
        return LogDensityParts(0.0, 0.0 if x > 0.999 else -math.inf)

    at = start([1.0, 1.0], target=target, betas=(0.0, 1.0))
    chain = temper(
        rng.spawn(3), at, chain_at=partial(KernelChain, target, _stay), steps_per_swap=1,
        independent=lambda rng: rng.random(),
    )  # fmt: skip
    items = list(islice(chain, 300))
    drawn = [item.steps[0][0].accepted for item in items]
    assert 0 < sum(drawn) < 300  # one in a thousand draws, a hundred tries
    assert all(chain.state > 0.999 for item in items for chain in item.state.chains)


def _normal(x, *, centre):
    return LogDensityParts(-0.5 * x**2, -0.5 * (x - centre) ** 2)


def _stay(rng, chain_state, *, log_density_fn):
    return chain_state, StepInfo("stay", False, 0.0)


D, SHARPNESS = 6, 1e4


def gaussian(x: np.ndarray) -> LogDensityParts:
    """Standard normal prior and likelihood: at beta a normal of precision 1 + beta SHARPNESS."""
    return LogDensityParts(-0.5 * float(x @ x), -0.5 * SHARPNESS * float(x @ x))


def exact_step(rng, chain_state, *, log_density_fn):
    """An independent draw: no move could mix better, so that swap rates are the known ones."""
    x = rng.standard_normal(D) / math.sqrt(1 + log_density_fn.rung.beta * SHARPNESS)
    return chain_state._replace(state=x), StepInfo("draw", True, 0.0)


def gaussian_rates(betas, *, n: int = 200_000) -> np.ndarray:
    """Swap rates between these normal distributions, from independent draws."""
    rng = np.random.default_rng(0)
    squares = [rng.chisquare(D, n) / (1 + beta * SHARPNESS) for beta in betas]
    return np.array(
        [
            np.exp(np.minimum(0, -0.5 * SHARPNESS * (cold - hot) * (at_hot - at_cold))).mean()
            for (hot, at_hot), (cold, at_cold) in pairwise(zip(betas, squares, strict=True))
        ]
    )


def adapted(n_rungs: int, *, seed: int, rounds: int):
    betas = power_ladder(n_rungs)
    rngs = np.random.default_rng(seed).spawn(n_rungs + 1)
    at = start([np.zeros(D)] * n_rungs, target=gaussian, betas=betas)
    chain = temper(
        rngs, at, chain_at=partial(KernelChain, gaussian, exact_step), steps_per_swap=1, adapt=True
    )
    *_, last = islice(chain, rounds)
    return rngs, last.state


def test_the_ladder_adapts_to_equal_swap_rates():
    assert np.ptp(gaussian_rates(power_ladder(7))) > 0.3
    _, position = adapted(7, seed=1, rounds=3_000)
    # Normal distributions swap equally often where their precisions are a geometric series.
    precisions = 1 + SHARPNESS * np.array(position.betas)
    np.testing.assert_allclose(np.diff(np.log(precisions)), math.log(precisions[-1]) / 6, rtol=0.15)
    assert np.ptp(gaussian_rates(position.betas)) < 0.06
    assert position.betas[0] == 0
    assert position.betas[-1] == 1


@pytest.mark.parametrize("rungs", [5, 13])
def test_a_ladder_with_fewer_or_more_rungs_swaps_about_evenly(rungs):
    _, position = adapted(9, seed=1, rounds=1_000)
    other = resized(position, rungs)
    assert len(other.betas) == len(other.chains) == len(other.replicas) == rungs
    assert np.ptp(gaussian_rates(other.betas)) < np.ptp(gaussian_rates(position.betas)) + 0.1
    for chain, beta, value in zip(other.chains, other.betas, other.log_likelihoods, strict=True):
        parts = gaussian(chain.state)
        assert value == parts.log_likelihood
        assert chain.log_density == pytest.approx(parts.at(Rung(beta)))
    assert other.chains[0].state is position.chains[0].state
    assert other.chains[-1].state is position.chains[-1].state


def test_a_ladder_of_another_size_keeps_both_ends():
    _, position = adapted(9, seed=1, rounds=10)
    assert resized(position, 9).betas == pytest.approx(position.betas)
    with pytest.raises(ValueError, match="9 rungs cannot have 1"):
        resized(position, 1)


@pytest.mark.parametrize("barrier", [1.0, 2.0, 3.5, 5.0])
def test_the_best_number_of_rungs_makes_most_round_trips_for_the_same_work(barrier):
    def trips(rungs: int) -> float:
        """Round trips by round and rung (Syed et al. 2022, theorem 1), with equal rejections."""
        rejected = barrier / (rungs - 1)
        return 1 / (2 + 2 * (rungs - 1) * rejected / (1 - rejected)) / rungs

    possible = range(math.floor(barrier) + 2, 30)
    assert trips(best_rungs(barrier)) > 0.97 * max(map(trips, possible))


def test_counted_swap_rates_are_the_known_ones():
    rngs, position = adapted(9, seed=2, rounds=1_000)
    table = SwapTable.empty(position.betas)
    chain = temper(
        rngs, position, chain_at=partial(KernelChain, gaussian, exact_step), steps_per_swap=1
    )
    n = 4_000
    for item in islice(chain, n):
        assert item.state.betas == position.betas  # frozen
        table = table.recorded(item.swap_acceptance, item.state.replicas)
    summary = table.summary()
    # Draws are independent, and so are the swap probabilities of every other round.
    np.testing.assert_allclose(
        summary.swap_rates, gaussian_rates(position.betas), atol=5 * 0.5 / math.sqrt(n)
    )
    assert summary.rounds == n
    # With one sweep a round, independent draws make n / (2 + 2 sum r / (1 - r)) trips (Syed et al.
    # 2022, theorem 1). More sweeps make more.
    rejected = 1 - gaussian_rates(position.betas)
    assert summary.round_trips > n / (2 + 2 * np.sum(rejected / (1 - rejected)))


TILTS = ((0.0,), (1.5,), (-1.0,), (0.0,))


def sizes_of(position, *, rounds: int, **options) -> tuple[np.ndarray, TemperingState]:
    """(rounds, K) number of coefficients on each rung, and the last position."""
    rngs = np.random.default_rng(6).spawn(len(position.betas) + 1)
    kernel = partial(step, mixture=polynomials.mixture())
    chain_at = partial(KernelChain, polynomials.target, kernel)
    chain = temper(rngs, position, chain_at=chain_at, steps_per_swap=4, **options)
    items = list(islice(chain, rounds))
    return np.array([item.state.counts for item in items], int)[:, :, 0], items[-1].state


def polynomial_ladder(target=polynomials.target) -> TemperingState:
    first = polynomials.draw_prior(np.random.default_rng(0))
    return start([first] * len(TILTS), target=target, betas=power_ladder(len(TILTS)))


def least_probable(sizes, rungs) -> float:
    """p value of the rung above the prior whose sizes fit worst."""
    tested = zip(sizes.T[1:], rungs[1:], strict=True)
    return min(chi_square(k - 1, polynomials.exact(rung)) for k, rung in tested)


def test_tilted_rungs_sample_their_own_distributions():
    sizes, last = sizes_of(polynomial_ladder()._replace(tilts=TILTS), rounds=6_000)
    assert last.tilts == TILTS
    assert least_probable(sizes, last.rungs) > PASS / len(TILTS)


def without_tilts(parts, rungs):
    """Forgets that tilts differ."""
    return [[part.at(Rung(rung.beta)) for rung in rungs] for part in parts]


@pytest.mark.slow
def test_the_same_test_fails_swaps_without_tilts(monkeypatch):
    monkeypatch.setattr(tempering, "_log_densities", without_tilts)
    sizes, last = sizes_of(polynomial_ladder()._replace(tilts=TILTS), rounds=6_000)
    assert least_probable(sizes, last.rungs) < FAIL


@pytest.mark.slow
def test_tilts_adapt_until_every_rung_has_its_mean_size():
    n = 20_000
    _, last = sizes_of(polynomial_ladder(), rounds=n, adapt=True, adapt_tilts=True)
    numbers = np.arange(1, polynomials.K_MAX + 1)
    ends = numbers.mean(), polynomials.exact() @ numbers
    assert last.tilts[0] == last.tilts[-1] == (0.0,)
    assert np.ravel(last.mean_counts) == pytest.approx(ends, abs=0.2)
    for rung in last.rungs[1:-1]:
        aim = ends[0] + rung.beta * (ends[1] - ends[0])
        untilted = polynomials.exact(Rung(rung.beta)) @ numbers
        # A stochastic approximation with gain g scatters by sqrt(g / 2 times the correlation time).
        error = np.var(numbers) * math.sqrt(4 * n**-0.6 / 2)
        assert abs(polynomials.exact(rung) @ numbers - aim) < 3 * error < abs(untilted - aim)


def test_every_rung_samples_its_own_distribution():
    rngs, position = adapted(4, seed=3, rounds=50)
    chain = temper(
        rngs, position, chain_at=partial(KernelChain, gaussian, exact_step), steps_per_swap=1
    )
    n = 4_000
    squares = [[at.state @ at.state for at in item.state.chains] for item in islice(chain, n)]
    scaled = np.mean(squares, axis=0) * (1 + SHARPNESS * np.array(position.betas))
    np.testing.assert_allclose(scaled, D, atol=5 * math.sqrt(2 * D / n))


def run(position, rngs, n, **options):
    chain = temper(rngs, position, **{"chain_at": CHAIN_AT, "steps_per_swap": 3} | options)
    return list(islice(chain, n))


def test_a_chain_goes_on_from_its_position():
    betas = power_ladder(4)
    at = start([islands.START] * 4, target=islands.target, betas=betas)
    for adapt in (False, True):
        rngs, again = (np.random.default_rng(4).spawn(5) for _ in range(2))
        whole = run(at, rngs, 20, adapt=adapt)
        first = run(at, again, 9, adapt=adapt)
        assert first + run(first[-1].state, again, 11, adapt=adapt) == whole


class Follower(KernelChain):
    """A chain that remembers what it was asked to be."""

    def __init__(self, state):
        super().__init__(islands.target, KERNEL, state)
        self.at = state

    def advance(self, rng, rung, steps):
        chain, infos = super().advance(rng, rung, steps)
        self.at = chain.state
        return chain, infos


def test_rung_chains_go_where_their_states_go():
    at = start([islands.START] * 4, target=islands.target, betas=power_ladder(4))
    rngs = np.random.default_rng(4).spawn(5)
    followers = []

    def chain_at(state):
        followers.append(Follower(state))
        return followers[-1]

    asked = run(at, rngs, 200, chain_at=chain_at)
    assert len(set(asked[-1].state.replicas)) == len(followers) == 4
    # States travel between rungs, and each takes its chain along.
    assert asked[-1].state.replicas != (0, 1, 2, 3)
    stands = [followers[k].at for k in asked[-1].state.replicas]
    assert stands == [chain.state for chain in asked[-1].state.chains]


def test_what_a_position_says_is_so():
    betas = power_ladder(5)
    at = start([islands.START] * 5, target=islands.target, betas=betas)
    items = run(at, np.random.default_rng(5).spawn(6), 40, adapt=True)
    for number, item in enumerate(items, 1):
        position = item.state
        assert position.rounds == number
        assert sorted(position.replicas) == list(range(5))
        assert [len(infos) for infos in item.steps] == [3] * 5
        for chain, beta, likelihood in zip(
            position.chains, position.betas, position.log_likelihoods, strict=True
        ):
            parts = islands.target(chain.state)
            assert chain.log_density == parts.at(Rung(beta))
            assert likelihood == parts.log_likelihood


def test_a_state_can_travel_through_all_rungs_in_a_round():
    flat = Mixture((Still(),), (1.0,))
    at = start([0, 1, 2, 3], target=lambda _: LogDensityParts(0.0, 0.0), betas=power_ladder(4))
    chain = temper(
        np.random.default_rng(6).spawn(5),
        at,
        chain_at=partial(
            KernelChain, lambda _: LogDensityParts(0.0, 0.0), partial(step, mixture=flat)
        ),
        steps_per_swap=1,
    )
    # All swaps succeed: every replica moves on to the other end, or turns at one.
    for _ in range(3):
        assert next(chain).state.replicas == (3, 2, 1, 0)
        assert next(chain).state.replicas == (0, 1, 2, 3)


class Still:
    name = "still"
    reverse = "still"

    def propose(self, rng, state):
        return Proposal(state, 0.0)


def test_one_rung_is_an_ordinary_chain():
    at = start([islands.START], target=islands.target, betas=[1.0])
    (item,) = run(at, np.random.default_rng(7).spawn(2), 1)
    assert item.state.replicas == (0,)
    assert item.swap_acceptance == ()


def test_the_prior_may_visit_what_the_likelihood_forbids():
    def half_line(x: float) -> LogDensityParts:
        return LogDensityParts(-0.5 * x * x, 0.0 if x > 0 else -math.inf)

    walk = Mixture((Jump(),), (1.0,))
    at = start([-1.0, 1.0], target=half_line, betas=[0.0, 1.0])
    assert at.chains[0].log_density == -0.5
    chain = temper(
        np.random.default_rng(8).spawn(3),
        at,
        chain_at=partial(KernelChain, half_line, partial(step, mixture=walk)),
        steps_per_swap=2,
    )
    hot, cold = zip(
        *([at.state for at in item.state.chains] for item in islice(chain, 500)), strict=True
    )
    assert min(cold) > 0
    assert min(hot) < 0 < max(hot)


class Jump:
    name = "jump"
    reverse = "jump"

    def propose(self, rng, state):
        return Proposal(state + rng.standard_normal(), 0.0)


def test_outside_the_prior_the_likelihood_means_nothing():
    assert LogDensityParts(-math.inf, math.nan).at(Rung(0.5)) == -math.inf
    assert LogDensityParts(-1.0, -math.inf).at(PRIOR) == -1.0
    assert LogDensityParts(-1.0, -4.0).at(Rung(0.5)) == -3.0


@pytest.mark.parametrize(
    ("betas", "message"),
    [
        ((), "must ascend"),
        ((0.0, 0.5, 0.5, 1.0), "must ascend"),
        ((-0.1, 1.0), "must ascend"),
        ((0.0, 0.9), "must ascend"),
        ((0.0, 0.5, 1.0), "2 states for 3 rungs"),
    ],
)
def test_ladders_that_cannot_be_climbed_are_refused(betas, message):
    with pytest.raises(ValueError, match=message):
        start([islands.START] * 2, target=islands.target, betas=betas)


def test_what_does_not_fit_the_ladder_is_refused():
    at = start([islands.START] * 2, target=islands.target, betas=[0.0, 1.0])
    with pytest.raises(ValueError, match="2 generators for 2 rungs and the swaps"):
        run(at, np.random.default_rng(0).spawn(2), 1)
    with pytest.raises(ValueError, match="steps_per_swap must be at least 1"):
        temper(
            np.random.default_rng(0).spawn(3),
            at,
            chain_at=CHAIN_AT,
            steps_per_swap=0,
        )
    with pytest.raises(FloatingPointError, match="log density is -inf"):
        start([0, 0], target=lambda _: LogDensityParts(-math.inf, 0.0), betas=[0.0, 1.0])
