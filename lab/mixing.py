"""How well do chains mix with tempering and without it, and what does a second process gain?

    python -m lab.mixing I3DB_FOLDER FOLDER [--scenes Scene04 …] [--steps N] [--workers 2]
    python -m lab.mixing --scaling [--steps N]

The first form samples each scene twice with four chains: with the default temperatures, and at one
temperature with as many steps as all temperatures have together, which takes about the same time.
Results are stored in FOLDER, one file a run, so that a killed command continues where it was; a
Markdown table is printed and its figures are written to ``lab/results.json``. With ``--scaling``
four chains with equal numbers of steps run alternately on one worker and on two. The best time of
each counts, because other processes on a shared machine only add time.
"""

from __future__ import annotations

import argparse
import json
import resource
import sys
import time
import warnings
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from imapper_prob.api import demo_clip
from imapper_prob.clips.i3db import read_i3db
from imapper_prob.config import SampleSettings
from imapper_prob.files import written_whole
from imapper_prob.models.scene import Clip
from imapper_prob.samplers.chains import run_chains
from imapper_prob.samplers.diagnostics import ShortChainWarning, ess, rhat
from imapper_prob.sampling.chain import run_chain
from imapper_prob.scenelets.library import load_library
from lab.stored import with_steps

if TYPE_CHECKING:
    # Processes of chains load this script again, and do not need torch.
    from imapper_prob.sampling.sample import Samples
    from imapper_prob.solver.solver import Solution

SCENES = ("Scene04", "Scene10", "Scene13", "Scene14")
OPEN = (0.05, 0.95)
"""Range of fractions of layouts that are neither practically excluded nor certain."""
TEMPERATURES = 8
"""Number of temperatures with which chains begin."""
REPEATS = 3
"""Number of timings of each number of workers."""


def settings_of(kind: str, steps: int) -> SampleSettings:
    """Default settings, or the same number of steps at the posterior's temperature alone."""
    usual = replace(with_steps(steps).sample, ensemble_steps=0)
    if kind == "tempered":
        return usual
    return replace(usual, temperatures=1, steps=steps * TEMPERATURES)


def figures(samples: Samples) -> dict[str, Any]:
    """R-hat and effective draws of scalar quantities and of the indicator of each layout."""
    shape = samples.shape
    values: dict[str, Any] = {
        "log posterior": samples.log_posterior,
        "objects": np.reshape([len(o) for o in samples.objects], shape).astype(float),
        "scenelets": np.reshape([s.n_scenelets for s in samples.states], shape).astype(float),
    }
    found = samples.probabilities
    undecided = (found.probability >= OPEN[0]) & (found.probability <= OPEN[1])
    indicator = 1 + samples.layouts.indicator.reshape(shape)
    layouts = [(indicator == k).astype(float) for k in found.layouts[undecided]]
    result: dict[str, Any] = {
        "mean log posterior": samples.log_posterior.mean(1).tolist(),
        "layouts": len(layouts),
        "R-hat of layouts": max((float(rhat(x)) for x in layouts), default=1.0),
        "effective draws of layouts": float(
            min(found.effective_draws[undecided], default=float("nan"))
        ),
        "round trips": sum(ladder.round_trips for ladder in samples.ladders),
        "swap rates": [ladder.swap_rates for ladder in samples.ladders],
        "verdict": samples.verdict.text,
    }
    for name, draws in values.items():
        result[f"R-hat of {name}"] = float(rhat(draws))
        result[f"effective draws of {name}"] = float(ess(draws))
    return result


def processor_seconds() -> float:
    """Processor seconds of this process and of its finished children."""
    used = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(one.ru_utime + one.ru_stime for one in used)


