"""How long the staged solver takes, stage by stage.

``python benchmarks/solve.py`` solves a simulated clip of 430 frames with 1,500 scenelets twice
and prints processor seconds by stage (the machine may be busy with other things; torch and
numba use one thread here, so that this is also the time on an idle one), and whether both runs
agree to the last bit. Loading the library and compiling are not counted: the kernels are
compiled once for a machine.
"""

from __future__ import annotations

import hashlib
import time

import numpy as np
import torch
from rich.console import Console
from rich.table import Table

from imapper_prob.models.posterior import empty_state, log_posterior
from imapper_prob.models.scene import Clip
from imapper_prob.models.scenelet import Library
from imapper_prob.models.simulate import simulate_clip
from imapper_prob.scenelets.library import load_library
from imapper_prob.staged.solver import Solution, solve

FRAMES, SCENELETS, INTERACTIONS = 430, 1500, 5
AIM = 60.0
"""Seconds."""


def workload() -> tuple[Clip, Library]:
    """A clip of five interactions, and scenelets from all over the built-in library."""
    everything = load_library()
    kept = np.linspace(0, len(everything) - 1, SCENELETS).round().astype(int)
    library = Library("1500", tuple(everything[int(k)] for k in kept))
    clip = simulate_clip(
        np.random.default_rng(0), library, n_frames=FRAMES, n_interactions=INTERACTIONS
    )
    return clip, library


def timed(clip: Clip, library: Library) -> tuple[Solution, dict[str, float]]:
    """The solution, and processor seconds by stage."""
    seconds: dict[str, float] = {}
    last = time.process_time()

    def report(stage: str, part: float) -> None:
        nonlocal last
        now = time.process_time()
        seconds[stage] = seconds.get(stage, 0.0) + now - last
        last = now

    solution = solve(clip, library, progress=report)
    seconds["tables of candidates"] = time.process_time() - last
    return solution, seconds


def digest(solution: Solution) -> str:
    """Of everything that a run could come to differ in."""
    state = hashlib.sha256()
    fits, found = solution.fits, solution.combinations
    arrays = [fits.placements, fits.cost, solution.curve.values, solution.path.estimate]
    arrays += [c.placement for c in solution.candidates]
    arrays += [a for s in solution.states for a in (s.items, s.placements)]
    for array in arrays:
        state.update(np.ascontiguousarray(array).tobytes())
    state.update(repr([(t.members, t.gain) for t in found.tried]).encode())
    return state.hexdigest()


def main() -> None:
    """Print the table."""
    torch.set_num_threads(1)
    clip, library = workload()
    warm = solve(clip, Library("few", tuple(library)[::60]))
    log_posterior(warm.problem, empty_state(warm.problem))
    runs = [timed(clip, library) for _ in range(2)]
    table = Table(
        title=f"{clip.n_frames} frames, {len(library)} scenelets: processor seconds",
        title_justify="left",
    )
    for name in ("stage", "first run", "second run"):
        table.add_column(name, justify="left" if name == "stage" else "right")
    for stage in runs[0][1]:
        table.add_row(stage, *(f"{seconds[stage]:.2f}" for _, seconds in runs))
    table.add_row("all", *(f"{sum(seconds.values()):.2f}" for _, seconds in runs))
    console = Console()
    console.print(table)
    worst = max(sum(seconds.values()) for _, seconds in runs)
    console.print(f"Aim: {AIM:.0f} s; {'met' if worst <= AIM else 'missed'}.")
    same = digest(runs[0][0]) == digest(runs[1][0])
    console.print(f"Both runs agree to the last bit: {'yes' if same else 'no'}.")


if __name__ == "__main__":
    main()
