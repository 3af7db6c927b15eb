"""A run on a dask cluster: a real scheduler and two real worker processes on this machine."""

from __future__ import annotations

import logging
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from functools import partial
from importlib.metadata import version
from operator import attrgetter
from pathlib import Path
from socket import socket
from threading import Thread
from time import sleep
from typing import Any

import pytest

from imapper_prob.api import demo_clip
from imapper_prob.cli.main import main
from imapper_prob.clips.load import write_clip
from imapper_prob.config import SampleSettings
from imapper_prob.models.errors import InputError
from imapper_prob.models.scenelet import Library
from imapper_prob.samplers.checkpoint import Snapshot, run_resumable_chains
from imapper_prob.sampling.cluster import Cluster, SameProgram, connected, executor_of
from imapper_prob.scenelets.library import load_library, save_library
from tests.samplers import kept

distributed = pytest.importorskip(
    "distributed", reason="dask's distributed is not installed: install the extra `cluster`"
)

BRIEF = "[sample]\nsteps = 60\ndraws = 6\nchains = 2\ntemperatures = 2\nensemble_steps = 2\n"


def run(folder: Path, out: str, *more: str) -> bytes:
    arguments = ["run", str(folder / "clip.npz"), "--library", str(folder / "part.npz")]
    settings = ["--config", str(folder / "brief.toml"), "--workers", "1"]
    assert main([*arguments, *settings, "-o", str(folder / out), *more]) == 0
    return (folder / out / "scenes.json").read_bytes()


@pytest.mark.slow
def test_a_run_on_a_cluster_draws_what_a_run_here_does(tmp_path: Path) -> None:
    write_clip(tmp_path / "clip.npz", demo_clip())
    save_library(Library("part", tuple(load_library())[::8]), tmp_path / "part.npz")
    (tmp_path / "brief.toml").write_text(BRIEF)
    with distributed.LocalCluster(
        processes=True,
        n_workers=2,
        threads_per_worker=1,
        host="127.0.0.1",
        dashboard_address=None,
        silence_logs=logging.CRITICAL,
    ) as cluster:
        there = run(tmp_path, "there", "--cluster", cluster.scheduler_address)
    assert there == run(tmp_path, "here")


class Workers:
    """Two workers, the second of which has something else than this program."""

    def __init__(self, *_: object, **__: object) -> None:
        self.other: object = "0.0.9"

    def __enter__(self) -> Workers:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def run(self, function: Callable[[str], str], name: str, *, on_error: str) -> dict[str, object]:
        assert on_error == "return"
        return {"tcp://a:1": function(name), "tcp://b:1": self.other}


@pytest.mark.parametrize(
    ("other", "said"),
    [
        ("0.0.9", "the worker tcp://b:1 has imapper-prob 0.0.9, and this is"),
        (ImportError("no such package"), "the worker tcp://b:1 has no imapper-prob"),
    ],
)
def test_a_worker_with_another_version_is_refused_by_name(
    monkeypatch: pytest.MonkeyPatch, other: object, said: str
) -> None:
    workers = Workers()
    workers.other = other
    monkeypatch.setattr(distributed, "Client", lambda *_, **__: workers)
    with pytest.raises(InputError, match=said), connected("tcp://here:1"):
        pass
    workers.other = version("imapper-prob")
    with connected("tcp://here:1") as client:
        assert client is workers


def done(client: Cluster | None, task: Callable[..., object], data: object) -> object:
    """What a task makes of data that were sent ahead."""
    with executor_of(client) as executor:
        assert executor is not None
        return executor.submit(task, executor.scatter(data)).result(timeout=60)


@contextmanager
def scheduler(workers: int) -> Iterator[str]:
    with distributed.LocalCluster(
        processes=False,
        protocol="tcp",
        n_workers=workers,
        threads_per_worker=1,
        host="127.0.0.1",
        dashboard_address=None,
        silence_logs=logging.CRITICAL,
    ) as cluster:
        yield cluster.scheduler_address


def test_a_worker_that_joins_late_with_another_version_is_refused_by_name(tmp_path: Path) -> None:
    # The other version has none of the modules that tasks are pickled by.
    (tmp_path / "imapper_prob").mkdir()
    (tmp_path / "imapper_prob" / "__init__.py").write_text("")
    (tmp_path / "imapper_prob-0.0.9.dist-info").mkdir()
    metadata = "Metadata-Version: 2.1\nName: imapper-prob\nVersion: 0.0.9\n"
    (tmp_path / "imapper_prob-0.0.9.dist-info" / "METADATA").write_text(metadata)
    with scheduler(workers=0) as address, connected(address) as client:
        assert isinstance(client, distributed.Client)
        worker = subprocess.Popen(
            [sys.executable, "-m", "distributed.cli.dask_worker", address, "--no-dashboard"],
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": str(tmp_path)},
            stderr=subprocess.DEVNULL,
        )
        try:
            client.wait_for_workers(1, timeout=60)
            (name,) = client.scheduler_info()["workers"]
            said = f"^the worker {name} has imapper-prob 0.0.9, and this is"
            with pytest.raises(InputError, match=said):
                done(client, attrgetter("chains"), SampleSettings(chains=3))
        finally:
            worker.terminate()
            worker.wait()


