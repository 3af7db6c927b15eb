"""The progress of a chain over scenes, which it needs to resume as if never interrupted."""

from __future__ import annotations

import dataclasses
import hashlib
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeGuard

import numpy as np
from numpy.typing import NDArray

from imapper_prob.config import SampleSettings
from imapper_prob.models.errors import InputError
from imapper_prob.models.log_posterior import State
from imapper_prob.models.problem import Problem
from imapper_prob.models.valid import check_state
from imapper_prob.samplers.checkpoint import (
    CheckpointError,
    Snapshot,
    load,
    pack,
    pack_rng,
    unpack,
    unpack_rng,
)
from imapper_prob.samplers.ladder import SwapTable
from imapper_prob.samplers.reversible_jump import AcceptanceTable, ChainState
from imapper_prob.samplers.tempering import TemperingInfo, TemperingState
from imapper_prob.sampling.schedule import draws_of, learning_of, trace_of
from imapper_prob.sampling.visits import Visits

__all__ = ["ChainProgress", "identity_of", "rounds_done"]

_LARGEST = 1e12
"""Largest absolute value of any stored number; log-posteriors are in nats."""
_MOST_ROUNDS = 10**9
"""Largest number of rounds of a chain, which would take years even for the shortest clip."""
_FIELDS = tuple(entry.name for entry in dataclasses.fields(State))


@dataclass
class ChainProgress:
    """Progress of a chain: all that its later draws depend on, and its draws so far.

    Parameters
    ----------
    rngs : list of numpy.random.Generator
        One for each temperature and one for the swaps.
    position : Position
        State at each temperature.
    table : SwapTable
        Swaps since the temperatures were fixed; during burn-in, since the last reference.
    states, values : list
        Kept draws and their log-posteriors, nats.
    trace : list of float
        Log-posterior over the whole run.
    acceptance : AcceptanceTable
        Acceptance at the posterior since the temperatures were fixed.
    visits : list of Visits
        Visits for each reference; the last ones are still being recorded.
    barrier : float
        Communication barrier (Syed et al. 2022) before the last reference of the burn-in; 0 if
        unknown.
    best : ChainState, optional
        The most probable state at the posterior after any round; None before the first.
    """

    rngs: list[np.random.Generator]
    position: TemperingState[State]
    table: SwapTable
    states: list[State] = field(default_factory=list)
    values: list[float] = field(default_factory=list)
    trace: list[float] = field(default_factory=list)
    acceptance: AcceptanceTable = field(default_factory=AcceptanceTable)
    visits: list[Visits] = field(default_factory=lambda: [Visits()])
    barrier: float = 0.0
    best: ChainState[State] | None = None

    @classmethod
    def begin(
        cls, rngs: Sequence[np.random.Generator], position: TemperingState[State]
    ) -> ChainProgress:
        """Progress of a chain that has not begun.

        Parameters
        ----------
        rngs : sequence of numpy.random.Generator
            One for each temperature and one for the swaps.
        position : TemperingState

        Returns
        -------
        ChainProgress
        """
        return cls(list(rngs), position, SwapTable.empty(position.betas))

    def record(self, at: TemperingInfo[State], *, fixed: bool) -> None:
        """Count a round; its moves only if the temperatures are fixed.

        Parameters
        ----------
        at : TemperingInfo
        fixed : bool
        """
        self.table = self.table.recorded(at.swap_acceptance, at.state.replicas)
        if fixed:
            for info in (*at.steps[-1], *at.crossovers):
                self.acceptance.record(info)

    def count_anew(self) -> None:
        """Drop the counts of swaps."""
        self.table = SwapTable.empty(self.position.betas)

    def thin(self, most: int) -> None:
        """Drop every second draw, or trace value, if there are more than ``most``.

        Parameters
        ----------
        most : int
        """
        if len(self.states) > most:
            del self.states[1::2], self.values[1::2]
        if len(self.trace) > most:
            del self.trace[1::2]

    def snapshot(self) -> Snapshot:
        """Convert to arrays and plain values for a checkpoint.

        Returns
        -------
        Snapshot
        """
        position = self.position
        return Snapshot(
            {
                **pack("rungs", [_arrays(chain.state) for chain in position.chains]),
                **pack("draws", [_arrays(state) for state in self.states]),
                "values": np.array(self.values, dtype=np.float64),
                "trace": np.array(self.trace, dtype=np.float64),
                **pack("visits", [visits.arrays() for visits in self.visits]),
                **pack("best", [] if self.best is None else [_arrays(self.best.state)]),
            },
            {
                "rngs": [pack_rng(rng) for rng in self.rngs],
                "betas": position.betas,
                "tilts": position.tilts,
                "counts": position.counts,
                "mean_counts": position.mean_counts,
                "log_densities": [chain.log_density for chain in position.chains],
                "log_likelihoods": position.log_likelihoods,
                "replicas": position.replicas,
                "rounds": position.rounds,
                "table": dataclasses.asdict(self.table),
                "proposed": dict(self.acceptance.proposed),
                "accepted": dict(self.acceptance.accepted),
                "barrier": self.barrier,
                "best": None if self.best is None else self.best.log_density,
            },
        )

    @classmethod
    def of(cls, snapshot: Snapshot) -> ChainProgress:
        """Restore the progress from a snapshot.

        Parameters
        ----------
        snapshot : Snapshot

        Returns
        -------
        ChainProgress
        """
        arrays, values = snapshot
        best = _states("best", snapshot)
        return cls(
            rngs=[unpack_rng(kept) for kept in values["rngs"]],
            position=TemperingState(
                betas=tuple(values["betas"]),
                chains=tuple(
                    ChainState(state, value)
                    for state, value in zip(
                        _states("rungs", snapshot), values["log_densities"], strict=True
                    )
                ),
                log_likelihoods=tuple(values["log_likelihoods"]),
                tilts=tuple(map(tuple, values["tilts"])),
                counts=tuple(map(tuple, values["counts"])),
                mean_counts=(tuple(values["mean_counts"][0]), tuple(values["mean_counts"][-1])),
                replicas=tuple(values["replicas"]),
                rounds=values["rounds"],
            ),
            table=SwapTable(**values["table"]),
            states=_states("draws", snapshot),
            values=arrays["values"].tolist(),
            trace=arrays["trace"].tolist(),
            acceptance=AcceptanceTable(Counter(values["proposed"]), Counter(values["accepted"])),
            visits=[Visits.of(item) for item in unpack("visits", arrays)],
            barrier=values["barrier"],
            best=ChainState(best[0], values["best"]) if best else None,
        )

    def check(self, problem: Problem, settings: SampleSettings) -> None:
        """Refuse progress that no chain with these settings can have.

        Parameters
        ----------
        problem : Problem
        settings : SampleSettings

        Raises
        ------
        InputError
            The message says what is wrong.
        """
        position, table = self.position, self.table
        rungs, now = len(position.betas), position.rounds
        if not _is_count(now):
            raise InputError("rounds are of no chain of this run")
        numbers = [chain.log_density for chain in position.chains]
        by_kind = (*position.tilts, *position.counts, *position.mean_counts)
        numbers += [x for of_rung in by_kind for x in of_rung]
        numbers += [*position.log_likelihoods, *self.values, *self.trace, *table.swaps]
        numbers += [self.barrier, *([] if self.best is None else [self.best.log_density])]
        for what, holds in {
            "generators": len(self.rngs) == rungs + 1,
            "rungs": len(position.chains) == len(position.log_likelihoods) == rungs
            and len(position.tilts) == len(position.counts) == rungs
            and len(position.mean_counts) == 2 and len({*map(len, by_kind)}) == 1
            and min(2, settings.temperatures) <= rungs <= settings.temperatures,
            "replicas": sorted(position.replicas) == list(range(rungs)),
            "temperatures": all(_ascends(betas, rungs) for betas in (position.betas, table.betas)),
            "numbers": all(isinstance(x, float) and abs(x) < _LARGEST for x in numbers),
            "draws": len(self.states) == len(self.values) == draws_of(settings).kept(now),
            "trace": len(self.trace) == trace_of(settings).kept(now),
            "swaps": len(table.swaps) == rungs - 1 and isinstance(table.rounds, int)
            and 0 <= table.rounds <= now,
            "best scene": (self.best is None) == (now == 0),
            "ends": len(table.last_end) == rungs and {*table.last_end} <= {-1, 0, 1},
            "crossings": len(table.crossings) == rungs
            and all(isinstance(n, int) and 0 <= n <= now for n in table.crossings),
            "moves": all(
                isinstance(n, int) and 0 <= self.acceptance.accepted[move] <= n
                for move, n in self.acceptance.proposed.items()
            ) and {*self.acceptance.accepted} <= {*self.acceptance.proposed},
        }.items():  # fmt: skip
            if not holds:
                raise InputError(f"{what} are of no chain of this run")
        learnt = sum(end <= self.position.rounds for end in learning_of(settings).ends)
        if len(self.visits) != learnt + 1:
            raise InputError("visits are of no chain of this run")
        for visits in self.visits:
            visits.check(problem)
        best = [] if self.best is None else [self.best]
        for state in [*(chain.state for chain in (*position.chains, *best)), *self.states]:
            check_state(problem, state)


