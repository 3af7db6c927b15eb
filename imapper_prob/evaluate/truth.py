"""Furniture in the form that scores use, and the truth of a clip, in camera axes.

Scores are computed in camera axes, the frame of the i3DB files. Objects are therefore not upright
in it, and the camera's tilt is part of the answer, not of the frame. Top view means here: without
the camera's up axis.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from shapely import MultiPoint, Point, Polygon, convex_hull

from imapper_prob.models.camera import Camera
from imapper_prob.models.errors import InputError
from imapper_prob.models.scene import Clip, SceneObject
from imapper_prob.models.skeleton import LKNE, LWRI, PELV, RKNE, RWRI

__all__ = [
    "GROUPS",
    "Outline",
    "TruthInView",
    "box_corners",
    "outline_of",
    "segments",
    "truth_in_view",
]

Array = NDArray[np.float64]
GROUPS: Final = {
    "chair": "seat", "couch": "seat", "stool": "seat", "bench": "seat", "armchair": "seat",
    "sofa": "seat", "table": "table", "desk": "table", "shelf": "shelf", "bookcase": "shelf",
}  # fmt: skip
"""Groups of labels that may be paired with each other. {chair, couch, stool}, {table} and {shelf}
are those of the benchmark; the other labels are synonyms. A label that is not listed is its own
group and has no partner in i3DB."""
_WITH_FRONT: Final = frozenset({"chair", "couch", "bench", "armchair", "sofa"})
"""Categories whose front and back differ; of other categories only the axis is known."""
_CORNERS: Final = np.array(list(product((-0.5, 0.5), repeat=3)))


@dataclass(frozen=True, eq=False)
class Outline:
    """A piece of furniture in top view.

    Parameters
    ----------
    label : str
    centre : (2,) float
        Middle of the smallest rectangle along the object's axes that contains all its boxes: metres
        to the right of the camera and ahead of it.
    yaw : float
        Direction of the front, radians counter-clockwise from straight ahead.
    has_front : bool
        Whether front and back can be told apart; otherwise ``yaw`` is known modulo half a turn.
    hull : shapely.Polygon
        Convex outline of all boxes, metres.
    corners : (N, 3) float
        Corners of all boxes, camera axes, metres.
    """

    label: str
    centre: Array
    yaw: float
    has_front: bool
    hull: Polygon
    corners: Array

    @property
    def group(self) -> str:
        """Group of labels that the object may be paired with."""
        return GROUPS.get(self.label, self.label)

    @property
    def middle(self) -> Array:
        """(3,) centre in 3D: ``centre`` in top view and half the height, metres."""
        low, high = self.corners[:, 2].min(), self.corners[:, 2].max()
        return np.array([*self.centre, (low + high) / 2])

    @classmethod
    def of_corners(
        cls, label: str, corners: ArrayLike, sideways: ArrayLike, *, has_front: bool
    ) -> Outline:
        """Make an outline from the corners of boxes.

        Parameters
        ----------
        label : str
        corners : (N, 3) float
            Corners of all boxes, camera axes (x right, y forward, z up), metres.
        sideways : (3,) float
            Direction from left to right as one faces the object's front, which is its local x axis,
            in camera axes. It is level for any tilt of the camera, so that the front, at a right
            angle to it, does not depend on the tilt.
        has_front : bool

        Returns
        -------
        Outline

        Raises
        ------
        InputError
            Corners are not finite, or ``sideways`` is not level.
        """
        whole = np.asarray(corners, float)
        points = whole[:, :2]
        right = np.asarray(sideways, float)[:2]
        length = np.linalg.norm(right)
        if not np.isfinite(whole).all() or not length > 0:
            raise InputError(f"{label}: corners must be finite and its sideways axis level")
        right = right / length
        front = np.array([-right[1], right[0]])
        axes = np.stack([right, front])
        along = points @ axes.T
        centre = (along.min(0) + along.max(0)) / 2 @ axes
        yaw = float(np.arctan2(-front[0], front[1]))
        return cls(label, centre, yaw, has_front, convex_hull(MultiPoint(points)), whole)


def box_corners(centre: ArrayLike, axes: ArrayLike, size: ArrayLike) -> Array:
    """The eight corners of a box.

    Parameters
    ----------
    centre : (3,) float
        Metres.
    axes : (3, 3) float
        Unit axes in columns.
    size : (3,) float
        Full side lengths, metres.

    Returns
    -------
    (8, 3) float
    """
    corners: Array = np.asarray(centre) + (_CORNERS * np.asarray(size)) @ np.asarray(axes).T
    return corners


def outline_of(item: SceneObject, camera: Camera) -> Outline:
    """Convert an object from world coordinates to the axes of a camera.

    Parameters
    ----------
    item : SceneObject
    camera : Camera

    Returns
    -------
    Outline
    """
    corners = np.concatenate(
        [item.placement.apply(box_corners(c.centre, np.eye(3), c.size)) for c in item.cuboids]
    )
    sideways = np.array([*item.placement.rotation[:, 0], 0.0]) @ camera.rotation
    return Outline.of_corners(
        item.label,
        camera.to_camera(corners),
        sideways,
        has_front=item.label in _WITH_FRONT,
    )


# ------------------------------------------------------------------------------------------------
# Ground truth.

Flags = NDArray[np.bool_]
_AT_THE_TABLE: Final = 0.30
"""Greatest distance in metres of pelvis or knee from the outline of a table that is used."""


@dataclass(frozen=True, eq=False)
class TruthInView:
    """Ground truth of a clip in camera axes.

    Parameters
    ----------
    name : str
        Name of the clip.
    frame_ids : (T,) int
    joints : (R, 16, 3) float
        x right, y forward, z up from the optical centre, metres; NaN where not annotated. T rows of
        the first person, or T rows of each person, concatenated.
    pixels : (R, 16, 2) float
        True joints in the image, NaN where not annotated.
    hidden : (R, 16) bool
        Joints hidden by furniture.
    objects : tuple of Outline
        All annotated furniture.
    used : tuple of int
        Indices of the ``objects`` that somebody interacts with; only these are scored.
    actions : tuple of str
        One word a row, or empty.
    """

    name: str
    frame_ids: NDArray[np.int64]
    joints: Array
    pixels: Array
    hidden: Flags
    objects: tuple[Outline, ...]
    used: tuple[int, ...]
    actions: tuple[str, ...]

    @property
    def known(self) -> Flags:
        """(R,) bool, whether all joints of a row are annotated."""
        flags: Flags = np.all(np.isfinite(self.joints), axis=(1, 2))
        return flags

    @property
    def used_objects(self) -> tuple[Outline, ...]:
        """The objects that are scored."""
        return tuple(self.objects[k] for k in self.used)


def segments(actions: tuple[str, ...], n_frames: int) -> Iterator[tuple[str, slice]]:
    """Intervals of rows in which one person has the same action, in order of time.

    Parameters
    ----------
    actions : tuple of str
        One word a row.
    n_frames : int
        Rows of each person.

    Yields
    ------
    action : str
    rows : slice
    """
    first = 0
    for t in range(1, len(actions) + 1):
        if t % n_frames == 0 or t == len(actions) or actions[t] != actions[first]:
            yield actions[first], slice(first, t)
            first = t


def used_objects(
    objects: tuple[Outline, ...], joints: Array, actions: tuple[str, ...], n_frames: int
) -> tuple[int, ...]:
    """Indices of the objects that somebody interacts with.

    These are: the seat nearest to the median pelvis of each sitting; the table nearest to pelvis or
    knees in every frame in which it is within 30 cm of them; the shelf nearest to the hands of each
    reach (the pelvis may be nearer to its neighbour). Without annotated actions all objects count.
    """
    if not any(actions):
        return tuple(range(len(objects)))
    of_group = {
        group: [k for k, o in enumerate(objects) if o.group == group]
        for group in ("seat", "table", "shelf")
    }
    used: set[int] = set()
    for action, frames in segments(actions, n_frames):
        body = joints[frames]
        body = body[np.isfinite(body).all((1, 2)), :, :2]
        if not len(body):
            continue
        if action == "sitting" and of_group["seat"]:
            middle = np.median(body[:, PELV], axis=0)
            away = {k: np.linalg.norm(objects[k].centre - middle) for k in of_group["seat"]}
            used.add(min(away, key=away.__getitem__))
        if action == "reaching" and of_group["shelf"]:
            hands = body[:, (RWRI, LWRI)]
            away = {
                k: np.median(np.linalg.norm(hands - objects[k].centre, axis=-1).min(1))
                for k in of_group["shelf"]
            }
            used.add(min(away, key=away.__getitem__))
    if of_group["table"]:
        for legs in joints[:, (PELV, RKNE, LKNE), :2]:
            points = [Point(p) for p in legs if np.isfinite(p).all()]
            if not points:
                continue
            near = {k: min(objects[k].hull.distance(p) for p in points) for k in of_group["table"]}
            nearest = min(near, key=near.__getitem__)
            if near[nearest] <= _AT_THE_TABLE:
                used.add(nearest)
    return tuple(sorted(used))


def truth_in_view(clip: Clip) -> TruthInView:
    """The ground truth of a clip for scores.

    Parameters
    ----------
    clip : Clip

    Returns
    -------
    TruthInView

    Raises
    ------
    InputError
        There is no truth, or it has another number of frames.
    """
    truth = clip.truth
    if truth is None:
        raise InputError(f"clip {clip.name}: nobody knows its truth; nothing to hold a result to")
    if len(truth.joints) not in (clip.n_frames, len(clip.tracks) * clip.n_frames):
        raise InputError(
            f"clip {clip.name}: has {clip.n_frames} frames, its truth {len(truth.joints)}"
        )
    joints = truth.camera.to_camera(truth.joints)
    objects = tuple(outline_of(o, truth.camera) for o in truth.objects)
    return TruthInView(
        name=clip.name,
        frame_ids=clip.frame_ids,
        joints=joints,
        pixels=truth.camera.project(truth.joints),
        hidden=truth.hidden,
        objects=objects,
        used=used_objects(objects, joints, truth.actions, clip.n_frames),
        actions=truth.actions,
    )
