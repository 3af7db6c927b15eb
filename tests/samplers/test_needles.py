"""Numbers, places and yaws of needles: the prior comes back, and so does a known posterior."""

from __future__ import annotations

from functools import partial
from itertools import islice

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from imapper_prob.samplers.reversible_jump import sample, step
from imapper_prob.samplers.tempering import POSTERIOR, start, temper
from tests.samplers import needles
from tests.samplers.frequencies import chi_square
from tests.samplers.kernel_chain import KernelChain
from tests.samplers.rounds import RoundTripError, check_rounds

# A right sampler falls below by chance once in a thousand seeds; wrong ones are far below.
PASS, FAIL = 1e-3, 1e-6
N_BINS = 6


def p_values(states, kappa: float) -> dict[str, float]:
    """How probable numbers are that far off, and places and yaws of the first needles."""
    sizes = np.array([len(state) for state in states])
    firsts = np.array([state[0] for state in states if len(state)])
    edges = np.linspace(-np.pi, np.pi, N_BINS + 1)
    # Without a likelihood von Mises is uniform.
    shares = np.diff(stats.vonmises(max(kappa, 1e-9)).cdf(edges))
    return {
        "number": chi_square(sizes, needles.numbers(kappa)),
        "place": chi_square((firsts[:, 0] * N_BINS).astype(int), np.full(N_BINS, 1 / N_BINS)),
        "yaw": chi_square(np.digitize(firsts[:, 1], edges[1:-1]), shares),
    }


def draws(mixture, kappa: float, *, n: int = 20_000) -> list[np.ndarray]:
    chain = sample(
        np.random.default_rng(7),
        needles.EMPTY,
        log_density_fn=lambda state: needles.target(state, kappa).at(POSTERIOR),
        mixture=mixture,
    )
    return [at.state for at, _ in islice(chain, n)]


@pytest.mark.parametrize("kappa", [0.0, needles.KAPPA], ids=["prior", "posterior"])
def test_what_is_known_comes_back(kappa):
    for name, p_value in p_values(draws(needles.mixture(), kappa), kappa).items():
        assert p_value > PASS / 3, name


@pytest.mark.parametrize(
    ("wrong", "shows_in"),
    [
        pytest.param(
            needles.mixture(log_turn=-needles.LOG_TURN), "number", id="yaw density, wrong sign"
        ),
        pytest.param(needles.mixture(jacobian=False), "place", id="Jacobian dropped"),
    ],
)
def test_the_same_test_fails_a_wrong_move(wrong, shows_in):
    assert p_values(draws(wrong, 0.0), 0.0)[shows_in] < FAIL


def test_the_ends_of_a_ladder_are_prior_and_posterior():
    betas = (0.0, 0.4, 1.0)
    rngs = np.random.default_rng(8).spawn(len(betas) + 1)
    chain = temper(
        rngs,
        start([needles.EMPTY] * len(betas), target=needles.target, betas=betas),
        chain_at=partial(KernelChain, needles.target, partial(step, mixture=needles.mixture())),
        steps_per_swap=5,
    )
    positions = [item.state for item in islice(chain, 2_000)]
    for rung, beta in enumerate(betas):
        states = [position.chains[rung].state for position in positions]
        for name, p_value in p_values(states, beta * needles.KAPPA).items():
            assert p_value > PASS / 9, (beta, name)


@given(k=st.integers(0, needles.K_MAX), seed=st.integers(0, 2**32 - 1))
def test_every_ratio_is_that_of_both_directions(k, seed):
    rng = np.random.default_rng(seed)
    first = np.stack([rng.random(k), rng.uniform(-3, 3, k)], axis=1)
    check_rounds(
        rng, first, lambda state: needles.target(state).at(POSTERIOR), needles.mixture(), n=8
    )


@pytest.mark.parametrize(
    "wrong", [needles.mixture(log_turn=-needles.LOG_TURN), needles.mixture(jacobian=False)]
)
def test_check_finds_the_wrong_ratio(rng, wrong):
    with pytest.raises(RoundTripError):
        check_rounds(
            rng, needles.EMPTY, lambda state: needles.target(state).at(POSTERIOR), wrong, n=100
        )
