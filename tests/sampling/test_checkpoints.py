"""Chains over scenes that were interrupted or killed, and go on."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from imapper_prob.api import demo_clip
from imapper_prob.clips.load import write_clip
from imapper_prob.config import SampleSettings
from imapper_prob.models.errors import InputError
from imapper_prob.models.scenelet import Library
from imapper_prob.samplers.checkpoint import Checkpointer
from imapper_prob.samplers.reversible_jump import ChainState
from imapper_prob.samplers.tempering import LogDensityParts, start
from imapper_prob.sampling import chain, schedule
from imapper_prob.sampling.chain import Chain, Setup, first_used, run_chain
from imapper_prob.sampling.checkpoints import ChainProgress
from imapper_prob.sampling.sample import sample_scenes, setup_of
from imapper_prob.sampling.schedule import burn_in_of, learning_of
from imapper_prob.scenelets.library import load_library, save_library
from tests.runs import small_solution
from tests.sampling.scenes import assert_same_states

SETTINGS = SampleSettings(
    steps=600, burn_in=0.4, draws=40, temperatures=8, ensemble_steps=4, chains=2
)


@pytest.fixture(scope="module", autouse=True)
def short_chains_learn_like_long_ones() -> Iterator[None]:
    """References after the burn-in, and tilts."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(schedule, "_LATER_FROM", 0)
        patch.setattr(chain, "_TILTED_FROM", 0)
        yield


@pytest.fixture(scope="module")
def setup() -> Setup:
    return setup_of(small_solution(), SETTINGS)


@pytest.fixture(scope="module")
def undisturbed(setup: Setup) -> Chain:
    return run(setup, None)


def run(setup: Setup, path: Path | None, *, stop_at: float = 2.0) -> Chain:
    """One chain, asked to stop once a part ``stop_at`` of it is done."""
    checkpointer = None if path is None else Checkpointer(path, identity="test", every_seconds=0.0)

    def report(part: object = None, /) -> bool:
        return not (isinstance(part, float) and part >= stop_at)

    return run_chain(
        setup, small_solution().states[:1], np.random.default_rng(5), report, checkpointer
    )


def assert_same(one: Chain, other: Chain) -> None:
    np.testing.assert_array_equal(one.log_posterior, other.log_posterior)
    np.testing.assert_array_equal(one.trace, other.trace)
    assert one.acceptance == other.acceptance
    assert one.ladder == other.ladder
    assert_same_states(one.states, other.states)


# While the temperatures adapt, after some were dropped, in the last round of that, after it, and
# after a reference was learnt there.
@pytest.mark.parametrize("stop_at", [0.2, 0.35, 0.4, 0.7, 0.8])
def test_an_interrupted_chain_goes_on_to_the_same_draws(
    setup: Setup, undisturbed: Chain, tmp_path: Path, stop_at: float
) -> None:
    part = run(setup, tmp_path / "chain.npz", stop_at=stop_at)
    assert not part.finished
    resumed = run(setup, tmp_path / "chain.npz")
    assert resumed.finished
    assert_same(resumed, undisturbed)
    # Once more: it is done, and only says so.
    assert_same(run(setup, tmp_path / "chain.npz"), undisturbed)


def test_rounds_after_burn_in_are_counted_and_references_learnt_there(undisturbed: Chain) -> None:
    burn_in = burn_in_of(SETTINGS)
    assert undisturbed.ladder.rounds == SETTINGS.rounds - burn_in
    marks = [end for end in learning_of(SETTINGS).ends if end <= SETTINGS.rounds]
    assert marks[-1] > burn_in
    assert len(undisturbed.progress.visits) == 1 + len(marks)
    # Those that the last reference was learnt from, the walk's and the later half, are kept.
    first = first_used(len(marks) if marks[-1] < SETTINGS.rounds else len(marks) - 1)
    assert first > 1
    kept = [visits.n_states > 0 for visits in undisturbed.progress.visits[:-1]]
    assert kept == [at == 0 or at >= first for at in range(len(marks))]


def test_tilts_adapt_during_a_long_burn_in(setup: Setup, undisturbed: Chain) -> None:
    first, *inner, last = undisturbed.progress.position.tilts
    assert not any(first)
    assert not any(last)
    assert np.abs(inner).max() > 0.1
    again = ChainProgress.of(undisturbed.progress.snapshot())
    assert again.position.tilts == undisturbed.progress.position.tilts
    assert again.position.mean_counts == undisturbed.progress.position.mean_counts
    again.position = again.position._replace(tilts=again.position.tilts[1:])
    with pytest.raises(InputError, match="rungs"):
        again.check(setup.problem, SETTINGS)