def compare(clips: Path, folder: Path, scenes: list[str], steps: int, workers: int) -> None:
    """Make the missing runs, print the table, and store its figures."""
    from imapper_prob.sampling.sample import sample_scenes
    from imapper_prob.solver.solver import solve

    folder.mkdir(parents=True, exist_ok=True)
    runs: dict[tuple[str, str], dict[str, Any]] = {}
    for scene in scenes:
        solution: Solution | None = None
        for kind in ("tempered", "plain"):
            settings = settings_of(kind, steps)
            path = folder / f"{scene}-{kind}-{steps}.json"
            if not path.exists():
                solution = solution or solve(read_i3db(clips / scene), load_library())
                begun = time.perf_counter(), processor_seconds()
                samples = sample_scenes(
                    solution, settings, seed=np.random.SeedSequence(0), workers=workers
                )
                took = time.perf_counter() - begun[0], processor_seconds() - begun[1]
                made = {"settings": asdict(settings), "seconds": took[0], "processor": took[1]}
                with written_whole(path) as beside:
                    beside.write_text(json.dumps(made | figures(samples), indent=1) + "\n")
            runs[scene, kind] = json.loads(path.read_text())
    sys.stdout.write(table(runs))
    note(
        {
            f"mixing_{scene.lower()}_{kind}_{name}": run[key]
            for (scene, kind), run in runs.items()
            for name, key in (
                ("rhat_of_log_posterior", "R-hat of log posterior"),
                ("rhat_of_objects", "R-hat of objects"),
                ("effective_layout_draws", "effective draws of layouts"),
                ("processor_seconds", "processor"),
            )
        }
    )


def table(runs: dict[tuple[str, str], dict[str, Any]]) -> str:
    """The runs as a Markdown table, one row each."""
    rows = [
        "| scene | chains | R-hat: log posterior | objects | scenelets | layouts "
        "| effective draws: log posterior | layouts | mean log posterior | round trips "
        "| processor s |",
        "|---|---|" + "---:|" * 9,
    ]
    for (scene, kind), run in runs.items():
        columns = [
            *(f"{run[f'R-hat of {x}']:.2f}" for x in ("log posterior", "objects", "scenelets")),
            f"{run['R-hat of layouts']:.2f}",
            *(f"{run[f'effective draws of {x}']:.0f}" for x in ("log posterior", "layouts")),
            " ".join(f"{mean:.0f}" for mean in run["mean log posterior"]),
            str(run["round trips"]) if kind == "tempered" else "-",
            f"{run['processor']:.0f}",
        ]
        rows.append(f"| {scene} | {kind} | " + " | ".join(columns) + " |")
    return "\n".join(rows) + "\n"


def scaling(clip: Clip, steps: int) -> None:
    """Time four chains on one worker and on two."""
    from imapper_prob.sampling.sample import setup_of
    from imapper_prob.solver.solver import solve

    solution = solve(clip, load_library())
    settings = settings_of("tempered", steps)
    setup, starts = setup_of(solution, settings), [solution.states[:1]] * 4
    # Kernels are compiled once on a machine.
    run_chains(run_chain, replace(setup, settings=settings_of("tempered", 5)), starts[:1], seed=0)
    seconds: dict[int, list[float]] = {1: [], 2: []}
    for _ in range(REPEATS):
        for workers, times in seconds.items():
            begun = time.perf_counter()
            run_chains(run_chain, setup, starts, seed=0, workers=workers)
            times.append(time.perf_counter() - begun)
    ratio = min(seconds[2]) / min(seconds[1])
    for workers, times in seconds.items():
        told = ", ".join(f"{t:.1f}" for t in times)
        sys.stdout.write(f"4 chains of {steps} steps, workers {workers}: {told} s\n")
    sys.stdout.write(f"best on two over best on one: {ratio:.2f} (aim: .6)\n")
    note({"chains_on_two_workers_over_one": ratio})


def note(found: dict[str, float]) -> None:
    """Add figures to the file of results."""
    path = Path(__file__).with_name("results.json")
    known = json.loads(path.read_text(encoding="utf-8"))
    # JSON cannot represent infinity and NaN.
    rounded = {name: float(f"{value:.4g}") for name, value in found.items() if np.isfinite(value)}
    with written_whole(path) as beside:
        beside.write_text(json.dumps(known | rounded, indent=1) + "\n", encoding="utf-8")


def main(arguments: Sequence[str] | None = None) -> None:
    """Compare, or time."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("clips", type=Path, nargs="?")
    parser.add_argument("folder", type=Path, nargs="?")
    parser.add_argument("--scenes", nargs="+", default=list(SCENES))
    parser.add_argument("--steps", type=int, default=SampleSettings().steps)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--scaling", action="store_true", help="time one worker and two")
    options = parser.parse_args(arguments)
    if options.scaling:
        scaling(demo_clip(), options.steps)
    elif options.folder is None:
        parser.error("give the folder of i3DB's scenes and one for results, or --scaling")
    else:
        with warnings.catch_warnings():
            # A short chain has no R-hat, as the table shows.
            warnings.simplefilter("ignore", ShortChainWarning)
            compare(options.clips, options.folder, options.scenes, options.steps, options.workers)


if __name__ == "__main__":
    main()
