"""Read statements about a scene from TOML and from other programs' files that it names.

Boxes of objects are read from files in COCO's results format, depths from CSV or ``.npz``. Unknown
keys are refused; messages name the table.
"""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np

from imapper_prob.clips.parsing import LARGEST_NUMBER, load_archive, load_json, numbers
from imapper_prob.files import read_text, read_toml
from imapper_prob.models.errors import InputError
from imapper_prob.models.furniture_statements import (
    Behind,
    Contact,
    ObjectAt,
    Presence,
    SameObject,
    Seen,
)
from imapper_prob.models.problem import labels_of
from imapper_prob.models.scene import Clip
from imapper_prob.models.scenelet import Library
from imapper_prob.models.settings import LARGEST_IMAGE
from imapper_prob.models.statement_rows import check_statements
from imapper_prob.models.statements import DepthOf, JointAt, Measured, Room, Statement

__all__ = ["check_file", "read_statements"]

_MEASURED: Final = {"camera": ("pitch", "height", "focal"), "person": ("stature",)}
_LOWEST_SCORE: Final = 0.3
"""Score below which boxes are left out, as in detectors' own viewers; chosen."""


def read_statements(path: str | Path) -> tuple[Statement, ...]:
    """Read statements from a TOML file.

    Parameters
    ----------
    path : path
        See ``docs/how-to/say_what_is_known.md``. Files that it names are in the same folder.

    Returns
    -------
    tuple of Statement

    Raises
    ------
    InputError
        The file is missing, not TOML, empty, or has an invalid key or value.

    Examples
    --------
    >>> from pathlib import Path
    >>> _ = Path("given.toml").write_text("[camera]\\nheight = [1.6, 0.02]")
    >>> im.read_statements("given.toml")
    (Measured(quantity='height', value=1.6, std=0.02),)
    """
    path = Path(path)
    tables = read_toml(path)
    unknown = sorted(set(tables) - {*_MEASURED, *_READERS})
    if unknown:
        raise InputError(
            f"{path}: unknown table {unknown[0]!r}; known are "
            f"{', '.join(sorted({*_MEASURED, *_READERS}))}"
        )
    statements: list[Statement] = []
    for name, table in tables.items():
        if name in _MEASURED:
            statements += _measured(name, table, f"{path}: [{name}]")
            continue
        entries = table if isinstance(table, list) else [table]
        for number, entry in enumerate(entries, 1):
            where = f"{path}: {name} {number}"
            if not isinstance(entry, dict):
                raise InputError(f"{where} must be a table, [[{name}]]")
            statements.append(_read(_READERS[name], entry, where, path.parent))
    if not statements:
        raise InputError(f"{path}: says nothing")
    return tuple(statements)


def check_file(path: Path, statements: Sequence[Statement], clip: Clip, library: Library) -> None:
    """Refuse statements of a file that no scene of a clip and library can fulfil.

    Parameters
    ----------
    path : Path
    statements : sequence of Statement
        Those of the file.
    clip : Clip
    library : Library

    Raises
    ------
    InputError
        See :func:`imapper_prob.models.statement_rows.check_statements`; the message names the file.
    """
    try:
        check_statements(statements, clip, labels_of(library))
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def _measured(name: str, table: Any, where: str) -> Iterator[Statement]:
    if not isinstance(table, dict):
        raise InputError(f"{where} must be a table")
    for quantity, said in table.items():
        if quantity not in _MEASURED[name]:
            raise InputError(
                f"{where}: unknown key {quantity!r}; known are {', '.join(_MEASURED[name])}"
            )
        if not isinstance(said, list) or len(said) != 2 or not all(map(_is_number, said)):
            raise InputError(f"{where}: {quantity} must be [value, standard deviation]")
        value, std = map(float, said)
        yield _made(partial(Measured, quantity, value, std), where)


