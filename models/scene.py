"""The types that all packages share: a clip (the input) and a scene (the result).

All types are frozen. Their arrays are validated and made read-only on construction, so other code
need not check them again.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import InitVar, dataclass, field
from functools import cached_property
from html import escape
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imapper_prob.models.camera import Camera
from imapper_prob.models.drawing import (
    axes_for,
    draw_clip,
    draw_furniture,
    draw_paths,
    name_axes_of_floor,
    picture_of,
    show_legend,
)
from imapper_prob.models.errors import InputError
from imapper_prob.models.settings import (
    FARTHEST_KEYPOINT,
    HIGHEST_CAMERA,
    LARGEST_IMAGE,
    LONGEST_CLIP,
    LONGEST_FOCAL,
    LOWEST_CAMERA,
    MOST_PEOPLE,
    QUICKEST_FILM,
    SHORTEST_FOCAL,
    STEEPEST_CAMERA,
)
from imapper_prob.models.skeleton import JOINTS, N_JOINTS
from imapper_prob.models.text import brief, readable

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = [
    "FRONTLESS", "MEASURED_FOCAL", "SEATS", "Clip", "Cuboid", "Placement", "Scene", "SceneObject",
    "Track", "Truth", "read_only",
]  # fmt: skip

Array = NDArray[np.float64]

MEASURED_FOCAL: Final = 0.005
"""Standard deviation of the log focal length of a calibrated camera."""
FRONTLESS: Final = frozenset({"desk", "table"})
"""Categories without a distinguishable front: rotated by half a turn they look the same. A stool
has no front either, but its scenelets align it with the person, who turns on it less than is
possible."""
SEATS: Final = frozenset({"armchair", "bench", "chair", "couch", "sofa", "stool"})
"""Labels of seats, which motion hardly distinguishes."""


_LARGEST_FRAME: Final = 2**53
"""Frame numbers are smaller, so that every number format holds them exactly."""
_LARGEST_BODY: Final = 10.0
"""Largest distance of a joint from the pelvis, metres: four tall people."""


def _word(text: object, what: str) -> str:
    """Check a name from the input, and remove what terminals or files cannot show."""
    if not isinstance(text, str):
        raise InputError(f"{what} must be text, not {text!r:.40}")
    return readable(text)


def read_only(values: ArrayLike, *, shape: Sequence[int | None], name: str) -> Array:
    """Copy an array, check its shape and make the copy read-only.

    Parameters
    ----------
    values : array_like
    shape : sequence of int or None
        ``None`` for any length.
    name : str
        Name of the array in messages.

    Returns
    -------
    ndarray of float

    Raises
    ------
    InputError
        The values are not numbers, or have another shape.
    """
    try:
        array = np.array(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name}: expected numbers, got {type(values).__name__}") from error
    expected = tuple(shape)
    if array.ndim != len(expected) or any(
        e is not None and e != a for a, e in zip(array.shape, expected, strict=True)
    ):
        raise InputError(f"{name}: expected shape {expected}, got {array.shape}")
    array.setflags(write=False)
    return array


@dataclass(frozen=True)
class Placement:
    """A position and orientation on the floor.

    Parameters
    ----------
    x, y : float
        Position in metres.
    yaw : float
        Counter-clockwise rotation about z in radians; the local +y axis is "forward".
    """

    x: float
    y: float
    yaw: float

    def __post_init__(self) -> None:
        if not all(map(math.isfinite, (self.x, self.y, self.yaw))):
            raise InputError(f"placement ({self.x}, {self.y}, {self.yaw}) must be finite")

    @property
    def rotation(self) -> Array:
        """(2, 2) rotation from local to parent axes."""
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        return np.array([[c, -s], [s, c]])

    def apply(self, points: ArrayLike) -> Array:
        """Transform local points (..., 3) to the parent frame (..., 3), metres.

        Parameters
        ----------
        points : (..., 3) float

        Returns
        -------
        (..., 3) float
        """
        points = np.asarray(points, float)
        floor = points[..., :2] @ self.rotation.T + (self.x, self.y)
        return np.concatenate([floor, points[..., 2:]], -1)

    def compose(self, inner: Placement) -> Placement:
        """Compose two placements: from the frame of ``inner`` to the parent frame of this one.

        Parameters
        ----------
        inner : Placement
            A placement in the local frame of this one.

        Returns
        -------
        Placement
            The same placement in the parent frame of this one.
        """
        x, y = self.rotation @ (inner.x, inner.y) + (self.x, self.y)
        return Placement(float(x), float(y), self.yaw + inner.yaw)


@dataclass(frozen=True)
class Cuboid:
    """A box with vertical sides, a part of an object.

    Parameters
    ----------
    part : str
        Name of the part: ``"seat"``, ``"back"``, ``"top"``, ``"leg"``, …
    centre : (3,) float
        Centre in metres, in the frame of the object.
    size : (3,) float
        Full side lengths in metres along the object's x (width), y (depth) and z axes.
    """

    part: str
    centre: Array
    size: Array

    def __post_init__(self) -> None:
        centre = read_only(self.centre, shape=(3,), name=f"cuboid {self.part} centre")
        size = read_only(self.size, shape=(3,), name=f"cuboid {self.part} size")
        if not np.all(np.isfinite(centre)) or not np.all(np.isfinite(size)) or np.any(size <= 0):
            raise InputError(f"cuboid {self.part}: centre and size must be finite, size positive")
        object.__setattr__(self, "part", _word(self.part, "the part of a cuboid"))
        object.__setattr__(self, "centre", centre)
        object.__setattr__(self, "size", size)

    def scaled(self, factor: float) -> Cuboid:
        """The box scaled by ``factor`` about the origin of its frame.

        Parameters
        ----------
        factor : float
            Positive and finite.

        Returns
        -------
        Cuboid

        Raises
        ------
        InputError
            ``factor`` is not positive and finite.
        """
        if not 0 < factor < math.inf:
            raise InputError(f"cuboid {self.part}: cannot be {factor} times as large")
        centre, size = factor * self.centre, factor * self.size
        # The other checks passed when this box was made; draws have a hundred thousand boxes.
        box = object.__new__(Cuboid)
        for name, values in (("centre", centre), ("size", size)):
            values.setflags(write=False)
            object.__setattr__(box, name, values)
        object.__setattr__(box, "part", self.part)
        return box


@dataclass(frozen=True)
class SceneObject:
    """A piece of furniture: a label, a placement and the boxes of its parts.

    Parameters
    ----------
    label : str
        Category, lower case: ``"chair"``, ``"couch"``, ``"table"``, ``"shelf"``, …
    placement : Placement
        Pose in the parent frame. Local +y is the object's front (a person leaves a seat towards +y,
        the backrest is at −y); the local origin is on the floor.
    cuboids : tuple of Cuboid
        Parts in the object's own frame; z is height above the floor.
    """

    label: str
    placement: Placement
    cuboids: tuple[Cuboid, ...]

    def __repr__(self) -> str:
        x, y, yaw = self.placement.x, self.placement.y, math.degrees(self.placement.yaw)
        at = f"at ({x:.2f}, {y:.2f}) m, turned by {yaw:.0f}°"
        return f"SceneObject({self.label!r:.60} {at}, {len(self.cuboids)} cuboids)"

    def __post_init__(self) -> None:
        object.__setattr__(self, "label", _word(self.label, "the label of an object"))
        object.__setattr__(self, "cuboids", tuple(self.cuboids))
        if not self.label:
            raise InputError("an object needs a label")
        if not self.cuboids:
            raise InputError(f"object {self.label!r} has no cuboids")

    @cached_property
    def bounds(self) -> Array:
        """(2, 3) lower and upper corner of all parts, in the object's own frame, metres."""
        centres = np.array([c.centre for c in self.cuboids])
        halves = np.array([c.size for c in self.cuboids]) / 2
        corners = np.stack([(centres - halves).min(0), (centres + halves).max(0)])
        corners.setflags(write=False)
        return corners

    @cached_property
    def centre(self) -> Array:
        """(3,) centre of the bounding box in the parent frame, metres."""
        centre = self.placement.apply(self.bounds.mean(0))
        centre.setflags(write=False)
        return centre

    @property
    def footprint(self) -> Array:
        """(4, 2) corners of the bounding box on the parent's floor, counter-clockwise."""
        (x0, y0, _), (x1, y1, _) = self.bounds
        corners = np.array([[x0, y0, 0], [x1, y0, 0], [x1, y1, 0], [x0, y1, 0]])
        return self.placement.apply(corners)[:, :2]

    def moved(self, placement: Placement) -> SceneObject:
        """The object transformed to the frame in which its parent frame has a placement.

        Parameters
        ----------
        placement : Placement
            Placement of the present parent frame.

        Returns
        -------
        SceneObject
        """
        return SceneObject(self.label, placement.compose(self.placement), self.cuboids)

    def scaled(self, factor: float) -> SceneObject:
        """The object scaled by ``factor`` about the origin of its parent frame.

        Parameters
        ----------
        factor : float

        Returns
        -------
        SceneObject
        """
        x, y = factor * self.placement.x, factor * self.placement.y
        cuboids = tuple(c.scaled(factor) for c in self.cuboids)
        return SceneObject(self.label, Placement(x, y, self.placement.yaw), cuboids)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the object from above, in metres.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            If not given, the axes of a new figure.

        Returns
        -------
        matplotlib.axes.Axes

        Examples
        --------
        >>> axes = im.demo_clip().truth.objects[0].plot()
        >>> axes.get_ylabel()
        'y, away from the camera [m]'
        """
        axes = axes_for(ax, size=(3.2, 3.2))
        draw_furniture(axes, [self])
        name_axes_of_floor(axes)
        show_legend(axes)
        return axes

    def _repr_html_(self) -> str:
        """A view from above and a text, for notebooks."""
        return f"<p>{escape(repr(self))}</p>{picture_of(self.plot, size=(3.2, 3.2))}"


@dataclass(frozen=True)
class Track:
    """Detections and lifted poses of one person, frame by frame.

    Parameters
    ----------
    name : str
        Name of the person.
    keypoints : (T, 16, 2) float
        Detected positions in pixels; NaN without a detection.
    confidences : (T, 16) float
        Detector confidence in [0, 1]; 0 if there is no detection or the joint is synthesised from
        others.
    poses : (T, 16, 3) float
        Lifted joints relative to the pelvis, camera axes (x right, y forward, z up), metres; NaN in
        all joints of a frame without a pose.
    interpolated : (T,) bool
        Frames whose pose was already interpolated in the input.
    first_frame : int
        Number of the first frame, for error messages only.
    """

    name: str
    keypoints: Array
    confidences: Array
    poses: Array
    interpolated: NDArray[np.bool_]
    first_frame: InitVar[int] = 0

    __repr__ = brief

    def __post_init__(self, first_frame: int) -> None:
        object.__setattr__(self, "name", _word(self.name, "the name of a track"))
        keypoints = read_only(self.keypoints, shape=(None, N_JOINTS, 2), name="keypoints")
        n_frames = len(keypoints)
        confidences = read_only(
            self.confidences, shape=(n_frames, N_JOINTS), name=f"confidences of {self.name}"
        )
        poses = read_only(self.poses, shape=(n_frames, N_JOINTS, 3), name=f"poses of {self.name}")
        interpolated = np.array(self.interpolated, dtype=bool)
        if interpolated.shape != (n_frames,):
            raise InputError(f"interpolated of {self.name}: expected ({n_frames},) flags")
        bad = np.logical_not((confidences >= 0) & (confidences <= 1))
        if bad.any():
            t, j = np.argwhere(bad)[0]
            raise InputError(
                f"track {self.name}, frame {first_frame + t}, joint {JOINTS[j]}: confidence "
                f"{confidences[t, j]} is not in [0, 1]"
            )
        lost = (confidences > 0) & ~np.isfinite(keypoints).all(-1)
        if lost.any():
            t, j = np.argwhere(lost)[0]
            raise InputError(
                f"track {self.name}, frame {first_frame + t}, joint {JOINTS[j]}: a confidence but "
                "no finite position; give a missing joint confidence 0"
            )
        far = np.where(np.isfinite(poses), np.abs(poses), 0.0).max(-1)
        if far.size and far.max() > _LARGEST_BODY:
            t, j = np.unravel_index(np.argmax(far), far.shape)
            raise InputError(
                f"track {self.name}, frame {first_frame + t}, joint {JOINTS[j]}: its pose has it "
                f"{far[t, j]:g} m from the pelvis; poses are in metres"
            )
        partial = np.isfinite(poses).all((1, 2)) != np.isfinite(poses).any((1, 2))
        if partial.any():
            t = int(np.argmax(partial))
            j = int(np.argmax(~np.isfinite(poses[t]).all(-1)))
            raise InputError(
                f"track {self.name}, frame {first_frame + t}, joint {JOINTS[j]}: pose is not "
                "finite; a frame has all joints or none"
            )
        interpolated.setflags(write=False)
        object.__setattr__(self, "keypoints", keypoints)
        object.__setattr__(self, "confidences", confidences)
        object.__setattr__(self, "poses", poses)
        object.__setattr__(self, "interpolated", interpolated)

    @property
    def has_pose(self) -> NDArray[np.bool_]:
        """(T,) bool, frames with a lifted pose."""
        flags: NDArray[np.bool_] = np.all(np.isfinite(self.poses), axis=(1, 2))
        return flags


@dataclass(frozen=True)
class Truth:
    """Ground truth, where it is known.

    Parameters
    ----------
    camera : Camera
        The camera whose world frame ``objects`` and ``joints`` are in.
    objects : tuple of SceneObject
        Furniture in that world frame.
    joints : (T, 16, 3) or (K T, 16, 3) float
        Joints in that world frame, metres; NaN in frames without annotation. Of the first person
        only, or of all K people: all frames of the first person, then of the next.
    hidden : (T, 16) or (K T, 16) bool
        Joints that furniture hides from the camera.
    actions : tuple of str
        One word per row of ``joints`` (``"sitting"``, …), or empty.
    """

    camera: Camera
    objects: tuple[SceneObject, ...]
    joints: Array
    hidden: NDArray[np.bool_]
    actions: tuple[str, ...] = ()

    __repr__ = brief

    def __post_init__(self) -> None:
        object.__setattr__(self, "objects", tuple(self.objects))
        joints = read_only(self.joints, shape=(None, N_JOINTS, 3), name="true joints")
        object.__setattr__(self, "joints", joints)
        object.__setattr__(self, "actions", tuple(self.actions))


@dataclass(frozen=True)
class Clip:
    """A recording by one fixed camera: detections and lifted poses of people.

    Parameters
    ----------
    name : str
        Used in messages and file names.
    camera : Camera
        Intrinsics and nominal pose, which is the mean of the prior.
    fps : float
        Frames per second.
    frame_ids : (T,) int
        Frame numbers of the input, consecutive.
    tracks : tuple of Track
        One per person, each with T frames.
    focal_spread : float
        Standard deviation of the log focal length, i.e. its relative error. A careful guess, as in
        i3DB, is accurate to .05.
    truth : Truth, optional
        Ground truth of simulated clips, for evaluation. Inference never reads it.

    Examples
    --------
    >>> clip = im.demo_clip()
    >>> clip.name, clip.fps, [track.name for track in clip.tracks]
    ('demo', 10.0, ['actor'])
    >>> clip.tracks[0].keypoints.shape
    (130, 16, 2)
    """

    name: str
    camera: Camera
    fps: float
    frame_ids: NDArray[np.int64]
    tracks: tuple[Track, ...]
    focal_spread: float = 0.05
    truth: Truth | None = field(default=None, compare=False)

    __repr__ = brief

    def __post_init__(self) -> None:
        object.__setattr__(self, "name", _word(self.name, "the name of a clip"))
        given = np.asarray(self.frame_ids)
        whole = given.ndim == 1 and given.dtype.kind in "iuf" and np.isfinite(given).all()
        if not whole or np.any(given % 1) or np.any(abs(given.astype(float)) >= _LARGEST_FRAME):
            raise InputError(f"clip {self.name}: frame ids must be consecutive integers")
        ids = np.array(given, dtype=np.int64)
        if np.any(np.diff(ids) != 1):
            raise InputError(f"clip {self.name}: frame ids must be consecutive integers")
        object.__setattr__(self, "tracks", tuple(self.tracks))
        called = [track.name for track in self.tracks]
        if len(set(called)) < len(called):
            twice = next(name for name in called if called.count(name) > 1)
            raise InputError(
                f"clip {self.name}: two tracks are called {twice}; each needs a name of its own"
            )
        if not self.tracks:
            raise InputError(f"clip {self.name}: no person in it")
        if not (np.isfinite(self.fps) and self.fps > 0):
            raise InputError(f"clip {self.name}: frame rate {self.fps} must be positive")
        self._check_size(len(ids))
        if not 0 < self.focal_spread < 1:
            raise InputError(
                f"clip {self.name}: the focal length's spread {self.focal_spread} is no part of it"
            )
        for track in self.tracks:
            if len(track.keypoints) != len(ids):
                raise InputError(
                    f"clip {self.name}: track {track.name} has {len(track.keypoints)} frames, "
                    f"the clip has {len(ids)}"
                )
        ids.setflags(write=False)
        object.__setattr__(self, "frame_ids", ids)

    def _check_size(self, n_frames: int) -> None:
        """Check that sizes are realistic, before arrays of these sizes are made."""
        camera, name = self.camera, self.name
        if self.fps > QUICKEST_FILM:
            raise InputError(
                f"clip {name}: {self.fps:g} frames a second; films have {QUICKEST_FILM:g} at most"
            )
        if n_frames > LONGEST_CLIP:
            raise InputError(
                f"clip {name}: {n_frames} frames, more than {LONGEST_CLIP}; cut it in parts"
            )
        if len(self.tracks) > MOST_PEOPLE:
            raise InputError(f"clip {name}: {len(self.tracks)} people, more than {MOST_PEOPLE}")
        self._check_camera(max(camera.width, camera.height))
        if not max(abs(camera.pitch), abs(camera.roll)) <= STEEPEST_CAMERA:
            raise InputError(
                f"clip {name}: a camera of pitch {math.degrees(camera.pitch):.3g} and roll "
                f"{math.degrees(camera.roll):.3g} degrees; either may be "
                f"{math.degrees(STEEPEST_CAMERA):.0f} at most"
            )
        if not LOWEST_CAMERA <= camera.elevation <= HIGHEST_CAMERA:
            raise InputError(
                f"clip {name}: a camera {camera.elevation:g} m above the floor; it may be "
                f"{LOWEST_CAMERA:g} to {HIGHEST_CAMERA:g}"
            )
        farthest = FARTHEST_KEYPOINT * max(camera.width, camera.height)
        for track in self.tracks:
            seen = np.abs(track.keypoints[track.confidences > 0])
            if seen.size and seen.max() > farthest:
                raise InputError(
                    f"clip {name}, track {track.name}: a joint at {seen.max():g} pixels in an "
                    f"image of {camera.width} x {camera.height}"
                )

    def _check_camera(self, longer: int) -> None:
        camera, name = self.camera, self.name
        size = f"{camera.width} x {camera.height}"
        if longer > LARGEST_IMAGE:
            raise InputError(f"clip {name}: images of {size}; {LARGEST_IMAGE} a side at most")
        shortest, longest = SHORTEST_FOCAL * longer, LONGEST_FOCAL * longer
        for axis in ("fx", "fy"):
            if not shortest <= getattr(camera, axis) <= longest:
                raise InputError(
                    f"clip {name}: focal length {axis} = {getattr(camera, axis):g} pixels; cameras "
                    f"with images of {size} have {shortest:g} to {longest:g}"
                )
        if not max(abs(camera.cx), abs(camera.cy)) <= FARTHEST_KEYPOINT * longer:
            raise InputError(
                f"clip {name}: principal point ({camera.cx:g}, {camera.cy:g}) in images of {size}"
            )

    @property
    def n_frames(self) -> int:
        """T, the number of frames.

        Examples
        --------
        >>> im.demo_clip().n_frames
        130
        """
        return len(self.frame_ids)

    @property
    def focal_known(self) -> bool:
        """Whether the focal length is as accurate as a calibration.

        Examples
        --------
        >>> im.demo_clip().focal_known
        False
        """
        return self.focal_spread <= MEASURED_FOCAL

    def plot(self, ax: Axes | None = None, *, moments: int = 5) -> Axes:
        """Draw the 2D joints of all people in the image at several frames, earlier ones lighter.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            If not given, the axes of a new figure.
        moments : int
            Number of frames.

        Returns
        -------
        matplotlib.axes.Axes

        Examples
        --------
        >>> axes = im.demo_clip().plot()
        >>> axes.get_xlabel(), axes.get_ylabel()
        ('u, to the right [px]', 'v, down [px]')
        """
        axes = axes_for(ax, size=(7.0, 4.4))
        draw_clip(axes, self, moments=moments)
        show_legend(axes)
        return axes

    def _repr_html_(self) -> str:
        """The 2D joints and a text, for notebooks."""
        return f"<p>{escape(repr(self))}</p>{picture_of(self.plot, size=(7.0, 4.4))}"


@dataclass(frozen=True)
class Scene:
    """A scene hypothesis: camera, furniture and motion.

    Parameters
    ----------
    camera : Camera
        Camera of this scene; its pose defines the world frame.
    objects : tuple of SceneObject
        Furniture in the world frame; objects of several scenelets are merged if they agree.
    joints : (T, 16, 3) float
        Joints in the world frame, metres; NaN in frames without information.
    assignment : tuple of (str, int)
        Scenelet identifiers and their start frames, in order of time.
    log_posterior : float
        Log-posterior in nats, up to a constant of the clip.
    people : int
        Number of people whose frames ``joints`` contains, one person after the other.
    """

    camera: Camera
    objects: tuple[SceneObject, ...]
    joints: Array
    assignment: tuple[tuple[str, int], ...]
    log_posterior: float
    people: int = 1

    __repr__ = brief

    def __post_init__(self) -> None:
        object.__setattr__(self, "objects", tuple(self.objects))
        object.__setattr__(self, "assignment", tuple(self.assignment))
        joints = read_only(self.joints, shape=(None, N_JOINTS, 3), name="joints of the scene")
        object.__setattr__(self, "joints", joints)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the scene from above: furniture by category, and the paths of all pelvises.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            If not given, the axes of a new figure.

        Returns
        -------
        matplotlib.axes.Axes

        Examples
        --------
        >>> axes = posterior.draw(0).plot()
        >>> axes.get_xlabel(), axes.get_ylabel()
        ('x, to the right [m]', 'y, away from the camera [m]')
        """
        axes = axes_for(ax, size=(5.0, 4.6))
        draw_paths(axes, self.joints, people=self.people, label="pelvis")
        draw_furniture(axes, self.objects)
        name_axes_of_floor(axes)
        show_legend(axes, below=True)
        return axes

    def _repr_html_(self) -> str:
        """A view from above and a text, for notebooks."""
        return f"<p>{escape(repr(self))}</p>{picture_of(self.plot, size=(5.0, 4.6))}"
