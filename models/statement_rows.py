"""Check statements against clip and library, and pack them into a problem as flat rows.

:mod:`imapper_prob.models.statements` and :mod:`imapper_prob.models.furniture_statements` define the
statements; :mod:`imapper_prob.models.kernels.statement_terms` evaluates their terms.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Final

import numpy as np
from numpy.typing import NDArray
from shapely import Point, Polygon

from imapper_prob.models.errors import InputError, require_kind
from imapper_prob.models.furniture_statements import (
    Behind,
    Contact,
    ObjectAt,
    Presence,
    SameObject,
    Seen,
)
from imapper_prob.models.kernels.statement_terms import (
    BEHIND,
    CONTACT,
    DEPTH,
    DETECTIONS_OF_OBJECTS,
    NUMBER,
    OBJECT,
    POINT,
    PRESENCE,
    ROOM,
    SAME_OBJECT,
    WRONG,
)
from imapper_prob.models.problem import (
    GIVEN_KINDS,
    GIVEN_NUMBERS,
    GIVEN_ROW,
    Problem,
)
from imapper_prob.models.scene import Clip
from imapper_prob.models.settings import NEAREST
from imapper_prob.models.skeleton import JOINTS, PELV
from imapper_prob.models.statement_values import Points
from imapper_prob.models.statements import (
    QUANTITIES,
    DepthOf,
    JointAt,
    Measured,
    Room,
    Statement,
    describe,
)

__all__ = ["check_statements", "log_by_chance", "tell"]

Array = NDArray[np.float64]
_ROOM_AREA: Final = 100.0
"""Area in m² over which the position in a random (wrong) answer is uniform; chosen, a large
room."""
_LARGEST_SIDE: Final = 3.0
"""Largest side in metres of the object size in a random answer, which is uniform; chosen."""
_BEYOND: Final = 0.1
"""Share of a picture's side by which a box may end outside of it; chosen. A box given by its
corners in place of its size ends farther out."""
_FAR_APART: Final = 6.0
"""Distance in standard deviations at which two measurements contradict each other; chosen."""


# ------------------------------------------------------------------------------------------------
# Checks against clip and library, and of statements against each other.


def check_statements(statements: Sequence[Statement], clip: Clip, labels: Sequence[str]) -> None:
    """Refuse statements that no scene of the clip and library can fulfil, before sampling.

    Parameters
    ----------
    statements : sequence of Statement
    clip : Clip
    labels : sequence of str
        Furniture labels of the library.

    Raises
    ------
    InputError
        Something is no statement, a label is not in the library, a frame not in the clip, a box not
        in the image, a position is behind the camera, a stature is of several people, a statement
        is given twice, or two statements contradict each other.
    """
    said: object = statements
    if isinstance(said, str) or not isinstance(said, Sequence):
        raise InputError(
            f"{said!r:.60} must be a list of statements; read a file with read_statements"
        )
    for statement in statements:
        require_kind("statement", statement, Statement, "one such as ObjectAt")
        for label in sorted(_labels_said(statement).difference(labels)):
            raise InputError(
                f"{describe(statement)}: the library has no {label!r}; it has "
                f"{', '.join(sorted(labels))}"
            )
        for frame in _frames_said(statement):
            if frame not in clip.frame_ids:
                raise InputError(
                    f"{describe(statement)}: clip {clip.name} has no frame {frame}; its frames are "
                    f"{clip.frame_ids[0]} to {clip.frame_ids[-1]}"
                )
        for person in _people_said(statement):
            if not 1 <= person <= len(clip.tracks):
                raise InputError(
                    f"{describe(statement)}: clip {clip.name} has no person {person}, but "
                    f"{len(clip.tracks)}"
                )
        if isinstance(statement, Measured) and statement.quantity == "stature":
            _check_stature(statement, clip)
        _check_view(statement, clip)
    for one, other in combinations(statements, 2):
        if one == other:
            raise InputError(f"{describe(one)} is given twice")
        if _contradict(one, other) or _contradict(other, one):
            raise InputError(f"{describe(one)} and {describe(other)} contradict each other")


def _check_stature(statement: Measured, clip: Clip) -> None:
    """One body size belongs to all people of a problem, each with a fixed factor of their own."""
    if len(clip.tracks) > 1:
        raise InputError(
            f"{describe(statement)}: clip {clip.name} has {len(clip.tracks)} people, and the "
            "stature of one of them is not a quantity of the model; leave it out"
        )


def _labels_said(statement: Statement) -> set[str]:
    if isinstance(statement, Seen):
        return {label for row in (*statement.confusion, statement.named or {}) for label in row}
    if isinstance(statement, Behind):
        return {*statement.labels, *statement.before}
    return set(getattr(statement, "labels", ()))


def _people_said(statement: Statement) -> tuple[int, ...]:
    if isinstance(statement, SameObject):
        return statement.people
    return (getattr(statement, "person", 1),)


def _frames_said(statement: Statement) -> tuple[int, ...]:
    match statement:
        case JointAt() | Seen():
            return (statement.frame,)
        case DepthOf():
            return statement.frames
        case Contact():
            return (statement.first, statement.last)
        case SameObject():
            return tuple(frame for span in statement.spans for frame in span)
        case _:
            return ()


def _check_view(statement: Statement, clip: Clip) -> None:
    """Check that boxes are in the image and positions in front of the camera."""
    width, height = clip.camera.width, clip.camera.height
    boxes = statement.boxes if isinstance(statement, Seen) else ()
    if isinstance(statement, ObjectAt):
        boxes = () if statement.box is None else (statement.box,)
    for left, top, right, bottom in boxes:
        if right <= 0 or bottom <= 0 or left >= width or top >= height:
            raise InputError(
                f"{describe(statement)}: the box {left:g}, {top:g}, {right:g}, {bottom:g} is "
                f"outside the picture of {width} x {height} px"
            )
        beyond = max(-left / width, -top / height, right / width - 1, bottom / height - 1)
        if beyond > _BEYOND:
            raise InputError(
                f"{describe(statement)}: the box {left:g}, {top:g}, {right:g}, {bottom:g} ends "
                f"far outside the picture of {width} x {height} px; is it of another image size?"
            )
    places: Sequence[tuple[float, ...]] = ()
    match statement:
        case ObjectAt(place=place) if place is not None:
            places = [(*place, 0.0)]
        case JointAt(point=point):
            places = [point]
        case Presence(there=True, region=corners) if corners is not None:
            places = [(*corner, 0.0) for corner in corners]
        case Room(walls=corners):
            places = [(*corner, 0.0) for corner in corners]
    if places:
        depth = float(clip.camera.to_camera(np.array(places))[:, 1].max())
        if depth <= NEAREST:
            raise InputError(
                f"{describe(statement)}: that is {-depth:.1f} m behind the camera, which looks "
                "along y"
            )


def _contradict(one: Statement, other: Statement) -> bool:
    """Whether the first statement makes the second practically impossible."""
    match one, other:
        case Measured(), Measured() if one.quantity == other.quantity:
            return abs(one.value - other.value) > _FAR_APART * math.hypot(one.std, other.std)
        case JointAt(), JointAt() if (one.joint, one.frame, one.person) == (
            other.joint, other.frame, other.person,
        ):  # fmt: skip
            apart = math.dist(one.point, other.point)
            return apart > _FAR_APART * math.hypot(one.std, other.std)
        case Presence(there=False, region=None), Behind():
            return any(set(said) <= set(one.labels) for said in (other.labels, other.before))
        case Presence(there=False), Presence(there=True) | ObjectAt() | Contact() | SameObject():
            # "None of these labels" contradicts a statement that an object of these labels exists.
            if not set(other.labels) <= set(one.labels):
                return False
            if one.region is None:
                return True
            if isinstance(other, Presence) and other.region is not None:
                return bool(Polygon(one.region).covers(Polygon(other.region)))
            return (
                isinstance(other, ObjectAt)
                and other.place is not None
                and _deep_in(
                    one.region, other.place, _FAR_APART * math.hypot(one.std, other.place_std)
                )
            )
        case DepthOf(), DepthOf() if (one.joint, one.person) == (other.joint, other.person):
            return _far_depths(one, other)
        case Room(), Room():
            far = _FAR_APART * math.hypot(one.std, other.std)
            return bool(Polygon(one.walls).distance(Polygon(other.walls)) > far)
        case Room(), JointAt(joint="PELV"):
            far = _FAR_APART * math.hypot(one.std, other.std)
            return bool(Polygon(one.walls).distance(Point(other.point[:2])) > far)
        case Room(), ObjectAt() if other.place is not None:
            far = _FAR_APART * math.hypot(one.std, other.place_std)
            return bool(Polygon(one.walls).distance(Point(other.place)) > far)
        case Room(), Presence(there=True) if other.region is not None:
            far = _FAR_APART * math.hypot(one.std, other.std)
            return bool(Polygon(one.walls).distance(Polygon(other.region)) > far)
        case _:
            return False


def _far_depths(one: DepthOf, other: DepthOf) -> bool:
    """Whether two systems' depths differ in a frame by more than their errors allow."""
    errors = (one.error, one.scale_error, other.error, other.scale_error)
    first = dict(zip(one.frames, one.depths, strict=True))
    return any(
        abs(math.log(depth / first[frame])) > _FAR_APART * math.hypot(*errors)
        for frame, depth in zip(other.frames, other.depths, strict=True)
        if frame in first
    )


