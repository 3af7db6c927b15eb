"""Run several chains in parallel; the draws do not depend on the number of processes.

Each chain draws from its own child of one seed sequence, so its draws are the same whatever the
number of workers. Processes are spawned, not forked, because a fork after a threaded library was
loaded may hang. Starting processes takes seconds, so :class:`Workers` keeps them alive for several
calls. The problem of each call is sent once to each process, not once to each chain.
"""

from __future__ import annotations

import ctypes
import logging
import multiprocessing
import os
import pickle
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    FIRST_EXCEPTION,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    wait,
)
from contextlib import contextmanager
from multiprocessing.process import BaseProcess
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np

from imapper_prob.samplers.interrupts import first_interrupt_sets

__all__ = ["ChainError", "Report", "Task", "Workers", "run_chains"]

_LOG = logging.getLogger(__name__)

P_contra = TypeVar("P_contra", contravariant=True)
X_contra = TypeVar("X_contra", contravariant=True)
R_co = TypeVar("R_co", covariant=True)
P = TypeVar("P")
X = TypeVar("X")
R = TypeVar("R")

# Interval at which progress is passed on, seconds; short enough that a person sees no delay.
_POLL_SECONDS = 0.1

# Chains already fill the cores, so threads inside them would only compete for these.
_ONE_THREAD = dict.fromkeys(
    (
        "OMP_NUM_THREADS",
        "OPENBLAS_NUM_THREADS",
        "MKL_NUM_THREADS",
        "VECLIB_MAXIMUM_THREADS",
        "NUMBA_NUM_THREADS",
    ),
    "1",
)


class ChainError(RuntimeError):
    """A process that ran chains died; the message names the chains."""


class Report(Protocol):
    """The callback that a task calls between steps.

    Parameters
    ----------
    *args, **kwargs
        See :meth:`__call__`.
    """

    def __call__(self, progress: object = None, /) -> bool:
        """Pass on ``progress`` (picklable, under 4 kB); an answer of False asks the task to return.

        Messages of up to 4 kB are written in one piece, so a process that is killed cannot leave
        half a message behind.
        """


class Task(Protocol[P_contra, X_contra, R_co]):
    """The function that runs one chain; importable by name, so that another process can find it.

    Parameters
    ----------
    *args, **kwargs
        See :meth:`__call__`.
    """

    def __call__(
        self, problem: P_contra, start: X_contra, rng: np.random.Generator, report: Report, /
    ) -> R_co:
        """Run from ``start`` and return the result, or the partial result if asked to stop."""


OnProgress = Callable[[int, object], bool | None]


class _Job(NamedTuple):
    chain: int
    start: Any
    seed: np.random.SeedSequence


class _SentJob(NamedTuple):
    """A job, and the file that holds its task and problem."""

    shared_input: Path
    job: _Job


class _Shared(NamedTuple):
    """Shared memory of the parent process and its workers.

    ``stop`` asks all chains to stop. ``pids`` holds the process of each running chain, else 0. Both
    are shared memory without a lock: a lock might stay held by a process that was killed, or by the
    code that a signal handler interrupted.
    """

    stop: Any
    pids: Any
    queue: Any


def run_chains(
    task: Task[P, X, R],
    problem: P,
    starts: Sequence[X],
    *,
    seed: int | np.random.SeedSequence,
    workers: int | Workers = 1,
    executor: Executor | None = None,
    on_progress: OnProgress | None = None,
    scratch: Path | None = None,
    restarts: int = 0,
) -> list[R]:
    """Run one chain from each start.

    The first Ctrl-C asks every chain to stop, and their partial results are returned. The second
    one raises `KeyboardInterrupt`.

    Parameters
    ----------
    task : callable
        ``task(problem, start, rng, report) -> result``. With more than one worker all of
        them must be picklable. A task that can be stopped calls ``report`` now and then
        and returns when the answer is False.
    problem : object
        Data that all chains share, read only.
    starts : sequence
        One start per chain.
    seed : int or numpy.random.SeedSequence
        Each chain draws from its own child. As usual in numpy, a seed sequence that is passed a
        second time spawns other children; an int gives the same ones.
    workers : int or Workers
        1 runs the chains in this process, one after the other. A larger number spawns that many
        processes, each with one thread for BLAS, OpenMP and numba. `Workers` reuses its processes.
    executor : concurrent.futures.Executor, optional
        Where to run instead, such as dask's ``client.get_executor()``. Only results come back from
        an executor: no progress, and no partial results of an interrupted run. The problem is sent
        with each chain; with dask a large one is sent once to each worker if ``problem`` is
        ``client.scatter(problem, broadcast=True)``.
    on_progress : callable, optional
        ``on_progress(chain, progress)``, called in this process with what tasks report; returning
        False asks all chains to stop.
    scratch : Path, optional
        Folder for the temporary file that sends the problem to the processes; its name begins with
        ``.problem-``, and it stays behind if this process is killed. Default: the system's folder.
    restarts : int
        How often all chains are started again after a process died; they draw the same.

    Returns
    -------
    list
        Results in the order of ``starts``.

    Raises
    ------
    ChainError
        Processes died more often than ``restarts``.
    Exception
        Any exception of a task, with a note that names the chain; the other chains are asked to
        stop.

    Notes
    -----
    With more than one worker, a script must keep its own code under ``if __name__ == "__main__":``,
    because each process imports the script.
    """
    parent = seed if isinstance(seed, np.random.SeedSequence) else np.random.SeedSequence(seed)
    children = parent.spawn(len(starts))
    jobs = [_Job(i, *pair) for i, pair in enumerate(zip(starts, children, strict=True))]
    if executor is not None and on_progress is not None:
        raise ValueError("on_progress cannot be called from another executor")
    while True:
        try:
            if executor is not None:
                return _run_elsewhere(task, problem, jobs, executor)
            if isinstance(workers, Workers):
                return workers.run(task, problem, jobs, on_progress, scratch)
            with Workers(min(workers, max(1, len(jobs)))) as processes:
                return processes.run(task, problem, jobs, on_progress, scratch)
        except ChainError as error:
            if restarts == 0:
                raise
            restarts -= 1
            _LOG.warning("%s; the chains are started again", error)


