"""Sitting still, sitting down and standing up: motions and recipes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.scene import Placement, SceneObject
from imapper_prob.models.skeleton import minimum_jerk
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
from imapper_prob.scenelets.procedural.gait import SWING_LIFT, Gait, Route, walk_along
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
"""Extra forward bend of the trunk in radians half-way down, beyond its final lean; with that lean
it is 35 to 45 degrees (Schenkman et al. 1990)."""
STEP: Final = 0.44
"""Time of a step as a fraction of the time to arrive. With this value the last swing of each foot
ends at its final place, so no foot has to move by a few centimetres more."""
OVERLAP: Final = 0.15
"""Seconds by which the hips start to go down before the feet have arrived."""


def sit_still(rng: np.random.Generator, pose: SeatedPose, times: Array) -> Array:
    """(n, 16, 3) joints in metres of a person who sits, breathes and looks about.

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
    # Busy hands move faster than breathing does.
    quick = np.where(pose.stir > 0.015, 3.0, 1.0)[:, None]
    drift = pose.stir[:, None] * np.sin(quick * slow[:, None, None] + np.arange(6.0).reshape(2, 3))
    drift[..., 2] = np.abs(drift[..., 2])
    wrists = trunk.at_pelvis(pose.hands) + drift
    ankles = np.broadcast_to(pose.ankles, (len(times), 2, 3))
    elbows = ELBOWS if pose.elbows is None else pose.elbows
    return pose_body(trunk, ankles=ankles, wrists=wrists, elbows=elbows, knees=pose.knees)


def hold_still(rng: np.random.Generator, pose: SeatedPose, *objects: SceneObject) -> Drawn:
    """A person who holds a pose for one and a half to two seconds, with furniture.

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
    """A route that walks to a place in front of a seat and turns the back to it.

    Parameters
    ----------
    end : Placement
        Final position of the feet and the yaw they then have.
    distance : float
        Length of the way, metres.
    bearing : float
        Direction the person comes from: 0 is straight in front of the seat, positive is to the
        sitter's left, radians.
    arrival : float
        When the person is there, seconds.

    Returns
    -------
    callable
        Maps seconds to placements (x, y, yaw).
    """
    direction = end.yaw + bearing
    offset = distance * np.array([-np.sin(direction), np.cos(direction)])
    # A person who comes from the left faces right and has a quarter turn to the left to make.
    turn = bearing - np.pi if bearing > 0 else bearing + np.pi

    def route(times: Array) -> Array:
        left = 1 - minimum_jerk(times / arrival)[:, None]
        way: Array = [end.x, end.y, end.yaw] + left * [*offset, turn]
        return way

    return route


def sit_down(
    rng: np.random.Generator, pose: SeatedPose, times: Array, *, route: Route, arrival: float
) -> Array:
    """(n, 16, 3) joints in metres of a person who follows a route to a seat and sits down.

    Played backwards, the motion is standing up and walking off: both are minimum-jerk movements.

    Parameters
    ----------
    rng : numpy.random.Generator
    pose : SeatedPose
        The final pose; its feet are side by side.
    times : (n,) float
        Seconds.
    route : Route
        Ends at the feet of the final pose, with its yaw.
    arrival : float
        When the feet arrive, seconds.

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
    # Short steps in front of a seat clear the floor by more than equally short steps of a walk.
    ankles[..., 2] = ANKLE_HEIGHT + np.sqrt(SWING_LIFT * (ankles[..., 2] - ANKLE_HEIGHT))
    start = max(arrival - OVERLAP, 0.0)
    progress = np.clip((times - start) / (times[-1] - start - 0.05), 0.0, 1.0)
    down = minimum_jerk(progress)
    bow = BOW * np.sin(np.pi * progress) ** 2
    standing = walk.trunk.pelvis
    # The hips move behind the ankles as the trunk bends forward, to keep the balance.
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
# Recipes, and furniture beside a seat.

_PLACES: Final[dict[int, Sequence[tuple[float, float]]]] = {
    1: ((0.0, 1.0),),
    2: ((-0.25, 0.25), (0.0, 0.5), (0.25, 0.25)),
    3: ((-0.33, 0.12), (0.0, 0.76), (0.33, 0.12)),
}
"""Places on a couch by its number of seats: offset from the middle as a fraction of the seat's
width, and probability. On i3DB people sit 28 cm (r.m.s., six sittings) from the middle of a couch,
so the outer places are less probable."""
Taken = tuple[SceneObject, Seat, float]
"""A piece of furniture, its seat in the scenelet's frame, and the x of the place to sit at."""


