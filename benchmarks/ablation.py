"""What each term does for the staged solver's best scene on i3DB.

``python benchmarks/ablation.py I3DB_FOLDER`` solves each scene as it is and with one term at a
time switched off, and prints how far its objects are from the truth, how many true objects
that somebody uses have one within a metre, and how many objects there are.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from preference import PAPER_NATS, centre_of, wishes_of
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from imapper_prob.inputs.i3db import read_i3db, read_i3db_truth
from imapper_prob.models.energy.occlusion import p_seen
from imapper_prob.models.geometry import NOTHING_IN_SIGHT
from imapper_prob.models.problem import Problem
from imapper_prob.models.scene import Clip, SceneObject, Truth
from imapper_prob.results.summary import distances_to_truth
from imapper_prob.sampling.layouts import merged_objects
from imapper_prob.scenelets.library import load_library
from imapper_prob.staged.candidates import screen
from imapper_prob.staged.combine import combine
from imapper_prob.staged.maxima import charness_curve
from imapper_prob.staged.solver import fit_clip

FOUND = 1.0
"""Metres within which an object counts as found (the paper's)."""


@dataclass(frozen=True)
class Score:
    """Distances in metres of the objects that have a partner; how many used ones were found."""

    distances: np.ndarray
    used: int
    found: int
    n_objects: int


def without_sight(problem: Problem) -> Problem:
    """Nothing hides anything: every joint is seen as often as where no furniture is.

    An infinite width makes the step of visibility one half everywhere; what the densities of
    hidden and seen are multiplied by makes up for it.
    """
    seen = p_seen(NOTHING_IN_SIGHT, problem.sight_width, problem.surprise)
    share = 2 * np.array([1 - seen, seen])
    return problem._replace(
        sight_width=np.inf,
        confidence_density=problem.confidence_density * share,
        static_density=problem.static_density * share,
    )


def variants(problem: Problem) -> dict[str, Problem]:
    """The log-posterior whole, and with one term switched off."""
    even = np.log(np.exp(problem.log_rate).mean())
    return {
        "all terms": problem,
        "no sight lines": without_sight(problem),
        "no free-pose cost": problem._replace(free_cost=np.zeros(problem.n_frames)),
        "no collision": problem._replace(collision_cost=0.0),
        "no smoothness": problem._replace(smoothness_cost=0.0),
        "no motion, no ground": problem._replace(motion_cost=0.0),
        "equal weights": problem._replace(log_rate=np.full_like(problem.log_rate, even)),
        "frames independent": problem._replace(frame_weight=1.0),
        "the published energy": problem._replace(paper_nats=PAPER_NATS),
    }


def scores(clip: Clip, truth: Truth) -> dict[str, Score]:
    """Each variant's best scene against the truth. Windows are fitted once: no term changes it."""
    library = load_library()
    fitted = fit_clip(clip, library)
    problem, fits = fitted.problem, fitted.fits
    curve = charness_curve(fits, fitted.charness, fps=clip.fps)
    result = {}
    for name, variant in variants(problem).items():
        best = combine(variant, screen(variant, fits), curve).states[0]
        result[name] = score(merged_objects(variant, library, best), truth)
    return result


def score(objects: tuple[SceneObject, ...], truth: Truth) -> Score:
    """Distances to the nearest partners, and how many of the used objects were found."""
    distances = distances_to_truth(objects, truth.objects)
    places = {wish.place for wish in wishes_of(truth)}
    used = [o for o in truth.objects if centre_of(o) in places]
    nearest = distances_to_truth(used, objects)
    return Score(
        distances[np.isfinite(distances)], len(used), int((nearest < FOUND).sum()), len(objects)
    )


def main() -> None:
    """Print a row a variant, a column a scene."""
    table = Table(
        title="distance to truth, mean in cm (used objects within 1 m; objects)",
        title_justify="left", box=SIMPLE_HEAD,
    )  # fmt: skip
    table.add_column("", no_wrap=True)
    by_scene = {}
    for scene in sorted(p for p in Path(sys.argv[1]).iterdir() if (p / "gt").is_dir()):
        clip = read_i3db(scene)
        by_scene[scene.name] = scores(clip, read_i3db_truth(scene, clip))
        table.add_column(scene.name, justify="right")
    table.add_column("all", justify="right")
    for name in next(iter(by_scene.values())):
        row = [s[name] for s in by_scene.values()]
        pooled = Score(
            np.concatenate([s.distances for s in row]),
            *(sum(getattr(s, f) for s in row) for f in ("used", "found", "n_objects")),
        )
        table.add_row(name, *(in_words(s) for s in (*row, pooled)))
    Console(width=120).print(table)


def in_words(score: Score) -> str:
    mean = f"{100 * score.distances.mean():.0f}" if len(score.distances) else "none"
    return f"{mean} ({score.found} of {score.used}; {score.n_objects})"


if __name__ == "__main__":
    main()
