"""Tables 1 and 2 of the paper with measured values, and readers of detections and depth maps.

In the paper a region detector finds an object if at least half of the object's region is detected
under the right label, on average over all frames. Its position in a depth map is the mean position
of the samples in its region (Monszpart et al. 2019, section 7.2). Here an object's region is the
hull of its true boxes in the image, and that of a detection is its box.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from shapely import MultiPoint, Polygon, box, contains_xy, convex_hull, unary_union

from imapper_prob.clips.parsing import load_archive, load_json, numbers
from imapper_prob.evaluate.score import SUBSETS, Score
from imapper_prob.evaluate.tables import Rows, number
from imapper_prob.evaluate.truth import GROUPS, Outline, TruthInView
from imapper_prob.models.camera import Camera
from imapper_prob.models.errors import InputError
from imapper_prob.models.scene import Clip

__all__ = [
    "NAMES",
    "OBJECTS",
    "POSES",
    "OnClip",
    "count_detected",
    "depth_errors",
    "published_object_rows",
    "published_pose_rows",
    "read_depths",
    "read_regions",
    "region_of",
]

Array = NDArray[np.float64]
Regions = dict[int, list[tuple[str, Polygon]]]
_DETECTED: Final = 0.5
"""Least fraction of an object's region that must be detected, on average over the frames."""
_SURE: Final = 0.5
"""Least score of a detection, at which such detectors draw a box."""
_NEEDED: Final = frozenset({"image_id", "category_id", "bbox", "score"})
_COCO: Final = {62: "chair", 63: "couch", 67: "table"}
"""Furniture labels by COCO's category numbers; other numbers need a table of categories in the
file."""
_NEAREST: Final = 0.1
"""Metres in front of the camera below which a corner is not projected."""


def region_of(item: Outline, camera: Camera) -> Polygon:
    """Region of an object in the image: the hull of its boxes' corners, clipped to the image.

    Parameters
    ----------
    item : Outline
    camera : Camera

    Returns
    -------
    shapely.Polygon
        Pixels.
    """
    ahead = item.corners[item.corners[:, 1] > _NEAREST]
    if len(ahead) < 3:
        return Polygon()
    hull = convex_hull(MultiPoint(camera.project_camera(ahead)))
    return hull.intersection(box(0, 0, camera.width, camera.height))


def read_regions(path: str | Path, clip: Clip) -> Regions:
    """Read detections by frame from a list of COCO results.

    Entries have ``image_id`` (a frame number, or a name that contains one), ``category_id``,
    ``bbox`` (x, y, width, height from the top left, pixels of the clip's image) and ``score``.
    Alternatively the file is an object with that list under ``detections`` and, optionally,
    ``categories`` (number and name of each) and ``size`` (width and height of the image).

    Parameters
    ----------
    path : path
    clip : Clip

    Returns
    -------
    dict of int to list of (str, Polygon)

    Raises
    ------
    InputError
        The file is damaged, of another image size, or a category or frame is unknown.
    """
    path = Path(path)
    data = load_json(path)
    listed, names = data, dict(_COCO)
    if isinstance(data, Mapping):
        listed = data.get("detections")
        names = _categories(path, data) if "categories" in data else names
        _require_size(path, data.get("size"), clip)
    if not isinstance(listed, list):
        raise InputError(f"{path}: no list of detections")
    found: Regions = {int(frame): [] for frame in clip.frame_ids}
    for count, entry in enumerate(listed):
        place = f"{path}, detection {count}"
        if not isinstance(entry, Mapping) or not set(entry) >= _NEEDED:
            raise InputError(f"{place}: needs image_id, category_id, bbox and score")
        frame = _frame(place, entry["image_id"])
        if frame not in found:
            raise InputError(f"{place}: frame {frame} is not of {clip.name}")
        x, y, width, height = numbers(entry["bbox"], shape=(4,), place=f"{place}: bbox")
        score = float(numbers(entry["score"], shape=(), place=f"{place}: score"))
        if not (min(width, height) > 0 and 0 <= score <= 1):
            raise InputError(
                f"{place}: the box is {width:g} x {height:g} px with a score of {score:g}; both "
                "sides must be positive, and the score from 0 to 1"
            )
        if x + width > clip.camera.width + 1 or y + height > clip.camera.height + 1:
            raise InputError(
                f"{place}: the box ends at ({x + width:.0f}, {y + height:.0f}), outside of "
                f"images of {clip.camera.width} x {clip.camera.height}; of another image size?"
            )
        category = entry["category_id"]
        if not isinstance(category, int):
            raise InputError(f"{place}: category_id must be a whole number")
        label = names.get(category)
        if label is not None and score >= _SURE:
            found[frame].append((label, box(x, y, x + width, y + height)))
    return found


