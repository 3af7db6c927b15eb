"""Are true scenes ranked uniformly among draws of their posteriors? Simulation-based calibration.

    python -m lab.sbc FOLDER [--every 4] [--count 200] [--workers 2] [--picture FILE]

draws data sets, samples the posterior of each (about ten seconds) and prints for every quantity how
uniform the ranks are; the exit status says whether all are uniform enough. The result of each data
set is stored in FOLDER; the same command continues from there, and starts again if the program has
changed. The result depends only on the first two options: the frames between detections, and the
number of data sets.

A scene is drawn from the prior and detections are drawn for it. The chains of
:mod:`imapper_prob.sampling` run on these as on any clip: fits and a start by the staged solver, all
moves, all temperatures. If model, moves and solver are correct, and chains long enough, the true
scene is exchangeable with their draws (Cook, Gelman & Rubin 2006; Talts et al. 2018,
arXiv:1804.06788), for every quantity. What is given differs from a real clip in four points,
without which the posterior is not that of any generative model
(``docs/research/calibration_ranks.md``). The uniformity of N ranks is best seen in their cumulative
distribution, together with a simultaneous confidence band (Säilynoja, Bürkner & Vehtari 2022, Stat.
Comput. 32, 32), whose ends ArviZ computes.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass, replace
from functools import cache, lru_cache
from pathlib import Path
from typing import Final

import numpy as np
from arviz_stats.ecdf_utils import compute_ecdf, get_pointwise_confidence_band
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray
from scipy.stats import binom

from imapper_prob.config import SampleSettings
from imapper_prob.files import written_whole
from imapper_prob.layouts import merged_objects
from imapper_prob.models.detector import DetectionModel
from imapper_prob.models.log_posterior import State, motion, terms
from imapper_prob.models.path_prior import CameraPrior, StaticPath
from imapper_prob.models.problem import Problem
from imapper_prob.models.scene import Clip, Track
from imapper_prob.models.scenelet import Library, Scenelet
from imapper_prob.models.settings import ModelSettings, Settings
from imapper_prob.models.skeleton import DETECTED, N_JOINTS, PELV, turned
from imapper_prob.samplers.diagnostics import ess
from imapper_prob.sampling.chain import run_chain
from imapper_prob.sampling.sample import setup_of
from imapper_prob.scenelets.charness import charness, motion_distances
from imapper_prob.scenelets.library import built_in_library
from imapper_prob.simulate.clips import NOMINAL_CAMERA
from imapper_prob.solver.fits import fit_windows
from imapper_prob.solver.poses import FrameTable, PoseSource
from imapper_prob.solver.solver import Fitted, Solution, solve_fitted
from lab.prior import Experiment, draw_state
from lab.stored import digest

__all__ = [
    "SETTINGS",
    "Drawn",
    "describe",
    "draw_and_sample",
    "ecdf_and_band",
    "rank_among",
    "rank_scene",
    "short_clip",
    "spread_ranks",
    "uniformity",
]


Array = NDArray[np.float64]

FRAMES: Final = 24
"""Frames of the clip, at 10 a second: enough for two scenelets, sometimes three short ones."""

SCENELETS: Final = (
    ("sit-couch-000", 8), ("sit-chair-000", 8), ("sit-couch-001", 12), ("stand-table-000", 8),
    ("reach-shelf-000", 12), ("stand-idle-000", 8),
)  # fmt: skip
"""Scenelets of the built-in library, and the number of their middle frames that are used."""

POOR: Final = 4.0
"""Factor on the pixel errors of the real detector. Even then the scenelets are rarely in doubt if a
joint is detected in every frame."""

SETTINGS: Final = SampleSettings(steps=30_000, temperatures=4, swap_every=5, burn_in=0.15, draws=31)
"""Settings of each data set's chain. There are 820 steps between draws; the correlation time of the
slowest quantities, camera and sizes, is 300 to 1,000."""


@dataclass(frozen=True)
class Drawn:
    """A scene drawn from the prior, and draws of the posterior for its detections."""

    truth: State
    problem: Problem
    library: Library
    states: tuple[State, ...]


@dataclass(frozen=True)
class Ranked:
    """Result of one data set.

    Parameters
    ----------
    ranks : dict of str to int
        Rank of the true scene among the draws, 0 to L, for each quantity.
    effective : dict of str to float
        Effective number of the L draws, NaN if all draws are equal.
    """

    ranks: dict[str, int]
    effective: dict[str, float]


def short_clip(library: Library, *, every: int, frames: int = FRAMES) -> Experiment:
    """An experiment in which the person stands still in frames without scenelets.

    The place of the person is given, and which joints are detected: those in one of every ``every``
    frames, about as much information as a weight of 1/12 leaves of fourteen joints, or less.

    Parameters
    ----------
    library : Library
        Contains :data:`SCENELETS`.
    every : int
        Frames between detections. With 1 the scenelets are nearly always certain, and chains hardly
        jump.
    frames : int
        Number of frames.
    """
    by_name = {s.name: s for s in library}
    small = Library("short", tuple(_middle(by_name[name], n) for name, n in SCENELETS))
    standing = by_name["stand-idle-001"].joints[8]
    joints = np.repeat(turned(standing, np.pi)[None], frames, 0)
    joints[..., 1] += 4.0
    in_camera = NOMINAL_CAMERA.to_camera(joints)
    pelvis = in_camera[:, PELV]
    seen = np.stack([pelvis[:, 0] / pelvis[:, 1], np.log(pelvis[:, 1])], -1)
    poses = in_camera - pelvis[:, None]
    rng, detections = np.random.default_rng(0), DetectionModel()
    confidences = np.zeros((frames, N_JOINTS))
    for row in confidences[::every]:
        row[rng.choice(DETECTED)] = 0.5
    track = Track(
        "actor", NOMINAL_CAMERA.project(joints), confidences, poses, np.zeros(frames, bool)
    )
    mean = (NOMINAL_CAMERA.pitch, NOMINAL_CAMERA.elevation, 0.0, 0.0, NOMINAL_CAMERA.roll)
    return Experiment(
        Clip("short", NOMINAL_CAMERA, 10.0, np.arange(frames), (track,)),
        StaticPath(
            seen, pelvis[:, 2] / pelvis[:, 1], np.tile([0.03, 0.2], (frames, 1)), poses,
            np.ones(frames, bool),
        ),
        CameraPrior(np.array(mean), np.diag([0.02, 0.06, 0.04, 0.04, 0.015]) ** 2),
        small,
        ModelSettings(
            frame_weight=1.0, smoothness_cost=0.0, motion_cost=0.5, collision_cost=5.0,
            scenelet_rate=0.15, start_bearing=0.03, start_log_depth=0.2,
        ),
        replace(detections, error_scale=POOR * detections.error_scale),
    )  # fmt: skip


def _middle(scenelet: Scenelet, n_frames: int) -> Scenelet:
    """The middle frames of a scenelet, with the same middle frame."""
    first = scenelet.n_frames // 2 - n_frames // 2
    return replace(scenelet, joints=scenelet.joints[first : first + n_frames])


def _solve_given(experiment: Experiment) -> Solution:
    """Result of the staged solver with camera and path given."""
    problem, clip, library = experiment.problem, experiment.clip, experiment.library
    distances = motion_distances(library)
    fits = fit_windows(problem, experiment.path, fps=clip.fps)
    n_frames = problem.n_frames
    frames = FrameTable(
        (PoseSource.OWN,) * n_frames, problem.used.sum(1), np.full(n_frames, np.nan),
        np.zeros(n_frames, bool),
    )  # fmt: skip
    fitted = Fitted(
        experiment.path, frames, experiment.camera, problem, fits,
        charness(library, distances), distances, Settings(model=experiment.settings),
    )  # fmt: skip
    return solve_fitted(clip, library, fitted)


def draw_and_sample(
    experiment: Experiment, seed: int, settings: SampleSettings = SETTINGS
) -> Drawn:
    """Draw a scene and its detections, and sample their posterior with one chain."""
    scene_rng, chain_rng = np.random.default_rng(seed).spawn(2)
    truth = draw_state(scene_rng, experiment.problem)
    solution = _solve_given(experiment.observed(scene_rng, truth))
    chain = run_chain(setup_of(solution, settings), solution.states[:1], chain_rng, _go_on)
    return Drawn(truth, solution.problem, solution.library, chain.states)


def rank_scene(experiment: Experiment, seed: int, settings: SampleSettings = SETTINGS) -> Ranked:
    """Rank a drawn scene among the draws of its posterior."""
    tie_rng = np.random.default_rng(seed).spawn(3)[2]
    found = draw_and_sample(experiment, seed, settings)
    problem, library = found.problem, found.library
    true = describe(problem, library, found.truth)
    drawn = [describe(problem, library, state) for state in found.states]
    ranks, effective = {}, {}
    for name, value in true.items():
        values = np.array([d[name] for d in drawn])
        ranks[name] = rank_among(tie_rng, value, values)
        finite = np.where(np.isfinite(values), values, -1e3)
        effective[name] = float(ess(finite[None])) if np.ptp(finite) > 0 else float("nan")
    return Ranked(ranks, effective)


def _go_on(_part: object = None, /) -> bool:
    """Tell a chain to continue; nothing is reported."""
    return True


def describe(problem: Problem, library: Library, state: State) -> dict[str, float]:
    """Quantities of a scene to be ranked; -inf, a value like any other, where one is undefined."""
    nats = terms(problem, state)
    joints = motion(problem, state)
    pitch, elevation, focal, body, roll = state.camera.tolist()
    camera = NOMINAL_CAMERA.posed(pitch=pitch, roll=roll, elevation=elevation)
    pelvis = camera.to_camera(joints[(0, len(joints) // 2, -1), PELV])
    objects = merged_objects(problem, library, state)
    where = objects[0].centre if objects else np.full(3, -np.inf)
    return {
        "log-posterior": sum(nats.values()),
        "log-likelihood": nats["detections"],
        "collisions and motion": nats["collision"] + nats["motion"] + nats["ground"],
        "pitch": pitch,
        "elevation": elevation,
        "focal length": focal,
        "body": body,
        "roll": roll,
        **_ends("bearing", pelvis[:, 0] / pelvis[:, 1]),
        **_ends("log depth", np.log(np.maximum(pelvis[:, 1], 1e-3))),
        "scenelets": state.n_scenelets,
        "objects": len(objects),
        "a couch": any(o.label == "couch" for o in objects),
        "covered frames": int(problem.lengths[state.items[:, 0]].sum()),
        "first start": state.items[0, 1] if state.n_scenelets else -np.inf,
        "first scenelet": state.items[0, 0] if state.n_scenelets else -np.inf,
        "first size": state.sizes[0] if state.n_scenelets else -np.inf,
        "first yaw": np.cos(state.placements[0, 2] - 1.0) if state.n_scenelets else -np.inf,
        "first object across": where[0],
        "first object along": where[1],
        "a latent number": state.latent[5, 1],
    }


def _ends(name: str, values: Sequence[float] | Array) -> dict[str, float]:
    first, _, last = (float(v) for v in values)
    return {f"first {name}": first, f"last {name}": last}


_SIMULATED: Final = 4000
"""Simulated sets of uniform numbers for a band; a probability of 1 % is accurate to .16 %."""


def rank_among(rng: np.random.Generator, value: float, draws: ArrayLike) -> int:
    """Number of the L draws that a value exceeds; ties are broken at random."""
    draws = np.asarray(draws, float)
    equal = int((draws == value).sum())
    return int((draws < value).sum()) + int(rng.integers(equal + 1))


def spread_ranks(ranks: ArrayLike, *, n_draws: int) -> Array:
    """(N,) ranks 0 to L as numbers in [0, 1), random within their cell: uniform if ranks are.

    Equal ranks give equal numbers.
    """
    ranks = np.asarray(ranks, float)
    numbers: Array = (ranks + np.random.default_rng(0).random(len(ranks))) / (n_draws + 1)
    return numbers


def ecdf_and_band(numbers: Array, *, probability: float = 0.95) -> tuple[Array, ...]:
    """Points (N - 1,), the cumulative fraction at them, and the ends of the simultaneous band.

    Parameters
    ----------
    numbers : (N,) float
        In [0, 1].
    probability : float
        Probability that uniform numbers are inside the band everywhere.
    """
    n = len(numbers)
    at = _places(n)
    shares: Array = compute_ecdf(numbers, at)  # type: ignore[no-untyped-call]
    pointwise = np.quantile(_simulated(n), probability)
    low, high = get_pointwise_confidence_band(pointwise, n, at)  # type: ignore[no-untyped-call]
    return at, shares, low, high


def uniformity(numbers: Array) -> float:
    """P-value of the hypothesis that numbers (N,) in [0, 1] are uniform.

    One minus the probability of the narrowest band that contains their cumulative fraction, but at
    least one over the number of simulated sets.
    """
    wider = _simulated(len(numbers)) >= _narrowest(numbers[None])[0] - 1e-9
    return float((1 + wider.sum()) / (1 + _SIMULATED))


def _places(n: int) -> Array:
    """(n - 1,) points at which cumulative fractions of n numbers are evaluated."""
    return np.arange(1, n) / n


def _narrowest(sets: Array) -> Array:
    """(S,) pointwise probability of the narrowest band that contains each set's fractions (S,
    n)."""
    n = sets.shape[1]
    at = _places(n)
    counts = np.array([np.searchsorted(np.sort(numbers), at, side="right") for numbers in sets])
    tails = np.minimum(binom.cdf(counts, n, at), binom.sf(counts - 1, n, at))
    found: Array = 1 - 2 * tails.min(1)
    return found


@lru_cache(maxsize=16)
def _simulated(n: int) -> Array:
    """(S,) such probabilities of simulated sets of n uniform numbers, with a fixed seed.

    ArviZ 0.8 simulates too, but truncates counts to the next lower integer: for 200 numbers its
    median is .936, not .949.
    """
    found = _narrowest(np.random.default_rng(0).random((_SIMULATED, n)))
    found.setflags(write=False)
    return found


BINS = 16
"""Bins of the histograms: two ranks each."""


@cache
def experiment(every: int) -> Experiment:
    """The experiment from which data are drawn, made once a process."""
    return short_clip(built_in_library(), every=every)


def rank_one(every: int, seed: int, path: Path) -> None:
    """Rank one data set and write the result to a file."""
    ranked = rank_scene(experiment(every), seed)
    with written_whole(path) as beside:
        beside.write_text(json.dumps(asdict(ranked)), encoding="utf-8")


def all_ranks(
    folder: Path, every: int, count: int, workers: int
) -> list[dict[str, dict[str, float]]]:
    """Results of all data sets; those missing from earlier runs are computed."""
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
    """Plot histogram and cumulative fraction of the ranks of all quantities, with 95 % bands."""
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
        at, shares, low, high = ecdf_and_band(spread_ranks(values, n_draws=n_draws))
        cumulative.fill_between(at, low - at, high - at, color="C0", alpha=0.25, step="mid")
        cumulative.plot(at, shares - at, color="black")
        cumulative.axhline(0.0, color="0.6", linewidth=0.5)
    figure.savefig(path, dpi=90)


def main(arguments: Sequence[str] | None = None) -> int:
    """Rank, print and draw; return whether all ranks are uniform enough."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--every", type=int, default=4)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--picture", type=Path)
    options = parser.parse_args(arguments)
    data_sets = all_ranks(options.folder, options.every, options.count, options.workers)
    ranks = {
        name: np.array([one["ranks"][name] for one in data_sets], dtype=np.int64)
        for name in data_sets[0]["ranks"]
    }
    p_values = {
        name: uniformity(spread_ranks(found, n_draws=SETTINGS.draws))
        for name, found in ranks.items()
    }
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
    return int(least <= 0.01)


if __name__ == "__main__":
    sys.exit(main())
