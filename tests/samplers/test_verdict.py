"""What is said about a run."""

from __future__ import annotations

import re

import numpy as np
import pytest

from imapper_prob.samplers.diagnostics import ShortChainWarning, ess, layout_probabilities
from imapper_prob.samplers.ladder import LadderSummary
from imapper_prob.samplers.verdict import judge, measure, worse
from tests.samplers.markov import autoregressive, two_states, two_states_error

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
    assert re.match(r"Converged: probabilities are good to ± 0\.0\d\. ", verdict.text)
    assert "of log posterior (1.01 wanted)" in verdict.text


def test_what_a_verdict_goes_by(rng):
    n = 2_000
    found = layouts(rng, n, leave=(0.01, 0.01))
    shifted = rng.standard_normal((4, n)) + np.array([0.0, 0.0, 0.0, 0.4])[:, None]
    measures = measure(found, {"near": rng.standard_normal((4, n)), "far": shifted})
    assert (measures.rhat_of, measures.effective_draws_of[:6]) == ("far", "layout")
    assert measures.rhat > 1.01
    assert measures.effective_layouts == measures.effective_draws == found.effective_draws.min()
    assert measures.error == found.standard_error.max()
    text = judge(found, {"near": rng.standard_normal((4, n)), "far": shifted}).text
    assert " Chains do not agree yet on far. " in text
    alone = judge(found, {"near": rng.standard_normal((4, n))}).text
    assert re.search(
        r" Chains agree, but layout 1[01] changes too seldom to be known well\. ", alone
    )
    nothing = measure(layout_probabilities(np.ones((4, 9), int), rng=rng), {})
    assert nothing.effective_draws == nothing.effective_layouts == np.inf
    assert nothing.rhat == 1.0


def test_a_run_of_one_layout_is_not_known_for_sure(rng):
    slow = autoregressive(rng, (4, 300), correlation=0.9)
    found = layout_probabilities(np.ones((4, 300), int), rng=rng)
    measures = measure(found, {"log posterior": slow})
    assert measures.error == 1 / (float(ess(slow)) + 2)
    assert "may be off by 0.00" not in judge(found, {"log posterior": slow}).text
    assert (found.effective_draws == np.inf).all()


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
    assert f"About {verdict.more_draws} more draws" in verdict.text
    # One standard error: sqrt(.25 / 81).
    off = re.match(r"Not converged: probabilities may be off by (0\.\d\d)\.", verdict.text)
    assert off is not None
    assert 0.03 < float(off[1]) < 0.12
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


def test_chains_that_stay_at_values_of_their_own_do_not_agree(rng):
    n = 500
    own = layout_probabilities(np.arange(2 * n).reshape(2, n), rng=rng)
    text = judge(own, {"number of objects": np.repeat([[2.0], [3.0]], n, axis=1)}).text
    assert "Chains do not agree yet on number of objects." in text


def test_chains_that_move_each_among_their_own_disagree(rng):
    chains = rng.integers(5, size=(4, 2_000)) + 10 * np.array([[0], [1], [0], [1]])
    verdict = judge(layout_probabilities(chains, rng=rng), {})
    assert verdict.disagreement is not None
    first, second = verdict.disagreement
    assert sorted((first // 10, second // 10)) == [0, 1]


def test_short_chains_among_many_layouts_do_not_disagree():
    # Each chain sees some 15 of 60 layouts: two chains have less than half of theirs in
    # common, but so have the halves of any chain.
    for seed in range(20):
        rng = np.random.default_rng(seed)
        chains = np.repeat(rng.integers(60, size=(4, 17)), 30, axis=1)
        found = layout_probabilities(chains, rng=rng)
        common = np.minimum(found.by_chain[:, None], found.by_chain[None]).sum(-1)
        assert common.min() < 0.5
        verdict = judge(found, {"layout": chains})
        assert verdict.disagreement is None
        assert verdict.more_draws > 0


def test_chains_that_crossed_once_need_more(rng):
    chains = np.repeat([[1, 2], [1, 2], [2, 2], [1, 1]], 500, axis=1)
    verdict = judge(layout_probabilities(chains[:2], rng=rng), {"layout": chains[:2]})
    assert verdict.disagreement is None
    assert verdict.more_draws > 0


def test_as_many_more_draws_as_it_says_are_enough():
    cases, n_seeds = ((1_000, (0.02, 0.02)), (1_500, (0.01, 0.01)), (700, (0.05, 0.01))), 30
    good = 0
    for n, leave in cases:
        share = leave[0] / sum(leave)
        # Draws of each of four chains for 400 effective ones.
        needed = 400 * two_states_error(1, leave=leave) ** 2 / (share * (1 - share)) / 4
        totals = []
        for seed in range(n_seeds):
            rng = np.random.default_rng(seed)
            totals.append(n + judge(layouts(rng, n, leave=leave), {}).more_draws)
            good += judge(layouts(rng, totals[-1], leave=leave), {}).good
        assert 1 < np.median(totals) / needed < 2
    # Without the margin just half of them are.
    assert good / (n_seeds * len(cases)) > 0.7


def ladder(*rates, trips):
    betas = tuple(np.linspace(0, 1, len(rates) + 1))
    return LadderSummary(betas, rates, round_trips=trips, rounds=100)


def test_tempering_is_mentioned(rng):
    found = layouts(rng, 8_000)
    good = judge(found, {}, ladders=[ladder(0.3, 0.4, trips=7), ladder(0.35, 0.42, trips=5)])
    assert good.good
    assert good.text.endswith(" Tempering made 12 round trips with swap rates from 0.30 to 0.42.")
    assert judge(found, {}).text == good.text[: good.text.index(" Tempering")]
    assert judge(found, {}, ladders=[ladder(trips=0)]).text == judge(found, {}).text


def test_chains_that_were_stopped_before_they_swapped_say_nothing_of_it(rng):
    found = layouts(rng, 8_000)
    stopped = ladder(np.nan, np.nan, trips=0)
    assert judge(found, {}, ladders=[stopped]).text == judge(found, {}).text
    told = judge(found, {}, ladders=[stopped, ladder(0.3, 0.4, trips=0)]).text
    assert told.endswith("from 0.30 to 0.40: try 4 temperatures in place of 3.")


def test_tempering_that_could_not_help_says_what_might(rng):
    stuck = layout_probabilities(np.repeat([[7], [4]], 500, axis=1), rng=rng)
    few = judge(stuck, {}, ladders=[ladder(0.02, 0.05, 0.01, trips=0)])
    # The barrier is 2.92: some seven temperatures.
    assert few.text.endswith("from 0.01 to 0.05: try 7 temperatures in place of 4.")
    slow = judge(stuck, {}, ladders=[ladder(0.6, 0.5, 0.6, trips=0)])
    assert slow.text.endswith("try more rounds.")
    assert slow.disagreement == (4, 7)


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


def test_the_worse_of_two_measures_counts(rng):
    good = layouts(rng, 4_000)
    steady, slow = (
        rng.standard_normal((4, 4_000)),
        autoregressive(rng, (4, 4_000), correlation=0.99),
    )
    before = measure(good, {"log posterior": slow})
    after = measure(good, {"log posterior": steady})
    assert after.effective_draws > 4 * before.effective_draws
    both = worse(after, before)
    assert (both.effective_draws, both.rhat) == (before.effective_draws, before.rhat)
    assert judge(good, {"log posterior": steady}).good
    told = judge(good, {"log posterior": steady}, before=before)
    assert not told.good
    assert f"{before.effective_draws:.0f} effective draws of log posterior" in told.text