def test_a_task_of_the_same_version_is_run() -> None:
    with scheduler(workers=1) as address, connected(address) as client:
        assert done(client, attrgetter("chains"), SampleSettings(chains=3)) == 3
        assert done(client, partial(sorted, reverse=True), [2, 3]) == [3, 2]
        with pytest.raises(ModuleNotFoundError):
            done(client, __import__, "nothing_of_that_name")


def test_what_is_sent_ahead_waits_for_a_first_worker() -> None:
    nobody: Any = Answering(TimeoutError("No valid workers found"), TimeoutError(), "sent")
    SameProgram(nobody, nobody).scatter("data")
    assert nobody.answers == []


class Answering(Workers):
    """A cluster that answers what it is told to when data are sent ahead."""

    def __init__(self, *answers: object) -> None:
        super().__init__()
        self.answers = list(answers)

    def scatter(self, data: object, *, broadcast: bool) -> object:
        answer = self.answers.pop(0)
        if isinstance(answer, Exception):
            raise answer
        return answer

    def get_executor(self) -> ThreadPoolExecutor:
        return ThreadPoolExecutor(1)


def test_a_scheduler_that_is_lost_for_good_is_said_plainly() -> None:
    lost: Any = Answering(OSError("Timed out trying to connect"))
    with pytest.raises(InputError, match=r"^the scheduler of the cluster was lost or has ended"):
        done(lost, sorted, [2, 3])


@contextmanager
def running(*command: str) -> Iterator[subprocess.Popen[bytes]]:
    """A process of dask, which is killed at the end."""
    with subprocess.Popen(
        [sys.executable, "-m", f"distributed.cli.dask_{command[0]}", *command[1:]],
        stderr=subprocess.DEVNULL,
    ) as process:
        try:
            yield process
        finally:
            process.kill()


@pytest.mark.slow
def test_chains_go_on_after_their_scheduler_was_restarted(tmp_path: Path) -> None:
    with socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    address = f"tcp://127.0.0.1:{port}"
    begin = partial(
        running, "scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard"
    )
    # A worker without a nanny ends with its scheduler.
    work = partial(running, "worker", address, "--no-nanny", "--nthreads", "1", "--no-dashboard")

    def sampled(executor: SameProgram | None) -> list[Snapshot]:
        return run_resumable_chains(
            kept.tempered,
            kept.ROUNDS if executor is None else executor.scatter(kept.ROUNDS),
            kept.STARTS,
            seed=11,
            folder=tmp_path / ("here" if executor is None else "there"),
            identity=kept.IDENTITY,
            every_seconds=0.05,
            executor=executor,
        )

    with ExitStack() as later:

        def restart() -> None:
            checkpoints = tmp_path / "there"
            while not list(checkpoints.glob("chain-*.npz")):
                sleep(0.02)
            first.kill()
            first.wait()
            later.enter_context(begin())
            later.enter_context(work())

        with (
            begin() as first,
            work(),
            connected(address) as client,
            executor_of(client) as executor,
        ):
            assert executor is not None
            again = Thread(target=restart)
            again.start()
            found = sampled(executor)
            again.join()
        assert first.returncode == -signal.SIGKILL
    for one, other in zip(found, sampled(None), strict=True):
        assert kept.same(one, other)


def test_a_scheduler_without_workers_is_spoken_of(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    workers = Workers()
    monkeypatch.setattr(workers, "run", lambda *_, **__: {})
    monkeypatch.setattr(distributed, "Client", lambda *_, **__: workers)
    with connected("tcp://here:1"):
        assert "tcp://here:1: has no worker yet" in caplog.text


def test_an_address_that_needs_certificates_says_so() -> None:
    with (
        pytest.raises(InputError, match="needs certificates; name them in dask's settings"),
        connected("tls://127.0.0.1:9"),
    ):
        pass


def test_nobody_at_the_address_is_said_plainly(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("imapper_prob.sampling.cluster._PATIENCE", "200ms")
    write_clip(tmp_path / "clip.npz", demo_clip())
    arguments = ["run", str(tmp_path / "clip.npz"), "-o", str(tmp_path / "out")]
    assert main([*arguments, "--cluster", "tcp://127.0.0.1:9"]) == 2
    assert "tcp://127.0.0.1:9: no dask scheduler answers there" in capsys.readouterr().err
