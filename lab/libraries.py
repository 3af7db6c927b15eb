"""How much of every score is luck of the library?

    python -m lab.libraries I3DB_FOLDER OUTPUT [--seeds 3] [--workers 2]

builds the built-in library from every seed, 0 being the one that is shipped, solves all scenes with
it by the staged solver and prints a Markdown table, with mean and standard deviation over
libraries. The libraries differ only in random numbers, so smaller changes by a change of method are
not significant.
"""

from __future__ import annotations

import argparse
import multiprocessing
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

from imapper_prob.config import Config
from imapper_prob.evaluate.score import SUBSETS, Summary, known_scene, scenes_with_truth
from imapper_prob.evaluate.suite import evaluate, solve_all, solved, tasks_of
from imapper_prob.scenelets.library import save_library
from imapper_prob.scenelets.procedural.catalogue import build_library

_COLUMNS = (
    "library", "error, cm", "seats", "found", "spurious", "yaw, °", "IoU",
    "joints: world, cm", "local", "px", "occluded: world", "local", "px",
)  # fmt: skip
_DIGITS = (0, 0, 1, 1, 0, 2, 1, 1, 0, 1, 1, 0)


def numbers(summary: Summary) -> list[float]:
    """The columns after the first."""
    every, occluded = (summary.pose[name] for name in tuple(SUBSETS)[:2])
    return [
        summary.error, summary.seat_error, summary.found, summary.spurious, summary.yaw,
        summary.overlap, *every, *occluded,
    ]  # fmt: skip


def line(name: str, values: list[float]) -> str:
    """One row of the table."""
    cells = [f"{v:.{digits}f}" for v, digits in zip(values, _DIGITS, strict=True)]
    return "| " + " | ".join([name, *cells]) + " |\n"


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("scenes", type=Path)
    parser.add_argument("output", type=Path, help="what is solved already is not solved again")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--workers", type=int, default=2)
    said = parser.parse_args(arguments)
    scenes = scenes_with_truth(said.scenes)
    known = [known_scene(scene) for scene in scenes]
    out = sys.stdout.write
    out("| " + " | ".join(_COLUMNS) + " |\n|---" + "|---:" * len(_DIGITS) + "|\n")
    rows = []
    spawned = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(said.workers, mp_context=spawned) as executor:
        for seed in range(said.seeds):
            folder = said.output / f"seed-{seed}"
            folder.mkdir(parents=True, exist_ok=True)
            library = folder / "library.npz"
            if not library.exists():
                save_library(build_library(seed), library)
            tasks = tasks_of(scenes, folder, Config(library=str(library)))
            solve_all(tasks, executor)
            answers = [(k.truth, [solved(t)]) for k, t in zip(known, tasks, strict=True)]
            pooled = next(s for s in evaluate(answers).summaries if len(s.clips) == len(scenes))
            rows.append(numbers(pooled))
            out(line(f"seed {seed}", rows[-1]))
            sys.stdout.flush()
    out(line("mean", np.mean(rows, 0).tolist()))
    if len(rows) > 1:
        out(line("standard deviation", np.std(rows, 0, ddof=1).tolist()))


if __name__ == "__main__":
    main()
