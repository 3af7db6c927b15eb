"""Checkpoints of chains, and chains that resume from them after the process was killed.

A checkpoint is one ``.npz`` file of named arrays, with plain values stored as JSON. It is written
under a temporary name and then renamed, so the last checkpoint stays intact if the process is
killed. Nothing is pickled, so reading a checkpoint runs no code.
"""

from __future__ import annotations

import json
import logging
import os
import shutil
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any, Generic, NamedTuple, Protocol, TypeVar
from uuid import uuid4

import numpy as np
from numpy.typing import NDArray

from imapper_prob.samplers.chains import ChainError, OnProgress, Report, Workers, run_chains

__all__ = [
    "CheckpointError",
    "Checkpointer",
    "Snapshot",
    "checkpoint_of",
    "load",
    "pack",
    "pack_rng",
    "run_resumable_chains",
    "save",
    "unpack",
    "unpack_rng",
]

AnyArray = NDArray[Any]

# Name of the entry that holds the plain values; no array may have it.
_VALUES = "values.json"
_FORMAT = "samplers checkpoint 1"
# Largest accepted pool size of a seed sequence, in 32-bit words; numpy's default is 4.
_LARGEST_POOL = 64


class CheckpointError(RuntimeError):
    """A checkpoint cannot be used; the message names the file and says what to do."""


class Snapshot(NamedTuple):
    """The stored state of a chain.

    Parameters
    ----------
    arrays : mapping of str to array
        Of any dtype but object; numpy reserves the names "file" and "allow_pickle".
    values : mapping of str to JSON value
        Such as the number of completed steps and the generators (see `pack_rng`).
    """

    arrays: Mapping[str, AnyArray]
    values: Mapping[str, Any]


def save(path: Path, snapshot: Snapshot, *, identity: str) -> None:
    """Write a checkpoint atomically.

    Parameters
    ----------
    path : Path
    snapshot : Snapshot
    identity : str
        Identity of the run, such as a hash of its settings, data and seed.
    """
    head = {"format": _FORMAT, "identity": identity, "values": snapshot.values}
    entry = np.frombuffer(json.dumps(head).encode(), dtype=np.uint8)
    beside = path.with_name(f".{path.stem}.{uuid4().hex}.partial")
    try:
        with beside.open("wb") as file:
            np.savez(file, allow_pickle=False, **{_VALUES: entry, **snapshot.arrays})
            file.flush()
            os.fsync(file.fileno())
        os.replace(beside, path)
    finally:
        beside.unlink(missing_ok=True)


def load(path: Path, *, identity: str) -> Snapshot | None:
    """Read a checkpoint.

    Parameters
    ----------
    path : Path
    identity : str
        Identity of the run, see `save`.

    Returns
    -------
    Snapshot or None
        None if the file does not exist.

    Raises
    ------
    CheckpointError
        The file is damaged, is not a checkpoint, or belongs to a run with another identity.
    """
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        return None
    try:
        with np.load(BytesIO(content), allow_pickle=False) as file:
            arrays = {name: np.array(file[name]) for name in file.files}
        head = json.loads(arrays.pop(_VALUES).tobytes())
        kind, owner, values = head["format"], head["identity"], head["values"]
    except Exception as error:  # a damaged file may raise nearly any exception, but runs no code
        raise CheckpointError(
            f"{path} is damaged or no checkpoint ({type(error).__name__}): delete it, and its "
            "chain begins anew"
        ) from error
    if kind != _FORMAT:
        raise CheckpointError(
            f"{path} is a checkpoint of another version: delete it, or go on with that version"
        )
    if owner != identity:
        raise CheckpointError(
            f"{path} belongs to a run with other settings or data, or of another version: delete "
            "it, or keep this run's checkpoints in another folder"
        )
    return Snapshot(arrays, values)


