"""How fast are the main parts of the program on this machine?

    python -m lab.speed [--seconds 2] [-o FILE]     (or: make bench)
    python -m lab.speed --solver
    python -m lab.speed --fits DEVICE

The first prints one figure a line and merges them into ``lab/results.json``. They are for one
process and one thread, mostly on the demo's clip. It takes about a minute; compiling missing
kernels takes two more.

The log-posterior, in full and by kind of change, is compared with its bare arithmetic. The
benchmark has 400 frames of 16 joints and 20 cuboids: a person walks round a room once and sits on
five couches. The bare kernel computes only the clearance of all 400 x 16 lines of sight from all 20
cuboids; torch and numpy do the same.

With ``--solver`` a simulated clip of 430 frames is solved twice with 1,500 scenelets. The output is
processor seconds by stage, and whether both runs agree to the last bit. Torch and numba use one
thread, so processor time equals the time on an idle machine. Loading the library and compiling are
not counted. It takes a minute and a half.

With ``--fits`` the fits of all scenelets in all windows of that clip are made on one processor and
on a torch device, such as ``cuda``, each with its own batch size. The output is seconds, and the
differences of placements and costs.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import resource
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from imapper_prob.api import demo_clip
from imapper_prob.config import SampleSettings
from imapper_prob.files import written_whole
from imapper_prob.models.geometry import pack_boxes
from imapper_prob.models.jit import compiled
from imapper_prob.models.kernels.visibility import (
    GAP,
    LINE,
    OCCLUDER,
    SCRATCH32,
    VIEW,
    Singles,
    open_bounds,
    ray_endpoints,
    set_occluder,
    update_clearance,
)
from imapper_prob.models.log_posterior import Incremental, State, empty_state, log_posterior, motion
from imapper_prob.models.path_prior import CameraPrior, StaticPath
from imapper_prob.models.problem import Problem, pack_problem
from imapper_prob.models.scene import Clip, Placement, SceneObject
from imapper_prob.models.scenelet import Library
from imapper_prob.models.settings import NOTHING_IN_SIGHT, OPAQUE
from imapper_prob.models.skeleton import PELV
from imapper_prob.samplers.tempering import POSTERIOR
from imapper_prob.sampling.chain import run_chain
from imapper_prob.sampling.gains import gains_of
from imapper_prob.sampling.learning import learn
from imapper_prob.sampling.sample import setup_of
from imapper_prob.sampling.steps import MOVES, SceneChain, scene_moves
from imapper_prob.sampling.visits import Visits
from imapper_prob.scenelets.build import build_library_from
from imapper_prob.scenelets.captures import Capture
from imapper_prob.scenelets.charness import (
    categories,
    descriptor_distances,
    motion_descriptors,
    object_histograms,
)
from imapper_prob.scenelets.library import load_library
from imapper_prob.scenelets.procedural.catalogue import build_library
from imapper_prob.simulate.clips import NOMINAL_CAMERA, simulate_clip, simulate_track
from imapper_prob.solver.fits import Fits, fit_windows
from imapper_prob.solver.solver import Solution, fit_clip, solve

Array = NDArray[np.float64]

RESULTS = Path(__file__).with_name("results.json")
CUBOIDS = 4
"""Cuboids of a couch: seat, back, two arms."""
STEPS = 200
"""Steps of a chain that is timed: its start takes little time, and the state hardly changes."""
CAMERA_DOUBT = np.array([0.05, 0.1, 0.05, 0.05, 0.02])
"""Standard deviations of pitch (rad), elevation (m), log focal and log body scale."""


@dataclass(frozen=True)
class World:
    """A problem, a state of it, and the boxes of that state."""

    problem: Problem
    state: State
    boxes: Array


def make_world(n_frames: int = 400, n_scenelets: int = 5, seed: int = 3) -> World:
    """A walk round an ellipse of 3 x 2.4 m, sitting down on couches at equal intervals."""
    rng, library, camera = np.random.default_rng(seed), load_library(), NOMINAL_CAMERA
    stand = next(s for s in library if s.name == "walk-000").joints[0]
    turn = np.linspace(0.0, 2.0 * np.pi, n_frames)
    place = np.stack([1.5 * np.sin(turn), 4.0 - 1.2 * np.cos(turn), 0.0 * turn], -1)
    joints = stand - [*stand[PELV, :2], 0.0] + place[:, None]
    track = simulate_track(rng, joints, np.zeros(joints.shape[:2], bool), camera=camera, fps=10.0)
    clip = Clip("round", camera, 10.0, np.arange(n_frames), (track,))
    in_camera = camera.to_camera(joints)
    pelvis = in_camera[:, PELV]
    seen = np.stack([pelvis[:, 0] / pelvis[:, 1], np.log(pelvis[:, 1])], -1)
    path = StaticPath(
        seen, pelvis[:, 2] / pelvis[:, 1], np.tile([0.01, 0.06], (n_frames, 1)),
        in_camera - pelvis[:, None], np.ones(n_frames, bool),
    )  # fmt: skip
    mean = np.array([camera.pitch, camera.elevation, 0.0, 0.0, 0.0])
    problem = pack_problem(clip, path, CameraPrior(mean, np.diag(CAMERA_DOUBT**2)), library)
    state, boxes = _seated(rng, problem, library, place, n_scenelets)
    return World(problem, state, boxes)


def _seated(
    rng: np.random.Generator, problem: Problem, library: Library, place: Array, n_scenelets: int
) -> tuple[State, Array]:
    couches = [
        k
        for k, s in enumerate(library)
        if s.labels == ("couch",) and len(pack_boxes(s.objects)) == CUBOIDS
    ]
    n_frames = len(place)
    objects: list[SceneObject] = []
    state = State(
        np.array(problem.camera_mean), np.empty((0, 2), np.int64), np.empty((0, 3)), np.empty(0),
        rng.standard_normal((n_frames, 2)),
    )  # fmt: skip
    for k in range(n_scenelets):
        scenelet = int(rng.choice(couches))
        length = int(problem.lengths[scenelet])
        start = int((k + 0.5) * n_frames / n_scenelets) - length // 2
        around = Placement(0.0, 0.0, rng.uniform(-np.pi, np.pi))
        x, y = (place[start] - around.apply(library[scenelet].joints[0, PELV]))[:2]
        at = replace(around, x=float(x), y=float(y))
        state = state.with_item(scenelet, start, np.array([at.x, at.y, at.yaw]))
        objects.extend(o.moved(at) for o in library[scenelet].objects)
    return state, pack_boxes(objects)


@compiled
def _bare(elevation: float, joints: Array, occluders: Singles, views: Singles) -> float:
    """Clearance of all lines of sight from all boxes; returns the sum, to prevent elimination."""
    total, n = 0.0, len(joints)
    lines, bench = np.empty((n, LINE), np.float32), np.empty(SCRATCH32, np.float32)
    for t in range(n):
        ray_endpoints(elevation, joints, lines, t)
        open_bounds(bench)
        update_clearance(occluders, 0, len(occluders), lines, views, t, bench)
        for j in range(16):
            total += bench[GAP + j]
    return total


def bare_kernel(world: World) -> Callable[[], object]:
    """The compiled arithmetic without pruning: every box is tested."""
    joints = np.ascontiguousarray(motion(world.problem, world.state).transpose(0, 2, 1))
    elevation = float(world.state.camera[1])
    occluders = np.zeros((len(world.boxes), OCCLUDER), np.float32)
    turns = np.stack([np.cos(world.boxes[:, 6]), np.sin(world.boxes[:, 6])], -1)
    for box, turn, outlook in zip(world.boxes, turns, occluders, strict=True):
        set_occluder(elevation, box, turn, outlook)
    occluders[:, :VIEW] = [-np.inf, np.inf, -np.inf, np.inf, -np.inf]
    everywhere = [-np.inf, np.inf, -np.inf, np.inf, np.inf]
    views = np.tile(np.array(everywhere, np.float32), (len(joints), 1))
    return lambda: _bare(elevation, joints, occluders, views)


def numpy_kernel(world: World) -> Callable[[], object]:
    """The same computation in numpy."""
    joints, elevation = motion(world.problem, world.state), float(world.state.camera[1])
    return lambda: _by_numpy(np.array([0.0, 0.0, elevation]), joints, world.boxes)


def _by_numpy(origin: Array, points: Array, boxes: Array) -> Array:
    """Clearance (...) of the lines of sight to points (..., 3) from boxes (K, 7).

    The minimum over s of the maximum of six lines is the greatest value at a crossing of a rising
    and a falling line.
    """
    clearance = np.full(points.shape[:-1], NOTHING_IN_SIGHT)
    for x, y, z, *half, yaw in np.asarray(boxes, float).reshape(-1, 7):
        c, s = np.cos(yaw), np.sin(yaw)
        into_box = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        start = into_box @ (origin - (x, y, z))
        slope = (points - origin) @ into_box.T
        h = np.asarray(half)
        # Six lines, value(s) = a s + b, of which three rise and three fall (or are level).
        rise, fall = np.abs(slope), -np.abs(slope)
        sign = np.where(slope >= 0, 1.0, -1.0)
        rise_at_0, fall_at_0 = sign * start - h, -sign * start - h
        a_up, b_up = rise[..., :, None], rise_at_0[..., :, None]
        a_down, b_down = fall[..., None, :], fall_at_0[..., None, :]
        gap = np.maximum(a_up - a_down, 1e-12)
        meet = (b_down - b_up) / gap
        value = b_up + a_up * meet
        flat = value.reshape(*value.shape[:-2], 9)
        best = flat.argmax(-1)[..., None]
        lowest = np.take_along_axis(flat, best, -1)[..., 0]
        where = np.take_along_axis(meet.reshape(flat.shape), best, -1)[..., 0]
        at_0 = np.broadcast_to((np.abs(start) - h).max(), lowest.shape)
        at_1 = (np.abs(start + slope) - h).max(-1)
        lowest = np.where(where <= 0, at_0, np.where(where >= 1, at_1, lowest))
        depth = lowest * max(1.0, OPAQUE / h.min())
        clearance = np.minimum(clearance, np.where(lowest < 0, depth, lowest))
    return clearance


def torch_kernel(world: World) -> Callable[[], object]:
    """The same computation in torch, eager, on one thread, for all boxes at once."""
    import torch

    joints = torch.tensor(motion(world.problem, world.state).reshape(-1, 3))
    boxes, elevation = torch.tensor(world.boxes), float(world.state.camera[1])

    def clearance() -> torch.Tensor:
        c, s = torch.cos(boxes[:, 6]), torch.sin(boxes[:, 6])
        half = boxes[:, 3:6]
        x, y, z = -boxes[:, 0], -boxes[:, 1], elevation - boxes[:, 2]
        start = torch.stack([c * x + s * y, c * y - s * x, z], -1)
        u, v, w = joints[:, None, 0], joints[:, None, 1], joints[:, None, 2] - elevation
        slope = torch.stack([c * u + s * v, c * v - s * u, w.expand(-1, len(boxes))], -1)
        size = slope.abs().clamp_min(1e-15)
        value = ((start + 0.5 * slope).abs() - 0.5 * size - half).amax(-1)
        for i, k in ((0, 1), (0, 2), (1, 2)):
            across = (start[:, i] * slope[..., k] - start[:, k] * slope[..., i]).abs()
            reach = size[..., k] * half[:, i] + size[..., i] * half[:, k]
            value = torch.maximum(value, (across - reach) / (size[..., i] + size[..., k]))
        thinnest = half.amin(-1)
        value = torch.maximum(value, -thinnest)
        value = torch.minimum(value, value * (OPAQUE / thinnest).clamp_min(1.0))
        return value.amin(-1).clamp_max(NOTHING_IN_SIGHT)

    return clearance


def walks(rng: np.random.Generator, world: World, n: int) -> list[State]:
    """Proposals that move one scenelet slightly."""
    state, proposals = world.state, []
    for _ in range(n):
        index = int(rng.integers(state.n_scenelets))
        step = rng.normal(0.0, [0.03, 0.1, 0.1])
        proposals.append(state.with_placement(index, state.placements[index] + step))
    return proposals


def births_and_deaths(rng: np.random.Generator, world: World, n: int) -> list[State]:
    """Proposals with one scenelet less, or one more in the longest free interval."""
    state, proposals = world.state, []
    for k in range(n):
        index = int(rng.integers(state.n_scenelets))
        if k % 2:
            proposals.append(state.without_item(index))
        else:
            scenelet, start = (int(v) for v in state.items[index])
            start += int(world.problem.lengths[scenelet]) + 15
            proposals.append(state.with_item(scenelet, start, state.placements[index]))
    return proposals


def refreshes(rng: np.random.Generator, world: World, n: int) -> list[State]:
    """Proposals that redraw sixty frames of the path."""
    state, proposals = world.state, []
    for _ in range(n):
        latent = state.latent.copy()
        first = int(rng.integers(-59, len(latent)))
        window = latent[max(first, 0) : first + 60]
        window[:] = rng.standard_normal(window.shape)
        proposals.append(replace(state, latent=latent))
    return proposals


def cameras(rng: np.random.Generator, world: World, n: int) -> list[State]:
    """Proposals with another camera and body, which change everything."""
    step = 0.4 * CAMERA_DOUBT
    state = world.state
    return [replace(state, camera=state.camera + rng.normal(0.0, step)) for _ in range(n)]


def mixed(rng: np.random.Generator, world: World, n: int) -> list[State]:
    """Proposals in about the sampler's proportions."""
    kinds = (births_and_deaths, walks, refreshes, cameras)
    shares = (0.54, 0.28, 0.08, 0.10)
    pools = [kind(rng, world, n) for kind in kinds]
    return [pools[int(rng.choice(len(kinds), p=shares))][k] for k in range(n)]


