"""Statements about furniture: what is there, where it is, and who sits on it or touches it.

See :mod:`imapper_prob.models.statements`.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from imapper_prob.models.errors import InputError, require_number, require_whole
from imapper_prob.models.settings import LARGEST_IMAGE
from imapper_prob.models.statement_values import (
    DOUBT,
    LEAST_METRES,
    MOST_METRES,
    Points,
    as_numbers,
    as_polygon,
    require_doubt,
    require_flag,
    store,
)

__all__ = ["Behind", "Contact", "ObjectAt", "Presence", "SameObject", "Seen"]

_LEAST_PIXELS: Final = 0.01
"""Least standard deviation of measured edges in a picture, px; chosen, see ``LEAST_METRES``."""
_LEAST_CLUTTER: Final = 1e-12
_MOST_CLUTTER: Final = 1e3
"""Range of the expected number of false detections in a picture; chosen."""


@dataclass(frozen=True)
class ObjectAt:
    """A measured object of one of several labels; give at least one of place, size and box.

    Parameters
    ----------
    labels : str or sequence of str
        Possible labels of the object.
    place : (float, float), optional
        x (right) and y (away from the camera) of the centre on the floor, m, in the world of the
        scene: its origin is on the floor below the camera.
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
        Probability that the answer was given by chance, in (0, 1).

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
    doubt: float = DOUBT

    def __post_init__(self) -> None:
        store(self, labels=_labels(self.labels))
        if self.place is None and self.size is None and self.box is None:
            raise InputError(
                f"object {self}: neither place, size nor box is said; say one, or its presence"
            )
        if self.place is not None:
            std = require_number(
                f"place_std of {self}", self.place_std, least=LEAST_METRES, most=MOST_METRES
            )
            store(
                self,
                place=as_numbers(f"the place of {self}", self.place, 2, most=MOST_METRES),
                place_std=std,
            )
        if self.size is not None:
            std = require_number(
                f"size_std of {self}", self.size_std, least=LEAST_METRES, most=MOST_METRES
            )
            store(
                self,
                size=as_numbers(f"the size of {self}", self.size, 3, most=MOST_METRES),
                size_std=std,
            )
            if not min(self.size) > 0:
                raise InputError(f"object {self}: its size {self.size} must be positive")
        if self.box is not None:
            std = require_number(
                f"box_std of {self}", self.box_std, least=_LEAST_PIXELS, most=LARGEST_IMAGE
            )
            store(self, box=_box(f"the box of {self}", self.box), box_std=std)
        store(self, doubt=require_doubt(f"object {self}", self.doubt))

    def __str__(self) -> str:
        return _either(self.labels)


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
        Probability that the answer was given by chance, in (0, 1).

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
    doubt: float = DOUBT

    def __post_init__(self) -> None:
        store(self, labels=_labels(self.labels))
        if self.region is not None:
            store(self, region=as_polygon(f"the region of {self}", self.region))
        store(
            self,
            there=require_flag(f"there of {_either(self.labels)}", self.there),
            std=require_number(f"std of {self}", self.std, least=LEAST_METRES, most=MOST_METRES),
            doubt=require_doubt(str(self), self.doubt),
        )

    def __str__(self) -> str:
        where = "" if self.region is None else " in a region"
        return f"{'a' if self.there else 'no'} {_either(self.labels)}{where}"


