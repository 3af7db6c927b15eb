"""Convert this program's types to rerun's archetypes, and log them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from imapper_prob.models.camera import Camera
from imapper_prob.models.geometry import pack_boxes
from imapper_prob.models.scene import Clip, SceneObject
from imapper_prob.models.skeleton import (
    HEAD,
    LANK,
    LELB,
    LHIP,
    LKNE,
    LSHO,
    LWRI,
    NECK,
    PELV,
    RANK,
    RELB,
    RHIP,
    RKNE,
    RSHO,
    RWRI,
    THRX,
)
from imapper_prob.recording.palette import FLOOR, FLOOR_LINE, TRUE_COLOUR, drawable
from imapper_prob.uncertainty.clusters import ObjectCluster

__all__ = [
    "PATH_RADIUS",
    "box_columns",
    "boxes",
    "camera_pose",
    "entity_part",
    "floor_lines",
    "floor_plane",
    "limbs",
    "log_moving",
    "log_person",
    "log_static",
    "name_columns",
    "names",
    "outlines",
    "own_entity",
    "paths",
    "pinhole",
    "position_ellipses",
    "regions",
]

Array = NDArray[np.float64]
_IMAGE_PLANE_DISTANCE = 0.7
"""Metres from the optical centre at which the image is drawn, large enough to read."""
_ELLIPSE_HEIGHT = 0.004
"""Half thickness in metres of an ellipse on the floor: flat but not degenerate."""
_QUANTILES = {0.5: 1.386, 0.9: 4.605}
"""Chi-square quantiles at two degrees of freedom, -2 log(1 - p)."""
_FLOOR_THICKNESS = 0.02
"""Metres; chosen by eye, so that the floor is visible from the side."""
_NAME_HEIGHT = 0.3
"""Metres above an object at which its name is drawn, above a person who sits there."""
_LIMBS = (
    (RANK, RKNE, RHIP, PELV, LHIP, LKNE, LANK),
    (PELV, THRX, NECK, HEAD),
    (RWRI, RELB, RSHO, THRX, LSHO, LELB, LWRI),
)
# rerun's camera looks along +z with x right and y down; this program's along +y with z up.
_OURS_FROM_RERUN = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])


def pinhole(camera: Camera) -> rr.Pinhole:
    """Intrinsics of a camera with axes x right, y down, z forward.

    Parameters
    ----------
    camera : Camera

    Returns
    -------
    rerun.Pinhole
    """
    return rr.Pinhole(
        focal_length=(camera.fx, camera.fy),
        principal_point=(camera.cx, camera.cy),
        width=camera.width,
        height=camera.height,
        camera_xyz=rr.ViewCoordinates.RDF,
        image_plane_distance=_IMAGE_PLANE_DISTANCE,
        color=(200, 205, 215),
    )


def camera_pose(camera: Camera) -> rr.Transform3D:
    """Rotation and translation from rerun's camera axes to the world.

    Parameters
    ----------
    camera : Camera

    Returns
    -------
    rerun.Transform3D
    """
    return rr.Transform3D(translation=camera.centre, mat3x3=camera.rotation @ _OURS_FROM_RERUN)


def boxes(
    objects: Sequence[SceneObject], categories: dict[str, int], *, outlined: bool = False
) -> rr.Boxes3D:
    """All cuboids of some objects as boxes.

    Parameters
    ----------
    objects : sequence of SceneObject
        In world coordinates.
    categories : dict of str to int
        Class numbers.
    outlined : bool
        Draw only their edges, in grey.

    Returns
    -------
    rerun.Boxes3D
    """
    centres, half_sizes, turns = _box_geometry(objects)
    if outlined:
        return rr.Boxes3D(
            centers=centres,
            half_sizes=half_sizes,
            quaternions=turns,
            colors=TRUE_COLOUR,
            radii=0.006,
            fill_mode=rr.components.FillMode.MajorWireframe,
        )
    return rr.Boxes3D(
        centers=centres,
        half_sizes=half_sizes,
        quaternions=turns,
        class_ids=_cuboid_classes(objects, categories),
        radii=0.006,
        fill_mode=rr.components.FillMode.TransparentFillMajorWireframe,
        show_labels=False,
    )


def box_columns(
    rows: Sequence[Sequence[SceneObject]], categories: dict[str, int]
) -> rr.ComponentColumnList:
    """Boxes with one row a scene: all cuboids of its objects.

    Parameters
    ----------
    rows : sequence of sequence of SceneObject
    categories : dict of str to int
        Class numbers.

    Returns
    -------
    rerun.ComponentColumnList
    """
    everything = [o for objects in rows for o in objects]
    lengths = [sum(len(o.cuboids) for o in objects) for objects in rows]
    centres, half_sizes, turns = _box_geometry(everything)
    columns = rr.Boxes3D.columns(
        centers=centres,
        half_sizes=half_sizes,
        quaternions=turns,
        class_ids=_cuboid_classes(everything, categories),
    )
    return columns.partition(lengths)


def names(objects: Sequence[SceneObject], categories: dict[str, int]) -> rr.Points3D:
    """Labels with each object's category, just above it.

    Parameters
    ----------
    objects : sequence of SceneObject
        In world coordinates.
    categories : dict of str to int
        Class numbers.

    Returns
    -------
    rerun.Points3D
    """
    return rr.Points3D(
        _above(objects),
        labels=[drawable(o.label) for o in objects],
        class_ids=[categories[o.label] for o in objects],
        radii=0.004,
        show_labels=True,
    )


def name_columns(
    draws: Sequence[Sequence[SceneObject]], categories: dict[str, int]
) -> rr.ComponentColumnList:
    """Labels with one row a draw: the categories of its objects, above them.

    Parameters
    ----------
    draws : sequence of sequence of SceneObject
    categories : dict of str to int
        Class numbers.

    Returns
    -------
    rerun.ComponentColumnList
    """
    everything = [o for objects in draws for o in objects]
    columns = rr.Points3D.columns(
        positions=_above(everything),
        labels=[drawable(o.label) for o in everything],
        class_ids=[categories[o.label] for o in everything],
    )
    return columns.partition([len(objects) for objects in draws])


def _above(objects: Sequence[SceneObject]) -> Array:
    """(n, 3) positions of the names."""
    above = np.array([0.0, 0.0, _NAME_HEIGHT])
    tops = [
        o.placement.apply(o.bounds.mean(0) * (1, 1, 0) + o.bounds[1] * (0, 0, 1)) + above
        for o in objects
    ]
    return np.reshape(tops, (-1, 3))


def position_ellipses(objects: Sequence[SceneObject], covariances: Array) -> rr.Ellipsoids3D:
    """The regions on the floor that hold 50 and 90 % of each object's position.

    Parameters
    ----------
    objects : sequence of SceneObject
        In world coordinates.
    covariances : (n_objects, 2, 2) float
        Square metres; objects whose covariance is not finite get no ellipse.

    Returns
    -------
    rerun.Ellipsoids3D
    """
    centres, half_sizes, turns = [], [], []
    for item, covariance in zip(objects, covariances, strict=True):
        if not np.isfinite(covariance).all():
            continue
        variances, axes = np.linalg.eigh(covariance)
        for quantile in _QUANTILES.values():
            radii = np.sqrt(np.maximum(variances, 0) * quantile)
            centres.append((*item.centre[:2], 2 * _ELLIPSE_HEIGHT))
            half_sizes.append((*np.maximum(radii, _ELLIPSE_HEIGHT), _ELLIPSE_HEIGHT))
            turns.append(np.arctan2(axes[1, 0], axes[0, 0]))
    return _on_floor(centres, half_sizes, turns)


def regions(clusters: Sequence[ObjectCluster]) -> rr.Ellipsoids3D:
    """Ellipses with 50 and 90 % of each object's position, over all draws.

    Parameters
    ----------
    clusters : sequence of ObjectCluster

    Returns
    -------
    rerun.Ellipsoids3D
    """
    found = [c.region(share) for c in clusters for share in _QUANTILES]
    return _on_floor(
        [(*r.centre, 2 * _ELLIPSE_HEIGHT) for r in found],
        [(*r.half_axes, _ELLIPSE_HEIGHT) for r in found],
        [r.angle for r in found],
    )


def outlines(objects: Sequence[SceneObject]) -> rr.LineStrips3D:
    """Footprints as closed lines on the floor, in the truth's grey.

    Parameters
    ----------
    objects : sequence of SceneObject
        In world coordinates.

    Returns
    -------
    rerun.LineStrips3D
    """
    corners = [np.column_stack([o.footprint, np.full(4, 2 * _ELLIPSE_HEIGHT)]) for o in objects]
    return rr.LineStrips3D(
        [np.concatenate([c, c[:1]]) for c in corners], colors=TRUE_COLOUR, radii=0.008
    )


def _on_floor(
    centres: Sequence[tuple[float, ...]],
    half_sizes: Sequence[tuple[float, ...]],
    turns: Sequence[float],
) -> rr.Ellipsoids3D:
    return rr.Ellipsoids3D(
        centers=np.array(centres, float).reshape(-1, 3),
        half_sizes=np.array(half_sizes, float).reshape(-1, 3),
        quaternions=_about_z(np.array(turns, float)),
        colors=(235, 235, 235),
        line_radii=0.005,
        fill_mode=rr.components.FillMode.MajorWireframe,
    )


def limbs(joints: Array) -> list[Array]:
    """Legs, spine and arms of one pose as three polylines; none if the pose is unknown.

    Parameters
    ----------
    joints : (16, 3) float
        Metres.

    Returns
    -------
    list of (n, 3) float
    """
    return [joints[list(chain)] for chain in _LIMBS] if np.isfinite(joints).all() else []


def paths(pelvis: Array) -> list[Array]:
    """The known intervals of a path as polylines.

    Parameters
    ----------
    pelvis : (T, 3) float
        Metres; NaN where unknown.

    Returns
    -------
    list of (n, 3) float
    """
    known = np.isfinite(pelvis).all(1)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], known, [False]]).astype(int)))
    return [pelvis[a:b] for a, b in edges.reshape(-1, 2) if b - a > 1]


def floor_plane(low: Array, high: Array) -> rr.Boxes3D:
    """A slab just under z = 0 between two corners, as the floor.

    Parameters
    ----------
    low, high : (2,) float
        Metres.

    Returns
    -------
    rerun.Boxes3D
    """
    size = (*(high - low), _FLOOR_THICKNESS)
    # A gap of a millimetre keeps the slab's top from flickering through the ellipses.
    centre = (*((low + high) / 2), -_FLOOR_THICKNESS / 2 - 0.001)
    return rr.Boxes3D(
        centers=[centre],
        sizes=[size],
        colors=FLOOR,
        fill_mode=rr.components.FillMode.Solid,
    )


def floor_lines(low: Array, high: Array) -> rr.LineStrips3D:
    """A grid of lines a metre apart between two corners.

    Parameters
    ----------
    low, high : (2,) float
        Whole metres.

    Returns
    -------
    rerun.LineStrips3D
    """
    (x0, y0), (x1, y1) = low, high
    across = [[(x0, y, 0.0), (x1, y, 0.0)] for y in np.arange(y0, y1 + 0.5)]
    along = [[(x, y0, 0.0), (x, y1, 0.0)] for x in np.arange(x0, x1 + 0.5)]
    return rr.LineStrips3D([*across, *along], colors=FLOOR_LINE, radii=0.004)


def _box_geometry(objects: Iterable[SceneObject]) -> tuple[Array, Array, Array]:
    """Centres (K, 3), half side lengths (K, 3) and quaternions (K, 4) of all cuboids."""
    packed = pack_boxes(objects)
    return packed[:, :3], packed[:, 3:6], _about_z(packed[:, 6])


def _cuboid_classes(objects: Iterable[SceneObject], categories: dict[str, int]) -> list[int]:
    return [categories[o.label] for o in objects for _ in o.cuboids]


def _about_z(angles: Array) -> Array:
    """(K, 4) quaternions x, y, z, w of rotations about z by (K,) radians."""
    zero = np.zeros_like(angles)
    return np.stack([zero, zero, np.sin(angles / 2), np.cos(angles / 2)], -1)


# ------------------------------------------------------------------------------------------------
# Logging of static and moving entities, and of a person.

_JOINT_RADIUS: Final = 0.045
_LIMB_RADIUS: Final = 0.03
PATH_RADIUS: Final = 0.012
"""Radii of joints, limbs and paths in metres, chosen by eye."""


def entity_part(number: int, name: str) -> str:
    """The part of an entity's path that names one of several things, unique by its number.

    Parameters
    ----------
    number : int
    name : str
        Characters that the viewer cannot draw become question marks: paths appear in its legends.

    Returns
    -------
    str
    """
    return rr.escape_entity_path_part(f"{number} {drawable(name)}")


def own_entity(clip: Clip, entity: str, person: int) -> str:
    """Entity of one person: ``entity``, with number and name below it if there are several people.

    Parameters
    ----------
    clip : Clip
    entity : str
    person : int
        Number of the track.

    Returns
    -------
    str
    """
    if len(clip.tracks) == 1:
        return entity
    return f"{entity}/{entity_part(person + 1, clip.tracks[person].name)}"


def log_static(recording: rr.RecordingStream, entity: str, what: rr.AsComponents) -> None:
    """Log an entity for all times.

    Parameters
    ----------
    recording : rerun.RecordingStream
    entity : str
    what : rerun.AsComponents
    """
    recording.log(entity, what, static=True, strict=True)


def log_moving(
    recording: rr.RecordingStream,
    entity: str,
    index: rr.TimeColumn,
    columns: rr.ComponentColumnList,
    *,
    style: rr.AsComponents,
) -> None:
    """Log the values of an entity along a timeline, and its constant style once.

    Parameters
    ----------
    recording : rerun.RecordingStream
    entity : str
    index : rerun.TimeColumn
    columns : rerun.ComponentColumnList
    style : rerun.AsComponents
        The constant components.
    """
    recording.send_columns(entity, indexes=[index], columns=columns, strict=True)
    log_static(recording, entity, style)


def log_person(
    recording: rr.RecordingStream, entity: str, joints: Array, number: int, frames: rr.TimeColumn
) -> None:
    """Log joints, limbs and path of a person.

    Parameters
    ----------
    recording : rerun.RecordingStream
    entity : str
        Parent of the entities that are logged.
    joints : (T, 16, 3) float
        Metres; NaN where unknown.
    number : int
        Class of the person, see :mod:`imapper_prob.recording.palette`.
    frames : rerun.TimeColumn
        T times.
    """
    known = np.isfinite(joints).all(-1)
    columns = rr.Points3D.columns(
        positions=joints[known], keypoint_ids=np.nonzero(known)[1]
    ).partition(known.sum(1))
    log_moving(
        recording,
        f"{entity}/person",
        frames,
        columns,
        style=rr.Points3D.from_fields(class_ids=number, radii=_JOINT_RADIUS, show_labels=False),
    )
    strips = [limbs(pose) for pose in joints]
    lines = rr.LineStrips3D.columns(strips=[s for row in strips for s in row])
    log_moving(
        recording,
        f"{entity}/limbs",
        frames,
        lines.partition([len(row) for row in strips]),
        style=rr.LineStrips3D.from_fields(class_ids=number, radii=_LIMB_RADIUS, show_labels=False),
    )
    path = rr.LineStrips3D(
        paths(joints[:, PELV]), class_ids=number, radii=PATH_RADIUS, show_labels=False
    )
    log_static(recording, f"{entity}/path", path)
