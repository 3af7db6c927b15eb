"""Reaching into shelves, high or low, standing or stepping nearer: motions and recipes."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imapper_prob.models.scene import Placement, SceneObject
from imapper_prob.models.skeleton import minimum_jerk
from imapper_prob.scenelets.procedural import furniture
from imapper_prob.scenelets.procedural.body import (
    FOREARM,
    UPPER_ARM,
    Drawn,
    Person,
    Trunk,
    hanging_wrists,
    moments,
    pose_body,
)
from imapper_prob.scenelets.procedural.gait import Walk, come_nearer
from imapper_prob.scenelets.procedural.standing import Pastime, held, stand, upright

__all__ = [
    "DEEPEST_CROUCH",
    "TRAVEL",
    "browse_shelf",
    "extent",
    "reach",
    "reach_shelf",
    "step_to_shelf",
]

Array = NDArray[np.float64]
COMFORTABLE: Final = 0.93 * (UPPER_ARM + FOREARM)
"""Distance in metres from shoulder to wrist that is reached without leaning."""
DEEPEST_CROUCH: Final = 0.48
"""Greatest lowering of the pelvis in metres, that of a squat on flat feet."""
FURTHEST_LEAN: Final = 1.25
"""Bend of the trunk in radians at which fingertips come near the floor with straight knees."""
LOWEST_HAND: Final = 0.12
"""Least height in metres of the wrist above the floor: fingers bend if the arm would hang lower."""
TRAVEL: Final = 0.7
"""Seconds a hand takes to or from something within reach (Flash and Hogan 1985: .5 to 1)."""
_CROUCHES: Final = np.linspace(0.0, DEEPEST_CROUCH, 13)


def extent(times: Array, *, start: float, finish: float, travel: float = TRAVEL) -> Array:
    """(n,) fraction, 0 to 1, of the way to the target that the hands have gone.

    The hands set off at ``start`` and set off back at ``finish`` seconds; each way takes ``travel``
    seconds. Either time may be outside the clip.

    Parameters
    ----------
    times : (n,) float
        Seconds.
    start : float
        Seconds.
    finish : float
        Seconds.
    travel : float
        Seconds.

    Returns
    -------
    (n,) float
    """
    there = minimum_jerk((times - start) / travel)
    return there * (1 - minimum_jerk((times - finish) / travel))


def reach(
    body: Walk,
    *,
    targets: ArrayLike,
    hands: ArrayLike,
    part: Array,
    via: ArrayLike,
    deepest: float = DEEPEST_CROUCH,
    leans: tuple[float, float] = (0.0, FURTHEST_LEAN),
    after: Pastime | None = None,
) -> Array:
    """(n, 16, 3) joints of a person on foot who reaches for something.

    Parameters
    ----------
    body : Walk
        The body in n frames, before it reaches.
    targets : (2, 3) or (n, 2, 3) float
        Positions that the right and the left wrist reach, metres.
    hands : (2,) bool
        Which hands reach; a hand that does not reach hangs.
    part : (n,) float
        Fraction of the way, from :func:`extent`.
    via : (3,) float
        Point from which the hands approach, relative to the target, metres: above it for a table,
        in front of it for a shelf.
    deepest : float
        Furthest that the knees may lower the pelvis, metres; low furniture leaves less room.
    leans : (float, float)
        Least and greatest bend of the trunk, radians.
    after : Pastime, optional
        What the hands hold after the reach; they hang before it, and after it if not given.

    Returns
    -------
    (n, 16, 3) float
        Joints in metres.
    """
    targets = np.broadcast_to(np.asarray(targets, float), body.wrists.shape)
    hands, via = np.asarray(hands, bool), np.asarray(via, float)
    lean, crouch = _effort(
        body, targets[:, hands], hands, frame=int(part.argmax()), deepest=deepest, leans=leans
    )
    trunk = _posture(body, targets[:, hands].mean(1), lean=part * lean, crouch=part * crouch)
    hanging = hanging_wrists(trunk, 0.08)
    hanging[..., 2] = np.maximum(hanging[..., 2], LOWEST_HAND)
    last = hanging if after is None else held(after, trunk, hanging)
    rest = np.where((np.arange(len(part)) > part.argmax())[:, None, None], last, hanging)
    # A quadratic Bezier curve from the resting place to the target, with target + via as its
    # control point.
    p = (part[:, None] * hands)[..., None]
    wrists = (1 - p) ** 2 * rest + 2 * p * (1 - p) * (targets + via) + p**2 * targets
    return pose_body(trunk, ankles=body.ankles, wrists=wrists)


def _posture(body: Walk, aim: Array, *, lean: Array, crouch: Array) -> Trunk:
    """The trunk bent towards ``aim`` (n, 3), with the hips moved back to keep the balance."""
    old = body.trunk
    offset = aim - old.pelvis
    across = (offset * old.right).sum(-1)
    ahead = (offset * old.forward).sum(-1)
    bearing = np.arctan2(across, np.maximum(ahead, 0.05))
    eager = np.clip((lean + crouch) / 0.1, 0.0, 1.0)
    back = 0.18 * np.sin(lean) + 0.22 * crouch
    level = old.pelvis[:, :2] - back[:, None] * old.forward[:, :2]
    distance = np.hypot(across, ahead)
    gaze = np.arctan2(old.pelvis[:, 2] + 0.7 - aim[:, 2], np.maximum(distance, 0.3))
    bent = old.lean + np.arcsin(np.sin(lean) * np.cos(bearing))
    aside = np.arcsin(np.sin(lean) * np.sin(bearing))
    nod = old.nod + eager * (np.clip(0.1 + 0.5 * gaze, -0.3, 1.0) - bent - old.nod)
    return upright(
        level,
        body.ankles,
        yaw=old.yaw,
        lean=bent,
        tilt=old.tilt + np.clip(aside, -0.4, 0.4),
        twist=old.twist - eager * np.clip(0.5 * bearing, -0.6, 0.6),
        nod=np.clip(nod, -0.55, 0.55),
        crouch=crouch,
    )


def _effort(
    body: Walk,
    targets: Array,
    hands: NDArray[np.bool_],
    *,
    frame: int,
    deepest: float,
    leans: tuple[float, float],
) -> tuple[float, float]:
    """Least lean (rad) and crouch (m) that bring targets (n, k, 3) of k hands into easy reach.

    The feet are taken as in frame ``frame``; all postures of a grid are evaluated at once.
    """
    grid = np.meshgrid(
        _CROUCHES[np.less_equal(_CROUCHES, deepest)], np.linspace(*leans, 26), indexing="ij"
    )
    crouches, bends = (values.ravel() for values in grid)
    frames = np.full(len(bends), frame)
    old = body.trunk
    still = Walk(
        Trunk(
            old.pelvis[frames], old.yaw[frames], old.lean[frames], old.tilt[frames],
            old.twist[frames], old.nod[frames],
        ),
        body.ankles[frames],
        body.wrists[frames],
    )  # fmt: skip
    worst = np.zeros(len(bends))
    for moment in {0, frame, len(targets) - 1}:
        aims = targets[moment]
        trunk = _posture(
            still, np.broadcast_to(aims.mean(0), (len(bends), 3)), lean=bends, crouch=crouches
        )
        gap = np.linalg.norm(trunk.shoulders[:, hands] - aims, axis=-1).max(-1)
        worst = np.maximum(worst, gap)
    # Being out of reach costs most; a metre of crouch costs as much as two radians of lean.
    best = int(np.argmin(20 * np.maximum(worst - COMFORTABLE, 0.0) + 0.5 * bends + crouches))
    return float(bends[best]), float(crouches[best])


# ------------------------------------------------------------------------------------------------
# Recipes.

FROM_THE_FRONT = (0.0, -0.22, 0.02)
"""Metres from a thing in a shelf to the point from which the hand approaches it."""
LOWEST_BOARD, HIGHEST_BOARD = 0.28, 1.72
"""Heights in metres of the lowest and highest board that a person of 1.70 m reaches without
kneeling or standing on the toes (Panero and Zelnik 1979: .30 to 1.80)."""


class _Aim(NamedTuple):
    """A shelf in front of the person, the target (2, 3) of each wrist, and which hands reach."""

    piece: SceneObject
    targets: Array
    hands: tuple[bool, bool]


def _aim(
    rng: np.random.Generator, person: Person, *, turned: float = 0.0, spread: float = 0.0
) -> _Aim:
    """A shelf, and a target on one of its boards.

    Parameters
    ----------
    turned : float
        Direction of the shelf to the left of where the person faces, radians.
    spread : float
        Free width in metres that the board needs on both sides of the target.
    """
    piece = person.sees(furniture.shelf(rng))
    boards = np.array([c.centre[2] + c.size[2] / 2 for c in piece.cuboids if c.part == "board"])
    highest = HIGHEST_BOARD - spread
    board = float(rng.choice(boards[(boards > LOWEST_BOARD) & (boards < highest)]))
    # A high board is reached only from near by.
    front = rng.uniform(0.40, 0.52) - 0.35 * max(board - 1.25, 0.0)
    half = piece.bounds[1, 0] - 0.15
    offset = 0.7 * rng.uniform(-half, half)
    hands = (True, True) if rng.random() < 0.35 else (True, False)
    room = max(half - spread - 0.12 * all(hands), 0.05)
    place = np.clip(rng.uniform(-0.10, 0.20), offset - room, offset + room)
    across = place + np.array([0.12, -0.12]) * all(hands)
    above = board + (0.10 if board < 1.3 else 0.06)
    depth = front + rng.uniform(-0.03, 0.06)
    targets = np.stack([across, np.full(2, depth), np.full(2, above)], -1)
    about = Placement(0.0, 0.0, turned)
    shelf = furniture.facing_back(piece, float(offset), edge=front)
    return _Aim(shelf.moved(about), about.apply(targets), hands)


def _via(turned: float) -> Array:
    via: Array = Placement(0.0, 0.0, turned).apply(np.array(FROM_THE_FRONT))
    return via


def reach_shelf(rng: np.random.Generator, person: Person) -> Drawn:
    """Standing in front of a shelf, or side-on to it, and reaching for something on a board.

    Parameters
    ----------
    rng : numpy.random.Generator
    person : Person

    Returns
    -------
    Drawn
    """
    times = moments(rng, 15, 20)
    # A single hand is the right one, so the shelf is more often on that side.
    turned = rng.uniform(-0.7, 0.3) if rng.random() < 0.4 else 0.0
    aim = _aim(rng, person, turned=turned)
    part = (
        extent(times, start=-1.0, finish=np.inf),
        extent(times, start=rng.uniform(0.0, 0.3), finish=np.inf),
        extent(times, start=rng.uniform(-0.3, 0.0), finish=times[-1] - rng.uniform(0.5, 0.7)),
    )[rng.integers(3)]
    work = 0.02 * np.sin(2 * np.pi * times / rng.uniform(1.5, 3.0))
    joints = reach(
        stand(rng, times, one_leg=bool(rng.random() < 0.2)),
        targets=aim.targets + work[:, None, None] * (1.0, 0.0, 0.0),
        hands=aim.hands,
        part=part,
        via=_via(turned),
    )
    return Drawn(joints, (aim.piece,))


def _approach(rng: np.random.Generator, times: Array) -> Walk:
    """A step or two to the origin, from behind it or from the side."""
    if rng.random() < 0.5:
        start = Placement(rng.uniform(-0.2, 0.2), -rng.uniform(0.25, 0.55), rng.uniform(-0.4, 0.4))
    else:
        side = rng.choice([-1, 1])
        start = Placement(
            side * rng.uniform(0.3, 0.6), -rng.uniform(0.0, 0.3), side * rng.uniform(0.6, 1.5)
        )
    return come_nearer(rng, start, times, arrival=0.9)


def step_to_shelf(rng: np.random.Generator, person: Person) -> Drawn:
    """Stepping towards a shelf and reaching into it.

    Parameters
    ----------
    rng : numpy.random.Generator
    person : Person

    Returns
    -------
    Drawn
    """
    times = moments(rng, 18, 20)
    aim = _aim(rng, person)
    joints = reach(
        _approach(rng, times),
        targets=aim.targets,
        hands=aim.hands,
        part=extent(times, start=times[-1] - TRAVEL - rng.uniform(0.0, 0.3), finish=np.inf),
        via=_via(0.0),
    )
    return Drawn(joints, (aim.piece,))


def browse_shelf(rng: np.random.Generator, person: Person) -> Drawn:
    """Moving a hand along a board, as in looking for something.

    Parameters
    ----------
    rng : numpy.random.Generator
    person : Person

    Returns
    -------
    Drawn
    """
    times = moments(rng, 15, 20)
    way = rng.uniform(0.10, 0.22)
    aim = _aim(rng, person, spread=way)
    along = rng.choice([-1, 1]) * way * (2 * minimum_jerk(times / times[-1]) - 1)
    joints = reach(
        stand(rng, times),
        targets=aim.targets + along[:, None, None] * (1.0, 0.0, 0.0),
        hands=aim.hands,
        part=extent(times, start=-1.0, finish=np.inf),
        via=_via(0.0),
    )
    return Drawn(joints, (aim.piece,))
