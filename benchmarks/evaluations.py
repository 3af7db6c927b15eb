"""Speed of the log-posterior, full and by what changed, beside the bare arithmetic in it.

The yardstick is 400 frames of 16 joints and 20 cuboids: somebody goes round a room once and
sits on five couches. The bare kernel computes the clearance of all 400 x 16 lines of sight
from all 20 cuboids and nothing else; torch and numpy do the same.

    python -m benchmarks.evaluations

prints the figures and draws ``docs/evaluation_cost.png``.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from imapper_prob.models.geometry import NOTHING_IN_SIGHT, OPAQUE, pack_boxes, sight_clearance
from imapper_prob.models.incremental import Incremental
from imapper_prob.models.jit import compiled
from imapper_prob.models.kernels.sight import (
    BENCH,
    GAP,
    LINE,
    OUTLOOK,
    VIEW,
    Singles,
    aim,
    clear,
    open_view,
    set_outlook,
)
from imapper_prob.models.path import CameraPrior, StaticPath
from imapper_prob.models.posterior import State, log_posterior, motion
from imapper_prob.models.problem import Problem, pack_problem
from imapper_prob.models.scene import Clip, Placement
from imapper_prob.models.scenelet import Library
from imapper_prob.models.simulate import NOMINAL_CAMERA
from imapper_prob.models.simulate_track import simulate_track
from imapper_prob.models.skeleton import PELV
from imapper_prob.scenelets.library import load_library

__all__ = ["draw", "figures", "scaling"]

Array = NDArray[np.float64]

CUBOIDS = 4
"""Of a couch: seat, back, two arms."""
SECONDS = 2.0
"""How long each thing is timed."""
CAMERA_DOUBT = np.array([0.05, 0.1, 0.05, 0.05, 0.02])
"""Standard deviations of pitch (rad), elevation (m), log focal and log body scale."""


@dataclass(frozen=True)
class World:
    """A problem, a state of it, and the state's boxes."""

    problem: Problem
    state: State
    boxes: Array


def make_world(n_frames: int = 400, n_scenelets: int = 5, seed: int = 3) -> World:
    """Once round an ellipse of 3 x 2.4 m, sitting down on couches at equal intervals."""
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
    n_frames, objects = len(place), []
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
def _bare(elevation: float, joints: Array, outlooks: Singles, views: Singles) -> float:
    """Clearance of all lines of sight from all boxes; returns their sum, so that none is idle."""
    total, n = 0.0, len(joints)
    lines, bench = np.empty((n, LINE), np.float32), np.empty(BENCH, np.float32)
    for t in range(n):
        aim(elevation, joints, lines, t)
        open_view(bench)
        clear(outlooks, 0, len(outlooks), lines, views, t, bench)
        for j in range(16):
            total += bench[GAP + j]
    return total


def bare_kernel(world: World) -> Callable[[], object]:
    """The compiled arithmetic without pruning: every box counts as in sight."""
    joints = np.ascontiguousarray(motion(world.problem, world.state).transpose(0, 2, 1))
    elevation = float(world.state.camera[1])
    outlooks = np.zeros((len(world.boxes), OUTLOOK), np.float32)
    turns = np.stack([np.cos(world.boxes[:, 6]), np.sin(world.boxes[:, 6])], -1)
    for box, turn, outlook in zip(world.boxes, turns, outlooks, strict=True):
        set_outlook(elevation, box, turn, outlook)
    outlooks[:, :VIEW] = [-np.inf, np.inf, -np.inf, np.inf, -np.inf]
    everywhere = [-np.inf, np.inf, -np.inf, np.inf, np.inf]
    views = np.tile(np.array(everywhere, np.float32), (len(joints), 1))
    return lambda: _bare(elevation, joints, outlooks, views)


def numpy_kernel(world: World) -> Callable[[], object]:
    """The same in numpy."""
    joints, elevation = motion(world.problem, world.state), float(world.state.camera[1])
    return lambda: sight_clearance([0.0, 0.0, elevation], joints, world.boxes)


def torch_kernel(world: World) -> Callable[[], object]:
    """The same in torch, eager, one thread, all boxes at once."""
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
    """One scenelet placed a little elsewhere."""
    state, proposals = world.state, []
    for _ in range(n):
        index = int(rng.integers(state.n_scenelets))
        step = rng.normal(0.0, [0.03, 0.1, 0.1])
        proposals.append(state.with_placement(index, state.placements[index] + step))
    return proposals


def births_and_deaths(rng: np.random.Generator, world: World, n: int) -> list[State]:
    """One scenelet less, or one more in the longest stretch that is free."""
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
    """Sixty frames of the path drawn again."""
    state, proposals = world.state, []
    for _ in range(n):
        latent = state.latent.copy()
        first = int(rng.integers(-59, len(latent)))
        window = latent[max(first, 0) : first + 60]
        window[:] = rng.standard_normal(window.shape)
        proposals.append(replace(state, latent=latent))
    return proposals