@dataclass(frozen=True)
class Contact:
    """The person sits on, or touches, an object of one of several labels throughout some frames.

    Parameters
    ----------
    labels : str or sequence of str
    first, last : int
        First and last frame, by the clip's own numbers.
    sits : bool
        Whether the person sits on it; else a hand, a knee or the pelvis touches it.
    doubt : float
        Probability that the answer was given by chance, in (0, 1).
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
    doubt: float = DOUBT
    person: int = 1

    def __post_init__(self) -> None:
        labels = _labels(self.labels)
        what = f"contact with {_either(labels)}"
        first, last = _span(what, self.first, self.last)
        store(
            self,
            labels=labels,
            first=first,
            last=last,
            sits=require_flag(f"sits of the {what}", self.sits),
            doubt=require_doubt(what, self.doubt),
            person=require_whole("person", self.person, least=1),
        )


@dataclass(frozen=True)
class SameObject:
    """The person sits on, or touches, the same object throughout several spans of frames.

    Parameters
    ----------
    labels : str or sequence of str
    spans : sequence of (int, int)
        First and last frame of each span, by the clip's own numbers; two spans or more.
    sits : bool
        Whether the person sits on it; else a hand, a knee or the pelvis touches it.
    doubt : float
        Probability that the answer was given by chance, in (0, 1).
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
    doubt: float = DOUBT
    people: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        labels = _labels(self.labels)
        sits = require_flag(f"sits of the contact with one {_either(labels)}", self.sits)
        store(self, labels=labels, sits=sits)
        spans = tuple(_span(str(self), first, last) for first, last in self.spans)
        people = tuple(require_whole("person", n, least=1) for n in self.people) or (1,) * len(
            spans
        )
        if len(spans) < 2 or len(people) != len(spans):
            raise InputError(
                f"{self}: {len(spans)} spans of frames of {len(people)} people; say two spans or "
                "more, and a person for each"
            )
        store(self, spans=spans, people=people, doubt=require_doubt(str(self), self.doubt))

    def __str__(self) -> str:
        what = "sits on" if self.sits else "touches"
        return f"{what} the same {_either(self.labels)}"


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
        Probability that the answer was given by chance, in (0, 1).

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
    doubt: float = DOUBT

    def __post_init__(self) -> None:
        store(self, labels=_labels(self.labels), before=_labels(self.before))
        store(self, doubt=require_doubt(str(self), self.doubt))

    def __str__(self) -> str:
        return f"a {_either(self.labels)} behind a {_either(self.before)}"


@dataclass(frozen=True)
class Seen:
    """The complete output of an object detector in one frame.

    A piece of furniture is detected with probability ``rate`` times the share of its part in the
    image that is unoccluded.

    Parameters
    ----------
    frame : int
        By the clip's own frame numbers.
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
        boxes = tuple(_box("a box in the picture", box) for box in self.boxes)
        confusion = tuple(_shares(row) for row in self.confusion)
        named = None if self.named is None else _shares(self.named)
        if len(boxes) != len(confusion):
            raise InputError(f"{len(boxes)} boxes in the picture, but {len(confusion)} labels")
        if named is not None:
            _require_named(confusion, named)
        store(
            self,
            frame=require_whole("frame", self.frame),
            boxes=boxes,
            confusion=confusion,
            rate=require_number("rate", self.rate, above=0, below=1),
            clutter=require_number(
                "clutter", self.clutter, least=_LEAST_CLUTTER, most=_MOST_CLUTTER
            ),
            std=require_number(
                "std of the boxes in the picture",
                self.std,
                least=_LEAST_PIXELS,
                most=LARGEST_IMAGE,
            ),
            person=require_whole("person", self.person, least=1),
            named=named,
        )


# ------------------------------------------------------------------------------------------------
# Checks of labels, spans and boxes, which return them in the type of their field.


def _labels(said: str | Sequence[str]) -> tuple[str, ...]:
    labels: tuple[Any, ...] = (said,)
    if isinstance(said, Iterable) and not isinstance(said, str):
        labels = tuple(said)
    if not labels or not all(isinstance(label, str) and label for label in labels):
        raise InputError(f"labels {said!r:.60} must be a label or some of them")
    return labels


def _either(labels: Sequence[str]) -> str:
    return " or ".join(labels)


def _span(what: str, first: Any, last: Any) -> tuple[int, int]:
    first, last = require_whole("first", first), require_whole("last", last)
    if last < first:
        raise InputError(f"{what}: the last frame {last} is before the first, {first}")
    return first, last


def _box(what: str, values: Any) -> tuple[float, ...]:
    left, top, right, bottom = box = as_numbers(what, values, 4, most=10.0 * LARGEST_IMAGE)
    if not (left < right and top < bottom):
        raise InputError(f"{what} must be left, top, right, bottom in pixels, not {box}")
    return box


def _shares(row: Any) -> dict[str, float]:
    """Probabilities by label."""
    return {
        label: require_number(f"the probability of {label!r:.60}", share, least=0, most=1)
        for label, share in dict(row).items()
    }


def _require_named(rows: Sequence[dict[str, float]], named: dict[str, float]) -> None:
    for label, share in ((label, share) for row in rows for label, share in row.items()):
        if share > named.get(label, 0.0):
            raise InputError(
                f"a box is a {label} with probability {share:g}, but all labels together name one "
                f"with {named.get(label, 0.0):g}"
            )
