"""Statements about a scene: knowledge besides the detections, as terms of the posterior.

A statement is an answer or a measurement. Its term is the density of that answer given the scene
(docs/explanation/model.md 25 to 34); :mod:`imapper_prob.models.kernels.statement_terms` evaluates
it. Lengths are in metres in the world frame of a scene: floor at z = 0, camera above the origin,
looking along y. Frame numbers are those of the clip. ``doubt`` is the probability that an answer
was given by chance.

Here are the statements about the room, the camera and the person; those about furniture are in
:mod:`imapper_prob.models.furniture_statements`.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Final, Literal, get_args

from imapper_prob.models.errors import InputError, require_number, require_whole
from imapper_prob.models.furniture_statements import (
    Behind,
    Contact,
    ObjectAt,
    Presence,
    SameObject,
    Seen,
)
from imapper_prob.models.settings import HIGHEST_CAMERA, LOWEST_CAMERA, NEAREST, STEEPEST_CAMERA
from imapper_prob.models.skeleton import JOINTS
from imapper_prob.models.statement_values import (
    DOUBT,
    LEAST_METRES,
    MOST_METRES,
    Points,
    as_numbers,
    as_polygon,
    require_doubt,
    store,
)

__all__ = [
    "QUANTITIES",
    "DepthOf",
    "JointAt",
    "Measured",
    "Room",
    "Statement",
    "describe",
    "from_json",
    "to_json",
]

_RANGES: Final = {
    "pitch": (-math.degrees(STEEPEST_CAMERA), math.degrees(STEEPEST_CAMERA)),
    "height": (LOWEST_CAMERA, HIGHEST_CAMERA),
    "focal": (1.0, 1e5),
    "stature": (0.5, 2.5),
}
"""Range of each quantity that can be measured: degrees, metres, pixels, metres."""
QUANTITIES: Final = tuple(_RANGES)
"""Quantities that can be measured; the index is their number in a problem."""
_FINEST: Final = 1e-6
"""Least standard deviation of a measurement over the range of its quantity; chosen."""
_LEAST_SHARE: Final = 1e-4
"""Least standard deviation of relative depths; chosen, see ``LEAST_METRES``."""


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
        _require_name(self.quantity, QUANTITIES, "not measured")
        what, (least, most) = f"the measured {self.quantity}", _RANGES[self.quantity]
        store(
            self,
            value=require_number(what, self.value, above=least, below=most),
            std=require_number(
                f"the std of {what}", self.std, least=_FINEST * (most - least), most=most - least
            ),
        )


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
        Probability that the answer was given by chance, in (0, 1).

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
    doubt: float = DOUBT

    def __post_init__(self) -> None:
        store(
            self,
            walls=as_polygon("the walls of the room", self.walls),
            std=require_number("std of the walls", self.std, least=LEAST_METRES, most=MOST_METRES),
            doubt=require_doubt("the room", self.doubt),
        )


@dataclass(frozen=True)
class JointAt:
    """The measured 3D position of a joint in one frame.

    Parameters
    ----------
    joint : str
        Such as ``"PELV"`` or ``"RWRI"``.
    frame : int
        By the clip's own frame numbers.
    point : (float, float, float)
        x, y and z in the world of the scene, m.
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
        _require_name(self.joint, JOINTS, "no joint")
        store(
            self,
            frame=require_whole("frame", self.frame),
            person=require_whole("person", self.person, least=1),
            point=as_numbers(f"the point of {self.joint}", self.point, 3, most=MOST_METRES),
            std=require_number(
                f"std of the point of {self.joint}",
                self.std,
                least=LEAST_METRES,
                most=MOST_METRES,
            ),
        )


@dataclass(frozen=True)
class DepthOf:
    """Depths of a joint along the camera's optical axis, measured by another system.

    Parameters
    ----------
    frames : sequence of int
        By the clip's own frame numbers.
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
        _require_name(self.joint, JOINTS, "no joint")
        depths_of = f"depths of {self.joint}"
        store(
            self,
            frames=tuple(require_whole("frame", frame) for frame in self.frames),
            person=require_whole("person", self.person, least=1),
            error=require_number(
                f"error of the {depths_of}", self.error, least=_LEAST_SHARE, most=1
            ),
            scale_error=require_number("scale_error", self.scale_error, least=0, most=1),
        )
        depths = as_numbers(
            f"{depths_of}, one for each frame, in metres,",
            self.depths,
            len(self.frames),
            most=MOST_METRES,
        )
        if not depths or len(set(self.frames)) < len(depths):
            raise InputError(f"{depths_of}: say each frame once, and at least one")
        if not min(depths) > NEAREST:
            raise InputError(f"{depths_of}: {min(depths):g} m is behind the camera")
        store(self, depths=depths)


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
    named = {cls.__name__: cls for cls in get_args(Statement)}
    return tuple(named[name](**values) for name, values in json.loads(text))


def _require_name(name: str, known: Sequence[str], lack: str) -> None:
    if name not in known:
        raise InputError(f"{name!r:.60} is {lack}; name one of {', '.join(known)}")
