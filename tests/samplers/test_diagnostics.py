"""Diagnostics against chains whose errors are known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from imapper_prob.samplers.diagnostics import (
    ShortChainWarning,
    equilibrated,
    ess,
    layout_probabilities,
    rhat,
    stationary_distribution,
    unanimous_error,
)
from tests.samplers.markov import autoregressive, two_states, two_states_error

LEAVE = (0.02, 0.06)


@given(hnp.arrays(float, st.integers(2, 7).map(lambda n: (3, n, n)), elements=st.floats(1e-6, 1)))
def test_stationary_distribution_is_stationary(matrices):
    matrices /= matrices.sum(-1, keepdims=True)
    found = stationary_distribution(matrices)
    np.testing.assert_allclose(found.sum(-1), 1)
    np.testing.assert_allclose(np.einsum("ri,rij->rj", found, matrices), found, atol=1e-12)


def test_stationary_distribution_of_states_that_hardly_ever_change():
    tiny = 1e-60  # 1 - tiny is 1 in floating point: a linear solver sees a singular matrix
    found = stationary_distribution(np.array([[1.0, tiny], [3 * tiny, 1.0]]))
    np.testing.assert_allclose(found, [0.75, 0.25], rtol=1e-14)


def test_error_of_one_chain_is_the_known_one(rng):
    n = 20_000
    states = two_states(rng, n, leave=LEAVE)
    found = layout_probabilities(states[None] * 5 + 3, rng=rng)
    truth = two_states_error(n, leave=LEAVE)
    assert found.layouts.tolist() == [3, 8]
    # The chain leaves its states 600 times: rates are known to 1 / sqrt(600), errors too.
    np.testing.assert_allclose(found.standard_error, truth, rtol=4 / np.sqrt(600))
    assert abs(found.probability[1] - 0.25) < 4 * truth
    np.testing.assert_allclose(found.effective_draws, 0.25 * 0.75 / truth**2, rtol=0.4)


def test_errors_cover_the_truth_as_often_as_they_should():
    inside = 0
    for seed in range(200):
        rng = np.random.default_rng(seed)
        states = np.stack([two_states(rng, 1_000, leave=LEAVE) for _ in range(2)])
        found = layout_probabilities(states, rng=rng)
        one = int(np.flatnonzero(found.layouts == 1)[0])
        inside += abs(found.probability[one] - 0.25) < 1.96 * found.standard_error[one]
    # Binomial(200, 0.95) has a standard deviation of 3.1; the larger of two errors covers more.
    assert inside > 190 - 4 * 3.1


def test_independent_draws_count_fully(rng):
    found = layout_probabilities(rng.choice(3, (4, 5_000), p=[0.2, 0.5, 0.3]), rng=rng)
    assert found.layouts.tolist() == [1, 2, 0]
    assert (found.effective_draws > 5_000).all()
    assert (found.effective_draws < 25_000).all()
    np.testing.assert_allclose(found.probability, [0.5, 0.3, 0.2], atol=4 / np.sqrt(20_000))


def test_chains_that_disagree_show_in_the_error(rng):
    stuck = np.repeat([[1], [2], [2], [2]], 5_000, axis=1)
    found = layout_probabilities(stuck, rng=rng)
    assert found.layouts.tolist() == [2, 1]
    np.testing.assert_allclose(found.probability, [0.75, 0.25])
    np.testing.assert_array_equal(found.by_chain, [[0, 1], [1, 0], [1, 0], [1, 0]])
    # Four chains, of which one is elsewhere: sd 0.5 between them.
    assert (found.standard_error >= 0.5 / 2 - 1e-12).all()
    assert (found.effective_draws < 4).all()


def test_the_error_between_chains_counts_where_transitions_look_healthy(rng):
    # Each chain moves freely between layouts, but with odds of its own: something else
    # that the indicator does not show keeps them apart.
    odds = np.array([0.2, 0.4, 0.6, 0.8])[:, None]
    found = layout_probabilities((rng.random((4, 5_000)) < odds).astype(int), rng=rng)
    between = found.by_chain.std(0, ddof=1) / 2
    np.testing.assert_allclose(found.standard_error, between)
    assert between[0] == pytest.approx(0.129, rel=0.1)


def test_many_rare_layouts_have_errors_too(rng):
    # 60 layouts, independent draws: beyond the twentieth they are taken as one.
    shares = np.concatenate([[0.4], np.full(59, 0.6 / 59)])
    found = layout_probabilities(rng.choice(60, (1, 20_000), p=shares), rng=rng)
    truth = np.sqrt(shares[0] * (1 - shares[0]) / 20_000)
    np.testing.assert_allclose(found.standard_error[0], truth, rtol=0.2)
    rare = np.sqrt(shares[1] * (1 - shares[1]) / 20_000)
    assert found.standard_error.shape == (60,)
    np.testing.assert_allclose(found.standard_error[1:], rare, rtol=0.35)


def test_one_layout_is_certain(rng):
    found = layout_probabilities(np.zeros((2, 10), int), rng=rng)
    assert found.probability.tolist() == [1.0]
    assert found.standard_error.tolist() == [0.0]
    assert found.effective_draws.tolist() == [np.inf]


def test_layouts_without_draws_are_refused(rng):
    with pytest.raises(ValueError, match=r"\(chains, draws\)"):
        layout_probabilities(np.zeros(5, int), rng=rng)
    with pytest.raises(ValueError, match=r"\(chains, draws\)"):
        layout_probabilities(np.zeros((2, 0), int), rng=rng)


def test_effective_draws_of_an_autoregression(rng):
    draws = autoregressive(rng, (4, 5_000), correlation=0.8)
    # (1 - r) / (1 + r) of the draws; arviz is known to about a tenth at this length.
    assert float(ess(draws)) == pytest.approx(20_000 * 0.2 / 1.8, rel=0.25)


def test_rhat_of_chains_that_agree_and_that_do_not(rng):
    draws = autoregressive(rng, (4, 2_000), correlation=0.5)
    assert float(rhat(draws)) < 1.01
    assert float(rhat(draws + np.array([0.0, 0.0, 0.0, 1.0])[:, None])) > 1.1


def test_trailing_axes_are_quantities(rng):
    draws = rng.standard_normal((4, 200, 3, 2))
    draws[0, :, 2, 1] += 5
    for function in (rhat, ess):
        assert function(draws).shape == (3, 2)
        assert float(function(draws)[1, 0]) == pytest.approx(float(function(draws[..., 1, 0])))
    assert rhat(draws)[2, 1] > 1.1
    assert (np.delete(rhat(draws).ravel(), 5) < 1.1).all()


def test_rhat_of_constants_is_settled():
    same = np.full((3, 50), 2.0)
    apart = same + np.arange(3)[:, None]
    assert float(rhat(same)) == 1
    assert float(rhat(apart)) == np.inf
    assert float(ess(same)) == 150


def test_short_chains_warn():
    with pytest.warns(ShortChainWarning, match="2 chains of 3 draws"):
        assert np.isnan(rhat(np.zeros((2, 3))))
    with pytest.warns(ShortChainWarning, match="1 chains of 50 draws"):
        assert np.isnan(rhat(np.zeros((1, 50))))
    with pytest.warns(ShortChainWarning):
        assert np.isnan(ess(np.zeros((2, 3, 2)))).all()
    with pytest.warns(ShortChainWarning):
        found = layout_probabilities(np.array([[1], [2]]), rng=np.random.default_rng(0))
    assert np.isnan(found.standard_error).all()


@pytest.mark.parametrize("part", [0.1, 0.15, 0.25, 0.45])
def test_draws_from_before_equilibrium_are_found(rng, part):
    n = 800
    draws = autoregressive(rng, (4, n), correlation=0.8)
    draws[:, : int(part * n)] -= 20.0
    first = equilibrated(draws)
    assert part * n <= first <= (part + 0.1) * n
    assert float(ess(draws[:, first:])) > 4 * float(ess(draws))
    # One chain that was elsewhere may have been in a rare mode, and one of higher density was not
    # on its way.
    draws = autoregressive(rng, (4, n), correlation=0.8)
    draws[0, : int(part * n)] -= 20.0
    assert equilibrated(draws) == 0
    draws[:, : int(part * n)] += 40.0
    assert equilibrated(draws) == 0
    assert equilibrated(draws[:, :100]) == 0


def test_chains_in_equilibrium_keep_all_draws(rng):
    assert (
        sum(equilibrated(autoregressive(rng, (4, 400), correlation=0.97)) > 0 for _ in range(100))
        <= 2
    )


def test_the_error_of_layouts_holds_where_fast_changes_hide_slow_ones(rng):
    z = []
    for _ in range(100):
        slow = np.stack([two_states(rng, 800, leave=(0.01, 0.01)) for _ in range(4)])
        found = layout_probabilities(slow ^ (rng.random(slow.shape) < 0.05), rng=rng)
        off = found.probability - 0.5
        z.append(float(off[0] / found.standard_error[0]))
    # Standard errors are themselves known to a third here; 1.75 with transitions alone.
    assert np.sqrt(np.mean(np.square(z))) < 1.3


def test_draws_that_agree_may_all_be_wrong(rng):
    """Of runs that agree, one minus the probability is spread as Laplace's rule says."""
    n = 60
    probability = rng.uniform(size=200_000)
    wrong = 1 - probability[rng.binomial(n, probability) == n]
    stated = unanimous_error(rng.standard_normal((4, n // 4)))
    assert wrong.std() == pytest.approx(1 / (n + 2), rel=0.1)
    assert 0.4 / (n + 2) < stated < 2.5 / (n + 2)
    slow = autoregressive(rng, (4, 2_000), correlation=0.98)
    assert unanimous_error(slow) == 1 / (float(ess(slow)) + 2) > 20 / slow.size
