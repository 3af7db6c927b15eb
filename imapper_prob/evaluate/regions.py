"""Objects as others see them in the image: regions of detectors, and maps of depth.

The paper counts an object as found by a region detector if at least half of its region is
detected under the right label, on average over all frames, and takes as its place in a depth map
the mean position of the samples in its region (Monszpart et al. 2019, section 7.2). A region is
here the hull of the true boxes in the image, and that of a detection its box.
"""

from __future__ import annotations

import re
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from shapely import MultiPoint, Polygon, box, contains_xy, convex_hull, unary_union

from imapper_prob.evaluate.outline import GROUPS, Outline
from imapper_prob.evaluate.truth import TruthInView
from imapper_prob.inputs.json_fields import load_json, numbers
from imapper_prob.models.camera import Camera
from imapper_prob.models.errors import InputError
from imapper_prob.models.scene import Clip

__all__ = ["count_detected", "depth_errors", "read_depths", "read_regions", "region_of"]

Array = NDArray[np.float64]
Regions = dict[int, list[tuple[str, Polygon]]]

_DETECTED: Final = 0.5
"""Part of an object's region that must be detected, on average over the frames."""
_SURE: Final = 0.5
"""Least score of a detection; that at which such detectors draw a box."""
_NEEDED: Final = frozenset({"image_id", "category_id", "bbox", "score"})
_COCO: Final = {62: "chair", 63: "couch", 67: "table"}
"""Furniture by the category numbers of COCO's annotations; other numbers need a table of
categories."""
_NEAREST: Final = 0.1
"""Metres before the camera, nearer than which a corner has no place in the image."""


def region_of(item: Outline, camera: Camera) -> Polygon:
    """Where an object is in the image: the hull of its boxes' corners, cut off at the edges."""
    ahead = item.corners[item.corners[:, 1] > _NEAREST]
    if len(ahead) < 3:
        return Polygon()
    hull = convex_hull(MultiPoint(camera.project_camera(ahead)))
    return hull.intersection(box(0, 0, camera.width, camera.height))


def read_regions(path: str | Path, clip: Clip) -> Regions:
    """Detections by frame from a list of COCO results.

    Entries have ``image_id`` (a frame number, or a name with one in it), ``category_id``,
    ``bbox`` (x, y, width, height from the top left, pixels of the clip's image) and ``score``. Or
    the file is an object with the list under ``detections``, beside it ``categories`` (number and
    name of each) and ``size`` (width and height of the image).

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
        if x + width > clip.camera.width + 1 or y + height > clip.camera.height + 1:
            raise InputError(
                f"{place}: the box ends at ({x + width:.0f}, {y + height:.0f}), outside of "
                f"images of {clip.camera.width} x {clip.camera.height}; of another image size?"
            )
        label = names.get(entry["category_id"])
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
    return int(digits[-1])


def count_detected(regions: Regions, truth: TruthInView, camera: Camera) -> int:
    """How many used objects have half of their region under the right label, on average."""
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
    """(F, h, w) depth along the optical axis, metres, from an ``.npz`` with ``depth``.

    The maps may be smaller than the image, of the same proportions; samples that are not
    positive and finite are none.

    Raises
    ------
    InputError
        The file is damaged, or the maps have other proportions than the image.
    """
    path = Path(path)
    try:
        with np.load(path, allow_pickle=False) as arrays:
            depth = np.asarray(arrays["depth"], np.float64)
    except (KeyError, OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise InputError(f"{path}: no depth maps ({error}); expected an array 'depth'") from error
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
    """(n,) metres between true centroids and mean positions of the samples in the objects' regions.

    Of the used objects that have a sample in the image at all.
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