def _categories(path: Path, data: Mapping[str, Any]) -> dict[int, str]:
    listed = data["categories"]
    ok = isinstance(listed, list) and all(
        isinstance(c, Mapping) and isinstance(c.get("id"), int) and isinstance(c.get("name"), str)
        for c in listed
    )
    if not ok:
        raise InputError(f"{path}: 'categories' must list id and name of each")
    return {c["id"]: c["name"].lower().replace("dining table", "table") for c in listed}


def _require_size(path: Path, size: Any, clip: Clip) -> None:
    if size is None:
        return
    width, height = numbers(size, shape=(2,), place=f"{path}: size").astype(int).tolist()
    if (width, height) != (clip.camera.width, clip.camera.height):
        raise InputError(
            f"{path}: is of images of {width} x {height}, those of {clip.name} are "
            f"{clip.camera.width} x {clip.camera.height}"
        )


def _frame(place: str, given: Any) -> int:
    digits = re.findall(r"\d+", Path(str(given)).stem)
    if isinstance(given, bool) or not digits:
        raise InputError(f"{place}: {str(given)[:40]!r} holds no frame number")
    try:
        return int(digits[-1])
    except ValueError as error:  # more digits than Python converts
        raise InputError(f"{place}: {str(given)[:40]!r} holds no frame number") from error


def count_detected(regions: Regions, truth: TruthInView, camera: Camera) -> int:
    """Number of used objects detected in the image: half of the region under the right label.

    Parameters
    ----------
    regions : dict of int to list of (str, Polygon)
        Detections by frame, see :func:`read_regions`.
    truth : TruthInView
    camera : Camera

    Returns
    -------
    int
    """
    count = 0
    for item in truth.used_objects:
        region = region_of(item, camera)
        if not region.area:
            continue
        shares = []
        for found in regions.values():
            alike = [r for label, r in found if GROUPS.get(label, label) == item.group]
            shares.append(unary_union(alike).intersection(region).area / region.area)
        count += bool(shares) and float(np.mean(shares)) >= _DETECTED
    return count


def read_depths(path: str | Path, clip: Clip) -> Array:
    """Read depth maps from the array ``depth`` of an ``.npz``.

    Parameters
    ----------
    path : path
    clip : Clip

    Returns
    -------
    (F, h, w) float
        Depth along the optical axis, metres. Maps may be smaller than the image but must have its
        proportions; samples that are not positive and finite are ignored.

    Raises
    ------
    InputError
        The file is damaged, or the maps have other proportions than the image.
    """
    path = Path(path)
    arrays = load_archive(path, what="depth maps")
    if "depth" not in arrays or arrays["depth"].dtype.kind not in "fiu":
        raise InputError(f"{path}: no depth maps; expected an array 'depth' of numbers")
    depth = arrays["depth"].astype(np.float64)
    if depth.ndim != 3 or not depth.size:
        raise InputError(f"{path}: 'depth' must be maps x lines x columns, not {depth.shape}")
    wide, high = depth.shape[2] / clip.camera.width, depth.shape[1] / clip.camera.height
    if abs(wide - high) > 0.02 * max(wide, high):
        raise InputError(
            f"{path}: maps of {depth.shape[2]} x {depth.shape[1]} do not have the proportions of "
            f"{clip.camera.width} x {clip.camera.height}"
        )
    return depth


def depth_errors(depth: Array, truth: TruthInView, camera: Camera) -> Array:
    """Distances of true centroids from the mean positions of the depth samples in their regions.

    Parameters
    ----------
    depth : (F, h, w) float
        Metres, see :func:`read_depths`.
    truth : TruthInView
    camera : Camera

    Returns
    -------
    (n,) float
        Metres, of the used objects that have a sample in the image.
    """
    _, lines, columns = depth.shape
    x = (np.arange(columns) + 0.5) * camera.width / columns
    y = (np.arange(lines) + 0.5) * camera.height / lines
    pixels = np.stack(np.meshgrid(x, y), -1)
    rays = camera.rays(pixels)
    errors = []
    for item in truth.used_objects:
        inside = contains_xy(region_of(item, camera), pixels[..., 0], pixels[..., 1])
        samples = depth[:, inside]
        there = np.isfinite(samples) & (samples > 0)
        if not there.any():
            continue
        points = (samples[..., None] * rays[inside])[there]
        errors.append(float(np.linalg.norm(points.mean(0) - item.middle)))
    return np.array(errors)


# ------------------------------------------------------------------------------------------------
# The tables.

