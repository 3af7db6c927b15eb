"""Statements about a scene: what somebody knows besides the detections, as terms of the posterior.

Each is an answer or a measurement. Its term is the density of what was said given the scene
(docs/explanation/model.md 25 to 33), which :mod:`imapper_prob.models.kernels.given` evaluates.
Lengths are in metres in the world of a scene: floor at z = 0, camera above the origin, looking
along y. Frames are numbered as in the clip. ``doubt`` is the probability that an answer was given
by chance.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from itertools import combinations
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray
from shapely import Point, Polygon

from imapper_prob.models.errors import InputError
from imapper_prob.models.kernels.given import (
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
)
from imapper_prob.models.problem import (
    GIVEN_KINDS,
    GIVEN_NUMBERS,
    GIVEN_ROW,
    Problem,
    labels_of,
)
from imapper_prob.models.scene import Clip
from imapper_prob.models.scenelet import Library
from imapper_prob.models.settings import LOWEST_CAMERA, NEAREST, STEEPEST_CAMERA
from imapper_prob.models.skeleton import JOINTS, PELV

__all__ = [
    "ROOM_AREA",
    "Behind",
    "Contact",
    "DepthOf",
    "JointAt",
    "Measured",
    "ObjectAt",
    "Presence",
    "Room",
    "SameObject",
    "Seen",
    "Statement",
    "check_statements",
    "describe",
    "from_json",
    "log_by_chance",
    "tell",
    "to_json",
]

Array = NDArray[np.float64]
Points = tuple[tuple[float, float], ...]
_DOUBT: Final = 0.001
"""One answer in a thousand is given by chance; chosen."""
ROOM_AREA: Final = 100.0
"""m^2 over which a place that was named by chance may be; chosen, a large room."""
_LARGEST_SIDE: Final = 3.0
"""Metres up to which each side of an object that was named by chance may be; chosen."""
_QUANTITIES: Final = ("pitch", "height", "focal", "stature")
_FAR_APART: Final = 6.0
"""Standard deviations at which two measurements of one thing contradict each other; chosen."""


@dataclass(frozen=True)
class Measured:
    """Camera or person were measured.

    Parameters
    ----------
    quantity : str
        ``"pitch"`` (degrees, negative looking down), ``"height"`` of the camera (m), ``"focal"``
        length (px), or the person's ``"stature"`` (m).
    value, std : float
        What was measured, and its standard deviation.

    Raises
    ------
    InputError
        There is no such quantity, or the numbers are none of it.

    Examples
    --------
    >>> im.Measured("height", 1.62, 0.02).std
    0.02
    """

    quantity: Literal["pitch", "height", "focal", "stature"]
    value: float
    std: float

    def __post_init__(self) -> None:
        if self.quantity not in _QUANTITIES:
            raise InputError(
                f"{self.quantity!r:.60} is not measured; name one of {', '.join(_QUANTITIES)}"
            )
        _require_finite(self.value, f"the measured {self.quantity}")
        _require_positive(self.std, f"the std of the measured {self.quantity}")
        least, most = {
            "pitch": (-math.degrees(STEEPEST_CAMERA), math.degrees(STEEPEST_CAMERA)),
            "height": (LOWEST_CAMERA, 100.0), "focal": (1.0, 1e5), "stature": (0.5, 2.5),
        }[self.quantity]  # fmt: skip
        if not least < self.value < most:
            raise InputError(
                f"a measured {self.quantity} of {self.value:g} is not between {least:g} and "
                f"{most:g}"
            )


@dataclass(frozen=True)
class ObjectAt:
    """An object of some labels was measured; say at least one of place, size and box.

    Parameters
    ----------
    labels : str or sequence of str
        It has one of these.
    place : (float, float), optional
        x, y of its centre, m.
    place_std : float
        m.
    size : (float, float, float), optional
        Width, depth and height, m.
    size_std : float
        m.
    box : (float, float, float, float), optional
        Left, top, right and bottom in the picture, px.
    box_std : float
        Of each edge, px.
    doubt : float

    Raises
    ------
    InputError
        Nothing was measured, or the numbers make no sense.

    Examples
    --------
    >>> im.ObjectAt("couch", place=(0.5, 3.0), place_std=0.1).labels
    ('couch',)
    """

    labels: tuple[str, ...]
    place: tuple[float, float] | None = None
    place_std: float = 0.1
    size: tuple[float, float, float] | None = None
    size_std: float = 0.1
    box: tuple[float, float, float, float] | None = None
    box_std: float = 20.0
    doubt: float = _DOUBT

    def __post_init__(self) -> None:
        object.__setattr__(self, "labels", _labels(self.labels))
        if self.place is None and self.size is None and self.box is None:
            raise InputError(
                f"object {self}: neither place, size nor box is said; say one, or its presence"
            )
        for name, count in (("place", 2), ("size", 3), ("box", 4)):
            values = getattr(self, name)
            if values is not None:
                object.__setattr__(self, name, _numbers(values, count, f"the {name} of {self}"))
                _require_positive(getattr(self, f"{name}_std"), f"{name}_std of {self}")
        if self.size is not None and not min(self.size) > 0:
            raise InputError(f"object {self}: its size {self.size} must be positive")
        if self.box is not None and not (self.box[0] < self.box[2] and self.box[1] < self.box[3]):
            raise InputError(
                f"object {self}: its box {self.box} must be left, top, right, bottom in pixels"
            )
        _require_doubt(self.doubt, f"object {self}")

    def __str__(self) -> str:
        return " or ".join(self.labels)


@dataclass(frozen=True)
class Presence:
    """There is, or there is not, an object of some labels in a region, or anywhere.

    Parameters
    ----------
    labels : str or sequence of str
    there : bool
    region : sequence of (float, float), optional
        Corners of a polygon on the floor in which its centre is, m; anywhere if not given.
    std : float
        Of the region's edge, m.
    doubt : float

    Raises
    ------
    InputError
        The region is none.

    Examples
    --------
    >>> im.Presence("table", there=False).there
    False
    """

    labels: tuple[str, ...]
    there: bool = True
    region: Points | None = None
    std: float = 0.1
    doubt: float = _DOUBT

    def __post_init__(self) -> None:
        object.__setattr__(self, "labels", _labels(self.labels))
        if self.region is not None:
            object.__setattr__(self, "region", _polygon(self.region, f"the region of {self}"))
        _require_positive(self.std, f"std of {self}")
        _require_doubt(self.doubt, str(self))

    def __str__(self) -> str:
        where = "" if self.region is None else " in a region"
        return f"{'a' if self.there else 'no'} {' or '.join(self.labels)}{where}"


@dataclass(frozen=True)
class Room:
    """Walls: all furniture and the person's pelvis are inside.

    Parameters
    ----------
    walls : sequence of (float, float)
        Corners of a polygon on the floor, m.
    std : float
        Of the walls, m.
    doubt : float

    Raises
    ------
    InputError
        The walls are no polygon.

    Examples
    --------
    >>> im.Room([(-2, 1), (2, 1), (2, 6), (-2, 6)]).std
    0.1
    """

    walls: Points
    std: float = 0.1
    doubt: float = _DOUBT

    def __post_init__(self) -> None:
        object.__setattr__(self, "walls", _polygon(self.walls, "the walls of the room"))
        _require_positive(self.std, "std of the walls")
        _require_doubt(self.doubt, "the room")


@dataclass(frozen=True)
class JointAt:
    """A joint was at a point of space in a frame.

    Parameters
    ----------
    joint : str
        Such as ``"PELV"`` or ``"RWRI"``.
    frame : int
    point : (float, float, float)
        x, y, z in m.
    std : float
        Along each axis, m.
    person : int
        Which track of the clip, from 1.

    Raises
    ------
    InputError
        There is no such joint, or the numbers are none.

    Examples
    --------
    >>> im.JointAt("PELV", 0, (0.0, 3.0, 0.9), 0.05).joint
    'PELV'
    """

    joint: str
    frame: int
    point: tuple[float, float, float]
    std: float
    person: int = 1

    def __post_init__(self) -> None:
        _require_joint(self.joint)
        object.__setattr__(self, "point", _numbers(self.point, 3, f"the point of {self.joint}"))
        _require_positive(self.std, f"std of the point of {self.joint}")


@dataclass(frozen=True)
class DepthOf:
    """Depths of a joint along the camera's axis, by any other system.

    Parameters
    ----------
    frames : sequence of int
    depths : sequence of float
        In these frames, m.
    error : float
        Of each by itself, as a share of the depth.
    scale_error : float
        Of all of them together, as a share: of a system that does not know its scale well.
    joint : str
    person : int
        Which track of the clip, from 1.

    Raises
    ------
    InputError
        Frames and depths differ in number, a frame is there twice, or a number makes no sense.

    Examples
    --------
    >>> im.DepthOf([0, 10], [3.1, 3.4], error=0.05).joint
    'PELV'
    """

    frames: tuple[int, ...]
    depths: tuple[float, ...]
    error: float
    scale_error: float = 0.0
    joint: str = "PELV"
    person: int = 1

    def __post_init__(self) -> None:
        _require_joint(self.joint)
        object.__setattr__(self, "frames", tuple(int(frame) for frame in self.frames))
        depths = _numbers(self.depths, len(self.frames), "depths, one for each frame,")
        object.__setattr__(self, "depths", depths)
        if not depths or len(set(self.frames)) < len(depths):
            raise InputError(f"depths of {self.joint}: say each frame once, and at least one")
        if not min(depths) > NEAREST:
            raise InputError(f"depths of {self.joint}: {min(depths):g} m is behind the camera")
        _require_positive(self.error, f"error of the depths of {self.joint}")
        if not 0 <= self.scale_error < math.inf:
            raise InputError(f"scale_error = {self.scale_error!r} must be a share, 0 or more")


@dataclass(frozen=True)
class Contact:
    """The person sits on, or touches, an object of some labels all through some frames.

    Parameters
    ----------
    labels : str or sequence of str
    first, last : int
        Frames.
    sits : bool
        On it; else a hand, a knee or the pelvis touches it.
    doubt : float
    person : int
        Which track of the clip, from 1.

    Raises
    ------
    InputError
        The last frame is before the first.

    Examples
    --------
    >>> im.Contact("chair", 20, 40).sits
    True
    """

    labels: tuple[str, ...]
    first: int
    last: int
    sits: bool = True
    doubt: float = _DOUBT
    person: int = 1

    def __post_init__(self) -> None:
        object.__setattr__(self, "labels", _labels(self.labels))
        if self.last < self.first:
            raise InputError(
                f"contact with {' or '.join(self.labels)}: its last frame {self.last} is before "
                f"its first, {self.first}"
            )
        _require_doubt(self.doubt, f"contact with {' or '.join(self.labels)}")


@dataclass(frozen=True)
class SameObject:
    """One object of some labels is sat on, or touched, all through several spans of frames.

    Parameters
    ----------
    labels : str or sequence of str
    spans : sequence of (int, int)
        First and last frame of each, two or more.
    sits : bool
        On it; else a hand, a knee or the pelvis touches it.
    doubt : float
    people : sequence of int, optional
        Whose frames each span has, tracks of the clip from 1; those of the first if not given.

    Raises
    ------
    InputError
        There are fewer than two spans, or not one person for each, or one ends before it begins.

    Examples
    --------
    >>> im.SameObject("chair", [(20, 40), (90, 120)]).people
    (1, 1)
    """

    labels: tuple[str, ...]
    spans: tuple[tuple[int, int], ...]
    sits: bool = True
    doubt: float = _DOUBT
    people: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "labels", _labels(self.labels))
        spans = tuple((int(first), int(last)) for first, last in self.spans)
        object.__setattr__(self, "spans", spans)
        people = tuple(int(person) for person in self.people) or (1,) * len(spans)
        object.__setattr__(self, "people", people)
        if len(spans) < 2 or len(people) != len(spans):
            raise InputError(
                f"{self}: {len(spans)} spans of frames of {len(people)} people; say two spans or "
                "more, and a person for each"
            )
        for first, last in spans:
            if last < first:
                raise InputError(f"{self}: the last frame {last} is before the first, {first}")
        _require_doubt(self.doubt, str(self))

    def __str__(self) -> str:
        what = "sits on" if self.sits else "touches"
        return f"{what} the same {' or '.join(self.labels)}"


@dataclass(frozen=True)
class Behind:
    """An object of some labels stands behind one of others, as the camera sees them.

    Its centre is further from the camera, and there is a direction in which both are.

    Parameters
    ----------
    labels : str or sequence of str
        What stands behind.
    before : str or sequence of str
        What stands before it.
    doubt : float

    Raises
    ------
    InputError
        Labels are none.

    Examples
    --------
    >>> im.Behind("couch", "table").before
    ('table',)
    """

    labels: tuple[str, ...]
    before: tuple[str, ...]
    doubt: float = _DOUBT

    def __post_init__(self) -> None:
        object.__setattr__(self, "labels", _labels(self.labels))
        object.__setattr__(self, "before", _labels(self.before))
        _require_doubt(self.doubt, str(self))

    def __str__(self) -> str:
        return f"a {' or '.join(self.labels)} behind a {' or '.join(self.before)}"


@dataclass(frozen=True)
class Seen:
    """What a detector of objects found in the picture of one frame, all of it.

    A piece of furniture is found with the probability ``rate`` times the share of it that is in
    the picture and behind nothing.

    Parameters
    ----------
    frame : int
    boxes : (D, 4) float
        Left, top, right and bottom, px.
    confusion : sequence of D mapping of str to float
        Of each box the probability of its detected label by the object's true label, out of the
        library.
    rate : float
        At which pieces in full view are found.
    clutter : float
        Boxes of nothing that are expected.
    std : float
        Of each edge, px.
    person : int
        Whose joints are in the way, a track of the clip from 1.

    Raises
    ------
    InputError
        Boxes and labels differ in number, or the numbers are none.

    Examples
    --------
    >>> found = im.Seen(0, [(100, 200, 500, 600)], [{"couch": 0.9, "armchair": 0.1}])
    >>> found.rate
    0.9
    """

    frame: int
    boxes: tuple[tuple[float, float, float, float], ...]
    confusion: tuple[dict[str, float], ...] = field(hash=False)
    rate: float = 0.9
    clutter: float = 0.5
    std: float = 20.0
    person: int = 1

    def __post_init__(self) -> None:
        boxes = tuple(_numbers(box, 4, "a box in the picture") for box in self.boxes)
        object.__setattr__(self, "boxes", boxes)
        object.__setattr__(self, "confusion", tuple(dict(row) for row in self.confusion))
        if len(boxes) != len(self.confusion):
            raise InputError(f"{len(boxes)} boxes in the picture, but {len(self.confusion)} labels")
        for box in boxes:
            if not (box[0] < box[2] and box[1] < box[3]):
                raise InputError(f"the box {box} must be left, top, right, bottom in pixels")
        for row in self.confusion:
            if not all(0 <= share <= 1 for share in row.values()):
                raise InputError(f"confusion {row} must be of probabilities")
        if not 0 < self.rate < 1:
            raise InputError(f"rate = {self.rate!r} must be between 0 and 1")
        _require_positive(self.clutter, "clutter")
        _require_positive(self.std, "std of the boxes in the picture")


Statement = (
    Measured | ObjectAt | Presence | Room | JointAt | DepthOf | Contact | SameObject | Behind | Seen
)


def describe(statement: Statement) -> str:
    """A statement in a few words.

    Parameters
    ----------
    statement : Statement

    Returns
    -------
    str

    Examples
    --------
    >>> from imapper_prob.models.statements import describe
    >>> describe(im.Measured("height", 1.62, 0.02))
    'height 1.62 ± 0.02 m'
    """
    match statement:
        case Measured(quantity, value, std):
            unit = {"pitch": "°", "focal": " px"}.get(quantity, " m")
            return f"{quantity} {value:g} ± {std:g}{unit}"
        case ObjectAt():
            said = [
                f"{name} {', '.join(f'{x:g}' for x in values)}"
                for name in ("place", "size", "box")
                if (values := getattr(statement, name)) is not None
            ]
            return f"{statement}: {'; '.join(said)}"
        case Presence():
            return str(statement)
        case Room(walls):
            return f"a room of {len(walls)} walls"
        case JointAt(joint, frame, point):
            return f"{joint} at {', '.join(f'{x:g}' for x in point)} m in frame {frame}"
        case DepthOf():
            return f"depth of {statement.joint} in {len(statement.frames)} frames"
        case Contact():
            what = "sits on" if statement.sits else "touches"
            labels = " or ".join(statement.labels)
            return f"{what} a {labels} from frame {statement.first} to {statement.last}"
        case SameObject():
            spans = " and ".join(f"{first} to {last}" for first, last in statement.spans)
            return f"{statement} in frames {spans}"
        case Behind():
            return str(statement)
        case Seen():
            return f"{len(statement.boxes)} boxes in the picture of frame {statement.frame}"


_CLASSES: Final = (
    Measured, ObjectAt, Presence, Room, JointAt, DepthOf, Contact, SameObject, Behind, Seen,
)  # fmt: skip


def to_json(statements: Sequence[Statement]) -> str:
    """Statements as text; :func:`from_json` reads it back.

    Parameters
    ----------
    statements : sequence of Statement

    Returns
    -------
    str
    """
    return json.dumps([[type(s).__name__, asdict(s)] for s in statements])


def from_json(text: str) -> tuple[Statement, ...]:
    """The statements that :func:`to_json` wrote.

    Parameters
    ----------
    text : str

    Returns
    -------
    tuple of Statement

    Raises
    ------
    LookupError, TypeError, ValueError
        It wrote something else.
    """
    named = {cls.__name__: cls for cls in _CLASSES}
    return tuple(named[name](**values) for name, values in json.loads(text))


# ------------------------------------------------------------------------------------------------
# Against clip and library, and against each other.


def check_statements(statements: Sequence[Statement], clip: Clip, library: Library) -> None:
    """Refuse what no scene of a clip and a library can be, before anything is sampled.

    Parameters
    ----------
    statements : sequence of Statement
    clip : Clip
    library : Library

    Raises
    ------
    InputError
        A label is not in the library, a frame not in the clip, a box not in the picture, a place
        behind the camera, or two statements contradict each other.
    """
    known = set(labels_of(library))
    for statement in statements:
        for label in sorted(_labels_said(statement) - known):
            raise InputError(
                f"{describe(statement)}: library {library.name} has no {label!r}; it has "
                f"{', '.join(sorted(known))}"
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
        _check_view(statement, clip)
    for one, other in combinations(statements, 2):
        if _contradict(one, other) or _contradict(other, one):
            raise InputError(f"{describe(one)} and {describe(other)} contradict each other")


def _labels_said(statement: Statement) -> set[str]:
    if isinstance(statement, Seen):
        return {label for row in statement.confusion for label in row}
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
    """Boxes are in the picture, and places before the camera."""
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
    place: tuple[float, ...] | None = None
    if isinstance(statement, ObjectAt) and statement.place is not None:
        place = (*statement.place, 0.0)
    elif isinstance(statement, JointAt):
        place = statement.point
    if place is not None:
        depth = float(clip.camera.to_camera(np.array(place))[1])
        if depth <= NEAREST:
            raise InputError(
                f"{describe(statement)}: that is {-depth:.1f} m behind the camera, which looks "
                "along y"
            )


def _contradict(one: Statement, other: Statement) -> bool:
    """Whether the first makes the second as good as impossible."""
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
            # None of some labels where one of these labels is said to be.
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
        case Room(), ObjectAt() if other.place is not None:
            far = _FAR_APART * math.hypot(one.std, other.place_std)
            return bool(Polygon(one.walls).distance(Point(other.place)) > far)
        case Room(), Presence(there=True) if other.region is not None:
            far = _FAR_APART * math.hypot(one.std, other.std)
            return bool(Polygon(one.walls).distance(Polygon(other.region)) > far)
        case _:
            return False


def _deep_in(region: Points, place: tuple[float, float], by: float) -> bool:
    polygon, point = Polygon(region), Point(place)
    return bool(polygon.contains(point) and polygon.exterior.distance(point) > by)


# ------------------------------------------------------------------------------------------------
# As flat rows of a problem.


def tell(
    problem: Problem, statements: Sequence[Statement], clip: Clip, library: Library
) -> Problem:
    """The problem with statements as a term of its log-posterior, in place of any it has.

    Parameters
    ----------
    problem : Problem
        Of the clip's people, one after the other.
    statements : sequence of Statement
    clip : Clip
    library : Library
        All of it, or exactly the scenelets of the problem.

    Returns
    -------
    Problem

    Raises
    ------
    InputError
        See :func:`check_statements`.
    """
    check_statements(statements, clip, library)
    names = _names(problem, library)
    kinds = np.zeros((len(statements), GIVEN_KINDS), np.int64)
    numbers = np.zeros((len(statements), GIVEN_NUMBERS))
    labels: list[Array] = []
    rows: list[tuple[float, ...]] = []
    for kind, number, statement in zip(kinds, numbers, statements, strict=True):
        found = _packed(statement, clip)
        mine = found.labels or [dict.fromkeys(_labels_said(statement), 1.0)]
        kind[:] = (
            found.kind, len(labels), len(rows), len(rows) + len(found.rows), found.joint,
            found.first, found.end,
        )  # fmt: skip
        number[: len(found.numbers)] = found.numbers
        if not isinstance(statement, Seen) or statement.boxes:
            labels += [np.array([row.get(name, 0.0) for name in names]) for row in mine]
        rows += [(*row, *[0.0] * (GIVEN_ROW - len(row))) for row in found.rows]
    return problem._replace(
        given_kinds=kinds,
        given=numbers,
        given_labels=np.array(labels).reshape(-1, len(names)),
        given_rows=np.array(rows, dtype=np.float64).reshape(-1, GIVEN_ROW),
        given_power=np.ones(len(statements)),
    )


def _names(problem: Problem, library: Library) -> list[str]:
    """Labels by the numbers that a problem has for them; empty where its scenelets have none."""
    names = labels_of(library)
    if len(names) < len(problem.label_front):
        known = [o.label for s in library for o in s.objects for _ in o.cuboids]
        named = dict(zip(problem.box_label.tolist(), known, strict=True))
        names = [named.get(number, "") for number in range(len(problem.label_front))]
    return names


@dataclass(frozen=True)
class _Packed:
    """A statement as numbers."""

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
            return _Packed(NUMBER, (unit * value, unit * std), joint=_QUANTITIES.index(quantity))
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
            # Two edges either way, in order; and any of the labels.
            anywhere = 2 * math.log(2 / (width * height)) - math.log(_LABELS_OF_DETECTORS)
            said_seen = (statement.rate, statement.clutter, anywhere, statement.std, width, height)
            return _Packed(
                DETECTIONS_OF_OBJECTS, said_seen, statement.boxes, statement.confusion, first=t,
                end=t + 1,
            )  # fmt: skip


_LABELS_OF_DETECTORS: Final = 80
"""Labels among which a box of nothing has one; COCO's."""


