"""Chains on the workers of a dask cluster, all of which must have the same version of the program.

Connecting asks every worker for its version, before any work. Each task asks again in the worker
that runs it, so that a worker that joins later is refused as well.
"""

from __future__ import annotations

import logging
import pickle
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future
from contextlib import contextmanager
from functools import partial
from importlib.metadata import version
from typing import Any, Final, Protocol, TypeVar

from imapper_prob.models.errors import InputError

__all__ = ["Cluster", "SameProgram", "connected", "executor_of"]

T = TypeVar("T")
_LOG = logging.getLogger(__name__)
_PROGRAM: Final = "imapper-prob"
_PATIENCE: Final = "10s"
"""Time limit for connecting to a scheduler."""
_REFUSED: Final = (
    "the worker {worker} has {found}, and this is {own}; install the same one on all machines, and "
    "start the worker again"
)
_LOST: Final = (
    "the scheduler of the cluster was lost or has ended a task; start it and its workers again, "
    "and give the same command again"
)


class Cluster(Protocol):
    """The methods of a `distributed.Client` that are used.

    Parameters
    ----------
    *args, **kwargs
        The constructor is that of the class.
    """

    def get_executor(self) -> Executor:
        """An executor that runs tasks on the workers.

        Returns
        -------
        Executor
        """

    def run(self, function: Callable[..., Any], *args: Any, on_error: str) -> dict[str, Any]:
        """Call a function on every worker, and return its results or errors.

        Parameters
        ----------
        function : callable
        *args : object
            Its arguments.
        on_error : str
            ``"return"`` to return errors instead of raising them.

        Returns
        -------
        dict of str to object
            By address of the worker.
        """

    def scatter(self, data: Any, *, broadcast: bool) -> Any:
        """Send data to workers once, and return a reference to it.

        Parameters
        ----------
        data : object
        broadcast : bool
            Whether to send it to all workers.

        Returns
        -------
        object
            The reference, which can be passed to tasks.
        """


@contextmanager
def connected(address: str | None) -> Iterator[Cluster | None]:
    """Connect to the scheduler at an address such as ``tcp://host:8786``; None without one.

    Parameters
    ----------
    address : str or None

    Returns
    -------
    iterator of Cluster or None
        A context manager.

    Raises
    ------
    InputError
        dask is not installed, no scheduler answers, or a worker has another version of the program.
    """
    if address is None:
        yield None
        return
    try:
        from distributed import Client
    except ImportError as error:
        raise InputError(
            "a cluster needs dask's distributed: install the extra, imapper-prob[cluster]"
        ) from error
    make_client: Any = Client
    try:
        client = make_client(address, timeout=_PATIENCE)
    except TypeError as error:  # raised for a tls:// address without certificates
        raise InputError(
            f"{address}: needs certificates; name them in dask's settings, distributed.comm.tls"
        ) from error
    except (OSError, ValueError) as error:
        refused = "certificate" in str(error)
        why = "its certificate is not the one expected" if refused else "nothing answers"
        raise InputError(f"{address}: no dask scheduler answers there ({why})") from error
    with client:
        _require_same_program(address, client)
        yield client


@contextmanager
def executor_of(cluster: Cluster | None) -> Iterator[SameProgram | None]:
    """The executor of a cluster, whose tasks run with this version only; None without a cluster.

    On exit it does not wait for running tasks, because those of lost workers never end.

    Parameters
    ----------
    cluster : Cluster or None

    Returns
    -------
    iterator of SameProgram or None
        A context manager.

    Raises
    ------
    InputError
        A worker that was given a task has another version of the program, or the scheduler is lost.
    """
    if cluster is None:
        yield None
        return
    executor = cluster.get_executor()
    try:
        yield SameProgram(cluster, executor)
    except ImportError as error:
        if error.name != _PROGRAM:
            raise
        raise InputError(str(error)) from error
    except (BrokenExecutor, CancelledError) as error:
        raise InputError(_LOST) from error
    finally:
        executor.shutdown(wait=False)


class SameProgram(Executor):
    """An executor of a cluster whose tasks compare the version of the program where they run.

    A task and its arguments are sent as bytes, which a worker unpacks only if its version is the
    same: another version may be unable to unpack them, and dask would end that worker.

    Parameters
    ----------
    cluster : Cluster
    executor : Executor
        That of the cluster.
    """

    def __init__(self, cluster: Cluster, executor: Executor) -> None:
        self._cluster = cluster
        self._executor = executor

    def scatter(self, data: Any) -> Any:
        """Send an argument of several tasks ahead, once to each worker; wait until there is one.

        Parameters
        ----------
        data : object
            Picklable.

        Returns
        -------
        object
            Replaces the argument in calls of `submit`.
        """
        return _Ahead(self._cluster, pickle.dumps(data))

    def submit(self, task: Callable[..., T], /, *args: Any, **kwargs: Any) -> Future[T]:
        """Run a task in a worker that has this version of the program.

        Parameters
        ----------
        task : callable
        *args : object
            Picklable, or results of `scatter`.
        **kwargs : object
            Picklable.

        Returns
        -------
        Future
            Its exception is an `ImportError` that names the worker if that has another version.
        """
        sent = [arg.reference() if isinstance(arg, _Ahead) else pickle.dumps(arg) for arg in args]
        call = pickle.dumps(partial(task, **kwargs))
        return self._executor.submit(_compared(), version(_PROGRAM), call, *sent)


class _Ahead:
    """An argument that is sent ahead, as bytes, and again to a scheduler that was restarted."""

    def __init__(self, cluster: Cluster, sent: bytes) -> None:
        self._cluster = cluster
        self._sent = sent
        self._reference = self._scattered()

    def reference(self) -> Any:
        # A client cancels what it has sent when it loses its scheduler.
        if self._reference.cancelled():
            self._reference = self._scattered()
        return self._reference

    def _scattered(self) -> Any:
        while True:
            try:
                return self._cluster.scatter(self._sent, broadcast=True)
            except TimeoutError:  # dask waits some seconds for a first worker
                continue
            except OSError as error:
                raise BrokenExecutor("its scheduler does not answer any more") from error


def _compared() -> Callable[..., Any]:
    """Make the function that workers run: it compares versions, then unpacks and runs a task."""

    # Importable functions are sent by name, and a worker without this program cannot find them.
    # This one is not importable, so that it is sent whole. It needs Python and dask only.
    def run(own: str, *sent: bytes) -> Any:
        import pickle
        from importlib.metadata import PackageNotFoundError, version

        from distributed import get_worker

        try:
            found = f"{_PROGRAM} {version(_PROGRAM)}"
        except PackageNotFoundError:
            found = f"no {_PROGRAM}"
        if found != f"{_PROGRAM} {own}":
            here = get_worker().address
            text = _REFUSED.format(worker=here, found=found, own=own)
            raise ImportError(text, name=_PROGRAM)
        task, *args = map(pickle.loads, sent)
        return task(*args)

    return run


def _require_same_program(address: str, cluster: Cluster) -> None:
    """Ask every worker for its version of the program, and refuse another one."""
    own = version(_PROGRAM)
    workers = cluster.run(version, _PROGRAM, on_error="return")
    if not workers:
        _LOG.warning("%s: has no worker yet; chains wait until one is started", address)
    for worker, found in workers.items():
        if found != own:
            has = f"{_PROGRAM} {found}" if isinstance(found, str) else f"no {_PROGRAM}"
            raise InputError(_REFUSED.format(worker=worker, found=has, own=own))
