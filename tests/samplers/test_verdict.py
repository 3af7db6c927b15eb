"""What is said about a run."""

from __future__ import annotations

import numpy as np
import pytest

from imapper_prob.samplers.diagnostics import ShortChainWarning, layout_probabilities
from imapper_prob.samplers.verdict import judge
from tests.samplers.markov import autoregressive, two_states

LEAVE = (0.1, 0.1)


def layouts(rng, n, *, leave=LEAVE):
    chains = np.stack([two_states(rng, n, leave=leave) for _ in range(4)])
    return layout_probabilities(chains + 10, rng=rng)


def test_a_long_run_is_good(rng):
    draws = {"log posterior": autoregressive(rng, (4, 4_000), correlation=0.5)}
    verdict = judge(layouts(rng, 4_000), draws)
    assert verdict.good
    assert verdict.more_draws == 0
    assert verdict.disagreement is None
    assert verdict.text.startswith("Good: at worst ")
    assert "of log posterior" in verdict.text


def test_a_run_without_functionals_is_judged_by_its_layouts(rng):
    verdict = judge(layouts(rng, 8_000), {})
    assert verdict.good
    assert "R-hat" not in verdict.text


def test_a_short_run_says_how_many_more(rng):
    n = 2_000
    draws = {"log posterior": rng.standard_normal((4, n))}
    verdict = judge(layouts(rng, n, leave=(0.01, 0.01)), draws)
    # 8,000 draws of which one in 99 counts: 81 effective ones, five times as many are due.
    assert not verdict.good
    assert n < verdict.more_draws < 12 * n
    assert verdict.more_draws % 100 == 0
    assert f"about {verdict.more_draws} more draws" in verdict.text
    assert "of layout 1" in verdict.text


def test_chains_that_only_have_not_met_need_more(rng):
    draws = rng.standard_normal((4, 2_000)) + np.array([0.0, 0.0, 0.0, 0.4])[:, None]
    verdict = judge(layouts(rng, 2_000, leave=(0.5, 0.5)), {"number of objects": draws})
    assert not verdict.good
    assert verdict.more_draws >= 2_000
    assert "of number of objects" in verdict.text


def test_stuck_chains_disagree_and_more_draws_are_no_cure(rng):
    stuck = np.repeat([[7], [4], [7], [7]], 500, axis=1)
    verdict = judge(layout_probabilities(stuck, rng=rng), {"constant": stuck})
    assert verdict.disagreement == (7, 4)
    assert not verdict.good
    assert verdict.more_draws == 0
    assert "layouts 7 and 4" in verdict.text


def test_a_common_layout_is_no_disagreement(rng):
    chains = rng.choice(3, (4, 4_000), p=[0.4, 0.35, 0.25])
    assert judge(layout_probabilities(chains, rng=rng), {}).disagreement is None


def test_a_rare_layout_does_not_count(rng):
    chains = np.zeros((4, 5_000), int)
    chains[2, 100:180] = 1  # one visit of one chain, 0.4 % of all draws
    assert judge(layout_probabilities(chains, rng=rng), {}).good


@pytest.mark.parametrize("n", [1, 3])
def test_a_run_of_hardly_any_draws_warns_and_still_answers(rng, n):
    with pytest.warns(ShortChainWarning):
        verdict = judge(
            layout_probabilities(np.zeros((4, n), int), rng=rng), {"x": np.zeros((4, n))}
        )
    assert not verdict.good
    assert verdict.more_draws > 0
