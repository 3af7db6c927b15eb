"""Do regions hold the truth of simulated clips as often as they say, and what breaks that?

    python -m lab.coverage FOLDER [--drawn 200] [--plausible 200] [--wrong 34] [--workers 2]
        [--picture FILE]

draws scenes and their detections from the model itself and samples their posteriors. It then makes
plausible clips, and clips of three wrong models, and solves and samples each as a user would. It
prints how often regions of a stated probability contain true object centres and joints. Each clip's
result is stored in FOLDER; the same command continues from there, and starts again if the program
has changed. 502 clips take more than an hour on two cores.

Recorded clips, and those of a simulator, follow the model only approximately. For a scene and
detections drawn from the model, the posterior is exact, so wrong coverage is an error of the
sampler. The other clips are as plausible as the simulator makes them, or violate one assumption
each, as real ones may.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from scipy.stats import binom

import imapper_prob
from imapper_prob.config import Config, SampleSettings
from imapper_prob.evaluate.probability import score_posterior
from imapper_prob.evaluate.regions import elliptic_rank
from imapper_prob.evaluate.truth import truth_in_view
from imapper_prob.files import written_whole
from imapper_prob.layouts import merged_objects
from imapper_prob.models.camera import Camera
from imapper_prob.models.errors import InputError
from imapper_prob.models.log_posterior import State, motion, state_camera
from imapper_prob.models.scene import Clip, SceneObject, Truth
from imapper_prob.models.scenelet import Library
from imapper_prob.models.settings import ModelSettings
from imapper_prob.models.skeleton import PELV, SCORED
from imapper_prob.scenelets.library import built_in_library
from imapper_prob.simulate.clips import NOMINAL_CAMERA, draw_camera, simulate_clip
from imapper_prob.simulate.scene import hidden_joints
from imapper_prob.uncertainty.estimate import drawn_objects
from lab.prior import Experiment
from lab.sbc import SETTINGS as RANK_SETTINGS
from lab.sbc import Drawn, draw_and_sample, short_clip
from lab.stored import digest

__all__ = ["FRAMES", "MODELS", "region_ranks", "simulated"]


Array = NDArray[np.float64]

MODELS: Final = {
    "plausible": "camera, body and detector as the model has them, scenelets of its library",
    "other scenelets": "performed from a library of other bodies and other furniture",
    "stronger noise": "pixel errors three times as large, at the same confidences",
    "tilted floor": "a camera rolled by eight degrees, five standard deviations",
}
"""The clips of each model."""

SIMULATED_FRAMES: Final = 80
"""Frames of each clip, at 10 a second: somebody enters and does one thing."""

_NOISIER: Final = 3.0
_TILT: Final = float(np.deg2rad(8.0))
_OTHER_LIBRARY: Final = 1
"""Seed of the library that is performed, other than the one that is searched."""


def simulated(model: str, seed: int) -> tuple[Clip, Library]:
    """A clip of one of :data:`MODELS`, and the library for its inference.

    Equal arguments give the same clip. Room and walk are plausible, not a draw from p(X), and the
    errors of the static path are those that occur, not those measured on i3DB.
    """
    if model not in MODELS:
        raise InputError(f"no model {model!r}; there are {', '.join(MODELS)}")
    rng = np.random.default_rng(seed)
    library = built_in_library()
    performed = built_in_library(_OTHER_LIBRARY) if model == "other scenelets" else library
    camera = draw_camera(rng)
    if model == "tilted floor":
        camera = replace(camera, roll=camera.roll + _TILT)
    clip = simulate_clip(
        rng,
        performed,
        n_frames=SIMULATED_FRAMES,
        n_interactions=1,
        camera=camera,
        name=f"{model} {seed}",
    )
    # True furniture deviates from the scenelets' furniture.
    clip = replace(clip, truth=_displaced(rng, clip))
    # The program knows only the nominal camera, as for a real clip.
    clip = replace(clip, camera=NOMINAL_CAMERA)
    return (_noisier(clip) if model == "stronger noise" else clip), library


def _displaced(rng: np.random.Generator, clip: Clip) -> Truth:
    truth = clip.truth
    assert truth is not None  # simulated clips have ground truth
    return replace(truth, objects=drawn_objects(rng, truth.objects, ModelSettings()))


def _noisier(clip: Clip) -> Clip:
    truth, track = clip.truth, clip.tracks[0]
    assert truth is not None  # simulated clips have ground truth
    exact = truth.camera.project(truth.joints)
    keypoints = exact + _NOISIER * (track.keypoints - exact)
    return replace(clip, tracks=(replace(track, keypoints=keypoints),))


FRAMES: Final = 60
"""Frames of each clip, at 10 a second."""

_FEWEST: Final = 20
"""Least number of draws with an object, or that hide a joint, for an ellipse."""


def region_ranks(experiment: Experiment, seed: int, settings: SampleSettings) -> dict[str, Array]:
    """Ranks in [0, 1] of drawn values in regions of their posterior, in camera axes.

    ``objects``: centre of the scene's first object in order of time, among the draws that have an
    object; ``pelvis`` and ``joints`` of all frames; ``hidden``: joints hidden by furniture, among
    the draws in which they are hidden. (If a rank is taken only for scenes with some property, only
    the draws with that property may be compared.)
    """
    drawn = draw_and_sample(experiment, seed, settings)
    truth = drawn.truth
    joints = np.array([_in_camera(drawn, state) for state in drawn.states])
    true = _in_camera(drawn, truth)
    hidden = np.array([_hidden(drawn, state) for state in drawn.states])
    asked = [(t, j) for t, j in np.argwhere(_hidden(drawn, truth)).tolist() if j in SCORED]
    alike = [(t, j, hidden[:, t, j]) for t, j in asked if hidden[:, t, j].sum() >= _FEWEST]
    everywhere = [(t, j) for t in range(len(true)) for j in SCORED]
    return {
        "objects": _first_object(drawn, merged_objects(drawn.problem, drawn.library, truth)),
        "pelvis": _ranks((joints[:, t, PELV], true[t, PELV]) for t in range(len(true))),
        "joints": _ranks((joints[:, t, j], true[t, j]) for t, j in everywhere),
        "hidden": _ranks((joints[those, t, j], true[t, j]) for t, j, those in alike),
    }


def _ranks(asked: Iterable[tuple[Array, Array]]) -> Array:
    return np.array([elliptic_rank(draws, point) for draws, point in asked])


def _hidden(drawn: Drawn, state: State) -> NDArray[np.bool_]:
    """(T, 16) whether the furniture of a state hides its joints."""
    objects = merged_objects(drawn.problem, drawn.library, state)
    return hidden_joints(_camera(state), motion(drawn.problem, state), objects)


def _camera(state: State) -> Camera:
    return state_camera(NOMINAL_CAMERA, state)


def _in_camera(drawn: Drawn, state: State) -> Array:
    """(T, 16, 3) joints of a state in camera axes, metres."""
    joints: Array = _camera(state).to_camera(motion(drawn.problem, state))
    return joints


def _first_object(drawn: Drawn, true: tuple[SceneObject, ...]) -> Array:
    """(1,) rank of the first object, or (0,) if there is none."""
    found = [(s, merged_objects(drawn.problem, drawn.library, s)) for s in drawn.states]
    centres = [_camera(s).to_camera(objects[0].centre)[:2] for s, objects in found if objects]
    if not true or len(centres) < _FEWEST:
        return np.empty(0)
    centre = _camera(drawn.truth).to_camera(true[0].centre)[:2]
    return np.array([elliptic_rank(np.array(centres), centre)])


DRAWN = "drawn"
"""Name of the model itself, beside :data:`MODELS`."""
WHAT = {DRAWN: "scene and detections drawn from the model, camera prior and path given"} | MODELS
DRAWN_SETTINGS = replace(RANK_SETTINGS, steps=40_000, draws=39)
"""With 870 steps between draws. Uniform ranks need independent draws, not many, and with 39 draws
both .5 and .9 are boundaries between two ranks."""
SETTINGS = SampleSettings(
    chains=2, steps=1500, temperatures=3, swap_every=5, draws=100, ensemble_steps=2,
)  # fmt: skip
"""Short runs: about ten seconds a clip. Chains that have not converged are part of the result."""
BINS = 50
"""Bins of the histogram of ranks that is stored for a clip."""
STATED = np.arange(1, BINS) / BINS
"""Probabilities of the regions that are counted."""
BOOTSTRAPS = 1000
KINDS = ("objects", "pelvis", "joints", "hidden")


@dataclass(frozen=True)
class Curve:
    """Fraction of the truths in regions of :data:`STATED` probability.

    Parameters
    ----------
    share, low, high : (K,) float
        With a 90 % bootstrap band over clips, because joints of one clip are dependent.
    truths, clips : int
    """

    share: Array
    low: Array
    high: Array
    truths: int
    clips: int


@cache
def experiment() -> Experiment:
    """The experiment from which scenes are drawn, made once a process."""
    return short_clip(built_in_library(), every=4, frames=FRAMES)


def evaluate_one(model: str, seed: int, path: Path) -> None:
    """Evaluate one clip and write the result to a file."""
    document = drawn_scene(seed) if model == DRAWN else simulated_clip(model, seed)
    with written_whole(path) as beside:
        beside.write_text(json.dumps(document), encoding="utf-8")


def counted(ranks: Sequence[Array]) -> dict[str, list[int]]:
    """Histograms of ranks by kind."""
    counts = [np.histogram(r, bins=BINS, range=(0, 1))[0].tolist() for r in ranks]
    return dict(zip(KINDS, counts, strict=True))


def drawn_scene(seed: int) -> dict[str, Any]:
    """Histograms of the ranks of one scene drawn from the model."""
    ranks = region_ranks(experiment(), seed, DRAWN_SETTINGS)
    return counted([ranks[kind] for kind in KINDS])


def simulated_clip(model: str, seed: int) -> dict[str, Any]:
    """Histograms of the ranks of one simulated clip that is solved and sampled, and counts."""
    clip, library = simulated(model, seed)
    posterior = imapper_prob.sample(clip, library, config=Config(seed=seed, sample=SETTINGS))
    found = score_posterior(posterior, truth_in_view(clip), name=model)
    ranks = (found.object_ranks, found.pelvis_ranks, found.joint_ranks, found.hidden_ranks)
    return counted(ranks) | {
        "claimed": found.claimed, "true": found.true, "found": found.found,
        "expected": found.expected, "joint_expected": found.joint_expected,
    }  # fmt: skip


def all_clips(
    folder: Path, counts: dict[str, int], workers: int
) -> dict[str, list[dict[str, Any]]]:
    """Results of all clips; those missing from earlier runs are computed."""
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


def curve_of(clips: list[dict[str, Any]], kind: str, rng: np.random.Generator) -> Curve:
    """Coverage pooled over clips."""
    counts = np.array([clip[kind] for clip in clips], float)
    drawn = counts[rng.integers(len(clips), size=(BOOTSTRAPS, len(clips)))].sum(1)
    whole = np.vstack([counts.sum(0), drawn])
    shares = whole.cumsum(1)[:, :-1] / np.maximum(whole.sum(1, keepdims=True), 1)
    low, high = np.quantile(shares[1:], (0.05, 0.95), axis=0)
    return Curve(shares[0], low, high, int(counts.sum()), len(clips))


def table(curves: dict[str, dict[str, Curve]], clips: dict[str, list[dict[str, Any]]]) -> Table:
    """One row for each model and kind."""
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
    """One panel for each kind with a line for each model, and the band for correct coverage."""
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


def main(arguments: Sequence[str] | None = None) -> None:
    """Simulate, sample and print the coverage."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--drawn", type=int, default=200, help="clips drawn from the model")
    parser.add_argument("--plausible", type=int, default=200, help="clips of the simulator")
    parser.add_argument("--wrong", type=int, default=34, help="clips of each wrong one")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--picture", type=Path)
    options = parser.parse_args(arguments)
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
