"""Chains that go on after a kill, each with a checkpoint of its own in one folder."""

from __future__ import annotations

import logging
import shutil
from collections.abc import Sequence
from concurrent.futures import Executor
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, Protocol, TypeVar

import numpy as np

from imapper_prob.samplers.chains import ChainError, OnProgress, Report, run_chains
from imapper_prob.samplers.checkpoint import CheckpointError, Keeper, load

__all__ = ["ResumableTask", "checkpoint_of", "run_resumable_chains"]

P_contra = TypeVar("P_contra", contravariant=True)
X_contra = TypeVar("X_contra", contravariant=True)
R_co = TypeVar("R_co", covariant=True)
P = TypeVar("P")
X = TypeVar("X")
R = TypeVar("R")

_LOG = logging.getLogger(__name__)


class ResumableTask(Protocol[P_contra, X_contra, R_co]):
    """One chain that keeps checkpoints; importable by name."""

    def __call__(
        self,
        problem: P_contra,
        start: X_contra,
        rng: np.random.Generator,
        report: Report,
        keeper: Keeper,
        /,
    ) -> R_co:
        """Go on from ``keeper.load()``, or begin at ``start`` with ``rng`` where it is None.

        A snapshot holds everything that later draws depend on, the generator included, and
        the draws so far. The task calls ``keeper.offer`` between steps and ``keeper.save``
        when it ends or was asked to stop. A task that finds itself finished just returns.
        """


@dataclass(frozen=True)
class _WithKeeper(Generic[P, X, R]):
    """A resumable task as a plain one, whose start says where its checkpoint lies."""

    task: ResumableTask[P, X, R]
    identity: str
    every_seconds: float

    def __call__(
        self, problem: P, start: tuple[Path, X], rng: np.random.Generator, report: Report, /
    ) -> R:
        # Made here and not sent: its clock is that of the process that runs the chain.
        keeper = Keeper(start[0], identity=self.identity, every_seconds=self.every_seconds)
        return self.task(problem, start[1], rng, report, keeper)


def run_resumable_chains(
    task: ResumableTask[P, X, R],
    problem: P,
    starts: Sequence[X],
    *,
    seed: int | np.random.SeedSequence,
    folder: Path,
    identity: str,
    every_seconds: float = 5.0,
    restarts: int = 1,
    workers: int = 1,
    executor: Executor | None = None,
    on_progress: OnProgress | None = None,
    anew: bool = False,
) -> list[R]:
    """Run one chain from each start; killed at any moment and run again, the draws are the same.

    Parameters
    ----------
    task : callable
        ``task(problem, start, rng, report, keeper) -> result``, see `ResumableTask`.
    problem, starts, seed, workers, executor, on_progress
        See `imapper_prob.samplers.chains.run_chains`. To resume, hand in the same ones;
        only ``workers``, ``executor`` and ``on_progress`` may differ.
    folder : Path
        Where checkpoints lie, ``chain-0.npz`` and so on; made if need be. No two runs may use
        it at the same time. All workers must see it, those on other machines too.
    identity : str
        Of settings, data and seed, such as a `imapper_prob.samplers.checkpoint.fingerprint`;
        a checkpoint of another identity is refused.
    every_seconds : float
        Least time between two checkpoints of a chain.
    restarts : int
        How often the run goes on by itself, from the checkpoints, after a worker died.
    anew : bool
        Delete checkpoints that are damaged or of another run, instead of refusing them.

    Returns
    -------
    list
        Results in the order of ``starts``. The checkpoints stay.

    Raises
    ------
    CheckpointError
        A checkpoint is damaged or of another run, unless ``anew``.
    ChainError
        Workers died more often than ``restarts``.
    Exception
        See `imapper_prob.samplers.chains.run_chains`.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for left_by_a_kill in folder.glob(".chain-*.partial"):
        left_by_a_kill.unlink()
    for left_by_a_kill in folder.glob(".problem-*"):
        shutil.rmtree(left_by_a_kill)
    if anew:
        for path in folder.glob("chain-*.npz"):
            _drop_unless_of(identity, path)
    kept = _WithKeeper(task, identity, every_seconds)
    placed = [(checkpoint_of(folder, chain), start) for chain, start in enumerate(starts)]
    # Spawning changes a sequence: each attempt spawns from a copy, the caller's just once.
    parent = seed if isinstance(seed, np.random.SeedSequence) else np.random.SeedSequence(seed)
    first = deepcopy(parent)
    parent.spawn(len(starts))
    while True:
        try:
            return run_chains(
                kept,
                problem,
                placed,
                seed=deepcopy(first),
                workers=workers,
                executor=executor,
                on_progress=on_progress,
                scratch=folder,
            )
        except ChainError as error:
            if restarts == 0:
                raise ChainError(
                    f"{error}; nothing is lost: run again, and the chains go on from their "
                    f"checkpoints in {folder}"
                ) from error
            restarts -= 1
            _LOG.warning("%s; going on from the checkpoints in %s", error, folder)


def checkpoint_of(folder: Path, chain: int) -> Path:
    """The file in which a chain leaves its checkpoint."""
    return folder / f"chain-{chain}.npz"


def _drop_unless_of(identity: str, path: Path) -> None:
    try:
        load(path, identity=identity)
    except CheckpointError as error:
        _LOG.info("%s", error)
        path.unlink()