def test_a_short_burn_in_has_no_tilts(setup: Setup, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(chain, "_TILTED_FROM", burn_in_of(SETTINGS) + 1)
    assert not np.any(run(setup, None).progress.position.tilts)


def test_visits_for_other_references_are_refused(setup: Setup, tmp_path: Path) -> None:
    progress = run(setup, tmp_path / "chain.npz", stop_at=0.8).progress
    progress.check(setup.problem, SETTINGS)
    progress.visits.pop()
    with pytest.raises(InputError, match="visits"):
        progress.check(setup.problem, SETTINGS)


def test_progress_without_its_best_scene_is_refused(setup: Setup, tmp_path: Path) -> None:
    progress = run(setup, tmp_path / "chain.npz", stop_at=0.8).progress
    progress.best = None
    with pytest.raises(InputError, match="best scene"):
        progress.check(setup.problem, SETTINGS)


def test_temperatures_in_excess_are_dropped(undisturbed: Chain) -> None:
    barrier = undisturbed.progress.barrier
    assert 1.0 < barrier < 3.0
    assert len(undisturbed.ladder.betas) == round(2 * barrier) + 1 < SETTINGS.temperatures


@pytest.mark.parametrize("stop_at", [0.2, 0.35])
def test_temperatures_that_the_barrier_asks_for_are_added(
    setup: Setup, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stop_at: float
) -> None:
    monkeypatch.setattr(chain, "_AT_FIRST", 3)
    whole = run(setup, None)
    betas = whole.ladder.betas
    assert len(betas) == round(2 * whole.progress.barrier) + 1 > 3
    assert betas[0] == 0 < betas[1]
    assert betas[-1] == 1
    streams = [rng.bit_generator.state["state"] for rng in whole.progress.rngs]
    assert len({str(stream) for stream in streams}) == len(betas) + 1
    assert not run(setup, tmp_path / "chain.npz", stop_at=stop_at).finished
    assert_same(run(setup, tmp_path / "chain.npz"), whole)


def test_all_chains_have_as_many_temperatures() -> None:
    samples = sample_scenes(small_solution(), SETTINGS, seed=np.random.SeedSequence(1))
    counts = {len(ladder.betas) for ladder in samples.ladders}
    assert len(counts) == 1
    assert counts < set(range(2, SETTINGS.temperatures))


def test_progress_survives_its_snapshot() -> None:
    first, other = small_solution().states[0], small_solution().states[-1]
    position = start([first, other], target=lambda _: LogDensityParts(0.0, -2.0), betas=(0.5, 1.0))
    progress = ChainProgress.begin(np.random.default_rng(3).spawn(3), position)
    progress.states.append(other)
    progress.values.append(-1.5)
    progress.barrier = 1.25
    progress.best = ChainState(first, -1.0)
    again = ChainProgress.of(progress.snapshot())
    assert again.position.betas == (0.5, 1.0)
    assert again.position.log_likelihoods == (-2.0, -2.0)
    for one, same in zip(again.rngs, progress.rngs, strict=True):
        assert one.random() == same.random()
    np.testing.assert_array_equal(again.position.chains[1].state.items, other.items)
    np.testing.assert_array_equal(again.states[0].items, other.items)
    assert again.values == [-1.5]
    assert again.table == progress.table
    assert again.barrier == 1.25
    assert again.best is not None
    assert again.best.log_density == -1.0
    np.testing.assert_array_equal(again.best.state.items, first.items)


def test_checkpoints_of_another_run_are_refused(tmp_path: Path) -> None:
    brief = SampleSettings(
        steps=100,
        draws=5,
        temperatures=2,
        ensemble_steps=2,
        chains=2,
    )
    for seed in (1, 1):
        sample_scenes(
            small_solution(), brief, seed=np.random.SeedSequence(seed), checkpoints=tmp_path
        )
    with pytest.raises(InputError, match="belongs to a run with other settings"):
        sample_scenes(small_solution(), brief, seed=np.random.SeedSequence(2), checkpoints=tmp_path)
    (tmp_path / "chain-1.npz").write_bytes(b"cut short")
    with pytest.raises(InputError, match=r"chain-1\.npz is damaged"):
        sample_scenes(small_solution(), brief, seed=np.random.SeedSequence(1), checkpoints=tmp_path)


@pytest.mark.slow
def test_a_killed_command_goes_on_to_the_same_scenes(tmp_path: Path) -> None:
    write_clip(tmp_path / "clip.npz", demo_clip())
    save_library(Library("part", tuple(load_library())[::8]), tmp_path / "part.npz")
    (tmp_path / "short.toml").write_text(
        "[sample]\nsteps = 3000\ndraws = 30\nensemble_steps = 4\nchains = 2\n"
    )

    def command(out: str) -> list[str]:
        arguments = ["run", "clip.npz", "--config", "short.toml", "--library", "part.npz"]
        return [sys.executable, "-m", "imapper_prob.cli", *arguments, "-o", out, "--workers", "2"]

    def launch(out: str) -> subprocess.Popen[bytes]:
        return subprocess.Popen(
            command(out), cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
            start_new_session=True, env={**os.environ, "PYTHONPATH": str(Path.cwd())},
        )  # fmt: skip

    victim = launch("killed")
    deadline = time.monotonic() + 300
    while len(list((tmp_path / "killed" / "checkpoints").glob("chain-*.npz"))) < 2:
        assert victim.poll() is None, victim.communicate()[1].decode()
        assert time.monotonic() < deadline
        time.sleep(0.1)
    os.killpg(victim.pid, signal.SIGKILL)
    victim.communicate()
    assert not (tmp_path / "killed" / "scenes.json").exists()
    for out in ("killed", "undisturbed"):
        done = launch(out)
        _, errors = done.communicate(timeout=300)
        assert done.returncode == 0, errors.decode()
    one, other = (
        (tmp_path / out / "scenes.json").read_bytes() for out in ("killed", "undisturbed")
    )
    assert one == other
    assert not (tmp_path / "killed" / "checkpoints").exists()
