"""The project's sampler beside Eryn on the same two targets; see docs/eryn.md.

``python -m benchmarks.eryn.run FOLDER [--eryn-python PATH]`` from the root of the repository.
Eryn lives in an environment of its own, which is made in FOLDER unless one is given. Prints
a table and merges its figures into ``benchmarks/results.json``. Ten minutes of one core.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.eryn import gaussian
from benchmarks.eryn.exchange import load_runs, save_problem
from benchmarks.eryn.scene import layouts_of, solve_scene
from imapper_prob.config import SampleSettings
from imapper_prob.samplers.diagnostics import mean_error
from imapper_prob.sampling.sample import setup_of

Array = NDArray[np.float64]

ROOT = Path(__file__).resolve().parents[2]
REQUIREMENTS = ("eryn==1.2.6", "numpy<2.4", "numba", "scipy")
"""Eryn 1.2.6 calls numpy.in1d, which numpy 2.4 no longer has."""
RUNS = 4
GAUSSIAN = (1.0, 10.0)
SCENE = (15.0, 20.0)
"""Seconds of processor time that each run burns in and samples."""
LEAST = 0.05
"""Layouts less probable than this are left out: errors of their errors are too large."""


def environment(folder: Path) -> Path:
    """The interpreter of a new environment with Eryn in it."""
    python = folder / "eryn" / "bin" / "python"
    if not python.exists():
        subprocess.run([sys.executable, "-m", "venv", folder / "eryn"], check=True)
        subprocess.run([python, "-m", "pip", "install", "--quiet", *REQUIREMENTS], check=True)
    return python


def runs_of(
    python: str | Path, module: str, arguments: Sequence[str | Path], path: Path, times: Array
) -> dict[str, NDArray]:
    """What a sampler draws in a process of its own, on one thread."""
    command = [python, "-W", "ignore", "-m", f"benchmarks.eryn.{module}", *arguments, path]
    threads = {name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")}
    subprocess.run(
        [*map(str, command), str(RUNS), *map(str, times)],
        cwd=ROOT,
        env={**os.environ, **threads, "PYTHONPATH": str(ROOT)},
        check=True,
    )
    return load_runs(path)


def shares(indicator: NDArray[np.bool_]) -> tuple[float, float]:
    """Probability and its standard error from an indicator (R, N, W).

    Walkers of an ensemble know each other, so that their mean is taken as one draw, and the
    error sees how far whole runs differ.
    """
    mean = indicator.mean(-1)
    return float(mean.mean()), float(mean_error(mean))


def gaussian_error(counts: NDArray[np.int64]) -> tuple[float, float]:
    """Largest error of P(k) in a run, the mean over runs; and of all runs, in standard errors."""
    exact = gaussian.probabilities()
    found = np.array([[(run == k).mean() for k in range(len(exact))] for run in counts])
    scores = [(p - e) / s for k, e in enumerate(exact) for p, s in [shares(counts == k)]]
    return float(np.abs(found - exact).max(1).mean()), float(np.abs(scores).max())


def effective_per_second(layouts: NDArray[np.str_]) -> dict[str, tuple[float, float, float]]:
    """Of each layout: probability, standard error, effective independent draws a second."""
    result = {}
    for name in np.unique(layouts):
        share, error = shares(layouts == name)
        effective = share * (1 - share) / error**2 if error > 0 else np.nan
        result[str(name)] = share, error, effective / (RUNS * SCENE[1])
    return result


def main() -> None:
    """Run all, print the table, merge the figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="where draws and the environment go")
    parser.add_argument("--eryn-python", type=Path, help="interpreter of an environment with Eryn")
    given = parser.parse_args()
    folder = given.folder.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    python = given.eryn_python or environment(folder)
    solution = solve_scene()
    problem = folder / "problem.npz"
    save_problem(problem, solution.problem, setup_of(solution, SampleSettings()).candidates)

    figures = {}
    for who, interpreter, arguments in (
        ("", sys.executable, ["gaussian"]),
        ("eryn_", python, ["gaussian", problem]),
    ):
        module = "theirs" if who else "ours"
        path = folder / f"{module}-gaussian.npz"
        error, score = gaussian_error(
            runs_of(interpreter, module, arguments, path, GAUSSIAN)["count"]
        )
        figures[f"{who}gaussian_model_probability_error"] = error
        print(f"{module:>6} gaussian   error of P(k) {error:.4f}, {score:.1f} standard errors")

    for name, who, interpreter, arguments in (
        ("layout", "ours", sys.executable, ["scene"]),
        ("eryn_layout", "theirs", python, ["prior", problem]),
        ("eryn_with_candidates_layout", "theirs", python, ["candidates", problem]),
    ):
        path = folder / f"{name}.npz"
        found = effective_per_second(
            layouts_of(solution, runs_of(interpreter, who, arguments, path, SCENE))
        )
        for layout, (share, error, rate) in sorted(found.items(), key=lambda item: -item[1][0]):
            print(
                f"{who:>6} {arguments[0]:<11} {layout:<16} {share:.4f} ± {error:.4f}  {rate:8.2f}/s"
            )
        figures[f"{name}_ess_per_second"] = min(
            rate for share, _, rate in found.values() if share >= LEAST
        )
    path = ROOT / "benchmarks" / "results.json"
    known = json.loads(path.read_text(encoding="utf-8"))
    known |= {name: float(f"{value:.4g}") for name, value in figures.items()}
    path.write_text(json.dumps(known, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