def _run(task: Task[P, X, R], problem: P, job: _Job, report: Report) -> R:
    try:
        return task(problem, job.start, np.random.default_rng(job.seed), report)
    except Exception as error:
        error.add_note(f"in chain {job.chain}")
        raise


def _no_report(progress: object = None, /) -> bool:
    return True


def _run_elsewhere(
    task: Task[P, X, R], problem: P, jobs: Sequence[_Job], executor: Executor
) -> list[R]:
    futures: list[Future[R]] = []
    try:
        futures += [executor.submit(_run, task, problem, job, _no_report) for job in jobs]
        wait(futures, return_when=FIRST_EXCEPTION)
        # Finished futures come first, so that an error is raised without waiting for other chains.
        for future in sorted(futures, key=lambda future: not future.done()):
            future.result()
    except CancelledError as error:  # of dask, whose message is empty
        raise ChainError("the executor gave up the chains: its scheduler was lost") from error
    except _deaths() as error:
        raise ChainError(f"a worker of the executor died: {error}") from error
    finally:
        for future in futures:
            future.cancel()
    return [future.result() for future in futures]


def _deaths() -> tuple[type[BaseException], ...]:
    """Exceptions that executors raise when a worker died."""
    # `distributed` is loaded only if the caller uses dask.
    distributed = sys.modules.get("distributed")
    dask = () if distributed is None else (distributed.scheduler.KilledWorker,)
    return (BrokenExecutor, *dask)


def _run_here(
    task: Task[P, X, R], problem: P, jobs: Sequence[_Job], on_progress: OnProgress | None
) -> list[R]:
    stop = ctypes.c_bool(False)

    def reporter(chain: int) -> Report:
        def report(progress: object = None, /) -> bool:
            if on_progress is not None and progress is not None:
                stop.value = on_progress(chain, progress) is False or stop.value
            return not stop.value

        return report

    with first_interrupt_sets(stop):
        return [_run(task, problem, job, reporter(job.chain)) for job in jobs]


class Workers:
    """A pool of processes that runs chains for several calls of :func:`run_chains`.

    Parameters
    ----------
    count : int
        Number of processes; 1 runs chains in this process.

    Raises
    ------
    ValueError
        ``count`` is below 1.

    Examples
    --------
    >>> with Workers(2) as workers:  # doctest: +SKIP
    ...     first = run_chains(task, problem, starts, seed=1, workers=workers)
    ...     second = run_chains(task, problem, first, seed=2, workers=workers)
    """

    def __init__(self, count: int) -> None:
        if count < 1:
            raise ValueError(f"workers must be at least 1, not {count}")
        self._count = count
        self._context = multiprocessing.get_context("spawn")
        self._pool: ProcessPoolExecutor | None = None
        self._shared: _Shared
        self._strangers: set[BaseProcess] = set()
        self._started: set[BaseProcess] = set()

    def __enter__(self) -> Workers:
        return self

    def __exit__(self, *_: object) -> None:
        self._close()

    def run(
        self,
        task: Task[P, X, R],
        problem: P,
        jobs: Sequence[_Job],
        on_progress: OnProgress | None,
        scratch: Path | None,
    ) -> list[R]:
        """Run jobs that :func:`run_chains` has made.

        Parameters
        ----------
        task, problem
            See `run_chains`.
        jobs : sequence
            One per chain.
        on_progress, scratch
            See `run_chains`.

        Returns
        -------
        list
            Results in the order of ``jobs``.

        Raises
        ------
        ChainError
            A process died.
        """
        if self._count == 1:
            return _run_here(task, problem, jobs, on_progress)
        if self._pool is not None and len(self._shared.pids) < len(jobs):
            self._close()
        pool = self._open(len(jobs)) if self._pool is None else self._pool
        self._shared.stop.value = False
        with (
            first_interrupt_sets(self._shared.stop),
            _shared_input((task, problem), scratch) as shared_input,
        ):
            try:
                with _environment(_ONE_THREAD):
                    futures: list[Future[R]] = [
                        pool.submit(_run_in_worker, _SentJob(shared_input, job)) for job in jobs
                    ]
                    # A pool notices that a process died only among those it had when it last got a
                    # job, and it starts another process only after that check. Hence an empty job.
                    pool.submit(_nothing)
                self._started |= set(multiprocessing.active_children()) - self._strangers
                _await(futures, self._shared, on_progress)
            except BrokenExecutor as error:
                raise self._dead() from error
            except BaseException:
                for process in self._started:
                    process.terminate()
                self._close()
                raise
            try:
                return [future.result() for future in futures]
            except BrokenExecutor as error:
                raise self._dead() from error

    def _open(self, chains: int) -> ProcessPoolExecutor:
        self._shared = _Shared(
            stop=self._context.RawValue(ctypes.c_bool, False),
            pids=self._context.RawArray(ctypes.c_long, chains),
            queue=self._context.SimpleQueue(),
        )
        self._strangers, self._started = set(multiprocessing.active_children()), set()
        self._pool = ProcessPoolExecutor(
            self._count, self._context, initializer=_initialise, initargs=(self._shared,)
        )
        return self._pool

    def _dead(self) -> ChainError:
        self._close()
        # Exit codes are known only after the pool has joined all its processes.
        return ChainError(_dead_workers_message(self._shared.pids, self._started))

    def _close(self) -> None:
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)
            self._pool = None