def per_second(action: Callable[[], object], *, count: int = 1, seconds: float) -> float:
    """Greatest rate a second of the ``count`` things that a call does.

    The fastest of many short runs is taken, because other work on the machine only adds time.
    """
    action()
    best, until = np.inf, time.perf_counter() + seconds
    while time.perf_counter() < until:
        start = time.perf_counter()
        action()
        best = min(best, time.perf_counter() - start)
    return count / best


def moves_per_second(world: World, proposals: Sequence[State], *, seconds: float) -> float:
    """Proposals a second from one state; one in four is accepted and reverted."""
    evaluator, home = Incremental(world.problem, world.state), world.state

    def run() -> None:
        for k, state in enumerate(proposals):
            evaluator.propose(state)
            if k % 8 == 0:
                evaluator.accept()
                evaluator.propose(home)
                evaluator.accept()

    done = len(proposals) + 1 + (len(proposals) - 1) // 8
    return per_second(run, count=done, seconds=seconds)


def evaluation_figures(seconds: float) -> dict[str, float]:
    """Evaluations and moves a second for 400 frames and 20 cuboids, each timed for ``seconds``."""
    world, rng = make_world(), np.random.default_rng(0)
    rate = partial(per_second, seconds=seconds)
    moves = partial(moves_per_second, world, seconds=seconds)
    full = rate(lambda: log_posterior(world.problem, world.state))
    bare = rate(bare_kernel(world))
    return {
        "full_evaluations_per_second": full,
        "incremental_moves_per_second": moves(mixed(rng, world, 32)),
        "incremental_walks_per_second": moves(walks(rng, world, 16)),
        "incremental_births_and_deaths_per_second": moves(births_and_deaths(rng, world, 16)),
        "incremental_path_refreshes_per_second": moves(refreshes(rng, world, 16)),
        "incremental_cameras_per_second": moves(cameras(rng, world, 16)),
        "bare_kernel_evaluations_per_second": bare,
        "full_evaluation_over_bare_kernel": bare / full,
        "torch_eager_evaluations_per_second": rate(torch_kernel(world)),
        "numpy_evaluations_per_second": rate(numpy_kernel(world)),
        **step_figures(world, seconds),
    }