def pack_rng(rng: np.random.Generator) -> dict[str, Any]:
    """Convert a generator to JSON values: its state, and how many children it has spawned.

    Parameters
    ----------
    rng : numpy.random.Generator

    Returns
    -------
    dict of str to JSON value

    Raises
    ------
    TypeError
        The generator is not one that ``numpy.random.default_rng`` makes.
    """
    bits = rng.bit_generator
    seed = bits.seed_seq
    if not (isinstance(bits, np.random.PCG64) and isinstance(seed, np.random.SeedSequence)):
        raise TypeError(f"only generators of default_rng can be kept, not {bits!r}")
    return {
        "state": bits.state,
        "entropy": seed.entropy,
        "spawn_key": list(seed.spawn_key),
        "pool_size": seed.pool_size,
        "n_children_spawned": seed.n_children_spawned,
    }


def unpack_rng(values: Mapping[str, Any]) -> np.random.Generator:
    """Restore a generator from the values of `pack_rng`; it continues the same stream.

    Parameters
    ----------
    values : mapping of str to JSON value

    Returns
    -------
    numpy.random.Generator

    Raises
    ------
    ValueError, TypeError, LookupError
        The values do not describe a generator.
    """
    if values["pool_size"] not in range(_LARGEST_POOL + 1):
        raise ValueError(f"pool_size = {values['pool_size']}")
    seeds = {name: value for name, value in values.items() if name != "state"}
    bits = np.random.PCG64(np.random.SeedSequence(**seeds))
    bits.state = values["state"]
    return np.random.Generator(bits)


def pack(name: str, items: Sequence[Mapping[str, AnyArray]]) -> dict[str, AnyArray]:
    """Store many states of varying size in few arrays, by concatenating each field.

    Parameters
    ----------
    name : str
        Prefix of the arrays' names.
    items : sequence of mapping of str to array
        All with the same fields. Arrays of a field have at least one dimension and may differ in
        length along the first only.

    Returns
    -------
    dict of str to array
        For each field, its concatenated values and the lengths of the parts.
    """
    arrays: dict[str, AnyArray] = {}
    for field in items[0] if items else ():
        arrays[f"{name}/{field}/values"] = np.concatenate([item[field] for item in items])
        arrays[f"{name}/{field}/lengths"] = np.array([len(item[field]) for item in items])
    return arrays


def unpack(name: str, arrays: Mapping[str, AnyArray]) -> list[dict[str, AnyArray]]:
    """Restore the items that `pack` stored under a name.

    Parameters
    ----------
    name : str
        Prefix of the arrays' names.
    arrays : mapping of str to array
        Arrays with another prefix are ignored.

    Returns
    -------
    list of dict of str to array
    """
    fields = {}
    for key in arrays:
        if key.startswith(f"{name}/") and key.endswith("/values"):
            field = key[len(name) + 1 : -len("/values")]
            ends = np.cumsum(arrays[f"{name}/{field}/lengths"])
            fields[field] = np.split(arrays[key], ends[:-1])
    columns = zip(*fields.values(), strict=True)
    return [dict(zip(fields, column, strict=True)) for column in columns]


class Checkpointer:
    """Writes and reads the checkpoints of one chain.

    Parameters
    ----------
    path : Path
    identity : str
        See `save`.
    every_seconds : float
        Least time between two checkpoints; at most this much work is lost.
    """

    def __init__(self, path: Path, *, identity: str, every_seconds: float) -> None:
        self.path = path
        self.identity = identity
        self.every_seconds = every_seconds
        self._due = time.monotonic() + every_seconds

    def load(self) -> Snapshot | None:
        """Read the last checkpoint, see `load`.

        Returns
        -------
        Snapshot or None
        """
        return load(self.path, identity=self.identity)

    def save(self, snapshot: Snapshot) -> None:
        """Write a checkpoint now. A chain does so when it ends or is asked to stop.

        Parameters
        ----------
        snapshot : Snapshot
        """
        save(self.path, snapshot, identity=self.identity)
        self._due = time.monotonic() + self.every_seconds

    def offer(self, snapshot_fn: Callable[[], Snapshot]) -> None:
        """Write a checkpoint if ``every_seconds`` have passed; only then call ``snapshot_fn``.

        Parameters
        ----------
        snapshot_fn : callable
            Makes the snapshot.
        """
        if time.monotonic() >= self._due:
            self.save(snapshot_fn())