@contextmanager
def _shared_input(contents: object, scratch: Path | None) -> Iterator[Path]:
    """Write what all workers need to a temporary file, which each process reads once.

    Arguments of a new process pass through a pipe, and the next process is started only after the
    last one has imported its modules and read them; large data would make this slow.
    """
    with TemporaryDirectory(prefix=".problem-", dir=scratch) as folder:
        path = Path(folder) / "problem"
        with path.open("wb") as file:
            pickle.dump(contents, file, protocol=pickle.HIGHEST_PROTOCOL)
        yield path


def _await(futures: Sequence[Future[R]], shared: _Shared, on_progress: OnProgress | None) -> None:
    """Pass on progress until every chain has ended; if one fails, stop the others."""
    pending = set(futures)
    while pending:
        done, pending = wait(pending, _POLL_SECONDS, FIRST_COMPLETED)
        if any(future.exception() for future in done):
            shared.stop.value = True
            pending = {future for future in pending if not future.cancel()}
        while not shared.queue.empty():
            said = shared.queue.get()
            if on_progress is not None and on_progress(*said) is False:
                shared.stop.value = True


# State of this worker process: what `_initialise` stored, and the input that was read last. A
# pool has no other way to send something once per process instead of once per job.
_shared: _Shared
_opened: tuple[Path, Task[Any, Any, Any], Any] | None = None


def _initialise(shared: _Shared) -> None:
    global _shared
    # The terminal sends Ctrl-C to all processes; only the parent reacts to it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_die_with_parent, daemon=True).start()
    _shared = shared


def _die_with_parent() -> None:
    """End this process when its parent has ended, even if killed; else it would wait forever."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _nothing() -> None:
    """A job that does nothing."""


def _run_in_worker(sent: _SentJob) -> Any:
    global _opened
    path, job = sent.shared_input, sent.job
    if _opened is None or _opened[0] != path:
        try:
            with path.open("rb") as file:
                _opened = (path, *pickle.load(file))
        except Exception as error:
            raise ChainError(
                f"chain {job.chain}: its process could not begin ({error}): can it import the "
                "task, and is the script's own work under `if __name__ == '__main__':`?"
            ) from error
    _, task, problem = _opened

    def report(progress: object = None, /) -> bool:
        if _shared.stop.value:
            return False
        if progress is not None:
            _shared.queue.put((job.chain, progress))
        return True

    _shared.pids[job.chain] = os.getpid()
    try:
        return _run(task, problem, job, report)
    finally:
        _shared.pids[job.chain] = 0


def _dead_workers_message(pids: Sequence[int], processes: set[BaseProcess]) -> str:
    """Message that names the chains whose process died; the pool ends all others by SIGTERM."""
    codes = {process.pid: process.exitcode for process in processes}
    running = {chain: codes.get(pid) for chain, pid in enumerate(pids) if pid}
    if not running:
        if -signal.SIGKILL in codes.values():
            return f"a process that waited for a chain died with {_named(-signal.SIGKILL)}"
        return (
            "a process died before its chain began: can it import the task, and is the "
            "script's own work under `if __name__ == '__main__':`?"
        )
    died = {chain: code for chain, code in running.items() if code not in (0, -signal.SIGTERM)}
    return "; ".join(
        f"chain {chain}: its process died with {_named(code)}"
        for chain, code in (died or running).items()
    )


def _named(code: int | None) -> str:
    killed = " (killed, perhaps for want of memory)" if code == -signal.SIGKILL else ""
    return f"exit code {code}{killed}"


@contextmanager
def _environment(values: Mapping[str, str]) -> Iterator[None]:
    """Set environment variables for processes that are started inside the block.

    Numerical libraries read them on import, so a worker cannot set them in time itself.
    """
    previous = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in previous.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
