"""Simulation-based calibration of scenes: ranks of true scenes among posterior draws.

``python benchmarks/calibration_ranks.py FOLDER [--every 4] [--count 200] [--picture FILE]`` draws
data sets, samples the posterior of each (ten seconds) and prints for every quantity how uniform
the ranks are. Each data set leaves a file in FOLDER; the same command goes on from there, and
begins anew where the program has changed since. The result depends on the first two options
alone: frames from one detection to the next, and data sets.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict
from functools import cache
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import imapper_prob
from imapper_prob.calibrate.simulated import SETTINGS, rank_scene, short_clip
from imapper_prob.files import written_whole
from imapper_prob.models.simulate_detections import Experiment
from imapper_prob.samplers.ranks import ecdf_band, ecdf_of_ranks, uniformity
from imapper_prob.scenelets.library import built_in_library

BINS = 16
"""Of the histograms: two ranks each."""


@cache
def experiment(every: int) -> Experiment:
    """What data are drawn of, made once a process."""
    return short_clip(built_in_library(), every=every)


def rank_one(every: int, seed: int, path: Path) -> None:
    """One data set, left in a file."""
    ranked = rank_scene(experiment(every), seed)
    with written_whole(path) as beside:
        beside.write_text(json.dumps(asdict(ranked)), encoding="utf-8")


def digest() -> str:
    """Of the whole program: what ranks of another one are no part of."""
    state = hashlib.sha256()
    root = Path(imapper_prob.__file__).parent
    for folder in (root, root / "models", root / "samplers"):
        for path in sorted(folder.rglob("*.py")):
            state.update(path.read_bytes())
    state.update((root / "models" / "calibrated.toml").read_bytes())
    return state.hexdigest()[:12]


def all_ranks(
    folder: Path, every: int, count: int, workers: int
) -> list[dict[str, dict[str, float]]]:
    """What every data set says, those left out by an earlier run made now."""
    own = folder / f"{digest()}-{every}"
    own.mkdir(parents=True, exist_ok=True)
    paths = {seed: own / f"{seed:05d}.json" for seed in range(count)}
    missing = {seed: path for seed, path in paths.items() if not path.exists()}
    with ProcessPoolExecutor(workers) as pool:
        jobs = [pool.submit(rank_one, every, seed, path) for seed, path in missing.items()]
        for done, job in enumerate(as_completed(jobs), count - len(missing) + 1):
            job.result()
            if sys.stderr.isatty():
                sys.stderr.write(f"\r{done} of {count} data sets")
    return [json.loads(path.read_text(encoding="utf-8")) for path in paths.values()]


def draw(ranks: dict[str, np.ndarray], p_values: dict[str, float], path: Path) -> None:
    """Histogram and cumulative share of the ranks of everything, with bands of 95 %."""
    n_draws, columns = SETTINGS.draws, 4
    rows = -(-len(ranks) // columns)
    figure = Figure(figsize=(13, 1.9 * rows), layout="constrained")
    axes = figure.subplots(rows, 2 * columns, squeeze=False)
    for place in axes.flat:
        place.set_axis_off()
    for index, (name, values) in enumerate(ranks.items()):
        row, column = index % rows, 2 * (index // rows)
        histogram, cumulative = axes[row, column : column + 2]
        for place in (histogram, cumulative):
            place.set_axis_on()
            place.tick_params(labelsize=6)
        counts = np.bincount(values, minlength=n_draws + 1).reshape(BINS, -1).sum(1)
        expected, spread = len(values) / BINS, np.sqrt(len(values) / BINS * (1 - 1 / BINS))
        histogram.bar(np.arange(BINS), counts, width=1.0, color="0.6")
        histogram.axhspan(expected - 2 * spread, expected + 2 * spread, color="C0", alpha=0.25)
        histogram.set_xticks([])
        histogram.set_title(f"{name}  (p = {p_values[name]:.2f})", fontsize=8, loc="left")
        band = ecdf_band(len(values), n_draws=n_draws)
        cumulative.fill_between(
            band.at, band.low - band.at, band.high - band.at, color="C0", alpha=0.25, step="mid"
        )
        cumulative.plot(band.at, ecdf_of_ranks(values, n_draws=n_draws) - band.at, color="black")
        cumulative.axhline(0.0, color="0.6", linewidth=0.5)
    figure.savefig(path, dpi=90)


def main() -> None:
    """Rank, print and draw; the exit status says whether everything is uniform enough."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--every", type=int, default=4)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--picture", type=Path)
    options = parser.parse_args()
    data_sets = all_ranks(options.folder, options.every, options.count, options.workers)
    ranks = {
        name: np.array([one["ranks"][name] for one in data_sets], dtype=np.int64)
        for name in data_sets[0]["ranks"]
    }
    p_values = {name: uniformity(r, n_draws=SETTINGS.draws) for name, r in ranks.items()}
    for name, p_value in p_values.items():
        effective = np.array([one["effective"][name] for one in data_sets])
        known = effective[np.isfinite(effective)]
        worth = f"{np.median(known):.0f}" if len(known) else "-"
        sys.stdout.write(
            f"{name:22s} p = {p_value:.4f}  mean rank {ranks[name].mean() / SETTINGS.draws:.3f}  "
            f"{worth} effective of {SETTINGS.draws} draws\n"
        )
    least = min(p_values.values()) * len(p_values)
    sys.stdout.write(f"least p-value times {len(p_values)}: {least:.3f}\n")
    if options.picture is not None:
        draw(ranks, p_values, options.picture)
    sys.exit(0 if least > 0.01 else 1)


if __name__ == "__main__":
    main()