def log_by_chance(statement: Statement, clip: Clip) -> float | None:
    """Log density of an answer by chance, the least that its term can be, nats.

    Parameters
    ----------
    statement : Statement
    clip : Clip

    Returns
    -------
    float or None
        None of measurements, which are never by chance.
    """
    packed = _packed(statement, clip)
    match statement:
        case ObjectAt():
            return math.log(packed.numbers[0]) + packed.numbers[1]
        case Presence() | Room() | Contact() | SameObject() | Behind():
            return math.log(0.5 * packed.numbers[0])
        case _:
            return None


def _object_numbers(said: ObjectAt, picture: tuple[float, float]) -> tuple[float, ...]:
    """As the kernel reads them; half of all answers by chance are that there is no such object."""
    wrong, nothing = -math.log(2.0), 0.0
    place, size, box = said.place, said.size, said.box
    if place is not None:
        wrong -= math.log(ROOM_AREA)
    if size is not None:
        wrong -= 3 * math.log(_LARGEST_SIDE)
    if box is not None:
        wrong += 2 * math.log(2 / (picture[0] * picture[1]))
    return (
        said.doubt, wrong,
        *(place or (0.0, 0.0)), said.place_std if place else nothing,
        *(size or (0.0,) * 3), said.size_std if size else nothing,
        *(box or (0.0,) * 4), said.box_std if box else nothing, *picture,
    )  # fmt: skip


