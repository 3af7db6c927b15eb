"""What does each term of the model do for the best scene, and each part of the path for joints?

    python -m lab.ablation I3DB_FOLDER
    python -m lab.ablation I3DB_FOLDER --path
    python -m lab.ablation --simulated 24

The first form solves each scene with all terms and with one term at a time switched off, and prints
the scores of ``docs/reference/metrics.md``. It then does the same for the five terms of the
published energy, by the published method. With ``--path`` the static path of every scene is fitted
as in the solver, then with one part at a time switched off. The output is a Markdown table of root
mean square errors in camera axes over annotated frames, means over scenes; it takes 20 s of
processor time. With ``--simulated`` the same table is of simulated clips (seeds 0, 1, …; 5 s a
clip). The last column is the mean difference of local errors from the first row, with its standard
error over clips.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from functools import partial
from pathlib import Path

import numpy as np
from rich.console import Console

from imapper_prob.evaluate.prediction import Prediction, prediction_of_scene
from imapper_prob.evaluate.score import (
    SUBSETS,
    KnownScene,
    Score,
    known_clip,
    known_scene,
    pose_scores,
    scenes_with_truth,
    score,
    summarise,
)
from imapper_prob.evaluate.tables import object_rows, pose_rows, screen_table
from imapper_prob.evaluate.truth import TruthInView
from imapper_prob.models.kernels.visibility import visibility_probability
from imapper_prob.models.log_posterior import State, state_camera
from imapper_prob.models.path_prior import StaticPath
from imapper_prob.models.problem import Problem, labels_of
from imapper_prob.models.scene import Clip, Scene
from imapper_prob.models.settings import (
    NOTHING_IN_SIGHT,
    CameraSettings,
    ModelSettings,
    PaperWeights,
    Settings,
    StaticPathSettings,
)
from imapper_prob.models.skeleton import BONE_LENGTHS, PELV
from imapper_prob.scenelets.library import built_in_library, load_library
from imapper_prob.simulate.clips import simulate_clip
from imapper_prob.solver.camera_prior import estimate_camera
from imapper_prob.solver.candidates import charness_curve, screen
from imapper_prob.solver.combinations import combine
from imapper_prob.solver.fits import best_fits
from imapper_prob.solver.limbs import limbs_of
from imapper_prob.solver.solver import fit_clip, method_of, solve_published
from imapper_prob.solver.static_path import estimate_static_path
from imapper_prob.uncertainty.stored import Source, StoredSource


def prediction_of_state(source: Source, state: State, *, name: str) -> Prediction:
    """The prediction of a state, with the objects that the method of its problem reports.

    Parameters
    ----------
    source : Source
    state : State
    name : str
        Name of the method.

    Returns
    -------
    Prediction
    """
    camera = state_camera(source.clip.camera, state)
    joints = limbs_of(source.problem, state, camera).joints
    objects = method_of(source.problem).objects(source.problem, source.library, state)
    scene = Scene(camera, objects, joints, (), 0.0)
    return prediction_of_scene(scene, name=name, people=len(source.clip.tracks))


def without_sight(problem: Problem) -> Problem:
    """The problem without occlusion: every joint is as probably visible as without furniture.

    An infinite width makes the visibility step one half everywhere; the factor on the densities of
    hidden and visible joints compensates for it.
    """
    seen = visibility_probability(NOTHING_IN_SIGHT, problem.sight_width, problem.visibility_error)
    share = 2 * np.array([1 - seen, seen])
    return problem._replace(
        sight_width=np.inf,
        confidence_density=problem.confidence_density * share,
        static_density=problem.static_density * share,
    )


def variants(problem: Problem) -> dict[str, Problem]:
    """The full log-posterior, and one problem for each term switched off."""
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
    """The full published energy, and one problem for each term switched off."""
    names = [f.name for f in fields(PaperWeights)]
    found = {"the published energy": problem}
    for k, name in enumerate(names):
        rest = problem.paper_nats * (np.arange(len(names)) != k)
        found[f"published, no {name}"] = problem._replace(paper_nats=rest)
    return found


def scores(folder: Path) -> dict[str, Score]:
    """Scores of each variant's best scene. Windows are fitted once, as no term affects them."""
    known, library = known_scene(folder), load_library()
    fitted = fit_clip(known.clip, library)
    curve = charness_curve(fitted.fits, fitted.charness, fps=known.clip.fps)
    result = {}
    for name, variant in variants(fitted.problem).items():
        best = combine(variant, screen(variant, fitted.fits), curve).states[0]
        source = StoredSource(
            known.clip,
            library,
            variant,
            best_fits(variant, fitted.fits),
            library.digest,
            tuple(labels_of(library)),
        )
        result[name] = score(prediction_of_state(source, best, name=name), known.truth)
    settings = Settings(model=ModelSettings(energy="paper"))
    fitted = fit_clip(known.clip, library, settings=settings)
    for name, variant in published_variants(fitted.problem).items():
        best = solve_published(known.clip, replace(fitted, problem=variant)).combinations.states[0]
        source = StoredSource(
            known.clip,
            library,
            variant,
            method_of(variant).best_fits(variant, fitted.fits),
            library.digest,
            tuple(labels_of(library)),
        )
        result[name] = score(prediction_of_state(source, best, name=name), known.truth)
    return result


