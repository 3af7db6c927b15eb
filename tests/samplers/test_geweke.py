"""Each move alone leaves the joint distribution of state and data as it is."""

from __future__ import annotations

import math
from functools import partial

import numpy as np
import pytest

from imapper_prob.samplers.reversible_jump import Mixture, init, step
from tests.samplers import geweke, intervals, needles, polynomials

# A right move falls below by chance once in a thousand seeds; wrong ones are far below.
PASS, FAIL = 1e-3, 1e-6


def transition(rng, state, data, *, log_density, mixture, n_steps: int = 5):
    """A few steps of a mixture on the posterior given the data."""
    target = partial(log_density, data=data)
    at = init(target, state)
    for _ in range(n_steps):
        at, _ = step(rng, at, log_density_fn=target, mixture=mixture)
    return at.state


def polynomial_functionals(theta, y) -> list[float]:
    return [len(theta), theta[0], theta[-1], theta @ theta, y[0] * theta[0], y.sum() * theta[-1]]


def of_polynomials(moves, weights, *, kind=Mixture) -> float:
    return geweke.p_value(
        1,
        draw_prior=polynomials.draw_prior,
        draw_data=polynomials.draw_data,
        transition=partial(
            transition,
            log_density=lambda theta, data: polynomials.log_density(theta, data),
            mixture=kind(moves, weights),
        ),
        functionals=polynomial_functionals,
    )


# Needles are seen as noisy sines of their yaws, by the mean of all.
SEEN = 0.5


def see(rng, state) -> float:
    return float(np.sin(state[:, 1]).sum() + SEEN * rng.standard_normal())


def seen_density(state, data) -> float:
    misfit = (data - np.sin(state[:, 1]).sum()) / SEEN
    return needles.target(state, 0.0).log_prior - 0.5 * misfit**2


def needle_functionals(state, data) -> list[float]:
    return [
        len(state),
        len(state) ** 2,
        state[:, 0].sum(),
        (state[:, 0] ** 2).sum(),
        np.cos(state[:, 1]).sum(),
        data * np.sin(state[:, 1]).sum(),
        data,
    ]


def of_needles(moves, weights, *, kind=Mixture) -> float:
    return geweke.p_value(
        2,
        draw_prior=partial(needles.draw, kappa=0.0),
        draw_data=see,
        transition=partial(transition, log_density=seen_density, mixture=kind(moves, weights)),
        functionals=needle_functionals,
    )


# Each slot is looked at by a detector that errs once in three. There are fewer intervals
# than in the other tests: mistakes where there is none would hardly show.
FLIPPED, FEWER = 1 / 3, 1.0


def interval_prior(state) -> float:
    return intervals.log_density(state) - FEWER * len(state)


PRIOR = np.exp([interval_prior(state) for state in intervals.STATES])
PRIOR /= PRIOR.sum()


def covered(state) -> np.ndarray:
    flags = np.zeros(intervals.N_SLOTS, bool)
    for interval in state:
        flags[slice(*interval)] = True
    return flags


def detect(rng, state) -> np.ndarray:
    return covered(state) ^ (rng.random(intervals.N_SLOTS) < FLIPPED)


def detected_density(state, data) -> float:
    wrong = np.count_nonzero(covered(state) != data)
    return interval_prior(state) + wrong * math.log(FLIPPED / (1 - FLIPPED))


def interval_functionals(state, data) -> list[float]:
    weight = sum(intervals.WEIGHTS[interval] for interval in state)
    # A swap whose ratio is wrong prefers what births prefer.
    liked = sum(math.log(intervals.BIRTH[interval]) for interval in state)
    agreed = np.count_nonzero(covered(state) == data)
    return [len(state), not state, weight, liked, covered(state).sum(), agreed]


def draw_intervals(rng):
    return intervals.STATES[rng.choice(len(intervals.STATES), p=PRIOR)]


def of_intervals(moves, weights, *, kind=Mixture) -> float:
    return geweke.p_value(
        3,
        draw_prior=draw_intervals,
        draw_data=detect,
        transition=partial(transition, log_density=detected_density, mixture=kind(moves, weights)),
        functionals=interval_functionals,
    )


@pytest.mark.parametrize(
    ("test", "moves"),
    [
        pytest.param(test, moves, id=f"{test.__name__[3:]}: {', '.join(m.name for m in moves)}")
        for test, moves in (
            (of_polynomials, (polynomials.Birth(), polynomials.Death())),
            (of_polynomials, (polynomials.Walk(),)),
            (of_needles, (needles.Birth(), needles.Death())),
            (of_intervals, (intervals.Birth(), intervals.Death())),
        )
    ]
    + [
        pytest.param(test, (move,), id=f"{test.__name__[3:]}: {move.name}", marks=pytest.mark.slow)
        for test, move in (
            (of_needles, needles.Turn()),
            (of_needles, needles.Squeeze()),
            (of_intervals, intervals.Swap()),
        )
    ],
)
def test_a_move_keeps_the_joint_distribution(test, moves):
    # Pairs are chosen unevenly, or the probability of choosing would cancel.
    assert test(moves, (0.6, 0.4)[: len(moves)]) > PASS


class SwapWithoutRatio(intervals.Swap):
    def propose(self, rng, state):
        proposal = super().propose(rng, state)
        return None if proposal is None else proposal._replace(log_ratio=0.0)


class ForgottenCount(needles.Death):
    """Takes the gaps between k needles for those between k - 1."""

    def propose(self, rng, state):
        proposal = super().propose(rng, state)
        if proposal is None:
            return None
        return proposal._replace(log_ratio=proposal.log_ratio + math.log(len(state)))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("test", "moves", "kind"),
    [
        pytest.param(*wrong, id=name)
        for name, wrong in {
            "Jacobian of a birth dropped": (
                of_polynomials,
                (polynomials.Birth(False), polynomials.Death(False)),
                Mixture,
            ),
            "Jacobian of a squeeze dropped": (of_needles, (needles.Squeeze(False),), Mixture),
            "density of a yaw with the wrong sign": (
                of_needles,
                (needles.Birth(-needles.LOG_TURN), needles.Death(-needles.LOG_TURN)),
                Mixture,
            ),
            "factor k dropped": (of_needles, (needles.Birth(), ForgottenCount()), Mixture),
            "choice probability dropped": (
                of_needles,
                (needles.Birth(), needles.Death()),
                intervals.ForgetfulMixture,
            ),
            "reverse from the wrong state": (
                of_intervals,
                (intervals.WrongStateBirth(), intervals.Death()),
                Mixture,
            ),
            "edge factor dropped": (
                of_intervals,
                (intervals.Birth(), intervals.EagerDeath()),
                Mixture,
            ),
            "ratio of a swap dropped": (of_intervals, (SwapWithoutRatio(),), Mixture),
        }.items()
    ],
)
def test_the_same_test_fails_a_wrong_move(test, moves, kind):
    assert test(moves, (0.6, 0.4)[: len(moves)], kind=kind) < FAIL
