"""Statements about a scene: knowledge besides the detections, as terms of the posterior.

A statement is an answer or a measurement. Its term is the density of that answer given the scene
(docs/explanation/model.md 25 to 34); :mod:`imapper_prob.models.kernels.given` evaluates it. Lengths
are in metres in the world frame of a scene: floor at z = 0, camera above the origin, looking along
y. Frame numbers are those of the clip. ``doubt`` is the probability that an answer was given by
chance.
"""

from __future__ import annotations

import json
import math
import operator
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field
from numbers import Real
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon

from imapper_prob.models.errors import InputError
from imapper_prob.models.settings import LOWEST_CAMERA, NEAREST, STEEPEST_CAMERA
from imapper_prob.models.skeleton import JOINTS

__all__ = [
    "QUANTITIES",
    "Behind",
    "Contact",
    "DepthOf",
    "JointAt",
    "Measured",
    "ObjectAt",
    "Points",
    "Presence",
    "Room",
    "SameObject",
    "Seen",
    "Statement",
    "describe",
    "from_json",
    "to_json",
]

Array = NDArray[np.float64]
Points = tuple[tuple[float, float], ...]
_DOUBT: Final = 0.001
"""Default probability that an answer is given by chance; chosen."""
_LEAST_METRES: Final = 1e-4
_LEAST_PIXELS: Final = 0.01
_LEAST_SHARE: Final = 1e-4
"""Least standard deviations of measured lengths (m), edges in a picture (px) and relative depths;
chosen. Nobody measures furniture better, and much smaller ones are lost in rounding."""
QUANTITIES: Final = ("pitch", "height", "focal", "stature")
"""Quantities that can be measured; the index is their number in a problem."""


@dataclass(frozen=True)
class Measured:
    """A measurement of the camera or of a person's stature.

    Parameters
    ----------
    quantity : str
        ``"pitch"`` (degrees, negative looking down), ``"height"`` of the camera (m), ``"focal"``
        length (px), or the person's ``"stature"`` (m).
    value, std : float
        The measured value and its standard deviation, in that unit.

    Raises
    ------
    InputError
        The quantity is unknown, or a number is out of its range.

    Examples
    --------
    >>> im.Measured("height", 1.62, 0.02).std
    0.02
    """

    quantity: Literal["pitch", "height", "focal", "stature"]
    value: float
    std: float

    def __post_init__(self) -> None:
        if self.quantity not in QUANTITIES:
            raise InputError(
                f"{self.quantity!r:.60} is not measured; name one of {', '.join(QUANTITIES)}"
            )
        object.__setattr__(self, "value", _number(self.value, f"the measured {self.quantity}"))
        _positive(self, "std", f"the std of the measured {self.quantity}")
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
    """A measured object of one of several labels; give at least one of place, size and box.

    Parameters
    ----------
    labels : str or sequence of str
        Possible labels of the object.
    place : (float, float), optional
        x, y of the centre on the floor, m.
    place_std : float
        Standard deviation, m.
    size : (float, float, float), optional
        Width, depth and height, m.
    size_std : float
        Standard deviation, m.
    box : (float, float, float, float), optional
        Left, top, right and bottom in the image, px.
    box_std : float
        Standard deviation of each edge, px.
    doubt : float

    Raises
    ------
    InputError
        Nothing was measured, or a number is invalid.

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
                least = _LEAST_PIXELS if name == "box" else _LEAST_METRES
                _positive(self, f"{name}_std", f"{name}_std of {self}", least=least)
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
    """Whether an object of one of several labels is in a region, or anywhere.

    Parameters
    ----------
    labels : str or sequence of str
    there : bool
    region : sequence of (float, float), optional
        Corners of a polygon on the floor that contains the centre, m; anywhere if not given.
    std : float
        Standard deviation of the region's edge, m.
    doubt : float

    Raises
    ------
    InputError
        The region is not a polygon.

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
        _require_bool(self.there, f"there of {' or '.join(self.labels)}")
        _positive(self, "std", f"std of {self}", least=_LEAST_METRES)
        _require_doubt(self.doubt, str(self))

    def __str__(self) -> str:
        where = "" if self.region is None else " in a region"
        return f"{'a' if self.there else 'no'} {' or '.join(self.labels)}{where}"


@dataclass(frozen=True)
class Room:
    """The walls of the room; all furniture and the person's pelvis are inside.

    Parameters
    ----------
    walls : sequence of (float, float)
        Corners of a polygon on the floor, m.
    std : float
        Standard deviation of the walls' position, m.
    doubt : float

    Raises
    ------
    InputError
        The walls are not a polygon.

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
        _positive(self, "std", "std of the walls", least=_LEAST_METRES)
        _require_doubt(self.doubt, "the room")


@dataclass(frozen=True)
class JointAt:
    """The measured 3D position of a joint in one frame.

    Parameters
    ----------
    joint : str
        Such as ``"PELV"`` or ``"RWRI"``.
    frame : int
    point : (float, float, float)
        x, y, z in m.
    std : float
        Standard deviation along each axis, m.
    person : int
        Track of the clip, from 1.

    Raises
    ------
    InputError
        The joint is unknown, or a number is invalid.

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
        for name in ("frame", "person"):
            object.__setattr__(self, name, _whole(getattr(self, name), name))
        object.__setattr__(self, "point", _numbers(self.point, 3, f"the point of {self.joint}"))
        _positive(self, "std", f"std of the point of {self.joint}", least=_LEAST_METRES)


