"""Sampling in blocks, and going on with what is finished: the draws of one long run."""

from __future__ import annotations

import os
import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from imapper_prob.config import SampleSettings
from imapper_prob.models.errors import InputError
from imapper_prob.models.log_posterior import log_posterior
from imapper_prob.samplers.verdict import Verdict
from imapper_prob.sampling import sample
from imapper_prob.sampling.blocks import Block, Clock, Limits
from imapper_prob.sampling.sample import Samples, sample_scenes
from imapper_prob.sampling.schedule import block_end, end_of, stopped_at
from tests.runs import small_solution
from tests.sampling.scenes import assert_same_states

SETTINGS = SampleSettings(
    steps=300, burn_in=0.4, draws=6, temperatures=2, chains=2, ensemble_steps=2
)
"""Blocks end after 60, 100 and 140 rounds."""
AN_HOUR = Limits(minutes=60.0)


class ThreeBlocks(Clock):
    """A clock that lets three blocks pass, whatever the time."""

    made = 0

    def allows(self, rounds: float, verdict: Verdict) -> bool:
        self.made += 1
        return self.made < 3


def samples(settings: SampleSettings = SETTINGS, **options: object) -> Samples:
    seed = np.random.SeedSequence(5)
    return sample_scenes(small_solution(), settings, seed=seed, **options)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def whole() -> Samples:
    """One block of the length of three."""
    return samples(stopped_at(SETTINGS, 140))


def assert_same(one: Samples, other: Samples) -> None:
    np.testing.assert_array_equal(one.log_posterior, other.log_posterior)
    np.testing.assert_array_equal(one.traces, other.traces)
    assert one.acceptance == other.acceptance
    assert one.ladders == other.ladders
    assert one.verdict == other.verdict
    assert_same_states(one.states, other.states)


def test_blocks_are_where_they_are_thought_to_be() -> None:
    ends = [block_end(SETTINGS, 0), block_end(SETTINGS, 60), block_end(SETTINGS, 100)]
    assert ends == [60, 100, 140]
    assert end_of(SETTINGS) == 60


def test_three_blocks_are_one_long_run(whole: Samples, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sample, "Clock", ThreeBlocks)
    told: list[Block] = []
    parts: list[float] = []

    def progress(stage: str, part: float) -> None:
        if stage.startswith("jumping"):
            parts.append(part)

    found = samples(limits=AN_HOUR, on_block=told.append, progress=progress)
    assert found.finished
    assert found.end(SETTINGS) == 140
    assert_same(found, whole)
    assert [block.steps for block in told] == [300, 500, 700]
    # 36 rounds after burn-in with 6 draws, 7 apart; of more than 12 draws each second one goes.
    assert [block.draws for block in told] == [6, 11, 9]
    assert whole.shape == (2, 9)
    assert told[0].seconds < told[-1].seconds
    assert told[-1].seconds_left == 0 < told[0].seconds_left <= 3600
    assert all(0 <= part <= 1 for part in parts)


@pytest.mark.slow
def test_blocks_do_not_depend_on_the_number_of_workers(
    whole: Samples, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(sample, "Clock", ThreeBlocks)
    assert_same(samples(limits=AN_HOUR, workers=2, checkpoints=tmp_path), whole)


@pytest.mark.slow
def test_a_finished_run_goes_on_to_the_draws_of_a_longer_one(
    whole: Samples, tmp_path: Path
) -> None:
    first = samples(checkpoints=tmp_path)
    assert first.shape == (2, 6)
    assert_same(samples(checkpoints=tmp_path), first)  # there is nothing more to do
    assert_same(samples(replace(SETTINGS, last_step=700), checkpoints=tmp_path), whole)
    # Chains cannot go back: less is asked for, and what there is stays.
    assert_same(samples(checkpoints=tmp_path), whole)


class Killed(Exception):
    """In place of a kill: nothing is written after it."""


@pytest.mark.parametrize("where", ["between", "inside", "interrupted"])
def test_blocks_that_were_stopped_go_on_to_the_same_draws(
    whole: Samples, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, where: str
) -> None:
    seen: list[float] = []

    def on_block(block: Block) -> None:
        if where == "between" and block.steps == 500:
            raise Killed

    def progress(stage: str, part: float) -> None:
        seen.append(part)
        if len(seen) == 5 and where == "inside":
            raise Killed
        if len(seen) == 5 and where == "interrupted":
            os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr(sample, "Clock", ThreeBlocks)
    options = {"limits": AN_HOUR, "checkpoints": tmp_path}
    if where == "interrupted":
        part = samples(on_block=on_block, progress=progress, **options)
        assert not part.finished
        assert part.end(SETTINGS) in (60, 100, 140)
        problem = small_solution().problem
        for state, value in zip(part.states, part.log_posterior.flat, strict=True):
            assert log_posterior(problem, state) == pytest.approx(value, abs=1e-6)
    else:
        with pytest.raises(Killed):
            samples(on_block=on_block, progress=progress, **options)
    assert len(list(tmp_path.glob("chain-*.npz"))) == 2
    monkeypatch.undo()
    longer = replace(SETTINGS, last_step=700)
    assert_same(samples(longer, checkpoints=tmp_path), whole)


def test_sampling_stops_where_it_is_good_or_the_time_is_up() -> None:
    good, bad = Verdict(True, 0, None, ""), Verdict(False, 9, None, "")
    assert not Clock(Limits()).allows(1, bad)
    assert not Clock(Limits(until="good")).allows(1, good)
    assert Clock(Limits(until="good")).allows(1, bad)
    assert Clock(AN_HOUR).allows(1, good)
    clock = Clock(AN_HOUR)
    clock.begin()
    clock.end(1e-9)  # a pace at which the next block would never end in time
    assert not clock.allows(1e9, bad)
    assert Clock(Limits(until="good")).left(30.0) == 30.0
    assert Clock(AN_HOUR).left(30.0) == pytest.approx(3600, abs=5)
    assert Clock(Limits(until="good")).left(float("nan")) == pytest.approx(3600, abs=5)


@pytest.mark.parametrize("minutes", [0.0, -1.0, float("nan"), float("inf")])
def test_times_that_are_none_are_refused(minutes: float) -> None:
    with pytest.raises(InputError, match="must be a positive number"):
        Limits(minutes=minutes)


def test_a_cluster_needs_a_folder_for_blocks() -> None:
    with pytest.raises(InputError, match="name a folder for these that its workers see"):
        samples(limits=AN_HOUR, cluster=object())
