"""What a chain over scenes keeps, to go on after a kill as if nothing had happened."""

from __future__ import annotations

import dataclasses
import hashlib
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.posterior import State
from imapper_prob.models.problem import Problem
from imapper_prob.samplers.checkpoint import Snapshot, pack, pack_rng, unpack, unpack_rng
from imapper_prob.samplers.kernel import ChainState
from imapper_prob.samplers.ladder import SwapTable
from imapper_prob.samplers.reversible_jump import AcceptanceTable
from imapper_prob.samplers.tempering import Position, Round
from imapper_prob.sampling.proposals import Candidates

__all__ = ["Progress", "identity_of"]

_FIELDS = tuple(entry.name for entry in dataclasses.fields(State))


@dataclass
class Progress:
    """How far a chain is: everything that its later draws depend on, and its draws so far.

    Parameters
    ----------
    rngs : list of numpy.random.Generator
        One for each temperature and one for the swaps.
    position : Position
        Where it stands at each temperature.
    table : SwapTable
        Swaps since the temperatures stay.
    states, values : list
        Draws kept, and their log-posterior.
    trace : list of float
        Log-posterior over the whole run.
    acceptance : AcceptanceTable
        At the posterior itself since the temperatures stay.
    """

    rngs: list[np.random.Generator]
    position: Position[State]
    table: SwapTable
    states: list[State] = field(default_factory=list)
    values: list[float] = field(default_factory=list)
    trace: list[float] = field(default_factory=list)
    acceptance: AcceptanceTable = field(default_factory=AcceptanceTable)

    @classmethod
    def begin(cls, rngs: Sequence[np.random.Generator], position: Position[State]) -> Progress:
        """Nothing done yet."""
        return cls(list(rngs), position, SwapTable.empty(position.betas))

    def record(self, at: Round[State]) -> None:
        """Count a round at fixed temperatures."""
        if self.table.rounds == 0:
            self.table = SwapTable.empty(at.position.betas)
        self.table = self.table.recorded(at.swap_acceptance, at.position.replicas)
        for info in (*at.steps[-1], *at.crossovers):
            self.acceptance.record(info)

    def snapshot(self) -> Snapshot:
        """All of it as arrays and plain values."""
        position = self.position
        return Snapshot(
            {
                **pack("rungs", [_arrays(chain.state) for chain in position.chains]),
                **pack("draws", [_arrays(state) for state in self.states]),
                "values": np.array(self.values, dtype=np.float64),
                "trace": np.array(self.trace, dtype=np.float64),
            },
            {
                "rngs": [pack_rng(rng) for rng in self.rngs],
                "betas": position.betas,
                "log_densities": [chain.log_density for chain in position.chains],
                "log_likelihoods": position.log_likelihoods,
                "replicas": position.replicas,
                "rounds": position.rounds,
                "table": dataclasses.asdict(self.table),
                "proposed": dict(self.acceptance.proposed),
                "accepted": dict(self.acceptance.accepted),
            },
        )

    @classmethod
    def of(cls, snapshot: Snapshot) -> Progress:
        """The progress that :meth:`snapshot` was taken of."""
        arrays, values = snapshot
        return cls(
            rngs=[unpack_rng(kept) for kept in values["rngs"]],
            position=Position(
                betas=tuple(values["betas"]),
                chains=tuple(
                    ChainState(state, value)
                    for state, value in zip(
                        _states("rungs", snapshot), values["log_densities"], strict=True
                    )
                ),
                log_likelihoods=tuple(values["log_likelihoods"]),
                replicas=tuple(values["replicas"]),
                rounds=values["rounds"],
            ),
            table=SwapTable(**values["table"]),
            states=_states("draws", snapshot),
            values=arrays["values"].tolist(),
            trace=arrays["trace"].tolist(),
            acceptance=AcceptanceTable(Counter(values["proposed"]), Counter(values["accepted"])),
        )


def _arrays(state: State) -> dict[str, NDArray[Any]]:
    return {name: getattr(state, name) for name in _FIELDS}


def _states(name: str, snapshot: Snapshot) -> list[State]:
    return [State(**item) for item in unpack(name, snapshot.arrays)]


def identity_of(
    problem: Problem,
    candidates: Candidates,
    starts: Sequence[Sequence[State]],
    settings: object,
    seed: np.random.SeedSequence,
) -> str:
    """A hash of all that the draws depend on: a checkpoint of anything else is refused."""
    digest = hashlib.sha256(repr((settings, seed.entropy, seed.spawn_key)).encode())
    arrays = [
        *problem, candidates.centres, candidates.placements, candidates.sizes, candidates.weights,
    ]  # fmt: skip
    arrays += [array for own in starts for state in own for array in _arrays(state).values()]
    for array in arrays:
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()