def cameras(rng: np.random.Generator, world: World, n: int) -> list[State]:
    """Another camera and body: everything changes."""
    step = 0.4 * CAMERA_DOUBT
    state = world.state
    return [replace(state, camera=state.camera + rng.normal(0.0, step)) for _ in range(n)]


def mixed(rng: np.random.Generator, world: World, n: int) -> list[State]:
    """About as often as the sampler tries them."""
    kinds = (births_and_deaths, walks, refreshes, cameras)
    shares = (0.54, 0.28, 0.08, 0.10)
    pools = [kind(rng, world, n) for kind in kinds]
    return [pools[int(rng.choice(len(kinds), p=shares))][k] for k in range(n)]


def per_second(action: Callable[[], object], *, count: int = 1, seconds: float = SECONDS) -> float:
    """How many of ``count`` things a call does are done in a second, at its quickest.

    The quickest of many short runs: other work on the machine only ever adds time.
    """
    action()
    best, until = np.inf, time.perf_counter() + seconds
    while time.perf_counter() < until:
        start = time.perf_counter()
        action()
        best = min(best, time.perf_counter() - start)
    return count / best


def moves_per_second(
    world: World, proposals: Sequence[State], *, seconds: float = SECONDS
) -> float:
    """Proposals from one state, of which one in four is accepted and taken back."""
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


def figures() -> dict[str, float]:
    """Evaluations and moves a second at 400 frames and 20 cuboids."""
    world, rng = make_world(), np.random.default_rng(0)
    full = per_second(lambda: log_posterior(world.problem, world.state))
    bare = per_second(bare_kernel(world))
    return {
        "full_evaluations_per_second": full,
        "incremental_moves_per_second": moves_per_second(world, mixed(rng, world, 32)),
        "incremental_walks_per_second": moves_per_second(world, walks(rng, world, 16)),
        "incremental_births_and_deaths_per_second": moves_per_second(
            world, births_and_deaths(rng, world, 16)
        ),
        "incremental_path_refreshes_per_second": moves_per_second(world, refreshes(rng, world, 16)),
        "incremental_cameras_per_second": moves_per_second(world, cameras(rng, world, 16)),
        "bare_kernel_evaluations_per_second": bare,
        "full_evaluation_over_bare_kernel": bare / full,
        "torch_eager_evaluations_per_second": per_second(torch_kernel(world)),
        "numpy_evaluations_per_second": per_second(numpy_kernel(world)),
    }


def scaling() -> dict[str, dict[int, tuple[float, float]]]:
    """Microseconds of a full evaluation and of a walk, by frames and by cuboids.

    The mean of five rooms each: what stands in whose way is not the same in all.
    """

    def cost(n_frames: int, n_scenelets: int) -> tuple[float, float]:
        pairs = []
        for seed in range(5):
            world = make_world(n_frames, n_scenelets, seed)
            problem, state, rng = world.problem, world.state, np.random.default_rng(seed)
            full = per_second(lambda p=problem, s=state: log_posterior(p, s), seconds=0.4)
            walk = moves_per_second(world, walks(rng, world, 16), seconds=0.4)
            pairs.append((1e6 / full, 1e6 / walk))
        full, walk = np.mean(pairs, 0)
        return float(full), float(walk)

    return {
        "frames, 20 cuboids": {n: cost(n, 5) for n in (100, 200, 300, 400, 600, 800)},
        "cuboids, 400 frames": {CUBOIDS * k: cost(400, k) for k in (1, 2, 3, 5, 7, 10)},
    }


def draw(costs: dict[str, dict[int, tuple[float, float]]]) -> Figure:
    """What an evaluation costs, beside the straight line that fits it best."""
    figure = Figure(figsize=(8.0, 3.2), layout="constrained")
    for axes, (what, row) in zip(figure.subplots(1, 2, sharey=True), costs.items(), strict=True):
        sizes = np.array(list(row))
        for k, (name, colour) in enumerate((("full", "#4e79a7"), ("a scenelet moved", "#f28e2b"))):
            microseconds = np.array([pair[k] for pair in row.values()])
            line = np.polynomial.Polynomial.fit(sizes, microseconds, 1)
            axes.plot(sizes, line(sizes), color=colour, linewidth=1)
            axes.plot(sizes, microseconds, "o", color=colour, label=name)
        axes.set(xlabel=what, xlim=(0, None), ylim=(0, None))
        axes.spines[["top", "right"]].set_visible(False)
    figure.axes[0].set_ylabel("microseconds an evaluation")
    figure.axes[0].legend(frameon=False)
    return figure


if __name__ == "__main__":
    for name, value in figures().items():
        sys.stdout.write(f"{name:<42}{value:>12.4g}\n")
    costs = scaling()
    for what, row in costs.items():
        cells = "  ".join(f"{n}: {full:.0f}, {walk:.0f} us" for n, (full, walk) in row.items())
        sys.stdout.write(f"{what:<20}{cells}\n")
    draw(costs).savefig(Path(__file__).parents[1] / "docs" / "evaluation_cost.png", dpi=120)