# ------------------------------------------------------------------------------------------------
# Single values.


def _labels(said: str | Sequence[str]) -> tuple[str, ...]:
    labels = (said,) if isinstance(said, str) else tuple(said)
    if not labels or not all(isinstance(label, str) and label for label in labels):
        raise InputError(f"labels {said!r:.60} must be a label or some of them")
    return labels


def _numbers(values: Any, count: int, what: str) -> Any:
    array = np.asarray(values)
    if array.dtype.kind not in "iuf" or array.shape != (count,) or not np.isfinite(array).all():
        raise InputError(f"{what} must be {count} finite numbers, not {values!r:.80}")
    return tuple(array.astype(float).tolist())


def _polygon(points: Any, what: str) -> Points:
    array = np.asarray(points) if _is_rectangular(points) else np.empty(0)
    good = array.dtype.kind in "iuf" and array.ndim == 2 and array.shape[1:] == (2,)
    if not good or len(array) < 3 or not np.isfinite(array).all():
        raise InputError(f"{what} must be three or more corners (x, y) in metres")
    polygon = Polygon(array)
    if not polygon.is_valid or polygon.area <= 0:
        raise InputError(f"{what} must be a polygon whose sides do not cross")
    corners: list[list[float]] = array.astype(float).tolist()
    return tuple((x, y) for x, y in corners)


def _is_rectangular(points: Any) -> bool:
    try:
        np.asarray(points)
    except ValueError:
        return False
    return True


def _require_finite(value: float, what: str) -> None:
    if not isinstance(value, int | float) or not math.isfinite(value):
        raise InputError(f"{what} must be a finite number, not {value!r:.60}")


def _require_positive(value: float, what: str) -> None:
    _require_finite(value, what)
    if not value > 0:
        raise InputError(f"{what} must be positive, not {value!r:.60}")


def _require_doubt(doubt: float, what: str) -> None:
    if not isinstance(doubt, int | float) or not 1e-12 <= doubt < 1:
        raise InputError(f"{what}: doubt = {doubt!r:.60} must be a probability, 1e-12 or more")


def _require_joint(joint: str) -> None:
    if joint not in JOINTS:
        raise InputError(f"{joint!r:.60} is no joint; name one of {', '.join(JOINTS)}")