def _deep_in(region: Points, place: tuple[float, float], by: float) -> bool:
    polygon, point = Polygon(region), Point(place)
    return bool(polygon.contains(point) and polygon.exterior.distance(point) > by)


# ------------------------------------------------------------------------------------------------
# Packing as flat rows of a problem.


def tell(
    problem: Problem, statements: Sequence[Statement], clip: Clip, labels: Sequence[str]
) -> Problem:
    """Add statements to a problem as a term of its log-posterior, replacing earlier ones.

    Parameters
    ----------
    problem : Problem
        Problem of all people of the clip, one after the other.
    statements : sequence of Statement
    clip : Clip
    labels : sequence of C str
        Furniture labels of the whole library, by category number
        (:func:`imapper_prob.models.problem.labels_of`).

    Returns
    -------
    Problem

    Raises
    ------
    InputError
        See :func:`check_statements`.
    """
    check_statements(statements, clip, labels)
    kinds = np.zeros((len(statements), GIVEN_KINDS), np.int64)
    numbers = np.zeros((len(statements), GIVEN_NUMBERS))
    said: list[Array] = []
    rows: list[tuple[float, ...]] = []
    for kind, number, statement in zip(kinds, numbers, statements, strict=True):
        found = _packed(statement, clip)
        mine = list(found.labels) or [dict.fromkeys(_labels_said(statement), 1.0)]
        if isinstance(statement, Seen):
            named = statement.named
            mine = [*found.labels, dict.fromkeys(labels, 1.0) if named is None else named]
        kind[:] = (
            found.kind, len(said), len(rows), len(rows) + len(found.rows), found.joint,
            found.first, found.end,
        )  # fmt: skip
        number[: len(found.numbers)] = found.numbers
        said += [np.array([row.get(label, 0.0) for label in labels]) for row in mine]
        rows += [(*row, *[0.0] * (GIVEN_ROW - len(row))) for row in found.rows]
    return problem._replace(
        given_kinds=kinds,
        given=numbers,
        given_labels=np.array(said).reshape(-1, len(labels)),
        given_rows=np.array(rows, dtype=np.float64).reshape(-1, GIVEN_ROW),
        given_power=np.ones(len(statements)),
    )


