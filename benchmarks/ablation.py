"""What each term does for the staged solver's best scene on i3DB.

``python benchmarks/ablation.py I3DB_FOLDER`` solves each scene as it is and with one term at a
time switched off, and prints the scores of ``docs/metrics.md``; then the same for the five terms of
the published energy, by the published method.
"""

from __future__ import annotations

import sys
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
from rich.console import Console

from imapper_prob.evaluate.prediction import prediction_of_state
from imapper_prob.evaluate.scenes import known_scene, scenes_with_truth
from imapper_prob.evaluate.score import Score, score, summarise
from imapper_prob.evaluate.tables import object_rows, pose_rows, screen_table
from imapper_prob.models.energy.occlusion import p_seen
from imapper_prob.models.energy.paper import PaperWeights
from imapper_prob.models.geometry import NOTHING_IN_SIGHT
from imapper_prob.models.problem import Problem
from imapper_prob.models.settings import ModelSettings, Settings
from imapper_prob.results.stored_input import StoredSource
from imapper_prob.scenelets.library import load_library
from imapper_prob.staged.candidates import screen
from imapper_prob.staged.combine import combine
from imapper_prob.staged.maxima import charness_curve
from imapper_prob.staged.resemblance import best_fits
from imapper_prob.staged.solver import fit_clip, solve_published


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
    }


def published_variants(problem: Problem) -> dict[str, Problem]:
    """The published energy whole, and without each of its terms."""
    names = [f.name for f in fields(PaperWeights)]
    found = {"the published energy": problem}
    for k, name in enumerate(names):
        rest = problem.paper_nats * (np.arange(len(names)) != k)
        found[f"published, no {name}"] = problem._replace(paper_nats=rest)
    return found


def scores(folder: Path) -> dict[str, Score]:
    """Each variant's best scene against the truth. Windows are fitted once: no term changes it."""
    known, library = known_scene(folder), load_library()
    fitted = fit_clip(known.clip, library)
    curve = charness_curve(fitted.fits, fitted.charness, fps=known.clip.fps)
    result = {}
    for name, variant in variants(fitted.problem).items():
        best = combine(variant, screen(variant, fitted.fits), curve).states[0]
        source = StoredSource(known.clip, library, variant, best_fits(variant, fitted.fits))
        result[name] = score(prediction_of_state(source, best, name=name), known.truth)
    settings = Settings(model=ModelSettings(energy="paper"))
    fitted = fit_clip(known.clip, library, settings=settings)
    for name, variant in published_variants(fitted.problem).items():
        best = solve_published(known.clip, replace(fitted, problem=variant))[2].states[0]
        source = StoredSource(known.clip, library, variant, best_fits(variant, fitted.fits))
        result[name] = score(prediction_of_state(source, best, name=name), known.truth)
    return result


def main() -> None:
    """Print a row a variant: all scenes together, then scene by scene."""
    by_scene = [scores(scene) for scene in scenes_with_truth(sys.argv[1])]
    together = [summarise([found[name] for found in by_scene]) for name in by_scene[0]]
    console = Console(width=170)
    console.print(screen_table(object_rows(together), title="Furniture, one term off"))
    poses = "Joints, one term off: world cm / local cm / pixels"
    console.print(screen_table(pose_rows(together), title=poses))
    for found in by_scene:
        summaries = [summarise([s]) for s in found.values()]
        console.print(screen_table(object_rows(summaries), title=summaries[0].clips[0]))


if __name__ == "__main__":
    main()
