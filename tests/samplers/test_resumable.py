"""Chains that were killed go on to the same draws, to the last bit."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from imapper_prob.samplers.chains import ChainError
from imapper_prob.samplers.checkpoint import CheckpointError, Snapshot, load, run_resumable_chains
from tests.samplers import kept

ROOT = Path(__file__).parents[2]


def run(folder: Path, **options) -> list[Snapshot]:
    options = {"seed": 11, "identity": kept.IDENTITY, "every_seconds": 0.05} | options
    return run_resumable_chains(
        options.pop("task", kept.tempered),
        options.pop("problem", kept.ROUNDS),
        kept.STARTS,
        folder=folder,
        **options,
    )


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory) -> list[Snapshot]:
    # Hardly a checkpoint: taking them must not change the draws either.
    return run(tmp_path_factory.mktemp("undisturbed"), every_seconds=60.0)


def assert_same(found: list[Snapshot], expected: list[Snapshot]) -> None:
    for one, other in zip(found, expected, strict=True):
        assert kept.same(one, other)


def kill_and_resume(folder: Path, *, rounds: int, kills: int, longest: float) -> None:
    """Kill a run ``kills`` times, each after up to ``longest`` seconds, then let it end."""
    rng = np.random.default_rng(kills)
    command = [sys.executable, "-m", "tests.samplers.kept", str(folder), str(rounds)]
    for delay in rng.uniform(0, longest, kills):
        with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as process:
            assert process.stdout.readline() == "begins\n"
            time.sleep(delay)
            process.kill()
        assert process.returncode == -9, "the run was over before it was killed"
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True, timeout=60)


def check_kills(folder: Path, *, rounds: int, kills: int, longest: float) -> None:
    kill_and_resume(folder / "killed", rounds=rounds, kills=kills, longest=longest)
    expected = run(folder / "undisturbed", problem=rounds, every_seconds=60.0)
    names = [f"draws-{chain}.npz" for chain in range(len(expected))]
    found = [load(folder / "killed" / name, identity=kept.IDENTITY) for name in names]
    assert_same(found, expected)


@pytest.mark.slow
def test_killed_at_random_moments_it_ends_the_same(tmp_path):
    check_kills(tmp_path, rounds=kept.ROUNDS, kills=3, longest=0.15)


@pytest.mark.slow
def test_killed_twenty_times_it_ends_the_same(tmp_path):
    check_kills(tmp_path, rounds=5 * kept.ROUNDS, kills=20, longest=0.25)


def test_checkpoints_and_workers_change_nothing(tmp_path, undisturbed):
    assert_same(run(tmp_path / "one", every_seconds=0.0), undisturbed)
    assert_same(run(tmp_path / "two", workers=2), undisturbed)


def test_another_seed_draws_otherwise(tmp_path, undisturbed):
    assert not kept.same(run(tmp_path, seed=12)[0], undisturbed[0])


def test_a_stopped_run_goes_on(tmp_path, undisturbed):
    partial = run(tmp_path, on_progress=lambda chain, done: done < 20)
    assert not kept.same(partial[0], undisturbed[0])
    assert_same(run(tmp_path), undisturbed)


def test_a_finished_run_returns_at_once(tmp_path, undisturbed):
    run(tmp_path)
    begin = time.perf_counter()
    assert_same(run(tmp_path), undisturbed)
    assert time.perf_counter() - begin < kept.ROUNDS * kept.PAUSE


def test_a_worker_that_was_killed_is_made_good(tmp_path, undisturbed, caplog):
    found = run(tmp_path, task=kept.dies_once, workers=2)
    assert_same(found, undisturbed)
    assert "exit code -9" in caplog.text
    assert "the chains are started again" in caplog.text


def test_a_worker_that_is_always_killed_is_given_up(tmp_path):
    with pytest.raises(ChainError, match=r"chain 0: .* nothing is lost: run again"):
        run(tmp_path, task=kept.dies_always, workers=2)


def test_a_seed_sequence_has_spawned_as_ever_afterwards(tmp_path, undisturbed):
    seed = np.random.SeedSequence(11)
    assert_same(run(tmp_path, seed=seed), undisturbed)
    assert seed.n_children_spawned == len(kept.STARTS)


def test_half_a_checkpoint_that_a_kill_left_is_swept_away(tmp_path):
    (tmp_path / ".chain-0.0123456789abcdef.partial").write_bytes(b"half of")
    run(tmp_path, problem=3)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["chain-0.npz", "chain-1.npz"]


def test_a_damaged_checkpoint_is_named(tmp_path):
    (tmp_path / "chain-1.npz").write_bytes(b"no")
    with pytest.raises(CheckpointError, match=r"chain-1\.npz is damaged") as caught:
        run(tmp_path, problem=3)
    assert caught.value.__notes__ == ["in chain 1"]


def test_settings_that_changed_are_noticed(tmp_path):
    run(tmp_path, problem=3)
    with pytest.raises(CheckpointError, match=r"chain-0\.npz belongs to a run with other"):
        run(tmp_path, problem=3, identity="changed")