NAMES: Final = {
    "Scene04": "Scene4", "Scene10": "Lobby2", "Scene13": "Library1", "Scene14": "Garden",
}  # fmt: skip
"""Names of the public scenes in the paper, by file name."""


@dataclass(frozen=True)
class ObjectRow:
    """A row of table 1 (Monszpart et al. 2019).

    Parameters
    ----------
    frames : int
    occluded : float
        Fraction of the frames with occlusion.
    objects : int
        Objects that somebody interacts with.
    region_detector : int
        Number of these found by Mask-RCNN.
    depth, imapper : (float, float)
        Mean and standard deviation of the distance of centroids in cm: of monocular depth, and of
        the authors' method; the deviation is NaN for a single object.
    """

    frames: int
    occluded: float
    objects: int
    region_detector: int
    depth: tuple[float, float]
    imapper: tuple[float, float]


_NAN: Final = float("nan")
OBJECTS: Final = {
    "Office1": ObjectRow(348, 1.00, 7, 5, (263, 117), (81, 43)),
    "LvRoom": ObjectRow(380, 0.84, 5, 4, (98, 36), (57, 32)),
    "Library1": ObjectRow(539, 0.49, 6, 5, (174, 73), (83, 29)),
    "Garden": ObjectRow(430, 0.86, 5, 5, (242, 68), (58, 28)),
    "Lobby1": ObjectRow(254, 0.65, 3, 1, (243, 98), (70, 55)),
    "Lobby2": ObjectRow(224, 0.97, 4, 1, (259, 101), (51, 21)),
    "Scene1": ObjectRow(80, 0.00, 1, 2, (120, _NAN), (45, _NAN)),
    "Scene2": ObjectRow(130, 0.57, 2, 5, (120, 10), (72, 6)),
    "Scene3": ObjectRow(120, 0.82, 1, 1, (191, _NAN), (25, _NAN)),
    "Scene4": ObjectRow(115, 0.77, 2, 2, (203, 12), (70, 57)),
    "Scene5a": ObjectRow(49, 0.84, 2, 2, (197, 24), (135, 13)),
    "Scene5b": ObjectRow(148, 0.93, 3, 2, (230, 52), (72, 41)),
    "Scene5c": ObjectRow(182, 1.00, 4, 2, (229, 48), (53, 49)),
    "Scene5d": ObjectRow(189, 0.98, 4, 2, (216, 50), (69, 38)),
}
"""All fourteen rows of table 1. Leave-one-out over PiGraphs, in the text: 110 (56) cm."""
Triple = tuple[float, float, float]
_NONE: Final[Triple] = (_NAN, _NAN, _NAN)
METHODS: Final = ("Tome3D", "LCR-Net++3D", "VNect", "iMapper")
POSES: Final[dict[str, tuple[Triple, Triple, Triple, Triple]]] = {
    "LvRoom": ((_NAN, 22.1, 346.0), (_NAN, 12.0, 77.0), _NONE, (71.5, 20.9, 197.6)),
    "Lobby1": ((_NAN, 28.1, 122.5), (_NAN, 21.9, 63.6), _NONE, (60.8, 29.2, 148.9)),
    "Lobby2": ((_NAN, 19.6, 81.0), (_NAN, 20.1, 73.6), _NONE, (32.0, 19.2, 68.6)),
    "Scene3": ((_NAN, 22.4, 70.6), (_NAN, 19.2, 83.5), _NONE, (56.7, 19.7, 65.4)),
    "Scene4": ((_NAN, 25.1, 91.6), (_NAN, 20.7, 104.1), _NONE, (61.8, 13.6, 46.3)),
    "GrRoom": ((_NAN, 35.5, 237.9), (_NAN, 20.0, 150.4), (68.3, 28.9, 171.1), (40.3, 23.5, 138.5)),
}
"""Table 2 by :data:`METHODS`: world cm, local cm, pixels, for frames with three or more hidden
joints. GrRoom is from MPI-INF-3DHP, the others from i3DB."""
_CLOSE: Final = 0.05
"""Half a unit of the last printed digit of table 2, the tolerance for a reproduced row."""
_LIFTER: Final = "input path"
"""Name of the lifter's output among the public files: Tome3D's, in one scene LCR-Net++'s."""