def rounds_done(path: Path, *, identity: str) -> int:
    """Number of rounds in a chain's checkpoint; 0 if there is none.

    Parameters
    ----------
    path : Path
        Path of the checkpoint.
    identity : str
        See :func:`identity_of`.

    Returns
    -------
    int

    Raises
    ------
    CheckpointError
        The checkpoint is damaged or of another run.
    """
    saved = load(path, identity=identity)
    if saved is None:
        return 0
    rounds = saved.values.get("rounds") if isinstance(saved.values, dict) else None
    if not _is_count(rounds):
        raise CheckpointError(f"{path} is damaged (rounds): delete it, and its chain begins anew")
    return int(rounds)


def _is_count(value: object) -> TypeGuard[int]:
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value < _MOST_ROUNDS


def _ascends(betas: Sequence[float], count: int) -> bool:
    numbers = all(isinstance(beta, float) and 0 <= beta <= 1 for beta in betas)
    return len(betas) == count and numbers and list(betas) == sorted(betas) and betas[-1] == 1


def _arrays(state: State) -> dict[str, NDArray[Any]]:
    return {name: getattr(state, name) for name in _FIELDS}


def _states(name: str, snapshot: Snapshot) -> list[State]:
    return [State(**item) for item in unpack(name, snapshot.arrays)]


def identity_of(
    problem: Problem,
    starts: Sequence[Sequence[State]],
    settings: SampleSettings,
    seed: np.random.SeedSequence,
) -> str:
    """A hash of all that the draws depend on; checkpoints with another hash are refused.

    It does not include where chains stop, because they may be continued.

    Parameters
    ----------
    problem : Problem
    starts : sequence of sequence of State
        For each chain, its starts by temperature.
    settings : SampleSettings
    seed : numpy.random.SeedSequence

    Returns
    -------
    str
        Hexadecimal.
    """
    endless = dataclasses.replace(settings, last_step=0)
    parts = (version("imapper-prob"), endless, seed.entropy, seed.spawn_key)
    digest = hashlib.sha256(repr(parts).encode())
    arrays = [*problem]
    arrays += [array for own in starts for state in own for array in _arrays(state).values()]
    for array in arrays:
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()
