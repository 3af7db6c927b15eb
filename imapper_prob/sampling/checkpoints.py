"""What a chain over scenes keeps, to go on after a kill as if nothing had happened."""

from __future__ import annotations

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
from imapper_prob.samplers.reversible_jump import AcceptanceTable
from imapper_prob.sampling.proposals import Candidates

__all__ = ["Progress", "identity_of"]

_FIELDS = ("camera", "items", "placements", "sizes", "latent")


@dataclass
class Progress:
    """How far a chain is: everything that its later draws depend on, and its draws so far.

    Parameters
    ----------
    rng : numpy.random.Generator
    state : State
        Where it stands.
    steps : int
        How many it has made.
    states, values : list
        Draws kept, and their log-posterior.
    trace : list of float
        Log-posterior over the whole run.
    acceptance : AcceptanceTable
    """

    rng: np.random.Generator
    state: State
    steps: int = 0
    states: list[State] = field(default_factory=list)
    values: list[float] = field(default_factory=list)
    trace: list[float] = field(default_factory=list)
    acceptance: AcceptanceTable = field(default_factory=AcceptanceTable)

    def snapshot(self) -> Snapshot:
        """All of it as arrays and plain values."""
        return Snapshot(
            {
                **pack("state", [_arrays(self.state)]),
                **pack("draws", [_arrays(state) for state in self.states]),
                "values": np.array(self.values, dtype=np.float64),
                "trace": np.array(self.trace, dtype=np.float64),
            },
            {
                "rng": pack_rng(self.rng),
                "steps": self.steps,
                "proposed": dict(self.acceptance.proposed),
                "accepted": dict(self.acceptance.accepted),
            },
        )

    @classmethod
    def of(cls, snapshot: Snapshot) -> Progress:
        """The progress that :meth:`snapshot` was taken of."""
        return cls(
            rng=unpack_rng(snapshot.values["rng"]),
            state=_states("state", snapshot)[0],
            steps=snapshot.values["steps"],
            states=_states("draws", snapshot),
            values=snapshot.arrays["values"].tolist(),
            trace=snapshot.arrays["trace"].tolist(),
            acceptance=AcceptanceTable(
                Counter(snapshot.values["proposed"]), Counter(snapshot.values["accepted"])
            ),
        )


def _arrays(state: State) -> dict[str, NDArray[Any]]:
    return {name: getattr(state, name) for name in _FIELDS}


def _states(name: str, snapshot: Snapshot) -> list[State]:
    return [State(**item) for item in unpack(name, snapshot.arrays)]


def identity_of(
    problem: Problem,
    candidates: Candidates,
    starts: Sequence[State],
    settings: object,
    seed: np.random.SeedSequence,
) -> str:
    """A hash of all that the draws depend on: a checkpoint of anything else is refused."""
    digest = hashlib.sha256(repr((settings, seed.entropy, seed.spawn_key)).encode())
    arrays = [*problem, candidates.items, candidates.placements, candidates.weights]
    arrays += [array for state in starts for array in _arrays(state).values()]
    for array in arrays:
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()
