"""Chains in one process and in several."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
import tempfile
import textwrap
import threading
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from imapper_prob.samplers.chains import ChainError, Workers, run_chains
from tests.samplers import tasks

ROOT = Path(__file__).parents[2]


def test_draws_do_not_depend_on_the_number_of_workers():
    starts = [0.0, 10.0, 20.0]
    one = run_chains(tasks.walk, 50, starts, seed=5)
    two = run_chains(tasks.walk, 50, starts, seed=5, workers=2)
    with ThreadPoolExecutor(2) as executor:
        other = run_chains(tasks.walk, 50, starts, seed=5, executor=executor)
    np.testing.assert_array_equal(one, two)
    np.testing.assert_array_equal(one, other)


def test_processes_serve_several_calls():
    alone = run_chains(tasks.walk, 50, [0.0, 10.0, 20.0], seed=5)
    with Workers(2) as workers:
        pids = run_chains(tasks.process, 0.2, [0, 0, 0, 0], seed=1, workers=workers)
        again = run_chains(tasks.process, 0.2, [0, 0], seed=1, workers=workers)
        walked = run_chains(tasks.walk, 50, [0.0, 10.0, 20.0], seed=5, workers=workers)
        # Nobody reads this progress, and it does not stop the pipe.
        run_chains(tasks.walk, 20_000, [0.0], seed=5, workers=workers)
    np.testing.assert_array_equal(alone, walked)
    assert len(set(pids)) == 2
    assert set(again) <= set(pids)


def test_processes_are_started_again_after_one_died():
    with Workers(2) as workers:
        with pytest.raises(ChainError, match="chain 1: its process died"):
            run_chains(tasks.kill_one, 1, [0, 1], seed=1, workers=workers)
        with pytest.raises(FloatingPointError, match="bad density"):
            run_chains(tasks.fail_one, 1, [0, 1], seed=1, workers=workers)
        walked = run_chains(tasks.walk, 50, [0.0], seed=5, workers=workers)
    np.testing.assert_array_equal(walked, run_chains(tasks.walk, 50, [0.0], seed=5))


def test_chains_differ_and_so_do_seeds():
    one = run_chains(tasks.walk, 50, [0.0, 0.0], seed=5)
    assert not np.array_equal(one[0], one[1])
    assert not np.array_equal(one, run_chains(tasks.walk, 50, [0.0, 0.0], seed=6))
    again = run_chains(tasks.walk, 50, [0.0, 0.0], seed=np.random.SeedSequence(5))
    np.testing.assert_array_equal(one, again)


def test_more_starts_do_not_change_the_first_chains():
    few = run_chains(tasks.walk, 20, [0.0], seed=5)
    many = run_chains(tasks.walk, 20, [0.0, 0.0, 0.0], seed=5)
    np.testing.assert_array_equal(few[0], many[0])


def test_no_start_is_no_chain():
    assert run_chains(tasks.walk, 20, [], seed=5, workers=2) == []


@pytest.mark.parametrize("workers", [1, 2])
def test_progress_arrives_in_order(workers):
    seen: dict[int, list[object]] = {0: [], 1: []}
    run_chains(
        tasks.walk,
        30,
        [0.0, 0.0],
        seed=5,
        workers=workers,
        on_progress=lambda chain, progress: seen[chain].append(progress),
    )
    assert seen == {0: list(range(30)), 1: list(range(30))}


@pytest.mark.parametrize("workers", [1, 2])
def test_progress_can_stop_all_chains(workers):
    results = run_chains(
        tasks.slow_walk,
        6_000,
        [0.0, 0.0, 0.0],
        seed=5,
        workers=workers,
        on_progress=lambda chain, progress: progress < 5,
    )
    assert all(1 <= n < 600 for n in results)


@pytest.mark.parametrize("workers", [1, 2])
def test_an_interrupt_returns_what_there_is(workers):
    before = signal.getsignal(signal.SIGINT)
    timer = threading.Timer(1.5, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    results = run_chains(tasks.slow_walk, 6_000, [0.0, 0.0], seed=5, workers=workers)
    assert all(1 <= n < 6_000 for n in results)
    assert signal.getsignal(signal.SIGINT) is before


def test_a_second_interrupt_gives_up():
    script = """
        import os, signal, threading, time
        from imapper_prob.samplers.chains import run_chains
        from tests.samplers.tasks import slow_walk

        def stubborn(problem, start, rng, report):
            slow_walk(problem, start, rng, lambda progress: True)

        if __name__ == "__main__":
            for delay in (0.3, 0.5):
                threading.Timer(delay, os.kill, (os.getpid(), signal.SIGINT)).start()
            try:
                run_chains(stubborn, 6_000, [0, 0], seed=5)
            except KeyboardInterrupt:
                print("gave up")
    """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(script)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=30,
        check=True,
    )
    assert done.stdout == "gave up\n"


@pytest.mark.parametrize("workers", [1, 2])
def test_the_error_of_a_task_names_its_chain(workers):
    starts = [1, 0, 0] if workers == 1 else [0, 1, 0]
    with pytest.raises(FloatingPointError, match="a bad density") as caught:
        run_chains(tasks.fail_one, 1, starts, seed=5, workers=workers)
    assert caught.value.__notes__ == [f"in chain {starts.index(1)}"]


def test_a_process_that_dies_is_no_hang():
    with pytest.raises(ChainError, match=r"^chain 1: .* exit code -9 .*memory\)$"):
        run_chains(
            tasks.kill_one, 1, [0, 1, 0], seed=5, workers=2, on_progress=lambda *progress: None
        )


def test_a_process_that_is_killed_while_it_waits_is_made_good(caplog):
    starts = [0.0, 10.0]
    with Workers(2) as workers:
        expected = run_chains(tasks.walk, 50, starts, seed=5, workers=workers)
        waiting = multiprocessing.active_children()
        for process in waiting:
            process.kill()
            process.join()
        found = run_chains(tasks.walk, 50, starts, seed=5, workers=workers, restarts=1)
    assert len(waiting) == 2
    np.testing.assert_array_equal(found, expected)
    assert "waited for a chain died with exit code -9" in caplog.text


@pytest.mark.parametrize("task", [tasks.walk, tasks.fail])
def test_what_processes_fetch_is_taken_away_again(task, tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with suppress(FloatingPointError):
        run_chains(task, 20, [0.0, 0.0], seed=0, workers=2)
    assert list(tmp_path.iterdir()) == []


def test_an_executor_that_breaks_is_no_hang():
    with (
        ProcessPoolExecutor(2) as executor,
        pytest.raises(ChainError, match=r"^a worker of the executor died: "),
    ):
        run_chains(tasks.kill_one, 1, [0, 1, 0], seed=5, executor=executor)


def test_an_error_elsewhere_does_not_wait_for_the_others():
    begin = time.perf_counter()
    with ThreadPoolExecutor(1) as executor, pytest.raises(FloatingPointError) as caught:
        # The chain that fails is not the first; those behind it are never begun.
        run_chains(tasks.fail_or_wait, 1, [0, 1, 1.5, 1.5, 1.5], seed=5, executor=executor)
    assert caught.value.__notes__ == ["in chain 1"]
    assert time.perf_counter() - begin < 4


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_process_that_cannot_begin_says_what_to_look_at(capfd):
    with pytest.raises(ChainError, match=r"chain [01]: its process could not begin"):
        run_chains(tasks.walk, tasks.Unloadable(), [0.0, 0.0], seed=5, workers=2)


def test_workers_have_one_thread_and_the_parent_keeps_its_own(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    monkeypatch.delenv("NUMBA_NUM_THREADS", raising=False)
    names = ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS")
    (found, _) = run_chains(tasks.threads, names, [0.0, 0.0], seed=5, workers=2)
    assert found == {"OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}
    assert os.environ["OMP_NUM_THREADS"] == "7"
    assert "NUMBA_NUM_THREADS" not in os.environ


def test_what_cannot_be_asked_for_is_refused():
    with pytest.raises(ValueError, match="workers must be at least 1"):
        run_chains(tasks.walk, 5, [0.0], seed=5, workers=0)
    with ThreadPoolExecutor(1) as executor, pytest.raises(ValueError, match="on_progress"):
        run_chains(
            tasks.walk, 5, [0.0], seed=5, executor=executor, on_progress=lambda *progress: None
        )


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_who_is_stopped_leaves_no_process_and_no_file(
    tmp_path: Path, number: signal.Signals
) -> None:
    """By SIGTERM once, by Ctrl-C twice; nor does Python speak of leaked semaphores."""
    program = textwrap.dedent(
        f"""
        from pathlib import Path
        from imapper_prob.cli.console import stoppable
        from imapper_prob.samplers.chains import run_chains
        from tests.samplers.tasks import leave_pid

        if __name__ == "__main__":
            pids = Path({str(tmp_path / "pids")!r})
            try:
                with stoppable():
                    run_chains(leave_pid, pids, [0, 1], seed=0, workers=2)
            except KeyboardInterrupt:
                raise SystemExit(7)
        """
    )
    for folder in ("pids", "tmp"):
        (tmp_path / folder).mkdir()
    (tmp_path / "script.py").write_text(program)
    parent = subprocess.Popen(
        [sys.executable, str(tmp_path / "script.py")],
        env={**os.environ, "PYTHONPATH": str(ROOT), "TMPDIR": str(tmp_path / "tmp")},
        stderr=subprocess.PIPE,
        text=True,
    )
    until(lambda: len(pids_in(tmp_path / "pids")) == 2)
    workers = pids_in(tmp_path / "pids")
    parent.send_signal(number)
    if number == signal.SIGINT:
        time.sleep(1)
        parent.send_signal(number)
    _, said = parent.communicate(timeout=60)
    assert (parent.returncode, said) == (7, "")
    until(lambda: all(map(gone, workers)))
    assert list((tmp_path / "tmp").iterdir()) == []


def until(done: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 60
    while not done():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def gone(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return True
    # An orphan that nobody has waited for is a zombie: dead, but still listed.
    status = Path(f"/proc/{pid}/stat")
    return status.exists() and status.read_text().rsplit(")", 1)[1].split()[0] == "Z"


def pids_in(folder: Path) -> list[int]:
    """Of processes that said which they are."""
    return [int(text) for text in (path.read_text() for path in folder.glob("*.pid")) if text]


def test_workers_do_not_outlive_a_parent_that_is_killed(tmp_path: Path) -> None:
    program = textwrap.dedent(
        f"""
        from pathlib import Path
        from imapper_prob.samplers.chains import run_chains
        from tests.samplers.tasks import leave_pid

        if __name__ == "__main__":
            run_chains(leave_pid, Path({str(tmp_path)!r}), [0, 1], seed=0, workers=2)
        """
    )
    (tmp_path / "script.py").write_text(program)
    parent = subprocess.Popen(
        [sys.executable, str(tmp_path / "script.py")],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    until(lambda: len(pids_in(tmp_path)) == 2)
    workers = pids_in(tmp_path)
    parent.kill()
    parent.wait()
    until(lambda: all(map(gone, workers)))