def step_figures(world: World, seconds: float) -> dict[str, float]:
    """Steps of a chain a second, and microseconds of a step by move, each timed for ``seconds``."""
    problem, n = world.problem, len(world.problem.lengths)
    alike = (np.ones((n, n)) - np.eye(n)) / (n - 1)
    visits = Visits()
    visits.note(world.state)
    reference = learn(problem, gains_of(problem), alike, visits)
    moves = scene_moves(problem, reference, np.diag(0.1 * CAMERA_DOUBT))

    def steps(weights: Array) -> float:
        """The fastest of short chains from the same state, which they hardly leave."""
        rng, best, until = np.random.default_rng(0), np.inf, time.perf_counter() + seconds
        while time.perf_counter() < until:
            chain = SceneChain(problem, moves._replace(weights=weights), world.state)
            start = time.perf_counter()
            chain.advance(rng, POSTERIOR, STEPS)
            best = min(best, time.perf_counter() - start)
        return STEPS / best

    one = np.eye(len(MOVES))
    steps(moves.weights)  # compiles missing kernels
    return {"steps_per_second": steps(moves.weights)} | {
        f"step_microseconds_{name}": 1e6 / steps(one[k]) for k, name in enumerate(MOVES)
    }


def best_of_three(action: Callable[[], object]) -> float:
    """Duration of ``action`` in seconds, the best of three."""
    times = []
    for _ in range(3):
        start = time.perf_counter()
        action()
        times.append(time.perf_counter() - start)
    return min(times)


