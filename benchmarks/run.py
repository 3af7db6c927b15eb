"""Speed of the main parts on the demo clip: prints a table, writes ``results.json`` beside.

Run with ``make bench``. Figures are of this machine, one process, one thread.
"""

from __future__ import annotations

import json
import resource
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from imapper_prob.config import SampleSettings
from imapper_prob.demo import demo_clip
from imapper_prob.models.posterior import empty_state, log_posterior
from imapper_prob.sampling.chain import run_chain
from imapper_prob.sampling.sample import setup_of
from imapper_prob.scenelets.library import load_library
from imapper_prob.staged.solver import solve


def per_second(action: Callable[[], object], *, seconds: float = 2.0) -> float:
    """How often ``action`` can be done in a second, after one to warm up."""
    action()
    count, start = 0, time.perf_counter()
    while time.perf_counter() - start < seconds:
        action()
        count += 1
    return count / (time.perf_counter() - start)


def main() -> None:
    """Measure, print, write."""
    clip, library = demo_clip(), load_library()
    solve(clip, library)  # compiles the kernels
    start = time.perf_counter()
    solution = solve(clip, library)
    solving = time.perf_counter() - start
    problem, best = solution.problem, solution.states[0]
    steps = 4000
    setup = setup_of(solution, SampleSettings(steps=steps, draws=100))
    start = time.perf_counter()
    run_chain(setup, best, np.random.default_rng(0), lambda progress=None: True)
    chain = steps / (time.perf_counter() - start)
    figures = {
        "demo_frames": clip.n_frames,
        "demo_boxes_of_best_scene": int(np.diff(problem.box_first)[best.items[:, 0]].sum()),
        "demo_solve_seconds": solving,
        "demo_full_evaluations_per_second": per_second(lambda: log_posterior(problem, best)),
        "demo_empty_evaluations_per_second": per_second(
            lambda: log_posterior(problem, empty_state(problem))
        ),
        "demo_chain_steps_per_second": chain,
        "peak_memory_mib": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }
    figures = {name: float(f"{value:.4g}") for name, value in figures.items()}
    width = max(map(len, figures))
    sys.stdout.writelines(f"{name:<{width}}  {value:>10g}\n" for name, value in figures.items())
    path = Path(__file__).with_name("results.json")
    path.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