@dataclass(frozen=True)
class _Packed:
    """A statement as numbers for the kernels."""

    kind: int
    numbers: Sequence[float]
    rows: Sequence[tuple[float, ...]] = ()
    labels: Sequence[dict[str, float]] = ()
    joint: int = 0
    first: int = 0
    end: int = 0


def _packed(statement: Statement, clip: Clip) -> _Packed:
    picture = (float(clip.camera.width), float(clip.camera.height))
    row_of = {int(frame): t for t, frame in enumerate(clip.frame_ids.tolist())}
    before = (getattr(statement, "person", 1) - 1) * clip.n_frames
    match statement:
        case Measured(quantity, value, std):
            unit = math.pi / 180 if quantity == "pitch" else 1.0
            said_number = (unit * value, unit * std, math.log(unit))
            return _Packed(NUMBER, said_number, joint=QUANTITIES.index(quantity))
        case ObjectAt():
            return _Packed(OBJECT, _object_numbers(statement, picture))
        case Presence():
            said = (statement.doubt, float(statement.there), statement.std)
            return _Packed(PRESENCE, said, statement.region or ())
        case Room():
            return _Packed(ROOM, (statement.doubt, statement.std), statement.walls)
        case JointAt():
            t = before + row_of[statement.frame]
            said_point = (*statement.point, statement.std)
            joint = JOINTS.index(statement.joint)
            return _Packed(POINT, said_point, joint=joint, first=t, end=t + 1)
        case DepthOf():
            rows = [
                (float(before + row_of[frame]), depth)
                for frame, depth in zip(statement.frames, statement.depths, strict=True)
            ]
            errors = (statement.error, statement.scale_error)
            return _Packed(DEPTH, errors, rows, joint=JOINTS.index(statement.joint))
        case Contact():
            first, last = before + row_of[statement.first], before + row_of[statement.last]
            said_sits = (statement.doubt, float(statement.sits))
            return _Packed(CONTACT, said_sits, joint=PELV, first=first, end=last + 1)
        case SameObject():
            spans: list[tuple[float, ...]] = [
                tuple(
                    float((person - 1) * clip.n_frames + row_of[frame] + more)
                    for frame, more in zip(span, (0, 1), strict=True)
                )
                for span, person in zip(statement.spans, statement.people, strict=True)
            ]
            return _Packed(SAME_OBJECT, (statement.doubt, float(statement.sits)), spans)
        case Behind():
            both = [dict.fromkeys(said, 1.0) for said in (statement.labels, statement.before)]
            return _Packed(BEHIND, (statement.doubt,), labels=both)
        case Seen():
            t, (width, height) = before + row_of[statement.frame], picture
            # Two edges per direction, in order; and any of the labels.
            anywhere = 2 * math.log(2 / (width * height)) - math.log(_LABELS_OF_DETECTORS)
            said_seen = (statement.rate, statement.clutter, anywhere, statement.std, width, height)
            boxes = [_in_picture(box, picture) for box in statement.boxes]
            return _Packed(
                DETECTIONS_OF_OBJECTS, said_seen, boxes, statement.confusion, first=t, end=t + 1
            )