@dataclass(frozen=True)
class DepthOf:
    """Depths of a joint along the camera's optical axis, measured by another system.

    Parameters
    ----------
    frames : sequence of int
    depths : sequence of float
        In these frames, m.
    error : float
        Independent relative error of each depth.
    scale_error : float
        Common relative error of all depths, for a system whose scale is uncertain.
    joint : str
    person : int
        Track of the clip, from 1.

    Raises
    ------
    InputError
        Frames and depths differ in number, a frame occurs twice, or a number is invalid.

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
        object.__setattr__(self, "frames", tuple(_whole(frame, "frame") for frame in self.frames))
        object.__setattr__(self, "person", _whole(self.person, "person"))
        depths = _numbers(self.depths, len(self.frames), "depths, one for each frame,")
        object.__setattr__(self, "depths", depths)
        if not depths or len(set(self.frames)) < len(depths):
            raise InputError(f"depths of {self.joint}: say each frame once, and at least one")
        if not min(depths) > NEAREST:
            raise InputError(f"depths of {self.joint}: {min(depths):g} m is behind the camera")
        _positive(self, "error", f"error of the depths of {self.joint}", least=_LEAST_SHARE)
        object.__setattr__(self, "scale_error", _number(self.scale_error, "scale_error"))
        if not self.scale_error >= 0:
            raise InputError(f"scale_error = {self.scale_error!r} must be a share, 0 or more")


@dataclass(frozen=True)
class Contact:
    """The person sits on, or touches, an object of one of several labels throughout some frames.

    Parameters
    ----------
    labels : str or sequence of str
    first, last : int
        First and last frame.
    sits : bool
        Whether the person sits on it; else a hand, a knee or the pelvis touches it.
    doubt : float
    person : int
        Track of the clip, from 1.

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
        for name in ("first", "last", "person"):
            object.__setattr__(self, name, _whole(getattr(self, name), name))
        if self.last < self.first:
            raise InputError(
                f"contact with {' or '.join(self.labels)}: its last frame {self.last} is before "
                f"its first, {self.first}"
            )
        _require_bool(self.sits, f"sits of the contact with {' or '.join(self.labels)}")
        _require_doubt(self.doubt, f"contact with {' or '.join(self.labels)}")


@dataclass(frozen=True)
class SameObject:
    """The person sits on, or touches, the same object throughout several spans of frames.

    Parameters
    ----------
    labels : str or sequence of str
    spans : sequence of (int, int)
        First and last frame of each span; two spans or more.
    sits : bool
        Whether the person sits on it; else a hand, a knee or the pelvis touches it.
    doubt : float
    people : sequence of int, optional
        Track of each span, from 1; the first track if not given.

    Raises
    ------
    InputError
        There are fewer than two spans, not one person for each, or a span ends before it begins.

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
        spans = tuple((_whole(a, "first"), _whole(b, "last")) for a, b in self.spans)
        object.__setattr__(self, "spans", spans)
        people = tuple(_whole(n, "person") for n in self.people) or (1,) * len(spans)
        object.__setattr__(self, "people", people)
        if len(spans) < 2 or len(people) != len(spans):
            raise InputError(
                f"{self}: {len(spans)} spans of frames of {len(people)} people; say two spans or "
                "more, and a person for each"
            )
        for first, last in spans:
            if last < first:
                raise InputError(f"{self}: the last frame {last} is before the first, {first}")
        _require_bool(self.sits, f"sits of what {self}")
        _require_doubt(self.doubt, str(self))

    def __str__(self) -> str:
        what = "sits on" if self.sits else "touches"
        return f"{what} the same {' or '.join(self.labels)}"


@dataclass(frozen=True)
class Behind:
    """One object is behind another, as seen from the camera.

    Its centre is farther from the camera, and there is a direction that contains both objects.

    Parameters
    ----------
    labels : str or sequence of str
        Possible labels of the object behind.
    before : str or sequence of str
        Possible labels of the object in front.
    doubt : float

    Raises
    ------
    InputError
        A label is missing or not text.

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
    """The complete output of an object detector in one frame.

    A piece of furniture is detected with probability ``rate`` times the share of it that is in the
    image and unoccluded.

    Parameters
    ----------
    frame : int
    boxes : (D, 4) float
        Left, top, right and bottom, px.
    confusion : sequence of D mapping of str to float
        For each box, the probability of the detected label given each possible true label of the
        library.
    rate : float
        Probability of detecting a piece in full view.
    clutter : float
        Expected number of false detections.
    std : float
        Standard deviation of each edge, px.
    person : int
        Track, from 1, of the person who may occlude furniture.
    named : mapping of str to float, optional
        For each label of the library, the probability that the detector names such a piece by one
        of the labels that are listened to; 0 for labels that are left out. All 1 if not given.

    Raises
    ------
    InputError
        Boxes and labels differ in number, a box is more probably named by one label than by all, or
        a number is invalid.

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
    named: dict[str, float] | None = field(default=None, hash=False)

    def __post_init__(self) -> None:
        for name in ("frame", "person"):
            object.__setattr__(self, name, _whole(getattr(self, name), name))
        boxes = tuple(_numbers(box, 4, "a box in the picture") for box in self.boxes)
        object.__setattr__(self, "boxes", boxes)
        object.__setattr__(self, "confusion", tuple(dict(row) for row in self.confusion))
        if len(boxes) != len(self.confusion):
            raise InputError(f"{len(boxes)} boxes in the picture, but {len(self.confusion)} labels")
        for box in boxes:
            if not (box[0] < box[2] and box[1] < box[3]):
                raise InputError(f"the box {box} must be left, top, right, bottom in pixels")
        named = None if self.named is None else dict(self.named)
        object.__setattr__(self, "named", named)
        for row in (*self.confusion, named or {}):
            if not all(0 <= share <= 1 for share in row.values()):
                raise InputError(f"confusion {row} must be of probabilities")
        if named is not None:
            _require_named(self.confusion, named)
        _positive(self, "clutter", "clutter")
        _positive(self, "std", "std of the boxes in the picture", least=_LEAST_PIXELS)
        object.__setattr__(self, "rate", _number(self.rate, "rate"))
        if not 0 < self.rate < 1:
            raise InputError(f"rate = {self.rate!r} must be between 0 and 1")


Statement = (
    Measured | ObjectAt | Presence | Room | JointAt | DepthOf | Contact | SameObject | Behind | Seen
)


def describe(statement: Statement) -> str:
    """A short text for a statement.

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
    """Serialise statements as JSON, which :func:`from_json` reads.

    Parameters
    ----------
    statements : sequence of Statement

    Returns
    -------
    str
    """
    return json.dumps([[type(s).__name__, asdict(s)] for s in statements])