def print_terms(folder: Path) -> None:
    """Print one row a variant: all scenes together, then scene by scene."""
    by_scene = [scores(scene) for scene in scenes_with_truth(folder)]
    together = [summarise([found[name] for found in by_scene]) for name in by_scene[0]]
    console = Console(width=170)
    console.print(screen_table(object_rows(together), title="Furniture, one term off"))
    poses = "Joints, one term off: world cm / local cm / pixels"
    console.print(screen_table(pose_rows(together), title=poses))
    for found in by_scene:
        summaries = [summarise([s]) for s in found.values()]
        console.print(screen_table(object_rows(summaries), title=summaries[0].clips[0]))


Variant = Callable[[Clip], Prediction]

_NOTHING = 1e3
"""Factor on the deviation of a term that is switched off."""
_EXACTLY = 1e-3
"""Deviation of a fixed quantity, in radians or log metres."""


def reference_body(
    clip: Clip, *, settings: StaticPathSettings | None = None, scale: float = 1.0
) -> Prediction:
    """The static path of a body of 1.70 m, or of ``scale`` times that; feet are not used."""
    return _prediction(clip, estimate_static_path(clip, settings=settings), scale, 1.0)


def with_feet(clip: Clip, *, settings: CameraSettings | None = None) -> Prediction:
    """The static path with body scale and focal length estimated from the feet."""
    path = estimate_static_path(clip)
    _, _, log_focal, log_body, _ = estimate_camera(clip, path, settings=settings).mean
    return _prediction(clip, path, float(np.exp(log_body)), float(np.exp(log_focal)))


def lifters_body(clip: Clip) -> Prediction:
    """The static path of a body of the lifter's size."""
    person = clip.tracks[0]
    poses = person.poses[person.has_pose]
    legs = [(p, c) for p, c in BONE_LENGTHS if PELV not in (p, c)][:4]
    lifted = sum(np.median(np.linalg.norm(poses[:, p] - poses[:, c], axis=-1)) for p, c in legs)
    return reference_body(clip, scale=float(lifted / sum(BONE_LENGTHS[bone] for bone in legs)))


def _prediction(clip: Clip, path: StaticPath, scale: float, focal: float) -> Prediction:
    """A path scaled to another body and focal length, with the same pixels."""
    joints = scale * path.joints * (1.0, focal, 1.0)
    return Prediction("static path", joints, clip.camera.project_camera(path.joints), ())


def path_variants() -> dict[str, Variant]:
    """The static path as the solver uses it, then with one part at a time switched off."""
    path, camera = StaticPathSettings(), CameraSettings()

    def changed(**values: float) -> Variant:
        return partial(reference_body, settings=replace(path, **values))

    return {
        "static path": reference_body,
        "body scale: the lifter's": lifters_body,
        "no prior on bone lengths": changed(length_tolerance=_NOTHING),
        "no smoothing of log depth": changed(walk_log_depth=_NOTHING),
        "no smoothing at all": changed(
            walk_log_depth=_NOTHING, walk_bearing=_NOTHING, walk_bone=_NOTHING
        ),
        "steps of bones half as large": changed(walk_bone=path.walk_bone / 2),
        "steps of bones twice as large": changed(walk_bone=path.walk_bone * 2),
        "squared pixel errors": changed(dof=_NOTHING),
        "frames independent": changed(correlation_time=0.1),
        "with the floor under the feet": with_feet,
        "the same, pitch known": partial(with_feet, settings=replace(camera, pitch=_EXACTLY)),
        "the same, pitch unknown": partial(with_feet, settings=replace(camera, pitch=_NOTHING)),
    }


def errors(prediction: Prediction, truth: TruthInView) -> tuple[float, ...]:
    """Errors in cm: pelvis in top view, joints in the world by subset, joints about the pelvis."""
    gap = prediction.joints[truth.known, PELV, :2] - truth.joints[truth.known, PELV, :2]
    pelvis = 100 * float(np.sqrt((gap**2).sum(-1).mean()))
    scores = pose_scores(prediction, truth)
    return (pelvis, *(scores[name].world for name in SUBSETS), scores[SUBSETS[0]].local)


def simulated_scenes(n: int) -> list[KnownScene]:
    """Simulated clips of seeds 0 to ``n - 1``."""
    library = built_in_library()
    return [known_clip(simulate_clip(np.random.default_rng(k), library)) for k in range(n)]


def print_path(known: Sequence[KnownScene]) -> None:
    """Print one row for each variant of the static path."""
    out = sys.stdout.write
    out(
        "| | pelvis, top view | joints, all frames | occluded joints | occ3 | about the pelvis "
        "| difference |\n|---|---:|---:|---:|---:|---:|---:|\n"
    )
    first: list[float] = []
    for name, variant in path_variants().items():
        found = np.array([errors(variant(scene.clip), scene.truth) for scene in known])
        first = first or found[:, -1].tolist()
        apart = found[:, -1] - first
        cells = " | ".join(f"{value:.1f}" for value in np.nanmean(found, 0))
        doubt = f" ± {apart.std(ddof=1) / np.sqrt(len(known)):.2f}" if len(known) > 1 else ""
        out(f"| {name} | {cells} | {apart.mean():+.2f}{doubt} |\n")


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the tables for terms, or for the path."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("scenes", type=Path, nargs="?", help="folder of i3DB scenes with truth")
    parser.add_argument("--path", action="store_true", help="parts of the static path instead")
    parser.add_argument("--simulated", type=int, default=0, help="clips, of parts of the path")
    options = parser.parse_args(arguments)
    if options.simulated:
        print_path(simulated_scenes(options.simulated))
    elif options.scenes is None:
        parser.error("name the folder of scenes, or --simulated")
    elif options.path:
        print_path([known_scene(scene) for scene in scenes_with_truth(options.scenes)])
    else:
        print_terms(options.scenes)


if __name__ == "__main__":
    main()