# ------------------------------------------------------------------------------------------------
# Chains that resume after a kill.

P_contra = TypeVar("P_contra", contravariant=True)
X_contra = TypeVar("X_contra", contravariant=True)
R_co = TypeVar("R_co", covariant=True)
P = TypeVar("P")
X = TypeVar("X")
R = TypeVar("R")
_LOG = logging.getLogger(__name__)


class ResumableTask(Protocol[P_contra, X_contra, R_co]):
    """The function that runs one chain with checkpoints; importable by name."""

    def __call__(
        self,
        problem: P_contra,
        start: X_contra,
        rng: np.random.Generator,
        report: Report,
        checkpointer: Checkpointer,
        /,
    ) -> R_co:
        """Continue from ``checkpointer.load()``; if that is None, begin at ``start`` with ``rng``.

        A snapshot holds all that later draws depend on, including the generator, and the draws so
        far. The task calls ``checkpointer.offer`` between steps, and ``checkpointer.save`` when it
        ends or was asked to stop. A task whose checkpoint is complete returns at once.
        """


@dataclass(frozen=True)
class _WithKeeper(Generic[P, X, R]):
    """Adapter from a resumable task to a plain one; the start includes the checkpoint's path."""

    task: ResumableTask[P, X, R]
    identity: str
    every_seconds: float

    def __call__(
        self, problem: P, start: tuple[Path, X], rng: np.random.Generator, report: Report, /
    ) -> R:
        # Made in the process that runs the chain, because its clock is that process's.
        checkpointer = Checkpointer(
            start[0], identity=self.identity, every_seconds=self.every_seconds
        )
        return self.task(problem, start[1], rng, report, checkpointer)


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
    workers: int | Workers = 1,
    executor: Executor | None = None,
    on_progress: OnProgress | None = None,
    anew: bool = False,
) -> list[R]:
    """Run one chain from each start; a run that was killed and is repeated gives the same draws.

    Parameters
    ----------
    task : callable
        ``task(problem, start, rng, report, checkpointer) -> result``, see `ResumableTask`.
    problem, starts, seed
        See `imapper_prob.samplers.chains.run_chains`. To resume, pass the same values.
    folder : Path
        Folder of the checkpoints ``chain-0.npz`` and so on; created if needed. Two runs must not
        use it at the same time. All workers must see it, including those on other machines.
    identity : str
        Identity of settings, data and seed, such as their hash; a checkpoint with another identity
        is refused.
    every_seconds : float
        Least time between two checkpoints of a chain.
    restarts : int
        How often the run resumes from the checkpoints by itself after a worker died.
    workers, executor, on_progress
        See `imapper_prob.samplers.chains.run_chains`; they may differ when a run is resumed.
    anew : bool
        Delete checkpoints that are damaged or of another run, instead of raising an error.

    Returns
    -------
    list
        Results in the order of ``starts``. The checkpoints are kept.

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
    try:
        return run_chains(
            kept,
            problem,
            placed,
            seed=seed,
            workers=workers,
            executor=executor,
            on_progress=on_progress,
            scratch=folder,
            restarts=restarts,
        )
    except ChainError as error:
        raise ChainError(
            f"{error}; nothing is lost: run again, and the chains go on from their "
            f"checkpoints in {folder}"
        ) from error


def checkpoint_of(folder: Path, chain: int) -> Path:
    """Path of a chain's checkpoint.

    Parameters
    ----------
    folder : Path
    chain : int
        From 0.

    Returns
    -------
    Path
    """
    return folder / f"chain-{chain}.npz"


def _drop_unless_of(identity: str, path: Path) -> None:
    try:
        load(path, identity=identity)
    except CheckpointError as error:
        _LOG.info("%s", error)
        path.unlink()