def library_figures() -> dict[str, float]:
    """Times for building a library, cutting one from captures, describing and searching it."""
    library = load_library()
    motions = [s.joints for s in library]
    known = motion_descriptors(motions)
    few, many = (pacing(minutes) for minutes in (5, 10))
    cut = [len(build_library_from([c], name="bench")[0]) for c in (few, many)]
    half = len(motions) // 2
    return {
        "library_scenelets": len(library),
        "library_build_seconds": best_of_three(lambda: build_library(0)),
        "descriptors_seconds": best_of_three(lambda: motion_descriptors(motions)),
        "descriptors_seconds_of_half": best_of_three(lambda: motion_descriptors(motions[:half])),
        "object_histograms_seconds": best_of_three(
            lambda: object_histograms(library.scenelets, categories(library))
        ),
        "nearest_motions_per_second": len(known)
        / best_of_three(lambda: descriptor_distances(known, known).argmin(1)),
        "capture_scenelets": cut[1],
        "capture_build_seconds": best_of_three(lambda: build_library_from([many], name="bench")),
        "capture_scenelets_of_half": cut[0],
        "capture_build_seconds_of_half": best_of_three(
            lambda: build_library_from([few], name="bench")
        ),
    }


def pacing(minutes: float) -> Capture:
    """A capture of walking back and forth in front of a couch, from the library's own motions."""
    library = load_library()
    walk = next(s for s in library if s.name == "walk-000")
    couch = next(s for s in library if s.labels == ("couch",)).objects[0]
    step = walk.joints[-1] - walk.joints[-2]
    way = np.concatenate([walk.joints, walk.joints[::-1] + 0.1 * step])
    times = int(minutes * 60 * walk.fps) // len(way)
    return Capture("pacing", "room", np.tile(way, (times, 1, 1)), (couch,), walk.fps)