def _read(reader: _Reader, entry: dict[str, Any], where: str, folder: Path) -> Statement:
    needed, optional, make = reader
    missing, unknown = sorted(needed - set(entry)), sorted(set(entry) - needed - optional)
    if unknown:
        raise InputError(
            f"{where}: unknown key {unknown[0]!r}; known are {', '.join(sorted(needed | optional))}"
        )
    if missing:
        raise InputError(f"{where}: has no {missing[0]!r}")
    for key, value in entry.items():
        if key in _TEXTS and not isinstance(value, str):
            raise InputError(f"{where}: {key} = {value!r:.60} must be text")
        if key in _WHOLE and (not isinstance(value, int) or isinstance(value, bool)):
            raise InputError(f"{where}: {key} = {value!r:.60} must be a whole number")
    return _made(lambda: make(entry, folder), where)


_TEXTS: Final = ("joint", "file", "kind")
_WHOLE: Final = ("frame", "person")


def _made(make: Callable[[], Statement], where: str) -> Statement:
    try:
        return make()
    except InputError as error:
        raise InputError(f"{where}: {error}") from error
    except (TypeError, ValueError, ArithmeticError, AttributeError, LookupError) as error:
        raise InputError(f"{where}: has a value of the wrong kind ({error})") from error


def _is_number(value: Any) -> bool:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    return number and abs(value) < LARGEST_NUMBER


def _object(entry: dict[str, Any], _: Path) -> Statement:
    return ObjectAt(entry["label"], **_without(entry, "label"))


def _present(entry: dict[str, Any], _: Path) -> Statement:
    return Presence(entry["label"], there=True, **_without(entry, "label"))


def _absent(entry: dict[str, Any], _: Path) -> Statement:
    return Presence(entry["label"], there=False, **_without(entry, "label"))


def _room(entry: dict[str, Any], _: Path) -> Statement:
    return Room(**entry)


def _joint(entry: dict[str, Any], _: Path) -> Statement:
    return JointAt(**entry)


def _contact(entry: dict[str, Any], _: Path) -> Statement:
    if not _is_span(entry["frames"]):
        raise InputError("frames must be [first, last]")
    first, last = entry["frames"]
    more = _without(entry, "label", "frames", "kind")
    return Contact(entry["label"], first, last, _sits(entry), **more)


def _same_object(entry: dict[str, Any], _: Path) -> Statement:
    spans = entry["frames"]
    if not isinstance(spans, list) or not all(map(_is_span, spans)):
        raise InputError("frames must be [[first, last], [first, last]]")
    more = _without(entry, "label", "frames", "kind")
    return SameObject(entry["label"], tuple(map(tuple, spans)), _sits(entry), **more)


def _behind(entry: dict[str, Any], _: Path) -> Statement:
    return Behind(entry["label"], **_without(entry, "label"))


def _sits(entry: dict[str, Any]) -> bool:
    kind = entry.get("kind", "sits")
    if kind not in ("sits", "touches"):
        raise InputError(f"kind = {kind!r:.60} must be 'sits' or 'touches'")
    return bool(kind == "sits")


def _is_span(frames: Any) -> bool:
    return isinstance(frames, list) and len(frames) == 2 and all(map(_is_whole, frames))


def _depth(entry: dict[str, Any], folder: Path) -> Statement:
    said = dict(entry)
    if "file" in said:
        if "frames" in said or "depths" in said:
            raise InputError("has both a file and frames with depths; say one")
        said["frames"], said["depths"] = _depths(folder / said.pop("file"))
    elif not {"frames", "depths"} <= set(said):
        raise InputError("has neither a file nor frames with depths")
    if not isinstance(said["frames"], list) or not all(map(_is_whole, said["frames"])):
        raise InputError("frames must be whole numbers")
    return DepthOf(**said)


