"""Which of both samplers is right about the two most probable scenes? Their evidences, alone.

``python -m benchmarks.eryn.evidence FOLDER`` after ``benchmarks.eryn.run`` with the same FOLDER.
With scenelets and starts fixed, camera, placements and sizes are nearly normal, and bridge
sampling finds the evidence from draws of these alone, without a jump. How often chains visit one
and the other should differ by the ratio of the evidences.
"""

from __future__ import annotations

import argparse
import math
from collections import Counter
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.eryn.exchange import load_problem, load_runs
from benchmarks.eryn.run import LONG
from imapper_prob.models.posterior import State, log_posterior
from imapper_prob.models.problem import Problem
from imapper_prob.samplers.evidence import Evidence, bridge_sampling

Array = NDArray[np.float64]
Items = tuple[tuple[int, int], ...]

DRAWS = 4000
"""Of each run, evenly spaced."""


def assignments(runs: dict[str, NDArray]) -> NDArray[np.object_]:
    """(R, N, W) the scenelets of a draw and their starts, in order of time."""
    found = np.empty(runs["alive"].shape[:-1], dtype=object)
    whole = np.floor(runs["leaves"][..., -2:]).astype(int)
    for at in np.ndindex(found.shape):
        items = whole[at][runs["alive"][at]].tolist()
        found[at] = tuple(sorted(map(tuple, items), key=lambda item: item[1]))
    return found


def vectors(runs: dict[str, NDArray], visited: NDArray[np.object_], items: Items) -> Array:
    """(R, n, 5 + 4 k) camera, placements and sizes of draws with an assignment, yaws unwrapped."""
    result = []
    for run in range(len(visited)):
        here = [at for at in np.ndindex(visited.shape[1:]) if visited[run][at] == items]
        rows = []
        for at in here:
            leaves = runs["leaves"][run][at][runs["alive"][run][at]]
            leaves = leaves[np.argsort(leaves[:, 5])]
            # Yaws beside that of the first draw, wherever a turn ends.
            about = rows[0][7::4] if rows else leaves[:, 2]
            leaves[:, 2] = about + (leaves[:, 2] - about + math.pi) % (2 * math.pi) - math.pi
            rows.append(np.append(runs["cameras"][run][at], leaves[:, :4]))
        result.append(np.array(rows))
    fewest = min(DRAWS, *map(len, result))
    spaced = [np.linspace(0, len(rows) - 1, fewest).astype(int) for rows in result]
    return np.array([rows[every] for rows, every in zip(result, spaced, strict=True)])


def evidence(problem: Problem, draws: Array, items: Items) -> Evidence:
    """Of an assignment, the latent numbers of the path being zero."""
    latent = np.zeros((problem.n_frames, 2))

    def density(x: Array) -> Array:
        own = x[:, 5:].reshape(len(x), len(items), 4)
        states = (
            State(camera.copy(), np.array(items), leaf[:, :3].copy(), leaf[:, 3].copy(), latent)
            for camera, leaf in zip(x[:, :5], own, strict=True)
        )
        return np.array([log_posterior(problem, state) for state in states])

    return bridge_sampling(draws, density, rng=np.random.default_rng(0))


def main() -> None:
    """Print the ratio of both evidences, and of the visits of both samplers."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    problem, _ = load_problem(folder / "problem.npz")
    names = ("layout", "eryn_with_candidates_layout")
    runs = {name: load_runs(folder / f"{name}-{LONG[1]:.0f}.npz") for name in names}
    visited = {name: assignments(runs[name]) for name in names}
    pair = tuple(items for items, _ in Counter(visited["layout"].flat).most_common(2))
    draws = [vectors(runs["layout"], visited["layout"], items) for items in pair]
    found = [evidence(problem, own, items) for own, items in zip(draws, pair, strict=True)]
    ratio = found[0].log_evidence - found[1].log_evidence
    error = math.hypot(found[0].standard_error, found[1].standard_error)
    print(f"{pair[0]} over {pair[1]}: log ratio of evidences {ratio:.3f} ± {error:.3f}")
    for name in names:
        shares = [
            np.array([np.mean([own == items for own in run.flat]) for run in visited[name]])
            for items in pair
        ]
        by_run = np.round(np.log(shares[0] / shares[1]), 2)
        visits = math.log(shares[0].mean() / shares[1].mean())
        print(f"  of visits, {name}: {visits:.3f}, run by run {by_run}")


if __name__ == "__main__":
    main()