def from_json(text: str) -> tuple[Statement, ...]:
    """Read statements that :func:`to_json` wrote.

    Parameters
    ----------
    text : str

    Returns
    -------
    tuple of Statement

    Raises
    ------
    LookupError, TypeError, ValueError
        The text is not of that format.
    """
    named = {cls.__name__: cls for cls in _CLASSES}
    return tuple(named[name](**values) for name, values in json.loads(text))


# ------------------------------------------------------------------------------------------------
# Validation of single values.


def _labels(said: str | Sequence[str]) -> tuple[str, ...]:
    labels: tuple[Any, ...] = (said,)
    if isinstance(said, Iterable) and not isinstance(said, str):
        labels = tuple(said)
    if not labels or not all(isinstance(label, str) and label for label in labels):
        raise InputError(f"labels {said!r:.60} must be a label or some of them")
    return labels


def _numbers(values: Any, count: int, what: str) -> Any:
    array = np.asarray(values)
    if array.dtype.kind not in "iuf" or array.shape != (count,) or not np.isfinite(array).all():
        raise InputError(f"{what} must be {count} finite numbers, not {values!r:.80}")
    return tuple(array.astype(float).tolist())


def _whole(value: Any, what: str) -> int:
    try:
        return operator.index(value)
    except TypeError as error:
        raise InputError(f"{what} must be a whole number, not {value!r:.60}") from error


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


def _number(value: Any, what: str) -> float:
    right = isinstance(value, Real) and not isinstance(value, bool)
    if not right or not math.isfinite(value):
        raise InputError(f"{what} must be a finite number, not {value!r:.60}")
    return float(value)


def _positive(statement: Any, name: str, what: str, *, least: float = 0.0) -> None:
    """Convert a field to a float; it must be greater than 0, and not less than ``least``."""
    value = _number(getattr(statement, name), what)
    if not value > 0:
        raise InputError(f"{what} must be positive, not {value!r:.60}")
    if value < least:
        raise InputError(f"{what} must be {least:g} or more, not {value:g}")
    object.__setattr__(statement, name, value)


def _require_bool(value: Any, what: str) -> None:
    if not isinstance(value, bool | np.bool_):
        raise InputError(f"{what} must be True or False, not {value!r:.60}")


def _require_named(rows: Sequence[dict[str, float]], named: dict[str, float]) -> None:
    for label, share in ((label, share) for row in rows for label, share in row.items()):
        if share > named.get(label, 0.0):
            raise InputError(
                f"a box is a {label} with probability {share:g}, but all labels together name one "
                f"with {named.get(label, 0.0):g}"
            )


def _require_doubt(doubt: float, what: str) -> None:
    if not 1e-12 <= _number(doubt, f"{what}: doubt") < 1:
        raise InputError(f"{what}: doubt = {doubt!r:.60} must be a probability, 1e-12 or more")


def _require_joint(joint: str) -> None:
    if joint not in JOINTS:
        raise InputError(f"{joint!r:.60} is no joint; name one of {', '.join(JOINTS)}")
