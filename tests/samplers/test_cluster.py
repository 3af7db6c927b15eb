"""Chains on a dask cluster: a real scheduler and two real worker processes on this machine."""

from __future__ import annotations

import logging
import os

import numpy as np
import pytest

from imapper_prob.samplers.chains import ChainError, run_chains
from imapper_prob.samplers.checkpoint import run_resumable_chains
from tests.samplers import kept, tasks

distributed = pytest.importorskip(
    "distributed", reason="dask's distributed is not installed: install the extra `cluster`"
)


@pytest.fixture(scope="module")
def client():
    with (
        distributed.LocalCluster(
            processes=True,
            n_workers=2,
            threads_per_worker=1,
            host="127.0.0.1",
            dashboard_address=None,
            silence_logs=logging.CRITICAL,  # workers are killed on purpose
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        yield client


def test_draws_are_the_same_as_here(client):
    starts = [0.0, 10.0, 20.0]
    with client.get_executor() as executor:
        found = run_chains(tasks.walk, 50, starts, seed=5, executor=executor)
    np.testing.assert_array_equal(found, run_chains(tasks.walk, 50, starts, seed=5))


def test_chains_run_in_both_workers(client):
    with client.get_executor() as executor:
        found = run_chains(tasks.process, 0.3, [0.0] * 4, seed=5, executor=executor)
    assert len(set(found)) == 2
    assert os.getpid() not in found


def test_a_problem_can_be_sent_ahead(client):
    problem = client.scatter(50, broadcast=True)
    with client.get_executor() as executor:
        found = run_chains(tasks.walk, problem, [0.0, 10.0], seed=5, executor=executor)
    np.testing.assert_array_equal(found, run_chains(tasks.walk, 50, [0.0, 10.0], seed=5))


def test_the_error_of_a_task_names_its_chain(client):
    with (
        client.get_executor() as executor,
        pytest.raises(FloatingPointError, match="a bad density") as caught,
    ):
        run_chains(tasks.fail, None, [0.0], seed=5, executor=executor)
    assert caught.value.__notes__ == ["in chain 0"]


def test_a_worker_that_is_killed_is_made_good(client, tmp_path):
    def run(folder, task, **options):
        return run_resumable_chains(
            task,
            kept.ROUNDS,
            kept.STARTS,
            seed=11,
            folder=tmp_path / folder,
            identity=kept.IDENTITY,
            every_seconds=0.05,
            **options,
        )

    with client.get_executor() as executor:
        found = run("killed", kept.dies_once, executor=executor)
    assert (tmp_path / "killed" / "chain-0.died").exists()
    for one, other in zip(found, run("undisturbed", kept.tempered), strict=True):
        assert kept.same(one, other)


@pytest.mark.slow
def test_a_worker_that_is_always_killed_is_given_up(client, tmp_path):
    executor = client.get_executor()
    with pytest.raises(
        ChainError, match=r"^a worker of the executor died: .*; nothing is lost: run again"
    ):
        run_resumable_chains(
            kept.dies_always,
            kept.ROUNDS,
            kept.STARTS,
            seed=11,
            folder=tmp_path,
            identity=kept.IDENTITY,
            restarts=0,
            executor=executor,
        )
    # Without waiting: where all workers are dead for good, the other chains never end.
    executor.shutdown(wait=False)