def _in_picture(box: tuple[float, ...], picture: tuple[float, float]) -> tuple[float, ...]:
    """A box without its part outside the picture, as the boxes of pieces are."""
    return tuple(min(max(edge, 0.0), picture[k % 2]) for k, edge in enumerate(box))


_LABELS_OF_DETECTORS: Final = 80
"""Number of labels of an object detector, over which false detections are uniform; that of COCO."""


def log_by_chance(statement: Statement, clip: Clip) -> float | None:
    """Log density of an answer given by chance, which is the least value of its term, nats.

    Parameters
    ----------
    statement : Statement
    clip : Clip

    Returns
    -------
    float or None
        None for measurements, which are never answered by chance.
    """
    packed = _packed(statement, clip)
    match statement:
        case ObjectAt():
            return math.log(packed.numbers[0]) + packed.numbers[WRONG]
        case Presence() | Room() | Contact() | SameObject() | Behind():
            return math.log(0.5 * packed.numbers[0])
        case _:
            return None


def _object_numbers(said: ObjectAt, picture: tuple[float, float]) -> tuple[float, ...]:
    """Numbers for the kernel; a random answer denies with probability 1/2 that the object
    exists."""
    wrong, nothing = -math.log(2.0), 0.0
    place, size, box = said.place, said.size, said.box
    if place is not None:
        wrong -= math.log(_ROOM_AREA)
    if size is not None:
        wrong -= 3 * math.log(_LARGEST_SIDE)
    if box is not None:
        wrong += 2 * math.log(2 / (picture[0] * picture[1]))
    return (
        said.doubt, wrong,
        *(place or (0.0, 0.0)), said.place_std if place else nothing,
        *(size or (0.0,) * 3), said.size_std if size else nothing,
        *(_in_picture(box, picture) if box else (0.0,) * 4), said.box_std if box else nothing,
        *picture,
    )  # fmt: skip
