"""The catalogue: which interactions the built-in library holds, and how each is drawn.

Actions are ``walk``, ``stand``, ``sit``, ``sit-down``, ``stand-up`` and ``reach``. Every
recipe draws one motion with its furniture; every second scenelet is the mirror image of the
one before, so that nothing in the library is more left- than right-handed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.scene import Placement, SceneObject
from imapper_prob.models.scenelet import Library, Scenelet
from imapper_prob.scenelets.frames import localised, mirrored
from imapper_prob.scenelets.procedural import furniture
from imapper_prob.scenelets.procedural.body import pose_body
from imapper_prob.scenelets.procedural.gait import arc, walk_along
from imapper_prob.scenelets.procedural.sitting import at_desk, draw_seated, sit_down, sit_still
from imapper_prob.scenelets.procedural.standing import reach_and_hold, stand_idle

__all__ = ["CATALOGUE", "FRAMES_PER_SECOND", "Entry", "build_library"]

Array = NDArray[np.float64]

FRAMES_PER_SECOND: Final = 10.0
"""Of i3DB, and fast enough for everything people do in a room."""

FACING_BACK: Final = float(np.pi)


class Drawn(NamedTuple):
    """One motion (n, 16, 3) in metres and its furniture, in a common frame."""

    joints: Array
    objects: tuple[SceneObject, ...]


def _times(rng: np.random.Generator, fewest: int, most: int) -> Array:
    return np.arange(int(rng.integers(fewest, most + 1))) / FRAMES_PER_SECOND


def walk(rng: np.random.Generator) -> Drawn:
    """About a metre or two of walking, straight or in a curve."""
    speed = rng.uniform(0.55, 1.25)
    curvature = rng.choice([0.0, rng.uniform(0.2, 1.3)])
    # Steps quicken as walking does: 85 a minute at .55 m/s, 115 at 1.25 m/s.
    step_time = 60 / (62 + 42 * speed)
    times = _times(rng, 15, 20)
    moving = walk_along(
        arc(speed, curvature),
        times,
        step_time=step_time,
        phase=rng.uniform(0, 2 * step_time),
        lean=rng.uniform(0.02, 0.08),
        half_width=rng.uniform(0.06, 0.10),
        vigour=rng.uniform(0.5, 1.3),
    )
    return Drawn(pose_body(moving.trunk, ankles=moving.ankles, wrists=moving.wrists), ())


def idle(rng: np.random.Generator) -> Drawn:
    """Standing with nothing near."""
    return Drawn(stand_idle(rng, _times(rng, 15, 18)), ())


def _seat(rng: np.random.Generator, kind: str) -> tuple[SceneObject, float]:
    """A piece to sit on, and the x of the seat that is taken."""
    if kind == "couch":
        seats = int(rng.integers(1, 4))
        piece = furniture.couch(rng, seats=seats)
        place = furniture.couch_place(piece, seats=seats, place=int(rng.integers(seats)))
        return piece, place + rng.uniform(-0.06, 0.06)
    if kind == "stool":
        return furniture.stool(rng), 0.0
    return furniture.chair(rng, arms=bool(rng.random() < 0.35)), 0.0


def _sit(kind: str) -> Callable[[np.random.Generator], Drawn]:
    def draw(rng: np.random.Generator) -> Drawn:
        piece, place = _seat(rng, kind)
        pose = draw_seated(rng, piece, sideways=place)
        return Drawn(sit_still(rng, pose, _times(rng, 15, 20)), (piece,))

    return draw


def sit_at_low_table(rng: np.random.Generator) -> Drawn:
    """On a couch with a coffee table before the knees."""
    piece, place = _seat(rng, "couch")
    pose = draw_seated(rng, piece, sideways=place, upright=True)
    table = furniture.low_table(rng)
    knees = max(pose.ankles[:, 1].max(), pose.pelvis[1] + 0.42)
    y = knees + rng.uniform(0.15, 0.30) + table.bounds[1, 1]
    low = table.moved(Placement(place + rng.uniform(-0.2, 0.2), float(y), FACING_BACK))
    return Drawn(sit_still(rng, pose, _times(rng, 15, 20)), (piece, low))


def sit_at_table(rng: np.random.Generator) -> Drawn:
    """On a chair at a table, hands on the top."""
    piece = furniture.chair(rng, arms=False)
    top = furniture.table(rng)
    pose = draw_seated(rng, piece, upright=True)
    edge = pose.pelvis[1] + rng.uniform(0.20, 0.30)
    pose = at_desk(rng, pose, edge=edge, top=float(top.bounds[1, 2]))
    half = (top.bounds[1, 0] - 0.35) * 0.8  # knees stay between the legs of the table
    at = Placement(rng.uniform(-half, half), edge + top.bounds[1, 1], FACING_BACK)
    return Drawn(sit_still(rng, pose, _times(rng, 15, 20)), (piece, top.moved(at)))


def _sit_down(kind: str, *, backwards: bool) -> Callable[[np.random.Generator], Drawn]:
    def draw(rng: np.random.Generator) -> Drawn:
        piece, place = _seat(rng, kind)
        pose = draw_seated(rng, piece, sideways=place, even_feet=True)
        if rng.random() < 0.3:
            times = _times(rng, 15, 17)
            turn, approach = 0.0, (0.0, 0.0)
        else:
            times = _times(rng, 19, 20)
            turn = float(rng.choice([-1, 1]) * rng.uniform(0.3, 2.4))
            approach = (float(rng.uniform(-0.25, 0.25)), float(rng.uniform(0.10, 0.35)))
        joints = sit_down(rng, pose, times, turn=turn, approach=approach)
        return Drawn(joints[::-1] if backwards else joints, (piece,))

    return draw


def _schedule(rng: np.random.Generator, times: Array) -> tuple[float, float | None]:
    """When hands set off and return: there already, setting off, or out and back."""
    choice = rng.integers(3)
    if choice == 0:
        return -1.0, None
    if choice == 1:
        return float(rng.uniform(0.0, 0.3)), None
    return float(rng.uniform(-0.3, 0.0)), float(times[-1] - rng.uniform(0.5, 0.7))


def stand_at_table(rng: np.random.Generator) -> Drawn:
    """Standing at a table with one hand or both on it or just over it."""
    top = furniture.table(rng)
    edge, height = rng.uniform(0.18, 0.28), float(top.bounds[1, 2])
    target = np.stack(
        [
            np.array([1, -1]) * rng.uniform(0.10, 0.25, 2),
            edge + rng.uniform(0.04, 0.20, 2),
            height + rng.uniform(0.05, 0.20, 2),
        ],
        -1,
    )
    hands = (True, True) if rng.random() < 0.6 else (True, False)
    half = top.bounds[1, 0] - 0.2
    at = Placement(rng.uniform(-half, half), edge + top.bounds[1, 1], FACING_BACK)
    times = _times(rng, 15, 20)
    start, finish = _schedule(rng, times)
    joints = reach_and_hold(rng, times, target=target, hands=hands, start=start, finish=finish)
    return Drawn(joints, (top.moved(at),))


def reach_shelf(rng: np.random.Generator) -> Drawn:
    """Standing before a shelf and reaching for something on one of its boards."""
    piece = furniture.shelf(rng)
    boards = [c.centre[2] + c.size[2] / 2 for c in piece.cuboids if c.part == "board"]
    board = rng.choice([z for z in boards if 0.35 < z < 1.65])
    front = rng.uniform(0.40, 0.52)
    half = piece.bounds[1, 0] - 0.2
    offset = rng.uniform(-half, half) * 0.7
    x = np.clip(np.array([0.14, -0.14]) + rng.uniform(-0.1, 0.1), offset - half, offset + half)
    target = np.stack(
        [x, np.full(2, front + rng.uniform(-0.03, 0.05)), np.full(2, board + 0.10)], -1
    )
    hands = (True, True) if rng.random() < 0.35 else (True, False)
    times = _times(rng, 15, 20)
    start, finish = _schedule(rng, times)
    joints = reach_and_hold(rng, times, target=target, hands=hands, start=start, finish=finish)
    at = Placement(offset, front + piece.bounds[1, 1], FACING_BACK)
    return Drawn(joints, (piece.moved(at),))


@dataclass(frozen=True)
class Entry:
    """A line of the catalogue: what it is called, what is done, how many, how one is drawn."""

    name: str
    action: str
    count: int
    draw: Callable[[np.random.Generator], Drawn]


CATALOGUE: Final = (
    Entry("walk", "walk", 48, walk),
    Entry("stand-idle", "stand", 6, idle),
    Entry("sit-chair", "sit", 24, _sit("chair")),
    Entry("sit-stool", "sit", 12, _sit("stool")),
    Entry("sit-couch", "sit", 28, _sit("couch")),
    Entry("sit-couch-table", "sit", 12, sit_at_low_table),
    Entry("sit-chair-table", "sit", 16, sit_at_table),
    Entry("sit-down-chair", "sit-down", 8, _sit_down("chair", backwards=False)),
    Entry("sit-down-couch", "sit-down", 8, _sit_down("couch", backwards=False)),
    Entry("stand-up-chair", "stand-up", 6, _sit_down("chair", backwards=True)),
    Entry("stand-up-couch", "stand-up", 6, _sit_down("couch", backwards=True)),
    Entry("stand-table", "stand", 18, stand_at_table),
    Entry("reach-shelf", "reach", 24, reach_shelf),
)
"""216 scenelets, about as many of each kind as people spend time on it in a living room."""


def build_library(seed: int = 0) -> Library:
    """The built-in library; the same seed gives the same library, bit for bit.

    Each scenelet has its own stream of random numbers, named by catalogue line and index,
    so lengthening one line changes nothing in the others.
    """
    scenelets: list[Scenelet] = []
    for line, entry in enumerate(CATALOGUE):
        for index in range(0, entry.count, 2):
            rng = np.random.default_rng([seed, line, index])
            drawn = entry.draw(rng)
            name = f"{entry.name}-{index:03d}"
            original = localised(
                name, entry.action, drawn.joints, drawn.objects, fps=FRAMES_PER_SECOND
            )
            scenelets += [original, mirrored(original, f"{entry.name}-{index + 1:03d}")]
    return Library("built-in" if seed == 0 else f"built-in-{seed}", tuple(scenelets))