def _is_whole(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def _without(entry: Mapping[str, Any], *names: str) -> dict[str, Any]:
    return {name: value for name, value in entry.items() if name not in names}


def _depths(path: Path) -> tuple[list[int], list[float]]:
    """Frames and depths (m), from columns or arrays named ``frame`` and ``depth``."""
    try:
        if path.suffix == ".npz":
            arrays = load_archive(path, what="depths")
            frames, depths = arrays["frame"], arrays["depth"]
            if frames.dtype.kind not in "fiu" or not np.all(abs(frames) < 2**53):
                raise ValueError("a frame is no number")
            if (frames != frames.astype(int)).any():
                raise ValueError("a frame is no whole number")
            if depths.dtype.kind not in "fiu":
                raise ValueError("a depth is no number")
            return frames.astype(int).tolist(), depths.astype(float).tolist()
        reader = csv.DictReader(read_text(path).splitlines())
        rows, names = list(reader), list(reader.fieldnames or ())
        if not rows:
            raise ValueError("nothing is there")
        if len(set(names)) < len(names):
            raise ValueError("a column occurs twice")
        for number, row in enumerate(rows, 1):
            if None in row:
                raise ValueError(f"row {number} has more cells than columns; decimal commas?")
        return [int(row["frame"]) for row in rows], [float(row["depth"]) for row in rows]
    except InputError:
        raise
    except (KeyError, TypeError, ValueError, csv.Error) as error:
        raise InputError(
            f"{path}: must have frame (whole numbers) and depth (m), as columns of a CSV file or "
            f"arrays of an .npz ({error})"
        ) from error


# ------------------------------------------------------------------------------------------------
# Boxes of objects.


def _seen(entry: dict[str, Any], folder: Path) -> Statement:
    """Boxes of one image; ``labels`` maps the detector's labels to the library's."""
    path = folder / entry["file"]
    names, image = entry["labels"], entry.get("image", entry["frame"])
    if not isinstance(names, dict) or not all(map(_is_confusion, names.values())):
        raise InputError(
            "labels must be a table: of each label of the detector, by name or number, the "
            "library's label, or a table of these with the probability that it is called so"
        )
    least = entry.get("score", _LOWEST_SCORE)
    if not (_is_number(least) and 0 <= least <= 1):
        raise InputError(f"score = {least!r:.60} must be a number from 0 to 1")
    # Categories that are plain names of one label share it.
    plain = Counter(row for row in names.values() if isinstance(row, str))
    rows = {
        str(category): {row: 1 / plain[row]} if isinstance(row, str) else dict(row)
        for category, row in names.items()
    }
    found, confusion = [], []
    for box, score, label in _results(path, _name(image), rows):
        if score >= least and label in rows:
            left, top, width, height = box
            found.append((left, top, left + width, top + height))
            confusion.append(rows[label])
    more = _without(entry, "file", "labels", "image", "score")
    return Seen(boxes=tuple(found), confusion=tuple(confusion), named=_named(rows), **more)


def _named(rows: Mapping[str, Mapping[str, float]]) -> dict[str, float]:
    """Probability that a piece of each label of the library is called by one of the categories."""
    named: dict[str, float] = {}
    for row in rows.values():
        for label, share in row.items():
            named[label] = named.get(label, 0.0) + share
    for label, share in named.items():
        if share > 1 + 1e-9:
            raise InputError(
                f"labels: a {label} is called by one of them with probability {share:g}; give each "
                "category a table of probabilities that add up to 1 or less for each label"
            )
    return {label: min(share, 1.0) for label, share in named.items()}


def _is_confusion(value: Any) -> bool:
    if isinstance(value, dict):
        return all(map(_is_number, value.values()))
    return isinstance(value, str)


def _results(
    path: Path, image: str, categories: Collection[str]
) -> list[tuple[list[float], float, str]]:
    """Box (left, top, width, height), score and label of each result for one image.

    A file without this image, or without any of the categories, says nothing about what is in the
    image: its images and categories have other names.
    """
    results = load_json(path)
    if not isinstance(results, list):
        raise InputError(f"{path}: must be a list of results, as COCO's format has it")
    found, images, labels = [], set(), set()
    for number, result in enumerate(results):
        try:
            images.add(_name(result["image_id"]))
            labels.add(_name(result["category_id"]))
            if _name(result["image_id"]) != image:
                continue
            there = "bbox" in result or "segmentation" not in result
            box = result["bbox"] if there else _box_of_mask(result["segmentation"])
            box = numbers(box, shape=(4,), place="bbox").tolist()
            score = float(numbers(result["score"], shape=(), place="score"))
            label = _name(result["category_id"])
        except (KeyError, TypeError, ValueError, IndexError, OverflowError) as error:
            raise InputError(
                f"{path}: result {number} must have image_id, category_id, score, and bbox or "
                f"segmentation ({error})"
            ) from error
        if min(box[2:]) <= 0:
            raise InputError(f"{path}: result {number}: bbox must be left, top, width, height")
        if not 0 <= score <= 1:
            raise InputError(f"{path}: result {number}: score {score:g} must be from 0 to 1")
        found.append((box, score, label))
    if image not in images:
        raise InputError(
            f"{path}: has no result for image {image}, but for {_some(images)}; name the frame's "
            "own with image = "
        )
    if labels.isdisjoint(categories):
        raise InputError(
            f"{path}: has no category of labels ({', '.join(sorted(categories))}), but "
            f"{_some(labels)}"
        )
    return found


def _name(value: Any) -> str:
    """An identifier as text; the same for 62, 62.0 and "62"."""
    whole = isinstance(value, float) and value.is_integer()
    return str(int(value) if whole else value)


def _some(names: Collection[str]) -> str:
    first = ", ".join(f"{name:.40}" for name in sorted(names)[:5])
    return f"{first} and others" if len(names) > 5 else first or "none"


def _box_of_mask(mask: Any) -> list[float]:
    """Box (left, top, width, height) of a mask, given as polygons or column-wise run lengths."""
    if isinstance(mask, list):
        points = np.concatenate([np.asarray(part, float).reshape(-1, 2) for part in mask])
        low, high = points.min(0), points.max(0)
        return [*low.tolist(), *(high - low).tolist()]
    height, width = (int(side) for side in mask["size"])
    counts = mask["counts"]
    runs = np.array(_counts(counts) if isinstance(counts, str) else counts, np.int64)
    most = height * width
    if not 0 < most <= LARGEST_IMAGE**2 or (runs < 0).any() or (runs > most).any():
        raise ValueError("no runs of a mask")
    ends = runs.cumsum()
    first, last = ends[:-1:2], ends[1::2] - 1
    first, last = first[last >= first], last[last >= first]
    if not len(first) or ends[-1] != height * width:
        raise ValueError("the runs of a mask are not as many as its pixels, or all of them are 0")
    whole = last // height > first // height
    top = np.where(whole, 0, first % height).min()
    bottom = np.where(whole, height - 1, last % height).max()
    left, right = (first // height).min(), (last // height).max()
    return [float(x) for x in (left, top, right + 1 - left, bottom + 1 - top)]


def _counts(text: str) -> list[int]:
    """Run lengths from COCO's compressed text: differences to the last but one, five bits a
    character."""
    counts: list[int] = []
    value, shift = 0, 0
    for character in text:
        bits = ord(character) - 48
        if not 0 <= bits < 64 or shift > 50:
            raise ValueError("no runs of a mask")
        value |= (bits & 31) << shift
        shift += 5
        if not bits & 32:
            if bits & 16:
                value -= 1 << shift
            counts.append(value + (counts[-2] if len(counts) > 2 else 0))
            value, shift = 0, 0
    return counts


_Reader = tuple[set[str], set[str], Callable[[dict[str, Any], Path], Statement]]
_READERS: Final[Mapping[str, _Reader]] = {
    "object": (
        {"label"},
        {"place", "place_std", "size", "size_std", "box", "box_std", "doubt"},
        _object,
    ),
    "present": ({"label"}, {"region", "std", "doubt"}, _present),
    "absent": ({"label"}, {"region", "std", "doubt"}, _absent),
    "room": ({"walls"}, {"std", "doubt"}, _room),
    "joint": ({"joint", "frame", "point", "std"}, {"person"}, _joint),
    "depth": (
        {"error"},
        {"frames", "depths", "file", "scale_error", "joint", "person"},
        _depth,
    ),
    "contact": ({"label", "frames"}, {"kind", "doubt", "person"}, _contact),
    "same_object": ({"label", "frames"}, {"kind", "doubt", "people"}, _same_object),
    "behind": ({"label", "before"}, {"doubt"}, _behind),
    "detections": (
        {"file", "frame", "labels"},
        {"image", "score", "rate", "clutter", "std", "person"},
        _seen,
    ),
}
"""Required keys of a table, optional keys, and the function that makes a statement of it."""
