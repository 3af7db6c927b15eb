"""Chains on other machines, by way of a dask scheduler."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from typing import Any, Protocol

from imapper_prob.models.errors import InputError

__all__ = ["Cluster", "connected", "executor_of"]

_PATIENCE = "10s"
"""How long a scheduler may take to answer."""


class Cluster(Protocol):
    """What is asked of a `distributed.Client`."""

    def get_executor(self) -> Executor:
        """Runs tasks on the workers."""

    def scatter(self, data: Any, *, broadcast: bool) -> Any:
        """Send something to every worker once, and stand for it."""


@contextmanager
def connected(address: str | None) -> Iterator[Cluster | None]:
    """A client of the scheduler at an address such as ``tcp://host:8786``; None without one.

    Raises
    ------
    InputError
        dask is not installed, or nobody answers.
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
    except (OSError, ValueError) as error:
        raise InputError(f"{address}: no dask scheduler answers there") from error
    with client:
        yield client


@contextmanager
def executor_of(cluster: Cluster | None) -> Iterator[Executor | None]:
    """Where tasks run on a cluster; None without one.

    Left by an error or an interrupt, it does not wait for tasks: those of workers that are gone
    never end.
    """
    if cluster is None:
        yield None
        return
    executor = cluster.get_executor()
    try:
        yield executor
    finally:
        executor.shutdown(wait=False)
