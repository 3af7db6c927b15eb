"""Sitting still, sitting down and standing up: motions and recipes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.scene import Placement, SceneObject
from imapper_prob.scenelets.procedural import furniture
from imapper_prob.scenelets.procedural.body import (
    ANKLE_HEIGHT,
    ELBOWS,
    Drawn,
    Person,
    Recipe,
    Trunk,
    moments,
    pose_body,
    reachable_height,
)
from imapper_prob.scenelets.procedural.gait import SWING_LIFT, Gait, Route, minimum_jerk, walk_along
from imapper_prob.scenelets.procedural.seated import (
    Seat,
    SeatedPose,
    at_table,
    draw_seated,
    seat_of,
)

__all__ = [
    "approach",
    "hold_still",
    "over_knees",
    "sit",
    "sit_at_desk",
    "sit_at_low_table",
    "sit_at_table",
    "sit_beside_shelf",
    "sit_down",
    "sit_down_at_table",
    "sit_down_on",
    "sit_still",
    "sit_turned",
    "table_edge",
    "take_seat",
    "with_room",
]

Array = NDArray[np.float64]
BOW: Final = 0.50
"""Radians that the trunk bends forward, beyond where it ends, half-way down: with the lean
of the end 35 to 45 degrees (Schenkman et al. 1990)."""
STEP: Final = 0.44
"""Time of a step as part of the time to arrive: the last swing of each foot then ends where it
is to stand, and none has to be moved by a few centimetres more."""
OVERLAP: Final = 0.15
"""Seconds by which the hips set off before the feet have arrived."""


def sit_still(rng: np.random.Generator, pose: SeatedPose, times: Array) -> Array:
    """(n, 16, 3) joints of somebody who sits, breathes and looks about, metres.

    Parameters
    ----------
    rng : numpy.random.Generator
    pose : SeatedPose
    times : (n,) float
        Seconds.

    Returns
    -------
    (n, 16, 3) float
    """
    slow = 2 * np.pi * (times / rng.uniform(2.5, 4.0) + rng.random())
    trunk = Trunk.of(
        np.broadcast_to(pose.pelvis, (len(times), 3)),
        pose.yaw,
        lean=pose.lean + 0.015 * np.sin(slow),
        tilt=pose.tilt,
        twist=pose.twist + 0.04 * np.sin(0.7 * slow),
        nod=pose.nod + 0.05 * np.sin(0.5 * slow + 1),
    )
    # Hands that do something are quicker than breath.
    quick = np.where(pose.stir > 0.015, 3.0, 1.0)[:, None]
    drift = pose.stir[:, None] * np.sin(quick * slow[:, None, None] + np.arange(6.0).reshape(2, 3))
    drift[..., 2] = np.abs(drift[..., 2])
    wrists = trunk.at_pelvis(pose.hands) + drift
    ankles = np.broadcast_to(pose.ankles, (len(times), 2, 3))
    elbows = ELBOWS if pose.elbows is None else pose.elbows
    return pose_body(trunk, ankles=ankles, wrists=wrists, elbows=elbows, knees=pose.knees)


def hold_still(rng: np.random.Generator, pose: SeatedPose, *objects: SceneObject) -> Drawn:
    """Somebody who sits for one and a half to two seconds, among furniture.

    Parameters
    ----------
    rng : numpy.random.Generator
    pose : SeatedPose
    *objects : SceneObject

    Returns
    -------
    Drawn
    """
    return Drawn(sit_still(rng, pose, moments(rng, 15, 20)), objects)


def approach(end: Placement, *, distance: float, bearing: float, arrival: float) -> Route:
    """Walk to a place before a seat and turn the back to it.

    Parameters
    ----------
    end : Placement
        Where the feet come to stand, and where they point then.
    distance : float
        How far off the walk begins, metres.
    bearing : float
        Where from: 0 straight ahead of who sits, positive to their left, radians.
    arrival : float
        When they are there, seconds.

    Returns
    -------
    callable
        From seconds to placements.
    """
    direction = end.yaw + bearing
    offset = distance * np.array([-np.sin(direction), np.cos(direction)])
    # Whoever comes from the left faces right: a quarter turn to the left is left to do.
    turn = bearing - np.pi if bearing > 0 else bearing + np.pi

    def route(times: Array) -> Array:
        left = 1 - minimum_jerk(times / arrival)[:, None]
        way: Array = [end.x, end.y, end.yaw] + left * [*offset, turn]
        return way

    return route


def sit_down(
    rng: np.random.Generator, pose: SeatedPose, times: Array, *, route: Route, arrival: float
) -> Array:
    """(n, 16, 3) joints of somebody who follows a route to a seat and sits down, metres.

    Played backwards this is standing up and walking off: both are minimum-jerk movements.

    Parameters
    ----------
    rng : numpy.random.Generator
    pose : SeatedPose
        The end; its feet are side by side.
    times : (n,) float
        Seconds.
    route : Route
        Ends at the feet of the pose, as it faces.
    arrival : float
        When the feet are there, seconds.

    Returns
    -------
    (n, 16, 3) float
    """
    gait = Gait(
        step_time=max(STEP * arrival, 0.3),
        phase=rng.uniform(-0.02, 0.02),
        lean=0.04,
        half_width=float(np.linalg.norm(pose.ankles[0, :2] - pose.ankles[1, :2]) / 2),
    )
    walk = walk_along(route, times, gait)
    ankles = walk.ankles.copy()
    # The short steps before a seat clear the floor by more than such steps of a walk would.
    ankles[..., 2] = ANKLE_HEIGHT + np.sqrt(SWING_LIFT * (ankles[..., 2] - ANKLE_HEIGHT))
    start = max(arrival - OVERLAP, 0.0)
    progress = np.clip((times - start) / (times[-1] - start - 0.05), 0.0, 1.0)
    down = minimum_jerk(progress)
    bow = BOW * np.sin(np.pi * progress) ** 2
    standing = walk.trunk.pelvis
    # The hips go behind the ankles once the trunk bends forward, to keep the balance.
    behind = -0.08 * bow[:, None] * walk.trunk.forward
    pelvis = standing + down[:, None] * (pose.pelvis - standing) + behind
    trunk = Trunk.of(
        pelvis,
        walk.trunk.yaw,
        lean=(1 - down) * 0.04 + down * pose.lean + bow,
        twist=walk.trunk.twist + down * (pose.twist - walk.trunk.twist),
        nod=0.1 - 0.3 * bow + down * (pose.nod - 0.1),
    )
    pelvis[:, 2] = np.minimum(pelvis[:, 2], reachable_height(trunk, ankles))
    wrists = walk.wrists + (trunk.shoulders - walk.trunk.shoulders)
    wrists = wrists + down[:, None, None] * (trunk.at_pelvis(pose.hands) - wrists)
    return pose_body(trunk, ankles=ankles, wrists=wrists)


# ------------------------------------------------------------------------------------------------
# Recipes, and what stands beside a seat.

_PLACES: Final[dict[int, Sequence[tuple[float, float]]]] = {
    1: ((0.0, 1.0),),
    2: ((-0.25, 0.25), (0.0, 0.5), (0.25, 0.25)),
    3: ((-0.33, 0.12), (0.0, 0.76), (0.33, 0.12)),
}
"""Where one sits on a couch, by its number of seats: parts of the seat's width from its
middle, and how often. On i3DB people sit 28 cm (r.m.s., six sittings) from the middle of a
couch, so the outer places are the rarer ones."""
Taken = tuple[SceneObject, Seat, float]
"""A piece, the seat it offers in the frame of the scenelet, and the x of the place taken."""


def take_seat(rng: np.random.Generator, person: Person, kind: str) -> Taken:
    """Something to sit on, facing +y.

    Parameters
    ----------
    rng : numpy.random.Generator
    person : Person
    kind : str
        Of furniture, such as ``"chair"``.

    Returns
    -------
    Taken
    """
    if kind == "bed":
        return _bedside(rng, person)
    if kind in ("couch", "armchair"):
        seats = 1 if kind == "armchair" else int(rng.choice([1, 2, 3], p=[0.2, 0.4, 0.4]))
        piece = person.sees(furniture.couch(rng, seats=seats))
        return piece, seat_of(piece), _place_on(rng, piece, seats)
    if kind == "bench":
        piece = person.sees(furniture.bench(rng))
        return piece, seat_of(piece), _place_on(rng, piece, 2)
    if kind == "stool":
        piece = person.sees(furniture.stool(rng))
    elif kind == "office-chair":
        piece = person.sees(furniture.office_chair(rng))
    else:
        piece = person.sees(furniture.chair(rng, arms=bool(rng.random() < 0.35)))
    return piece, seat_of(piece), float(rng.normal(0.0, 0.02))


def _place_on(rng: np.random.Generator, piece: SceneObject, seats: int) -> float:
    places, shares = np.array(_PLACES[seats]).T
    width = furniture.seat_part(piece).size[0]
    # The hips, .2 to either side, stay clear of the arms.
    most = max(width / 2 - 0.24, 0.0)
    place = rng.choice(places, p=shares) * width + rng.normal(0.0, 0.05 * seats)
    return float(np.clip(place, -most, most))


def _bedside(rng: np.random.Generator, person: Person) -> Taken:
    """The edge of a bed, which lies behind who sits there, its head to the left or right."""
    bed = person.sees(furniture.bed(rng))
    edge, half = 0.20, float(bed.bounds[1, 0])
    along = float(np.clip(rng.normal(0.0, 0.3), 0.4 - bed.bounds[1, 1], bed.bounds[1, 1] - 0.4))
    at = Placement(along, edge - half, float(rng.choice([-1, 1])) * np.pi / 2)
    return bed.moved(at), seat_of(bed, edge=edge), 0.0


def with_room(bed: SceneObject, *, right: float, left: float) -> SceneObject:
    """A bed below somebody who sits on its edge at x = 0, with so much of it to both sides.

    It is moved along its edge by as little as it takes; ``right`` and ``left`` are in metres.

    Parameters
    ----------
    bed : SceneObject
    right : float
        Metres.
    left : float
        Metres.

    Returns
    -------
    SceneObject
    """
    seat = furniture.seat_part(bed)
    half = np.array([0.0, seat.size[1] / 2, 0.0])
    ends = bed.placement.apply(seat.centre + np.stack([-half, half]))[:, 0]
    shift = max(right - ends.max(), 0.0) - max(left + ends.min(), 0.0)
    return bed.moved(Placement(float(shift), 0.0, 0.0))


def sit(kind: str) -> Recipe:
    """Sitting on a chair, office-chair, armchair, couch, stool, bench or the edge of a bed.

    Parameters
    ----------
    kind : str
        Of furniture, such as ``"chair"``.

    Returns
    -------
    callable
        From rng and person to :class:`~imapper_prob.scenelets.procedural.body.Drawn`.
    """

    def draw(rng: np.random.Generator, person: Person) -> Drawn:
        piece, seat, place = take_seat(rng, person, kind)
        pose = draw_seated(rng, seat, sideways=place)
        return hold_still(rng, pose, piece)

    return draw


def sit_turned(kind: str) -> Recipe:
    """Sitting with the whole body turned to one side, towards company.

    Parameters
    ----------
    kind : str
        Of furniture, such as ``"chair"``.

    Returns
    -------
    callable
        From rng and person to :class:`~imapper_prob.scenelets.procedural.body.Drawn`.
    """

    def draw(rng: np.random.Generator, person: Person) -> Drawn:
        piece, seat, place = take_seat(rng, person, kind)
        # From an outer place one turns to the middle; the other way there is an arm.
        side = np.sign(place) if abs(place) > 0.1 else rng.choice([-1, 1])
        # Knees between the arms of a narrow seat leave little room to turn.
        most = 0.35 if seat.arms and abs(seat.arms[0][0] - seat.arms[1][0]) < 0.9 else 0.70
        yaw = float(side * rng.uniform(0.2, most))
        pose = draw_seated(rng, seat, sideways=place, yaw=yaw)
        return hold_still(rng, pose, piece)

    return draw


def sit_at_low_table(rng: np.random.Generator, person: Person) -> Drawn:
    """On a couch with a coffee table before the knees.

    Parameters
    ----------
    rng : numpy.random.Generator
    person : Person

    Returns
    -------
    Drawn
    """
    piece, seat, place = take_seat(rng, person, "couch")
    pose = draw_seated(rng, seat, sideways=place)
    table = person.sees(furniture.low_table(rng))
    knees = max(float(pose.ankles[:, 1].max()), pose.pelvis[1] + 0.42)
    edge = knees + rng.uniform(0.15, 0.30)
    low = furniture.facing_back(table, place + rng.uniform(-0.2, 0.2), edge=edge)
    return hold_still(rng, pose, piece, low)


def _at(rng: np.random.Generator, person: Person, kind: str, table: SceneObject) -> Drawn:
    """Somebody on a chair at a table or desk, knees in its widest gap."""
    piece, seat, place = take_seat(rng, person, kind)
    pose = draw_seated(rng, seat, sideways=place, upright=True)
    edge = table_edge(pose, seat, gap=rng.uniform(0.20, 0.30))
    pose = at_table(rng, pose, edge=edge, top=float(table.bounds[1, 2]))
    return hold_still(rng, pose, piece, over_knees(rng, table, place, edge=edge))


def table_edge(pose: SeatedPose, seat: Seat, *, gap: float) -> float:
    """The y of the edge of a table that somebody sits at, clear of the seat's arms, metres.

    Parameters
    ----------
    pose : SeatedPose
    seat : Seat
    gap : float
        From the pelvis, metres.

    Returns
    -------
    float
    """
    rests = max((front for _, front, _ in seat.arms), default=-np.inf)
    return max(float(pose.pelvis[1]) + gap, rests + 0.02)


def over_knees(
    rng: np.random.Generator, table: SceneObject, place: float, *, edge: float
) -> SceneObject:
    """A table with its widest gap over the knees of somebody at x = ``place``.

    Parameters
    ----------
    rng : numpy.random.Generator
    table : SceneObject
    place : float
        Metres.
    edge : float
        The y of its edge, metres.

    Returns
    -------
    SceneObject
    """
    low, high = furniture.knee_room(table)
    middle, half = (low + high) / 2, max((high - low) / 2 - 0.30, 0.0)
    return furniture.facing_back(table, place + middle + rng.uniform(-half, half), edge=edge)


def sit_at_table(rng: np.random.Generator, person: Person) -> Drawn:
    """On a chair at a table, hands on the top.

    Parameters
    ----------
    rng : numpy.random.Generator
    person : Person

    Returns
    -------
    Drawn
    """
    kind = "chair" if rng.random() < 0.85 else "bench"
    return _at(rng, person, kind, person.sees(furniture.table(rng)))


def sit_at_desk(rng: np.random.Generator, person: Person) -> Drawn:
    """Typing, writing or thinking at a desk, on an office chair or another one.

    Parameters
    ----------
    rng : numpy.random.Generator
    person : Person

    Returns
    -------
    Drawn
    """
    kind = "office-chair" if rng.random() < 0.7 else "chair"
    return _at(rng, person, kind, person.sees(furniture.desk(rng)))


def sit_beside_shelf(kind: str) -> Recipe:
    """Sitting with a shelf at one side, against the same wall or facing the seat.

    Parameters
    ----------
    kind : str
        Of furniture, such as ``"chair"``.

    Returns
    -------
    callable
        From rng and person to :class:`~imapper_prob.scenelets.procedural.body.Drawn`.
    """

    def draw(rng: np.random.Generator, person: Person) -> Drawn:
        piece, seat, place = take_seat(rng, person, kind)
        side, half = (1 if place > 0 else -1), float(piece.bounds[1, 0])
        # On a long couch the place beside the shelf, or it would be out of reach.
        place = side * max(abs(place), half - 0.65)
        pose = draw_seated(rng, seat, sideways=place)
        shelf = person.sees(furniture.shelf(rng))
        edge = side * (half + rng.uniform(0.15, 0.35))
        half_width, half_depth = shelf.bounds[1, :2]
        if rng.random() < 0.5:
            wall = float(piece.bounds[0, 1])
            at = Placement(edge + side * half_width, wall + half_depth, 0.0)
        else:
            beside = float(rng.uniform(-0.2, 0.4))
            at = Placement(edge + side * half_depth, beside, side * np.pi / 2)
        return hold_still(rng, pose, piece, shelf.moved(at))

    return draw


def _way_to(
    rng: np.random.Generator, pose: SeatedPose, *, bearings: tuple[float, float], furthest: float
) -> Array:
    """Somebody who walks to the seat in a step or two, or is there already, and sits down."""
    feet = pose.ankles[:, :2].mean(0)
    end = Placement(float(feet[0]), float(feet[1]), pose.yaw)
    if rng.random() < 0.25:
        times, arrival, distance, bearing = moments(rng, 15, 17), 0.1, 0.0, np.pi
    else:
        times, distance = moments(rng, 19, 20), rng.uniform(0.15, furthest)
        arrival = rng.uniform(0.8, 0.95)
        bearing = float(rng.choice([-1, 1]) * rng.uniform(*bearings))
    route = approach(end, distance=distance, bearing=bearing, arrival=arrival)
    return sit_down(rng, pose, times, route=route, arrival=arrival)


def sit_down_on(kind: str) -> Recipe:
    """Walking to a seat, turning and sitting down.

    Parameters
    ----------
    kind : str
        Of furniture, such as ``"chair"``.

    Returns
    -------
    callable
        From rng and person to :class:`~imapper_prob.scenelets.procedural.body.Drawn`.
    """

    def draw(rng: np.random.Generator, person: Person) -> Drawn:
        piece, seat, place = take_seat(rng, person, kind)
        pose = draw_seated(rng, seat, sideways=place, upright=True)
        # Along the front of a couch there is no room for the feet of who comes from the side.
        bearings = (0.5, 1.1) if seat.closed else (0.7, 1.4)
        joints = _way_to(rng, pose, bearings=bearings, furthest=0.5)
        return Drawn(joints, (piece,))

    return draw


def sit_down_at_table(rng: np.random.Generator, person: Person) -> Drawn:
    """Sitting down from the side on a chair that is drawn back from a table.

    Parameters
    ----------
    rng : numpy.random.Generator
    person : Person

    Returns
    -------
    Drawn
    """
    piece, seat, place = take_seat(rng, person, "chair")
    pose = draw_seated(rng, seat, sideways=place, upright=True)
    joints = _way_to(rng, pose, bearings=(1.3, 1.57), furthest=0.4)
    table = person.sees(furniture.table(rng))
    edge = float(pose.ankles[:, 1].max()) + rng.uniform(0.20, 0.30)
    half = table.bounds[1, 0] - 0.35
    at = furniture.facing_back(table, rng.uniform(-half, half), edge=edge)
    return Drawn(joints, (piece, at))
