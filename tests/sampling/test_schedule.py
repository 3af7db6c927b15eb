"""When chains keep what, and where they may stop."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import hypothesis
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imapper_prob.config import SampleSettings
from imapper_prob.models.errors import InputError
from imapper_prob.sampling import schedule
from imapper_prob.sampling.schedule import (
    block_end,
    burn_in_of,
    draws_of,
    end_of,
    learning_of,
    piece_of,
    stopped_at,
    trace_of,
)


@st.composite
def settings(draw: st.DrawFn) -> SampleSettings:
    steps = draw(st.integers(1, 1200))
    swap_every = draw(st.integers(1, 7))
    burn_in = draw(st.floats(0, 0.9))
    most = SampleSettings(steps=steps, swap_every=swap_every, burn_in=burn_in, draws=1).most_draws
    draws = draw(st.integers(1, min(most, 20)))
    return SampleSettings(steps=steps, swap_every=swap_every, burn_in=burn_in, draws=draws)


FEW = hypothesis.settings(max_examples=40)


@FEW
@given(settings())
def test_a_planned_run_keeps_evenly_spaced_rounds(sample: SampleSettings) -> None:
    first, last = burn_in_of(sample), sample.rounds - 1
    for marks, begins in ((draws_of(sample), first), (trace_of(sample), 0)):
        expected = np.linspace(begins, last, sample.draws).round().astype(int).tolist()
        assert [at for at in range(sample.rounds) if marks.has(at)] == expected
        assert marks.kept(sample.rounds) == sample.draws


@FEW
@given(settings(), st.integers(1, 5))
def test_what_is_kept_does_not_depend_on_when_one_looks(sample: SampleSettings, times: int) -> None:
    marks = draws_of(sample)
    kept: list[int] = []
    for at in range(min(times * sample.rounds, 1500)):
        if marks.has(at):
            kept.append(at)
        if len(kept) > marks.most:
            del kept[1::2]
        assert len(kept) == marks.kept(at + 1) <= 2 * sample.draws
    numbers = range(0, marks.count(at + 1), marks.stride(at + 1))
    assert kept == [marks.at(number) for number in numbers]


@FEW
@given(settings())
def test_blocks_end_where_pieces_do_and_one_of_them_where_the_run_was_to_end(
    sample: SampleSettings,
) -> None:
    planned, first, piece = sample.rounds, burn_in_of(sample), piece_of(sample)
    ends = [block_end(sample, 0)]
    while len(ends) < 18:
        ends.append(block_end(sample, ends[-1]))
        # From anywhere in a block it ends at the same place.
        assert block_end(sample, ends[-1] - 1) == block_end(sample, ends[-2] + 1) == ends[-1]
    assert planned in ends
    assert ends[0] > first
    for end in ends:
        if end != planned:
            assert (end - (first if end < planned else planned)) % piece == 0
        assert end_of(stopped_at(sample, end)) == end
    lengths = np.diff([planned, *[end for end in ends if end > planned]])
    assert (np.diff(lengths) >= 0).all()
    assert set((lengths / lengths[0]).tolist()) <= {2.0**n for n in range(30)}


def test_default_blocks() -> None:
    sample = SampleSettings()
    ends = [block_end(sample, 0)]
    while len(ends) < 14:
        ends.append(block_end(sample, ends[-1]))
    steps = [5 * end for end in ends]
    assert steps[:5] == [76_000, 104_000, 132_000, 160_000, 188_000]
    kept = [draws_of(sample).kept(end) for end in ends]
    assert kept[3] == 800
    assert max(kept) <= 1600
    assert len(set(np.diff(steps[4:]).tolist())) > 1


def test_a_last_step_within_burn_in_is_refused() -> None:
    assert end_of(SampleSettings(last_step=60_001)) == 12_000 + 40
    assert end_of(SampleSettings(last_step=200_001)) == 40_000 + 40
    assert end_of(SampleSettings(last_step=199_999)) == 40_000
    with pytest.raises(InputError, match="last_step = 48000 must be beyond the burn-in"):
        SampleSettings(last_step=48_000)


def test_learning_is_as_often_as_said() -> None:
    usual = SampleSettings(steps=100_000, burn_in=0.4)
    learning = learning_of(usual)
    in_burn_in = tuple(range(0, 6001, 750))
    assert learning.ends[:13] == (*in_burn_in, 8800, 9680, 10_680, 11_760)
    assert learning.last_of_burn_in == 6000
    rounds = range(1, usual.rounds)
    stages = zip(learning.ends, learning.ends[1:], strict=False)
    noted = [sum(learning.has(at) for at in rounds if low < at <= high) for low, high in stages]
    assert noted[:8] == 8 * [750]
    lengths = np.diff(learning.ends)[8:17]
    assert all(min(length, 1000) <= n < 2000 for length, n in zip(lengths, noted[8:], strict=False))
    assert learning_of(replace(usual, burn_in=0.0)).ends == ()
    short = learning_of(replace(usual, steps=2000, draws=10))
    assert short.ends[:7] == (0, 20, 40, 60, 80, 100, 120)
    assert short.ends[7] >= 5000
    assert learning_of(replace(usual, steps=50, draws=2)).ends[:2] == (0, 3)


@given(settings())
def test_references_after_burn_in_are_learnt_ever_more_rarely_where_a_chain_may_stop(
    sample: SampleSettings,
) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(schedule, "_LATER_FROM", 0)
        learning, burn_in = learning_of(sample), burn_in_of(sample)
    later = [end for end in learning.ends if end > burn_in]
    assert len(later) == (73 if burn_in else 0)
    for before, at in pairwise((burn_in, *later)):
        assert at == end_of(replace(sample, last_step=at * sample.swap_every))
        assert at - before >= min(20, max(1, sample.rounds - before))