@dataclass(frozen=True, eq=False)
class OnClip:
    """This program's results on a public clip.

    Parameters
    ----------
    truth : TruthInView
    scores : mapping of str to Score
        Scores by method.
    regions : mapping of str to int
        Number of used objects found in the image, by detector.
    depths : mapping of str to (n,) float
        Distances of centroids in metres, by depth estimator.
    """

    truth: TruthInView
    scores: Mapping[str, Score]
    regions: Mapping[str, int] = field(default_factory=dict)
    depths: Mapping[str, np.ndarray] = field(default_factory=dict)

    @property
    def occluded(self) -> float:
        """Fraction of the annotated frames in which a joint is hidden."""
        return float(self.truth.hidden[self.truth.known].any(1).mean())


def published_object_rows(clips: Mapping[str, OnClip], ours: Sequence[str], theirs: str) -> Rows:
    """Rows of table 1, with printed and measured values in every column.

    Parameters
    ----------
    clips : mapping of str to OnClip
        By the name of the clip.
    ours : sequence of str
        Methods with columns of their own.
    theirs : str
        Name of the authors' public files among the scores.

    Returns
    -------
    list of tuple of str
    """
    rows: Rows = [
        ("scene", "clip", "frames", "frames with occlusion", "objects", "Mask-RCNN finds",
         "MonoDepth, cm", "iMapper printed, cm", "its public files: top view, cm", "in space, cm",
         *(f"{name}: top view, cm" for name in ours)),
    ]  # fmt: skip
    for name, row in OBJECTS.items():
        clip = _clip(name)
        found = clips.get(clip)
        printed = [str(row.frames), f"{row.occluded:.2f}", str(row.objects)]
        others = [str(row.region_detector), _mean_spread(*row.depth)]
        if found is None:
            nothing = ["–"] * (2 + len(ours))
            mine = _mean_spread(*row.imapper)
            rows.append((name, "not at hand", *printed, *others, mine, *nothing))
            continue
        truth = found.truth
        counts = [str(len(truth.frame_ids)), f"{found.occluded:.2f}", str(len(truth.used))]
        seen = [f"{n} ({method})" for method, n in found.regions.items()]
        deep = [f"{_errors(100 * d)} ({method})" for method, d in found.depths.items()]
        authors = found.scores.get(theirs)
        rows.append(
            (
                name,
                clip,
                *(f"{p} / {c}" for p, c in zip(printed, counts, strict=True)),
                " / ".join([others[0], *seen]),
                " / ".join([others[1], *deep]),
                _mean_spread(*row.imapper),
                *_two_readings(authors),
                *(_two_readings(found.scores.get(own))[0] for own in ours),
            )
        )
    return rows


def published_pose_rows(clips: Mapping[str, OnClip], ours: Sequence[str], theirs: str) -> Rows:
    """Rows of table 2: world cm / local cm / pixels.

    Parameters
    ----------
    clips, ours, theirs
        See :func:`published_object_rows`.

    Returns
    -------
    list of tuple of str
    """
    rows: Rows = [
        ("scene", "clip", *(f"{m} printed" for m in METHODS), "lifter's public file",
         "iMapper's public files", "reproduced", *ours),
    ]  # fmt: skip
    for name, methods in POSES.items():
        clip = _clip(name)
        found = clips.get(clip)
        printed = tuple(_triple(values) for values in methods)
        if found is None:
            nothing = ("–",) * (3 + len(ours))
            rows.append((name, "not at hand", *printed, *nothing))
            continue
        told = {m: s.pose[SUBSETS[2]] for m, s in found.scores.items()}
        values = {m: (s.world, s.local, s.pixels) for m, s in told.items()}
        lifter = values.get(_LIFTER, _NONE)
        authors = values.get(theirs, _NONE)
        same = all(abs(a - b) <= _CLOSE for a, b in zip(authors, methods[3], strict=True))
        rows.append(
            (
                name,
                clip,
                *printed,
                _triple(lifter),
                _triple(authors),
                "yes" if same else "no",
                *(_triple(values.get(own, _NONE)) for own in ours),
            )
        )
    return rows


def _two_readings(score: Score | None) -> tuple[str, str]:
    """Distances of centres in top view, and in 3D, as text in cm."""
    pairs = score.objects.pairs if score is not None else ()
    flat, space = (np.array([100 * getattr(p, n) for p in pairs]) for n in ("distance", "apart"))
    return _errors(flat), _errors(space)


def _errors(values: np.ndarray) -> str:
    if not len(values):
        return "–"
    return _mean_spread(float(values.mean()), float(values.std()) if len(values) > 1 else _NAN)


def _mean_spread(mean: float, spread: float) -> str:
    return f"{number(mean)} ({number(spread)})"


def _triple(values: Sequence[float]) -> str:
    return "–" if np.isnan(values).all() else " / ".join(number(v, 1) for v in values)


def _clip(name: str) -> str:
    return next((clip for clip, own in NAMES.items() if own == name), "")
