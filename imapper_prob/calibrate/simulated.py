"""Simulation-based calibration of scenes: is the posterior that chains find the posterior?

A scene is drawn from the prior, detections of it, and the chains of
:mod:`imapper_prob.sampling` are run on these as on any clip: fits and a start by the staged
solver, all moves, all temperatures. If model, moves and solver are right, and chains long enough,
the true scene is among their draws like one of them (Talts et al. 2018), in everything one
asks about it. What is known beforehand differs from a real clip's in four points, without
which the posterior is not that of any model of data (``docs/calibration_ranks.md``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.config import SampleSettings
from imapper_prob.models.energy.detections import DetectionModel
from imapper_prob.models.path import CameraPrior, StaticPath
from imapper_prob.models.pose import turned
from imapper_prob.models.posterior import State, motion, terms
from imapper_prob.models.problem import Problem
from imapper_prob.models.scene import Clip, Track
from imapper_prob.models.scenelet import Library, Scenelet
from imapper_prob.models.settings import ModelSettings
from imapper_prob.models.simulate import NOMINAL_CAMERA
from imapper_prob.models.simulate_detections import Experiment
from imapper_prob.models.simulate_state import draw_state
from imapper_prob.models.skeleton import DETECTED, N_JOINTS, PELV
from imapper_prob.samplers.diagnostics import ess
from imapper_prob.samplers.ranks import rank_among
from imapper_prob.sampling.chain import run_chain
from imapper_prob.sampling.layouts import merged_objects
from imapper_prob.sampling.sample import setup_of
from imapper_prob.scenelets.charness import charness, motion_distances
from imapper_prob.staged.fit import fit_windows
from imapper_prob.staged.frames import FrameTable
from imapper_prob.staged.solver import Fitted, Solution, solve_fitted

__all__ = [
    "SETTINGS", "Drawn", "Ranked", "describe", "draw_and_sample", "rank_scene", "short_clip",
    "solve_given",
]  # fmt: skip

Array = NDArray[np.float64]

FRAMES: Final = 24
"""Of the clip, at 10 a second: room for two scenelets, and for three short ones now and then."""

SCENELETS: Final = (
    ("sit-couch-000", 8), ("sit-chair-000", 8), ("sit-couch-001", 12), ("stand-table-000", 8),
    ("reach-shelf-000", 12), ("stand-idle-000", 8),
)  # fmt: skip
"""Of the built-in library, and how many of their middle frames."""

POOR: Final = 4.0
"""Times the pixel errors of the real detector, which even so seldom leave a doubt which scenelets
there are, if a joint is seen in every frame."""

SETTINGS: Final = SampleSettings(
    steps=30_000, temperatures=2, hottest=0.2, swap_every=5, burn_in=0.15, draws=31
)
"""Of each data set's chain. 820 steps lie between two draws; what is slowest, camera and sizes,
forgets itself in 300 to 1,000."""


@dataclass(frozen=True)
class Drawn:
    """A scene drawn from the prior, and draws of the posterior of what was detected of it."""

    truth: State
    problem: Problem
    library: Library
    states: tuple[State, ...]


@dataclass(frozen=True)
class Ranked:
    """What one data set says.

    Parameters
    ----------
    ranks : dict of str to int
        Of the true scene among the draws, 0 to L, for all that was asked.
    effective : dict of str to float
        Effective draws of L, NaN where all draws say the same.
    """

    ranks: dict[str, int]
    effective: dict[str, float]


def short_clip(library: Library, *, every: int, frames: int = FRAMES) -> Experiment:
    """Somebody stands there, if nothing else is drawn.

    Where they stand is given, and which joints the detector reports: one in every so many frames,
    about what a weight of 1/12 leaves of fourteen joints, or less.

    Parameters
    ----------
    library : Library
        Holds :data:`SCENELETS`.
    every : int
        Frames from one detection to the next. With 1 it is nearly always clear which scenelets
        there are, and chains hardly jump; with 4 they jump once in thirty births.
    frames : int
        How long it is.
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
    """A scenelet's middle frames, its middle one kept in the middle."""
    first = scenelet.n_frames // 2 - n_frames // 2
    return replace(scenelet, joints=scenelet.joints[first : first + n_frames])


def solve_given(experiment: Experiment) -> Solution:
    """The staged solver, camera and path being given."""
    problem, clip, library = experiment.problem, experiment.clip, experiment.library
    distances = motion_distances(library)
    fits = fit_windows(problem, experiment.path, fps=clip.fps)
    frames = FrameTable.unexamined(problem.used.sum(1))
    fitted = Fitted(
        experiment.path, frames, experiment.camera, problem, fits,
        charness(library, distances), distances,
    )  # fmt: skip
    return solve_fitted(clip, library, fitted)


def draw_and_sample(
    experiment: Experiment, seed: int, settings: SampleSettings = SETTINGS
) -> Drawn:
    """Draw a scene and its detections, and sample their posterior with one chain."""
    scene_rng, chain_rng = np.random.default_rng(seed).spawn(2)
    truth = draw_state(scene_rng, experiment.problem)
    solution = solve_given(experiment.observed(scene_rng, truth))
    chain = run_chain(setup_of(solution, settings), solution.states[:1], chain_rng, _go_on)
    return Drawn(truth, solution.problem, solution.library, chain.states)


def rank_scene(experiment: Experiment, seed: int, settings: SampleSettings = SETTINGS) -> Ranked:
    """Rank a scene that was drawn among the draws of its posterior."""
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
    """To a chain's report: nobody looks, nobody interrupts."""
    return True


def describe(problem: Problem, library: Library, state: State) -> dict[str, float]:
    """What is asked about a scene; -inf where it has no such thing, which is a value like any."""
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
