"""Calibration in the large: do regions hold the truth of simulated clips, and what breaks that?

``python benchmarks/simulated_coverage.py FOLDER [--drawn 200] [--plausible 200] [--wrong 34]
[--picture FILE]``
draws scenes and their detections from the model itself and samples their posteriors; then makes
clips that are plausible, and clips of three wrong models, solves and samples each as a user
would; and prints how often regions of a stated probability hold true object centres and joints.
Each clip leaves a file in FOLDER; the same command goes on from there, and begins anew where
the program has changed. 502 clips take more than an hour on two cores.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from calibration_ranks import digest
from matplotlib.figure import Figure
from numpy.typing import NDArray
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from scipy.stats import binom

import imapper_prob
from imapper_prob.calibrate.simulated import SETTINGS as RANK_SETTINGS
from imapper_prob.calibrate.simulated import short_clip
from imapper_prob.config import Config, SampleSettings
from imapper_prob.evaluate.drawn_scenes import FRAMES, region_ranks
from imapper_prob.evaluate.posterior_score import score_posterior
from imapper_prob.evaluate.truth import truth_in_view
from imapper_prob.evaluate.wrong_models import MODELS, simulated
from imapper_prob.files import written_whole
from imapper_prob.models.simulate_detections import Experiment
from imapper_prob.scenelets.library import built_in_library

Array = NDArray[np.float64]

DRAWN = "drawn"
"""The model itself, beside :data:`MODELS`."""
WHAT = {DRAWN: "scene and detections drawn from the model, camera prior and path given"} | MODELS
DRAWN_SETTINGS = replace(RANK_SETTINGS, steps=40_000, draws=39)
"""With 870 steps from draw to draw: ranks are uniform if draws are independent, not if they are
many, and of 39 both .5 and .9 are borders between two."""
SETTINGS = SampleSettings(
    chains=2, steps=1500, temperatures=3, swap_every=5, draws=100, ensemble_layouts=1,
    ensembles=2, ensemble_steps=2,
)  # fmt: skip
"""Short: about ten seconds a clip. That chains have not met is part of what is measured."""
BINS = 50
"""Of the ranks of joints that are kept of a clip."""
STATED = np.arange(1, BINS) / BINS
"""Probabilities of the regions that are looked at."""
BOOTSTRAPS = 1000
KINDS = ("objects", "pelvis", "joints", "hidden")


@dataclass(frozen=True)
class Curve:
    """Share of the truths in regions of :data:`STATED` probability.

    Parameters
    ----------
    share, low, high : (K,) float
        With the band of 90 % from drawing clips with replacement: joints of one clip go together.
    truths, clips : int
    """

    share: Array
    low: Array
    high: Array
    truths: int
    clips: int


@cache
def experiment() -> Experiment:
    """What scenes are drawn of, made once a process."""
    return short_clip(built_in_library(), every=4, frames=FRAMES)


def evaluate_one(model: str, seed: int, path: Path) -> None:
    """One clip, left in a file."""
    document = drawn_scene(seed) if model == DRAWN else simulated_clip(model, seed)
    with written_whole(path) as beside:
        beside.write_text(json.dumps(document), encoding="utf-8")


def counted(ranks: Sequence[Array]) -> dict[str, list[int]]:
    """Ranks by kind, binned."""
    counts = [np.histogram(r, bins=BINS, range=(0, 1))[0].tolist() for r in ranks]
    return dict(zip(KINDS, counts, strict=True))


def drawn_scene(seed: int) -> dict[str, Any]:
    """What one scene of the model says."""
    ranks = region_ranks(experiment(), seed, DRAWN_SETTINGS)
    return counted([ranks[kind] for kind in KINDS])


def simulated_clip(model: str, seed: int) -> dict[str, Any]:
    """What one clip says that was solved and sampled."""
    clip, library = simulated(model, seed)
    posterior = imapper_prob.sample(clip, library, config=Config(seed=seed, sample=SETTINGS))
    found = score_posterior(posterior, truth_in_view(clip), name=model)
    ranks = (found.object_ranks, found.pelvis_ranks, found.joint_ranks, found.hidden_ranks)
    return counted(ranks) | {
        "claimed": found.claimed, "true": found.true, "found": found.found,
        "expected": found.expected, "joint_expected": found.joint_expected,
    }  # fmt: skip


def all_clips(folder: Path, counts: dict[str, int], workers: int) -> dict[str, list[dict]]:
    """What every clip says, those left out by an earlier run made now."""
    paths = {
        (model, seed): folder / digest() / model.replace(" ", "-") / f"{seed:04d}.json"
        for model, count in counts.items()
        for seed in range(count)
    }
    for path in paths.values():
        path.parent.mkdir(parents=True, exist_ok=True)
    missing = {key: path for key, path in paths.items() if not path.exists()}
    with ProcessPoolExecutor(workers) as pool:
        jobs = [pool.submit(evaluate_one, *key, path) for key, path in missing.items()]
        for done, job in enumerate(as_completed(jobs), len(paths) - len(missing) + 1):
            job.result()
            if sys.stderr.isatty():
                sys.stderr.write(f"\r{done} of {len(paths)} clips")
    return {
        model: [json.loads(paths[model, seed].read_text("utf-8")) for seed in range(count)]
        for model, count in counts.items()
    }


def curve_of(clips: list[dict], kind: str, rng: np.random.Generator) -> Curve:
    """Pooled over clips."""
    counts = np.array([clip[kind] for clip in clips], float)
    drawn = counts[rng.integers(len(clips), size=(BOOTSTRAPS, len(clips)))].sum(1)
    whole = np.vstack([counts.sum(0), drawn])
    shares = whole.cumsum(1)[:, :-1] / np.maximum(whole.sum(1, keepdims=True), 1)
    low, high = np.quantile(shares[1:], (0.05, 0.95), axis=0)
    return Curve(shares[0], low, high, int(counts.sum()), len(clips))


def table(curves: dict[str, dict[str, Curve]], clips: dict[str, list[dict]]) -> Table:
    """A row a model and kind."""
    made = Table(title="share of the truths in regions of 50 % and 90 %", box=SIMPLE_HEAD)
    for name in ("clips of", "truths", "50 %", "90 %", "number", "claimed"):
        made.add_column(name, justify="left" if name in ("clips of", "truths") else "right")
    for model, found in curves.items():
        for kind, curve in found.items():
            cells = []
            for stated in (0.5, 0.9):
                k = int(np.searchsorted(STATED, stated - 1e-9))
                band = f"{curve.low[k]:.2f} to {curve.high[k]:.2f}"
                cells.append(f"{curve.share[k]:.2f} ({band})" if curve.truths else "–")
            claimed = ""
            if kind == "objects" and model != DRAWN:
                numbers = [sum(c[n] for c in clips[model]) for n in ("claimed", "true")]
                claimed = f"{numbers[0]} of {numbers[1]}"
            made.add_row(model, kind, *cells, str(curve.truths), claimed)
    return made


def picture(curves: dict[str, dict[str, Curve]], path: Path) -> None:
    """A panel a kind, a line a model, and the band in which the right one should lie."""
    figure = Figure((4.0 * len(KINDS), 4.0), layout="constrained")
    for axes, kind in zip(figure.subplots(1, len(KINDS)), KINDS, strict=True):
        axes.plot((0, 1), (0, 1), color="0.6", linewidth=0.8)
        truths = curves[DRAWN][kind].truths if DRAWN in curves else 0
        if kind == "objects" and truths:
            low, high = (binom.ppf(q, truths, STATED) / truths for q in (0.05, 0.95))
            axes.fill_between(STATED, low, high, color="0.85")
        for k, (model, found) in enumerate(curves.items()):
            curve = found[kind]
            if curve.truths:
                axes.plot(STATED, curve.share, color=f"C{k}", label=model)
                axes.fill_between(STATED, curve.low, curve.high, color=f"C{k}", alpha=0.12)
        axes.set_title(kind, fontsize=9)
        axes.set_xlabel("stated probability", fontsize=8)
        axes.set_aspect("equal")
        axes.legend(fontsize=7, frameon=False)
    figure.savefig(path, dpi=120)


def main() -> None:
    """Simulate, sample, count."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--drawn", type=int, default=200, help="clips drawn from the model")
    parser.add_argument("--plausible", type=int, default=200, help="clips of the simulator")
    parser.add_argument("--wrong", type=int, default=34, help="clips of each wrong one")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--picture", type=Path)
    options = parser.parse_args()
    counts = dict.fromkeys(WHAT, options.wrong)
    counts |= {DRAWN: options.drawn, "plausible": options.plausible}
    clips = all_clips(options.folder, {m: n for m, n in counts.items() if n}, options.workers)
    rng = np.random.default_rng(0)
    curves = {m: {kind: curve_of(c, kind, rng) for kind in KINDS} for m, c in clips.items()}
    console = Console()
    for model in clips:
        console.print(f"{model}: {WHAT[model]}")
    console.print(table(curves, clips))
    if options.picture is not None:
        picture(curves, options.picture)


if __name__ == "__main__":
    main()
