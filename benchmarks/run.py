"""Speed of the main parts, most on the demo clip: prints a table, writes ``results.json`` beside.

Run with ``make bench``. Figures are of this machine, one process, one thread.
"""

from __future__ import annotations

import json
import resource
import sys
import time
from collections.abc import Callable
from pathlib import Path

import evaluations
import numpy as np

from imapper_prob.config import SampleSettings
from imapper_prob.demo import demo_clip
from imapper_prob.inputs.captures import Capture
from imapper_prob.models.posterior import empty_state, log_posterior
from imapper_prob.sampling.chain import run_chain
from imapper_prob.sampling.sample import setup_of
from imapper_prob.scenelets.build import build_library_from
from imapper_prob.scenelets.descriptors import descriptor_distances, motion_descriptors
from imapper_prob.scenelets.library import load_library
from imapper_prob.scenelets.object_histograms import categories, object_histograms
from imapper_prob.scenelets.procedural.catalogue import build_library
from imapper_prob.staged.solver import solve


def per_second(action: Callable[[], object], *, seconds: float = 2.0) -> float:
    """How often ``action`` can be done in a second, after one to warm up."""
    action()
    count, start = 0, time.perf_counter()
    while time.perf_counter() - start < seconds:
        action()
        count += 1
    return count / (time.perf_counter() - start)


def seconds(action: Callable[[], object]) -> float:
    """How long ``action`` takes: the best of three."""
    times = []
    for _ in range(3):
        start = time.perf_counter()
        action()
        times.append(time.perf_counter() - start)
    return min(times)


def library_figures() -> dict[str, float]:
    """Cost of a library: built in, cut from captures, described and searched."""
    library = load_library()
    motions = [s.joints for s in library]
    known = motion_descriptors(motions)
    few, many = (pacing(minutes) for minutes in (5, 10))
    cut = [len(build_library_from([c], name="bench")[0]) for c in (few, many)]
    half = len(motions) // 2
    return {
        "library_scenelets": len(library),
        "library_build_seconds": seconds(lambda: build_library(0)),
        "descriptors_seconds": seconds(lambda: motion_descriptors(motions)),
        "descriptors_seconds_of_half": seconds(lambda: motion_descriptors(motions[:half])),
        "object_histograms_seconds": seconds(
            lambda: object_histograms(library.scenelets, categories(library))
        ),
        "nearest_motions_per_second": len(known)
        / seconds(lambda: descriptor_distances(known, known).argmin(1)),
        "capture_scenelets": cut[1],
        "capture_build_seconds": seconds(lambda: build_library_from([many], name="bench")),
        "capture_scenelets_of_half": cut[0],
        "capture_build_seconds_of_half": seconds(lambda: build_library_from([few], name="bench")),
    }


def pacing(minutes: float) -> Capture:
    """Somebody who walks to and fro before a couch, from the library's own motions."""
    library = load_library()
    walk = next(s for s in library if s.name == "walk-000")
    couch = next(s for s in library if s.labels == ("couch",)).objects[0]
    step = walk.joints[-1] - walk.joints[-2]
    way = np.concatenate([walk.joints, walk.joints[::-1] + 0.1 * step])
    times = int(minutes * 60 * walk.fps) // len(way)
    return Capture("pacing", "room", np.tile(way, (times, 1, 1)), (couch,), walk.fps)


def main() -> None:
    """Measure, print, write."""
    clip, library = demo_clip(), load_library()
    solve(clip, library)  # compiles the kernels
    start = time.perf_counter()
    solution = solve(clip, library)
    solving = time.perf_counter() - start
    problem, best = solution.problem, solution.states[0]
    steps = 4000
    setup = setup_of(solution, SampleSettings(steps=steps, draws=100, temperatures=1))
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
        **library_figures(),
        **evaluations.figures(),
        "peak_memory_mib": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }
    figures = {name: float(f"{value:.4g}") for name, value in figures.items()}
    width = max(map(len, figures))
    sys.stdout.writelines(f"{name:<{width}}  {value:>10g}\n" for name, value in figures.items())
    path = Path(__file__).with_name("results.json")
    # Those of other benchmarks stay.
    known = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    path.write_text(json.dumps(known | figures, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
