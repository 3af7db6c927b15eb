"""Arrays in files that the processes of the benchmark exchange."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from time import process_time
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.problem import Problem
from imapper_prob.sampling.gains import (
    expected_placement,
    gains_of,
    sequences_of,
    static_pelvis_on_floor,
)
from lab.eryn.leaves import LeafDensity

__all__ = ["during", "load_problem", "load_runs", "save_problem", "save_runs"]

Arrays = dict[str, NDArray[Any]]
T = TypeVar("T")


_LEAST = 1e-6
"""Least weight of a candidate, as a share of all; chosen: thousands are left."""


def save_problem(path: Path, problem: Problem) -> None:
    """Store the log-posterior, and the candidates from which births are drawn.

    They are scenelets at the static path, weighted by how well they explain the detections.
    """
    fields = {f"problem {name}": value for name, value in problem._asdict().items()}
    sequences, static = (
        sequences_of(problem, gains_of(problem).values),
        static_pelvis_on_floor(problem),
    )
    weights = sequences.hazard[:, None] * sequences.scenelets
    starts, scenelets = np.nonzero(weights > _LEAST * weights.sum())
    items = np.stack([scenelets, starts], -1)
    placements = np.array([expected_placement(problem, static, *item) for item in items.tolist()])
    np.savez(path, items=items, placements=placements, weights=weights[starts, scenelets], **fields)


def load_problem(path: Path) -> tuple[Problem, LeafDensity]:
    """Load the log-posterior, and the density of leaves around the candidates."""
    with np.load(path, allow_pickle=False) as file:
        arrays = {name: file[name] for name in file.files}
    values = [arrays[f"problem {name}"] for name in Problem._fields]
    problem = Problem(*(value if value.ndim else value.item() for value in values))
    density = LeafDensity.of(problem, arrays["items"], arrays["placements"], arrays["weights"])
    return problem, density


def save_runs(path: Path, runs: Sequence[Arrays]) -> None:
    """Store arrays (N, ...) of each run as (R, N, ...), with the N of the shortest."""
    shortest = min(len(array) for run in runs for array in run.values())
    stacked = {name: np.stack([run[name][-shortest:] for run in runs]) for name in runs[0]}
    np.savez(path, allow_pickle=False, **stacked)


def load_runs(path: Path) -> Arrays:
    """Load what :func:`save_runs` stored."""
    with np.load(path, allow_pickle=False) as file:
        return {name: file[name] for name in file.files}


def during(chain: Iterator[T], burn_in: float, seconds: float) -> Iterator[T]:
    """Items that a sampler yields after ``burn_in`` and for ``seconds`` of processor time."""
    begin = process_time()
    for item in chain:
        spent = process_time() - begin
        if spent > burn_in:
            yield item
        if spent > burn_in + seconds:
            return
