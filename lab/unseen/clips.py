"""Short simulated clips of one motion, by family: a person walks there and does it for a while.

The motion comes from another draw of the built-in library than the one that is searched: another
body and other furniture, with sizes from the same catalogue. The room contains only the motion's
own furniture, so everything else in a result is spurious.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from typing import Final, TypeVar
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.camera import Camera
from imapper_prob.models.errors import InputError
from imapper_prob.models.scene import Clip, Placement, SceneObject, Truth
from imapper_prob.models.scenelet import Library, Scenelet
from imapper_prob.models.skeleton import DETECTED, PELV, facing
from imapper_prob.scenelets.library import built_in_library
from imapper_prob.simulate.clips import (
    FEWEST_IN_IMAGE,
    SCALE_SPREAD,
    SHORTEST_STAY,
    draw_camera,
    simulate_track,
)
from imapper_prob.simulate.scene import (
    FEWEST_SEEN,
    Gait,
    Stay,
    draw_entry,
    draw_stay,
    find_route,
    hidden_joints,
    in_image,
    walk_between,
)
from lab.seats import NEAR, SITTABLE, gap
from lab.unseen.families import only_family, without_family

__all__ = [
    "CARRIED", "UNCARRIED", "Performance", "performed_scenelets", "searched_library",
    "simulate_performance", "thinned",
]  # fmt: skip

Array = NDArray[np.float64]
_T = TypeVar("_T")

CARRIED: Final = (
    "sit", "lie", "legs-crossed", "leg-folded", "cross-legged", "perch", "lean-on-arm", "slouch",
)  # fmt: skip
"""Families in which furniture carries the person."""
UNCARRIED: Final = ("squat", "kneel", "bend", "floor-sit", "floor-lie")
"""Families in which the person is low down without furniture."""

CAMERA: Final = Camera(
    width=1920, height=1080, fx=1400.0, fy=1400.0, cx=960.0, cy=540.0,
    pitch=float(np.deg2rad(-8.0)), elevation=1.5,
)  # fmt: skip
"""Like a webcam: 69 degrees wide, and pitched so that the floor is in view from 3 m."""
DISTANCES: Final = (3.0, 5.0)
"""Metres on the floor from the camera to the pelvis."""
FRAMES: Final = (60, 90)
"""Least and greatest number of frames of a clip, at 10 a second."""
FPS: Final = 10.0
SHARE: Final = 1 / 3
"""Fraction of each line of the catalogue that is in the searched library."""

_PERFORMED: Final = 1
"""Seed of the library that is performed."""
_SIDEWAYS: Final = 0.75
"""Fraction of half the field of view within which a person on the floor is."""
_BEHIND: Final = 0.1
"""Metres behind the place of the motion at which walking ends."""
_TRIES: Final = 5000
"""Rooms tried before an error; most motions need a dozen."""


@dataclass(frozen=True)
class Performance:
    """A clip of one motion.

    Parameters
    ----------
    clip : Clip
        Includes its ground truth.
    scenelet : Scenelet
        The scenelet that is performed.
    stay : (int, int)
        First frame of the performance, and the frame after the last.
    """

    clip: Clip
    scenelet: Scenelet
    stay: tuple[int, int]

    @property
    def pelvis(self) -> Array:
        """(3,) median of the true pelvis over the stay, metres in the world of the true camera."""
        assert self.clip.truth is not None  # simulated clips have ground truth
        middle: Array = np.median(self.clip.truth.joints[slice(*self.stay), PELV], axis=0)
        return middle


def thinned(library: Library, rng: np.random.Generator, *, share: float = SHARE) -> Library:
    """A random part of each line of the catalogue, at least one scenelet, in the library's order.

    A line is given by a scenelet's name without its number.
    """
    lines: dict[str, list[int]] = {}
    for k, scenelet in enumerate(library):
        lines.setdefault(scenelet.name.rpartition("-")[0], []).append(k)
    kept = [
        int(k)
        for own in lines.values()
        for k in rng.choice(own, size=max(1, round(share * len(own))), replace=False)
    ]
    return Library(f"{share:.2f} of {library.name}", tuple(library[k] for k in sorted(kept)))


@cache
def searched_library(seed: int, without: str | None = None) -> Library:
    """The searched part of the built-in library, with or without one family."""
    library = thinned(built_in_library(), np.random.default_rng([seed, crc32(b"library")]))
    return library if without is None else without_family(library, without)


@cache
def performed_scenelets(family: str) -> tuple[Scenelet, ...]:
    """The scenelets of a family that are performed.

    For a family of :data:`CARRIED`, those with the person on a seat or bed all the time, which
    excludes standing at a table. For one of :data:`UNCARRIED`, all.

    Raises
    ------
    InputError
        The family is in neither.
    """
    if family not in CARRIED + UNCARRIED:
        known = ", ".join(CARRIED + UNCARRIED)
        raise InputError(f"clips are simulated of the families {known}, not of {family!r}")
    own = only_family(built_in_library(_PERFORMED), family)
    return tuple(s for s in own if family in UNCARRIED or _on_seat(s))


def _on_seat(scenelet: Scenelet) -> bool:
    seats = [o for o in scenelet.objects if o.label in SITTABLE]
    pelvis = scenelet.joints[:, PELV, :2]
    return any(max(gap(o, point) for point in pelvis) < NEAR for o in seats)


def simulate_performance(family: str, index: int, *, seed: int = 0) -> Performance:
    """Simulate a clip in which a motion of a family is performed; equal arguments, equal clips.

    Orientation and height of the camera and the size of the body follow the model; place and yaw of
    the person are uniform among those from which enough is visible. Detections and lifted poses are
    drawn by :func:`~imapper_prob.simulate.clips.simulate_track`.

    Raises
    ------
    InputError
        There is no such family, or no room was found for the motion.
    """
    rng = np.random.default_rng([seed, crc32(family.encode()), index])
    scenelets, gait = performed_scenelets(family), _gait()
    for _ in range(_TRIES):
        scenelet = scenelets[int(rng.integers(len(scenelets)))]
        camera = draw_camera(rng, nominal=CAMERA)
        scale = float(np.exp(rng.normal(0.0, SCALE_SPREAD)))
        n_frames = int(rng.integers(FRAMES[0], FRAMES[1] + 1))
        stay = _stay(rng, scenelet, camera=camera, scale=scale)
        acted = stay and _walk_to(rng, stay, gait, camera=camera, scale=scale, n_frames=n_frames)
        if stay and acted:
            objects = tuple(stay.furniture(scale))
            return _filmed(rng, f"{family} {index}", stay, objects, *acted, camera=camera)
    raise InputError(f"clip {family} {index}: found no room in {_TRIES} tries")


@cache
def _gait() -> Gait:
    return Gait.of(built_in_library(_PERFORMED))


def _stay(
    rng: np.random.Generator, scenelet: Scenelet, *, camera: Camera, scale: float
) -> Stay | None:
    """A place for a motion at the right distance, or None."""
    if scenelet.objects:
        stay = draw_stay(rng, scenelet, camera=camera, scale=scale, furniture=())
    else:
        stay = _on_floor(rng, scenelet, camera=camera, scale=scale)
    if stay is None:
        return None
    away = np.linalg.norm(stay.joints(scale)[0, PELV, :2])
    return stay if DISTANCES[0] <= away <= DISTANCES[1] else None


def _on_floor(
    rng: np.random.Generator, scenelet: Scenelet, *, camera: Camera, scale: float
) -> Stay | None:
    """A place for a motion without furniture, or None if too little of it is in the image."""
    depth = rng.uniform(*DISTANCES)
    side = depth * _SIDEWAYS * camera.width / 2 / camera.fx
    placement = Placement(rng.uniform(-side, side), depth, rng.uniform(-np.pi, np.pi))
    joints = placement.apply(scenelet.joints * scale)
    if in_image(camera, joints[:, list(DETECTED)]).mean() < FEWEST_SEEN:
        return None
    x, y = joints[0, PELV, :2].tolist()
    start = Placement(x, y, float(facing(joints[0])))
    return Stay(
        scenelet, placement, start.apply(np.array([0.0, -_BEHIND, 0.0]))[:2], np.array([x, y])
    )


def _walk_to(
    rng: np.random.Generator,
    stay: Stay,
    gait: Gait,
    *,
    camera: Camera,
    scale: float,
    n_frames: int,
) -> tuple[Array, NDArray[np.bool_]] | None:
    """Joints (T, 16, 3) in the world, metres, and frames (T,) in which the motion is performed.

    None if this attempt found no route, or if too little of the person would be in the image.
    """
    furniture = stay.furniture(scale)
    entries = (draw_entry(rng, stay, camera=camera, furniture=furniture) for _ in range(10))
    entry = _first(entries)
    if entry is None:
        return None
    route = find_route(rng, entry, stay.approach, camera=camera, furniture=furniture)
    if route is None:
        return None
    motion = walk_between(
        rng, [stay], [route], gait=gait, n_frames=n_frames, scale=scale, fps=FPS,
        shortest_stay=round(SHORTEST_STAY * FPS),
    )  # fmt: skip
    if motion is None or in_image(camera, motion[0]).mean(1).min() < FEWEST_IN_IMAGE:
        return None
    return motion[0], motion[1] >= 0


def _first(attempts: Iterable[_T | None]) -> _T | None:
    return next((attempt for attempt in attempts if attempt is not None), None)


def _filmed(
    rng: np.random.Generator,
    name: str,
    stay: Stay,
    objects: tuple[SceneObject, ...],
    joints: Array,
    there: NDArray[np.bool_],
    *,
    camera: Camera,
) -> Performance:
    """The clip of a performance, with the nominal camera in place of the true one."""
    hidden = hidden_joints(camera, joints, objects)
    track = simulate_track(rng, joints, hidden, camera=camera, fps=FPS)
    actions = tuple(stay.scenelet.action if t else "walking" for t in there.tolist())
    clip = Clip(
        name=name,
        camera=CAMERA,
        fps=FPS,
        frame_ids=np.arange(len(joints)),
        tracks=(track,),
        truth=Truth(camera, objects, joints, hidden, actions),
    )
    frames = np.flatnonzero(there)
    return Performance(clip, stay.scenelet, (int(frames[0]), int(frames[-1]) + 1))
