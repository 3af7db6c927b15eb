"""A resumable chain of every kind of state: tempered, adapting, of varying dimension.

``python -m tests.samplers.kept FOLDER ROUNDS`` runs it with its checkpoints in FOLDER and writes
each chain's last snapshot to ``FOLDER/draws-0.npz`` and so on.
"""

from __future__ import annotations

import dataclasses
import json
import os
import signal
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np

from imapper_prob.samplers.checkpoint import (
    Snapshot,
    pack,
    pack_rng,
    run_resumable_chains,
    save,
    unpack,
    unpack_rng,
)
from imapper_prob.samplers.ladder import SwapTable, power_ladder
from imapper_prob.samplers.reversible_jump import ChainState, step
from imapper_prob.samplers.tempering import TemperingState, start, temper
from tests.samplers import polynomials
from tests.samplers.kernel_chain import KernelChain

BETAS = power_ladder(4)
ROUNDS, BURN_IN = 120, 40
# Each round of two chains takes some 3 ms; with the pause a run takes about a second.
PAUSE = 0.002
IDENTITY = "kept"


def pack_state(theta: np.ndarray) -> dict[str, np.ndarray]:
    return {"theta": theta}


def unpack_state(arrays: dict[str, np.ndarray]) -> np.ndarray:
    return arrays["theta"]


def pack_position(position: TemperingState) -> dict[str, np.ndarray]:
    return pack("rungs", [pack_state(chain.state) for chain in position.chains])


def position_values(position: TemperingState) -> dict[str, object]:
    return {
        "betas": position.betas,
        "tilts": position.tilts,
        "counts": position.counts,
        "mean_counts": position.mean_counts,
        "log_densities": [chain.log_density for chain in position.chains],
        "log_likelihoods": position.log_likelihoods,
        "replicas": position.replicas,
        "rounds": position.rounds,
    }


def unpack_position(snapshot: Snapshot) -> TemperingState:
    values = snapshot.values["position"]
    states = [unpack_state(item) for item in unpack("rungs", snapshot.arrays)]
    return TemperingState(
        betas=tuple(values["betas"]),
        tilts=tuple(map(tuple, values["tilts"])),
        counts=tuple(map(tuple, values["counts"])),
        mean_counts=tuple(map(tuple, values["mean_counts"])),
        chains=tuple(map(ChainState, states, values["log_densities"])),
        log_likelihoods=tuple(values["log_likelihoods"]),
        replicas=tuple(values["replicas"]),
        rounds=values["rounds"],
    )


def tempered(problem, first, rng, report, checkpointer) -> Snapshot:
    """``problem`` rounds of tempering, the first ones adapting; all is in the snapshot."""
    saved = checkpointer.load()
    if saved is None:
        rngs = rng.spawn(len(BETAS) + 1)
        position = start([first] * len(BETAS), target=polynomials.target, betas=BETAS)
        draws, table = [], SwapTable.empty(BETAS)
    else:
        rngs = [unpack_rng(values) for values in saved.values["rngs"]]
        position = unpack_position(saved)
        draws = [unpack_state(item) for item in unpack("draws", saved.arrays)]
        table = SwapTable(**saved.values["table"])

    def snapshot() -> Snapshot:
        return Snapshot(
            pack("draws", [pack_state(theta) for theta in draws]) | pack_position(position),
            {
                "position": position_values(position),
                "rngs": [pack_rng(rng) for rng in rngs],
                "table": dataclasses.asdict(table),
            },
        )

    while position.rounds < problem:
        chain = temper(
            rngs,
            position,
            chain_at=partial(
                KernelChain, polynomials.target, partial(step, mixture=polynomials.mixture())
            ),
            steps_per_swap=3,
            adapt=position.rounds < BURN_IN,
        )
        item = next(chain)
        position = item.state
        draws.append(position.chains[-1].state)
        if position.rounds > BURN_IN:
            table = table.recorded(item.swap_acceptance, position.replicas)
        time.sleep(PAUSE)
        checkpointer.offer(snapshot)
        if not report(position.rounds):
            break
    checkpointer.save(snapshot())
    return snapshot()


def dies_once(problem, first, rng, report, checkpointer) -> Snapshot:
    """The process of the chain that starts at 0 is killed at its first checkpoint."""

    def report_and_die(done: int, /) -> bool:
        if (
            not first.any()
            and checkpointer.path.exists()
            and not checkpointer.path.with_suffix(".died").exists()
        ):
            checkpointer.path.with_suffix(".died").touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return report(done)

    return tempered(problem, first, rng, report_and_die, checkpointer)


def dies_always(problem, first, rng, report, checkpointer) -> None:
    if not first.any():
        os.kill(os.getpid(), signal.SIGKILL)


STARTS = [np.zeros(1), np.ones(2)]


def same(one: Snapshot, other: Snapshot) -> bool:
    """Whether snapshots are the same to the last bit."""
    first, second = (
        (
            json.dumps(snapshot.values),
            {name: (array.dtype, array.tobytes()) for name, array in snapshot.arrays.items()},
        )
        for snapshot in (one, other)
    )
    return first == second


def main(folder: Path, rounds: int) -> None:
    sys.stdout.write("begins\n")
    sys.stdout.flush()
    results = run_resumable_chains(
        tempered,
        rounds,
        STARTS,
        seed=11,
        folder=folder,
        identity=IDENTITY,
        every_seconds=0.05,
    )
    for chain, snapshot in enumerate(results):
        save(folder / f"draws-{chain}.npz", snapshot, identity=IDENTITY)


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]))
