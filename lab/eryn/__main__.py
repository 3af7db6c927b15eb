"""Do Eryn and the project's sampler find the same posterior, and how fast?

See ``docs/research/eryn.md``.

    python -m lab.eryn FOLDER [--eryn-python PATH]

from the root of the repository runs both on two targets, prints a table and merges its figures into
``lab/results.json``. Eryn lives in an environment of its own, which is made in FOLDER unless one is
given. It takes half an hour of one core.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imapper_prob.samplers.diagnostics import mean_error
from lab.eryn import gaussian
from lab.eryn.exchange import load_runs, save_problem
from lab.eryn.scene import layouts_of, solve_scene

ROOT = Path(__file__).resolve().parents[2]
REQUIREMENTS = ("eryn==1.2.6", "numpy<2.4", "numba", "scipy")
"""Eryn 1.2.6 calls numpy.in1d, which numpy 2.4 removed."""
RUNS = 4
GAUSSIAN = (1.0, 10.0)
SCENE = (15.0, 20.0)
"""Seconds of processor time for burn-in and for sampling of each run."""
LONG = (30.0, 150.0)
"""The same for the reference runs, by this project and by Eryn with its candidates."""
LEAST = 0.05
"""Least probability of a layout that is compared; errors of rarer ones are too uncertain."""


def environment(folder: Path) -> Path:
    """Python interpreter of a new environment with Eryn in it."""
    python = folder / "eryn" / "bin" / "python"
    if not python.exists():
        subprocess.run([sys.executable, "-m", "venv", folder / "eryn"], check=True)
        subprocess.run([python, "-m", "pip", "install", "--quiet", *REQUIREMENTS], check=True)
    return python


def runs_of(
    python: str | Path,
    module: str,
    arguments: Sequence[str | Path],
    path: Path,
    times: tuple[float, float],
    *,
    first: int = 0,
) -> dict[str, NDArray[Any]]:
    """Draws of a sampler that runs in its own process on one thread."""
    command = [python, "-W", "ignore", "-m", f"lab.eryn.{module}", *arguments, path]
    threads = {name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")}
    subprocess.run(
        [*map(str, command), str(RUNS), *map(str, times), str(first)],
        cwd=ROOT,
        env={**os.environ, **threads, "PYTHONPATH": str(ROOT)},
        check=True,
    )
    return load_runs(path)


def shares(indicator: NDArray[np.bool_]) -> tuple[float, float]:
    """Probability and its standard error from an indicator (R, N, W).

    Walkers of an ensemble are dependent, so their mean counts as one draw, and the error includes
    differences between whole runs.
    """
    mean = indicator.mean(-1)
    return float(mean.mean()), float(mean_error(mean))


def gaussian_error(counts: NDArray[np.int64]) -> tuple[float, float]:
    """Largest error of P(k) in a run, mean over runs; and that of all runs, in standard errors."""
    exact = gaussian.probabilities()
    found = np.array([[(run == k).mean() for k in range(len(exact))] for run in counts])
    scores = [(p - e) / s for k, e in enumerate(exact) for p, s in [shares(counts == k)]]
    return float(np.abs(found - exact).max(1).mean()), float(np.abs(scores).max())


def probabilities(layouts: NDArray[np.str_]) -> dict[str, tuple[float, float]]:
    """Probability and standard error of each layout, the most probable first."""
    found = {str(name): shares(layouts == name) for name in np.unique(layouts)}
    return dict(sorted(found.items(), key=lambda item: -item[1][0]))


def effective_per_second(
    layouts: NDArray[np.str_], right: Mapping[str, tuple[float, float]]
) -> dict[str, float]:
    """Effective draws a second of each layout, relative to its probability in ``right``.

    It is the number of independent draws a second whose variance p (1 - p) / n equals a run's mean
    squared error about the reference. The error is not taken about the mean of the runs, because
    runs that are stuck in a part of the posterior hardly fluctuate.
    """
    result = {}
    for name, (p, _) in right.items():
        if p >= LEAST:
            error = ((layouts == name).mean((1, 2)) - p) ** 2
            result[name] = float(p * (1 - p) / error.mean() / SCENE[1])
    return result


def main(arguments: Sequence[str] | None = None) -> None:
    """Run everything, print the table, and merge the figures."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path, help="where draws and the environment go")
    parser.add_argument("--eryn-python", type=Path, help="interpreter of an environment with Eryn")
    given = parser.parse_args(arguments)
    folder = given.folder.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    python = given.eryn_python or environment(folder)
    solution = solve_scene()
    problem = folder / "problem.npz"
    save_problem(problem, solution.problem)

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

    samplers = {
        "layout": ("ours", sys.executable, ["scene"]),
        "eryn_layout": ("theirs", python, ["prior", problem]),
        "eryn_with_candidates_layout": ("theirs", python, ["candidates", problem]),
    }

    def drawn(name: str, times: tuple[float, float], first: int) -> NDArray[np.str_]:
        who, interpreter, arguments = samplers[name]
        path = folder / f"{name}-{times[1]:.0f}.npz"
        return layouts_of(solution, runs_of(interpreter, who, arguments, path, times, first=first))

    long = {
        name: probabilities(drawn(name, LONG, RUNS)) for name in samplers if name != "eryn_layout"
    }
    for name, found in long.items():
        for layout, (share, error) in found.items():
            print(f"{name:>28} {layout:<16} {share:.4f} ± {error:.4f}  {LONG[1]:.0f} s")
    for name in samplers:
        layouts = drawn(name, SCENE, 0)
        found, rates = probabilities(layouts), effective_per_second(layouts, long["layout"])
        for layout in sorted(found.keys() | rates.keys()):
            share, error = found.get(layout, (0.0, 0.0))
            rate = f"{rates[layout]:8.3f}/s" if layout in rates else ""
            print(f"{name:>28} {layout:<16} {share:.4f} ± {error:.4f}  {rate}")
        figures[f"{name}_ess_per_second"] = min(rates.values())
    path = ROOT / "lab" / "results.json"
    known = json.loads(path.read_text(encoding="utf-8"))
    known |= {name: float(f"{value:.4g}") for name, value in figures.items()}
    path.write_text(json.dumps(known, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