def demo_figures(seconds: float) -> dict[str, float]:
    """Times of solver, log-posterior and chain on the demo's clip."""
    clip, library = demo_clip(), load_library()
    solve(clip, library)  # compiles the kernels
    start = time.perf_counter()
    solution = solve(clip, library)
    solving = time.perf_counter() - start
    problem, best = solution.problem, solution.states[0]
    rate = partial(per_second, seconds=seconds)
    return {
        "demo_frames": clip.n_frames,
        "demo_boxes_of_best_scene": int(np.diff(problem.box_first)[best.items[:, 0]].sum()),
        "demo_solve_seconds": solving,
        "demo_full_evaluations_per_second": rate(lambda: log_posterior(problem, best)),
        "demo_empty_evaluations_per_second": rate(
            lambda: log_posterior(problem, empty_state(problem))
        ),
        "demo_chain_steps_per_second": steps_per_second(solution, round(2000 * seconds)),
    }


def steps_per_second(solution: Solution, steps: int) -> float:
    """Steps a second of a chain at one temperature, with kernels compiled."""
    settings = SampleSettings(steps=steps, draws=min(100, steps // 10), temperatures=1)
    setup = setup_of(solution, settings)
    brief = replace(setup, settings=replace(settings, steps=100, draws=10))
    run_chain(brief, solution.states[:1], np.random.default_rng(0), _go_on)
    start = time.perf_counter()
    run_chain(setup, solution.states[:1], np.random.default_rng(0), _go_on)
    return steps / (time.perf_counter() - start)


def _go_on(_part: object = None, /) -> bool:
    """Tell a chain to continue; nothing is reported."""
    return True


FRAMES, SCENELETS, INTERACTIONS = 430, 1500, 5
AIM = 60.0
"""Target in seconds."""
SAME = 0.001
"""Nats a confident joint within which two fits count as equal; other minima differ by more."""


def workload() -> tuple[Clip, Library]:
    """A clip of five interactions, and scenelets sampled evenly from the built-in library."""
    everything = load_library()
    kept = np.linspace(0, len(everything) - 1, SCENELETS).round().astype(int)
    library = Library("1500", tuple(everything[int(k)] for k in kept))
    clip = simulate_clip(
        np.random.default_rng(0), library, n_frames=FRAMES, n_interactions=INTERACTIONS
    )
    return clip, library


def timed(clip: Clip, library: Library) -> tuple[Solution, dict[str, float]]:
    """The solution, and processor seconds by stage."""
    seconds: dict[str, float] = {}
    last = time.process_time()

    def report(stage: str, part: float) -> None:
        nonlocal last
        now = time.process_time()
        seconds[stage] = seconds.get(stage, 0.0) + now - last
        last = now

    solution = solve(clip, library, progress=report)
    return solution, seconds


def digest(solution: Solution) -> str:
    """Digest of everything in which runs could differ."""
    state = hashlib.sha256()
    fits, found = solution.fits, solution.combinations
    arrays: list[NDArray[Any]] = [
        fits.placements,
        fits.cost,
        solution.curve.values,
        solution.path.estimate,
    ]
    arrays += [c.placement for c in solution.candidates]
    arrays += [a for s in solution.states for a in (s.items, s.placements)]
    for array in arrays:
        state.update(np.ascontiguousarray(array).tobytes())
    state.update(repr([(t.members, t.gain) for t in found.tried]).encode())
    return state.hexdigest()


def print_solver() -> None:
    """Print the table of stages, and whether both runs agree."""
    torch.set_num_threads(1)
    clip, library = workload()
    warm = solve(clip, Library("few", tuple(library)[::60]))
    log_posterior(warm.problem, empty_state(warm.problem))
    runs = [timed(clip, library) for _ in range(2)]
    table = Table(
        title=f"{clip.n_frames} frames, {len(library)} scenelets: processor seconds",
        title_justify="left",
    )
    for name in ("stage", "first run", "second run"):
        table.add_column(name, justify="left" if name == "stage" else "right")
    for stage in runs[0][1]:
        table.add_row(stage, *(f"{seconds[stage]:.2f}" for _, seconds in runs))
    table.add_row("all", *(f"{sum(seconds.values()):.2f}" for _, seconds in runs))
    console = Console()
    console.print(table)
    worst = max(sum(seconds.values()) for _, seconds in runs)
    console.print(f"Aim: {AIM:.0f} s; {'met' if worst <= AIM else 'missed'}.")
    same = digest(runs[0][0]) == digest(runs[1][0])
    console.print(f"Both runs agree to the last bit: {'yes' if same else 'no'}.")


def print_fits(device: str) -> None:
    """Print seconds of the fits on a processor and on a device, and their differences."""
    clip, library = workload()
    few = fit_clip(clip, Library("few", tuple(library)[::60]))
    found = fit_clip(clip, library)

    def fits(problem: Problem, where: str) -> Fits:
        return fit_windows(problem, found.path, fps=clip.fps, device=where)

    seconds, made = {}, {}
    for where in ("cpu", device):
        fits(few.problem, where)
        start = time.perf_counter()
        made[where] = fits(found.problem, where)
        seconds[where] = time.perf_counter() - start
    here, there = made["cpu"], made[device]
    fitted = np.isfinite(here.cost)
    same = np.abs(here.cost[fitted] - there.cost[fitted]) < SAME
    apart = np.abs(here.placements[fitted] - there.placements[fitted])[same].max()
    share = same.mean()
    windows, scenelets = here.cost.shape
    sys.stdout.write(
        f"{windows} windows, {scenelets} scenelets: cpu {seconds['cpu']:.2f} s, "
        f"{device} {seconds[device]:.2f} s\n"
        f"costs agree within {SAME} nats in {share:.4f} of the fits, "
        f"whose placements differ by {apart:.2g} m or rad at most\n"
    )


def note(figures: dict[str, float], path: Path) -> None:
    """Print figures, and add them to the file of results."""
    figures = {name: float(f"{value:.4g}") for name, value in figures.items()}
    width = max(map(len, figures))
    sys.stdout.writelines(f"{name:<{width}}  {value:>10g}\n" for name, value in figures.items())
    known = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    with written_whole(path) as beside:
        beside.write_text(json.dumps(known | figures, indent=1) + "\n", encoding="utf-8")


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--seconds", type=float, default=2.0, help="each thing is timed, 2 if not given"
    )
    parser.add_argument("--solver", action="store_true", help="the solver's stages instead")
    parser.add_argument("--fits", metavar="DEVICE", help="the fits on a device of torch instead")
    parser.add_argument("-o", "--output", type=Path, default=RESULTS, help="file of all figures")
    options = parser.parse_args(arguments)
    if options.solver:
        print_solver()
        return
    if options.fits is not None:
        print_fits(options.fits)
        return
    figures = {
        **demo_figures(options.seconds),
        **library_figures(),
        **evaluation_figures(options.seconds),
        "peak_memory_mib": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }
    note(figures, options.output)


if __name__ == "__main__":
    main()
