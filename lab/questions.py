"""Does an answer settle as much as was predicted, and more than the answer to any question would?

    python -m lab.questions FOLDER [--clips 100] [--steps 3000] [--seed 0] [--workers 2]
        [--picture FILE]

simulates short clips of a sixth of the built-in library, solves and samples each, and gives every
question of the posterior the answer that the true scene gives, with the error that the question
states. Draws are weighted by the probability of that answer, and the entropy of layouts is compared
with that of layouts moved against the weights. Prints Markdown: by how many bits it was said to
fall and fell, for the question ranked first and for one of the others drawn at random, and by how
much was said. The person's stature is not asked, for the truth of a clip does not have it. Each
clip leaves a file; the same command goes on from there, and begins anew where the program has
changed. 20 s a clip and core.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np
import shapely
import torch
from numpy.typing import NDArray

from imapper_prob.api import sample
from imapper_prob.config import Config, SampleSettings
from imapper_prob.evaluate.tables import markdown_table
from imapper_prob.files import written_whole
from imapper_prob.models.furniture_statements import Presence
from imapper_prob.models.problem import labels_of
from imapper_prob.models.scene import Clip, Truth
from imapper_prob.models.skeleton import PELV
from imapper_prob.models.statement_rows import tell
from imapper_prob.models.statements import DepthOf, JointAt, Measured
from imapper_prob.sampling.conditioning import statement_values
from imapper_prob.scenelets.library import load_library
from imapper_prob.uncertainty.questions import Question, shifted
from lab.alarms import shortened, simulated
from lab.stored import digest

__all__ = ["Settled", "answer_of", "fall", "page"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
BINS: Final = (-np.inf, 0.1, 0.3, 0.6, np.inf)
"""Predicted bits, for the table by how much was predicted."""


@dataclass(frozen=True)
class Settled:
    """What one answer did.

    Parameters
    ----------
    text : str
        The question.
    predicted : float
        Bits by which the entropy of layouts was to fall.
    error : float
        Standard error of that.
    fell : float
        Bits by which it fell.
    """

    text: str
    predicted: float
    error: float
    fell: float


def answer_of(
    question: Question, truth: Truth, clip: Clip, rng: np.random.Generator
) -> bool | float | tuple[float, ...] | None:
    """What the true scene answers, with the error that is stated; None where it does not know."""
    match question.open:
        case Presence(labels=labels, region=region):
            here = shapely.Polygon(region)
            return any(
                o.label in labels and here.covers(shapely.Point(o.placement.x, o.placement.y))
                for o in truth.objects
            )
        case Measured(quantity="height", std=std):
            return truth.camera.elevation + std * float(rng.standard_normal())
        case DepthOf(frames=(frame,), error=error):
            depth = truth.camera.to_camera(_pelvis(truth, clip, frame))[1]
            return float(depth * np.exp(error * rng.standard_normal()))
        case JointAt(frame=frame, std=std):
            return tuple((_pelvis(truth, clip, frame) + std * rng.standard_normal(3)).tolist())
    return None


def _pelvis(truth: Truth, clip: Clip, frame: int) -> Array:
    place: Array = truth.joints[int(np.flatnonzero(clip.frame_ids == frame)[0]), PELV]
    return place


def fall(layouts: Ints, log_weights: Array, rng: np.random.Generator) -> float:
    """Bits by which weights lower the entropy of layouts.

    The entropy of few effective draws is too low. So the entropy with weights is compared with what
    it is if the layouts are moved along all chains, so that weights tell nothing of them.

    Parameters
    ----------
    layouts : (C, N) int
        Layout of each draw of each chain.
    log_weights : (C N,) float
    rng : numpy.random.Generator
        For the moves.

    Returns
    -------
    float
    """
    idle = np.mean([_entropy(moved.ravel(), log_weights) for moved in shifted(layouts, rng)])
    return float(idle - _entropy(layouts.ravel(), log_weights))


def _entropy(layouts: Ints, log_weights: Array) -> float:
    """Entropy of layouts, bits, of draws with weights."""
    weights = np.exp(log_weights - log_weights.max())
    shares = np.bincount(layouts, weights) / weights.sum()
    shares = shares[shares > 0]
    return float(-(shares * np.log2(shares)).sum())


def settled(seed: int, config: Config) -> list[Settled]:
    """A clip, its posterior, and what the answer to each of its questions did."""
    library, rng = shortened(load_library()), np.random.default_rng(seed)
    clip = simulated(rng, library)
    truth = clip.truth
    assert truth is not None
    posterior = sample(clip, library, rng=seed, config=config)
    samples, found = posterior.samples, []
    layouts = samples.layouts.indicator.reshape(samples.shape)
    for question in posterior.questions():
        answer = answer_of(question, truth, clip, rng)
        if answer is None:
            continue
        said = question.answered(answer)
        told = tell(posterior.solution.problem, [said], clip, labels_of(library))
        fell = fall(layouts, statement_values(told, samples.states), rng)
        found.append(Settled(question.text, question.bits, question.error, fell))
    return found


def _kept(seed: int, folder: Path, config: Config) -> list[Settled]:
    """What is in the file of a clip, made if it is not there."""
    torch.set_num_threads(1)
    path = folder / f"clip-{seed:04d}.json"
    if not path.exists():
        rows = [vars(one) for one in settled(seed, config)]
        with written_whole(path) as beside:
            beside.write_text(json.dumps(rows, indent=1), encoding="utf-8")
    return [Settled(**row) for row in json.loads(path.read_text(encoding="utf-8"))]


def chosen(
    clips: Sequence[Sequence[Settled]], rng: np.random.Generator
) -> Mapping[str, list[Settled]]:
    """The question ranked first of every clip that has several, and another one at random."""
    several = [clip for clip in clips if len(clip) > 1]
    return {
        "ranked first": [clip[0] for clip in several],
        "another, at random": [clip[int(rng.integers(1, len(clip)))] for clip in several],
    }


def page(clips: Sequence[Sequence[Settled]], rng: np.random.Generator) -> str:
    """Tables of what was predicted and what came, in Markdown."""
    asked = [one for clip in clips for one in clip]
    by_bits = {
        _bin(low, high): [one for one in asked if low <= one.predicted < high]
        for low, high in pairwise(BINS)
    }
    by_kind = {
        "yes or no": [one for one in asked if one.text.startswith("Is ")],
        "a measured number or place": [one for one in asked if not one.text.startswith("Is ")],
    }
    return "\n\n".join(
        markdown_table([
            (title, "answers", "predicted, bit", "fell by, bit", "difference, bit"),
            *(_row(name, rows) for name, rows in groups.items() if rows),
        ])
        for title, groups in (
            ("question", chosen(clips, rng)), ("predicted", by_bits), ("answer", by_kind),
        )
    )  # fmt: skip


def _bin(low: float, high: float) -> str:
    if not np.isfinite(low):
        return f"below {high:g} bit"
    return f"{low:g} to {high:g} bit" if np.isfinite(high) else f"{low:g} bit and more"


def _row(name: str, rows: Sequence[Settled]) -> tuple[str, ...]:
    predicted = np.array([one.predicted for one in rows])
    fell = np.array([one.fell for one in rows])
    off = fell - predicted
    error = off.std(ddof=1) / np.sqrt(len(off)) if len(off) > 1 else np.nan
    return (
        name, str(len(rows)), f"{predicted.mean():.2f}", f"{fell.mean():.2f}",
        f"{off.mean():+.2f} ± {error:.2f}",
    )  # fmt: skip


def draw(clips: Sequence[Sequence[Settled]], path: Path) -> None:
    """Bits that answers were worth against bits that were predicted, as a PNG."""
    from matplotlib.figure import Figure

    asked = [one for clip in clips for one in clip]
    predicted = np.array([one.predicted for one in asked])
    fell = np.array([one.fell for one in asked])
    figure = Figure(figsize=(4.6, 4.2), layout="constrained")
    axes = figure.subplots()
    axes.scatter(predicted, fell, s=6, color="0.75", label="one answer")
    place, mean, error = [], [], []
    for low, high in pairwise(BINS):
        inside = (predicted >= low) & (predicted < high)
        if inside.sum() > 1:
            place.append(predicted[inside].mean())
            mean.append(fell[inside].mean())
            error.append(fell[inside].std(ddof=1) / np.sqrt(inside.sum()))
    axes.errorbar(place, mean, error, fmt="o", color="C0", label="mean, standard error")
    largest = max(1.0, float(predicted.max(initial=0.0)))
    axes.plot([0, largest], [0, largest], color="0.3", lw=1, label="as predicted")
    axes.set_xlabel("predicted fall of the entropy of layouts (bit)")
    axes.set_ylabel("fall when answered (bit)")
    figure.legend(loc="outside upper center", ncols=3, frameon=False, fontsize="small")
    figure.savefig(path, dpi=150)


def main(arguments: Sequence[str] | None = None) -> None:
    """Simulate, sample, answer; print tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--clips", type=int, default=100)
    parser.add_argument("--steps", type=int, default=3000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--picture", type=Path, metavar="FILE")
    options = parser.parse_args(arguments)
    sparse = SampleSettings(
        chains=2, steps=options.steps, draws=1, temperatures=5, ensemble_steps=0
    )
    config = Config(sample=replace(sparse, draws=min(400, sparse.most_draws)))
    folder = options.folder / f"{digest(Path(__file__))}-{options.steps}"
    folder.mkdir(parents=True, exist_ok=True)
    seeds = [options.seed * 1000 + k for k in range(options.clips)]
    clips = []
    with ProcessPoolExecutor(options.workers) as pool:
        for clip in pool.map(partial(_kept, folder=folder, config=config), seeds):
            clips.append(clip)
            sys.stderr.write(f"{len(clips)} of {options.clips}\n")
    sys.stdout.write(page(clips, np.random.default_rng(options.seed)) + "\n")
    if options.picture is not None:
        draw(clips, options.picture)


if __name__ == "__main__":
    main()