def take_seat(rng: np.random.Generator, person: Person, kind: str) -> Taken:
    """Draw a piece of furniture to sit on, facing +y.

    Parameters
    ----------
    rng : numpy.random.Generator
    person : Person
    kind : str
        Kind of furniture, such as ``"chair"``.

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
    # The hips, .2 m to either side, stay clear of the armrests.
    most = max(width / 2 - 0.24, 0.0)
    place = rng.choice(places, p=shares) * width + rng.normal(0.0, 0.05 * seats)
    return float(np.clip(place, -most, most))


def _bedside(rng: np.random.Generator, person: Person) -> Taken:
    """A bed to sit on the edge of: it lies behind the person, its head to the left or right."""
    bed = person.sees(furniture.bed(rng))
    edge, half = 0.20, float(bed.bounds[1, 0])
    along = float(np.clip(rng.normal(0.0, 0.3), 0.4 - bed.bounds[1, 1], bed.bounds[1, 1] - 0.4))
    at = Placement(along, edge - half, float(rng.choice([-1, 1])) * np.pi / 2)
    return bed.moved(at), seat_of(bed, edge=edge), 0.0


def with_room(bed: SceneObject, *, right: float, left: float) -> SceneObject:
    """A bed that extends far enough to both sides of a person on its edge at x = 0.

    It is moved along its edge by the least distance needed; ``right`` and ``left`` are in metres.

    Parameters
    ----------
    bed : SceneObject
    right : float
        Metres needed to the right.
    left : float
        Metres needed to the left.

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
    """Recipe: sitting on a chair, office chair, armchair, couch, stool, bench or bed edge.

    Parameters
    ----------
    kind : str
        Kind of furniture, such as ``"chair"``.

    Returns
    -------
    callable
        Maps rng and person to :class:`~imapper_prob.scenelets.procedural.body.Drawn`.
    """

    def draw(rng: np.random.Generator, person: Person) -> Drawn:
        piece, seat, place = take_seat(rng, person, kind)
        pose = draw_seated(rng, seat, sideways=place)
        return hold_still(rng, pose, piece)

    return draw


def sit_turned(kind: str) -> Recipe:
    """Recipe: sitting with the whole body turned to one side, as towards other people.

    Parameters
    ----------
    kind : str
        Kind of furniture, such as ``"chair"``.

    Returns
    -------
    callable
        Maps rng and person to :class:`~imapper_prob.scenelets.procedural.body.Drawn`.
    """

    def draw(rng: np.random.Generator, person: Person) -> Drawn:
        piece, seat, place = take_seat(rng, person, kind)
        # From an outer place the person turns to the middle; on the other side is the armrest.
        side = np.sign(place) if abs(place) > 0.1 else rng.choice([-1, 1])
        # The armrests of a narrow seat leave the knees little room to turn.
        most = 0.35 if seat.arms and abs(seat.arms[0][0] - seat.arms[1][0]) < 0.9 else 0.70
        yaw = float(side * rng.uniform(0.2, most))
        pose = draw_seated(rng, seat, sideways=place, yaw=yaw)
        return hold_still(rng, pose, piece)

    return draw


def sit_at_low_table(rng: np.random.Generator, person: Person) -> Drawn:
    """Sitting on a couch with a coffee table in front of the knees.

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
    """A person on a chair at a table or desk, with the knees in its gap."""
    piece, seat, place = take_seat(rng, person, kind)
    pose = draw_seated(rng, seat, sideways=place, upright=True)
    edge = table_edge(pose, seat, gap=rng.uniform(0.20, 0.30))
    pose = at_table(rng, pose, edge=edge, top=float(table.bounds[1, 2]))
    return hold_still(rng, pose, piece, over_knees(rng, table, place, edge=edge))


def table_edge(pose: SeatedPose, seat: Seat, *, gap: float) -> float:
    """The y in metres of the edge of a table that a sitter uses, clear of the armrests.

    Parameters
    ----------
    pose : SeatedPose
    seat : Seat
    gap : float
        Distance from the pelvis to the edge, metres.

    Returns
    -------
    float
    """
    rests = max((front for _, front, _ in seat.arms), default=-np.inf)
    return max(float(pose.pelvis[1]) + gap, rests + 0.02)


def over_knees(
    rng: np.random.Generator, table: SceneObject, place: float, *, edge: float
) -> SceneObject:
    """A table with its knee gap over the knees of a sitter at x = ``place``.

    Parameters
    ----------
    rng : numpy.random.Generator
    table : SceneObject
    place : float
        The x of the sitter, metres.
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
    """Sitting on a chair or bench at a table, hands on the top.

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
    """Typing, writing or thinking at a desk, on an office chair or an ordinary chair.

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
    """Recipe: sitting with a shelf at one side, against the same wall or facing the seat.

    Parameters
    ----------
    kind : str
        Kind of furniture, such as ``"chair"``.

    Returns
    -------
    callable
        Maps rng and person to :class:`~imapper_prob.scenelets.procedural.body.Drawn`.
    """

    def draw(rng: np.random.Generator, person: Person) -> Drawn:
        piece, seat, place = take_seat(rng, person, kind)
        side, half = (1 if place > 0 else -1), float(piece.bounds[1, 0])
        # On a long couch the person sits at the end beside the shelf; elsewhere it is out of reach.
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
    """A person who walks to the seat in a step or two, or is already there, and sits down."""
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
    """Recipe: walking to a seat, turning and sitting down.

    Parameters
    ----------
    kind : str
        Kind of furniture, such as ``"chair"``.

    Returns
    -------
    callable
        Maps rng and person to :class:`~imapper_prob.scenelets.procedural.body.Drawn`.
    """

    def draw(rng: np.random.Generator, person: Person) -> Drawn:
        piece, seat, place = take_seat(rng, person, kind)
        pose = draw_seated(rng, seat, sideways=place, upright=True)
        # Along the front of a closed seat the feet have no room to come from far to the side.
        bearings = (0.5, 1.1) if seat.closed else (0.7, 1.4)
        joints = _way_to(rng, pose, bearings=bearings, furthest=0.5)
        return Drawn(joints, (piece,))

    return draw


def sit_down_at_table(rng: np.random.Generator, person: Person) -> Drawn:
    """Sitting down from the side on a chair that is pulled back from a table.

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
