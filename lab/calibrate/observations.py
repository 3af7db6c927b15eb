"""The evidence of one clip with ground truth on the constants, as plain arrays.

The truth of i3DB is annotated in every second frame, that of the simulator in every frame; ``gap``
is the number of frames between two that are known. True furniture is compared with what a scenelet
of the motion predicts: its place relative to the person, and the joints it hides.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from imapper_prob.layouts import group_of
from imapper_prob.models.geometry import pack_boxes, sight_clearance
from imapper_prob.models.path_prior import CameraPrior, StaticPath
from imapper_prob.models.scene import SEATS, Clip, Placement, SceneObject, Truth
from imapper_prob.models.scenelet import Scenelet
from imapper_prob.models.skeleton import DETECTED, LANK, MIRROR, PELV, RANK
from imapper_prob.solver.camera_prior import find_stays, thigh_signs
from imapper_prob.solver.poses import bones_of, lifted_body

__all__ = [
    "Detections",
    "Lifted",
    "Motion",
    "PathErrors",
    "Thighs",
    "furniture_errors",
    "observe_detections",
    "observe_lifted",
    "observe_motion",
    "observe_path",
    "observe_seats",
    "observe_thighs",
    "sights_past",
    "stretches",
]


Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

_LINES = 1080.0
"""Height in lines of the image in whose pixels errors are given."""
_SWAP_SCALE = 20.0
_FLIP_MARGIN = 5.0
"""Pixels, and nats of a Student-t with four degrees of freedom. A frame that is more likely by that
much with sides exchanged counts as one in which the detector exchanged them."""
_STRETCH = 2.0
"""Seconds into which longer stays are divided, about the length of a scenelet."""
_STAYS = frozenset({"sitting", "standing", "reaching", "lying"})


@dataclass(frozen=True)
class Detections:
    """Detections compared with projected true joints, in the K known frames.

    Parameters
    ----------
    confidence : (K, 14) float
        0 where there is no detection.
    hidden : (K, 14) bool
    error : (K, 14, 2) float
        Pixels in an image of 1080 lines; NaN without a detection, or if sides are flipped.
    flipped : (K,) bool
        Frames in which the detector exchanged left and right.
    gap : int
    """

    confidence: Array
    hidden: Flags
    error: Array
    flipped: Flags
    gap: int

    @property
    def used(self) -> Flags:
        """(K, 14) bool, whether there is an error to use."""
        return np.asarray(np.isfinite(self.error).all(-1))


@dataclass(frozen=True)
class Motion:
    """Steps of the true motion from one known frame to the next.

    Parameters
    ----------
    bearing, lift, log_depth : (n,) float
        Steps of the pelvis in view coordinates, over ``gap`` frames.
    bones : (n, 14, 3) float
        Change of the bone vectors, camera axes, metres.
    joints : (n, 16, 3) float
        Change of joints relative to the pelvis, metres.
    gap : int
    """

    bearing: Array
    lift: Array
    log_depth: Array
    bones: Array
    joints: Array
    gap: int


@dataclass(frozen=True)
class PathErrors:
    """Errors of the static path against the truth.

    Parameters
    ----------
    log_depth : (K,) float
        Log of the estimated depth of the pelvis over the true one.
    across : (K, 2) float
        Errors of the pelvis across the viewing ray, metres.
    deviation : (K, 2) float
        Standard deviations that the fit states of the error to the right and of the log depth.
    ankle : (T,) float
        Height of the lower ankle above the floor for the true camera, metres.
    stays : (n, 2) int
        The first of the K frames of each stay, and the one after its last.
    """

    log_depth: Array
    across: Array
    deviation: Array
    ankle: Array
    stays: NDArray[np.int64]


@dataclass(frozen=True)
class Thighs:
    """Thighs of the static path in frames with a known action.

    Parameters
    ----------
    angle : (n,) float
        Radians from the vertical (:mod:`imapper_prob.solver.camera_prior`).
    seen : (n,) float
        Visibility of the legs.
    carried : (n,) bool
        Whether the person sits.
    """

    angle: Array
    seen: Array
    carried: Flags


@dataclass(frozen=True)
class Lifted:
    """Errors of the lifter's bones against the true ones.

    Parameters
    ----------
    errors : (m, 14, 3) float
        Lifted minus true bones, divided by their length, camera axes, in frames with a lifted pose
        of their own.
    """

    errors: Array


def _known(truth: Truth) -> tuple[NDArray[np.intp], int]:
    frames = np.flatnonzero(np.isfinite(truth.joints).all((1, 2)))
    return frames, int(np.diff(frames).min())


def observe_detections(clip: Clip, truth: Truth) -> Detections:
    """Compare the detections of one person with the truth."""
    frames, gap = _known(truth)
    joints = list(DETECTED)
    person = clip.tracks[0]
    unit = clip.camera.short_side / _LINES
    true = truth.camera.project(truth.joints[frames])
    confidence = person.confidences[frames][:, joints]
    error = (person.keypoints[frames] - true)[:, joints] / unit
    mirrored = (person.keypoints[frames] - true[:, list(MIRROR)])[:, joints] / unit
    seen = (confidence > 0) & np.isfinite(error).all(-1) & np.isfinite(mirrored).all(-1)

    def misfit(errors: Array) -> Array:
        squared = (errors**2).sum(-1) / (4 * _SWAP_SCALE**2)
        loss: Array = np.where(seen, 3 * np.log1p(np.where(seen, squared, 0.0)), 0.0).sum(-1)
        return loss

    flipped = misfit(error) - misfit(mirrored) > _FLIP_MARGIN
    usable = seen & ~flipped[:, None]
    return Detections(
        confidence,
        np.asarray(truth.hidden)[frames][:, joints],
        np.where(usable[..., None], error, np.nan),
        flipped,
        gap,
    )


def observe_motion(truth: Truth) -> Motion:
    """Steps of the true motion between successive known frames."""
    frames, gap = _known(truth)
    first = frames[:-1][np.diff(frames) == gap]
    joints = truth.camera.to_camera(truth.joints)
    pelvis = joints[:, PELV]
    x, depth, z = pelvis.T
    bones = bones_of(joints)

    def step(values: Array) -> Array:
        return np.asarray(values[first + gap] - values[first])

    return Motion(
        step(x / depth),
        step(z / depth),
        step(np.log(depth)),
        step(bones),
        step(joints - pelvis[:, None]),
        gap,
    )


def observe_path(clip: Clip, truth: Truth, path: StaticPath, camera: CameraPrior) -> PathErrors:
    """Compare a static path with the truth."""
    frames, _ = _known(truth)
    true = truth.camera.to_camera(truth.joints)
    found = path.joints
    log_depth = np.log(found[:, PELV, 1] / true[:, PELV, 1])
    x, depth, z = np.moveaxis(true[frames, PELV], -1, 0)
    rays = np.stack([x / depth, z / depth], -1)
    own = np.stack([path.estimate[frames, 0], path.lift[frames]], -1)
    world = truth.camera.to_world(found)
    stays = find_stays(clip.tracks[0], path, camera, fps=clip.fps)[:, :2]
    return PathErrors(
        log_depth[frames],
        (own - rays) * depth[:, None],
        path.deviation[frames] * np.stack([depth, np.ones_like(depth)], -1),
        world[:, [RANK, LANK], 2].min(1),
        np.searchsorted(frames, stays),
    )


def observe_lifted(clip: Clip, truth: Truth) -> Lifted:
    """Compare the lifter's bones, at the reference stature, with the truth."""
    frames, _ = _known(truth)
    person = clip.tracks[0]
    body = lifted_body(person, person.has_pose & ~person.interpolated)
    bones = bones_of(truth.camera.to_camera(truth.joints))
    own = frames[body.known[frames]]
    return Lifted((body.bones - bones)[own] / body.lengths[:, None])


def observe_thighs(clip: Clip, truth: Truth, path: StaticPath, camera: CameraPrior) -> Thighs:
    """Compare the thighs of a static path with the annotated actions."""
    angle, seen = thigh_signs(clip.tracks[0], path, camera, fps=clip.fps)
    actions = np.array(truth.actions[: len(angle)])
    angle, seen = angle[: len(actions)], seen[: len(actions)]
    return Thighs(angle, seen, actions == "sitting")


def stretches(truth: Truth, fps: float) -> list[slice]:
    """Intervals of at most about two seconds of one action in one place."""
    actions = truth.actions
    cuts = [0, *(t for t in range(1, len(actions)) if actions[t] != actions[t - 1]), len(actions)]
    found = []
    for begin, end in pairwise(cuts):
        if actions and actions[begin] in _STAYS:
            pieces = max(1, round((end - begin) / (_STRETCH * fps)))
            edges = np.linspace(begin, end, pieces + 1).astype(int).tolist()
            found += [slice(a, b) for a, b in pairwise(edges)]
    return [s for s in found if s.stop - s.start >= _STRETCH * fps / 2]


_NEAR = 1.0
"""Distance in metres within which a true piece corresponds to a scenelet's, as in the scores."""


def furniture_errors(truth: Truth, placed: Iterable[tuple[Scenelet, Placement]]) -> Array:
    """Errors of the furniture places that correctly placed scenelets predict.

    Parameters
    ----------
    truth : Truth
    placed : iterable of (Scenelet, Placement)
        Scenelets nearest to the true motion, placed at it in the truth's world frame.

    Returns
    -------
    (n, 3) float
        One row for each true piece that somebody used: its mean offset over scenelets from the
        predicted place, along its own axes; sideways as a fraction of its width, and forward in
        metres; and the mean angle between both bounding boxes, radians. A box turned by a quarter
        is one with exchanged sides, so angles are modulo that.
    """
    errors: dict[int, list[Array]] = defaultdict(list)
    turns: dict[int, list[float]] = defaultdict(list)
    for scenelet, placement in placed:
        for said in (o.moved(placement) for o in scenelet.objects):
            near = [
                (float(np.linalg.norm(o.centre[:2] - said.centre[:2])), k)
                for k, o in enumerate(truth.objects)
                if group_of(o.label) == group_of(said.label)
            ]
            distance, k = min(near, default=(np.inf, -1))
            if distance <= _NEAR:
                errors[k].append(_along_axes(truth.objects[k], said))
                turns[k].append(truth.objects[k].placement.yaw - said.placement.yaw)
    rows = [[*np.mean(own, axis=0), _mean_turn(turns[k])] for k, own in errors.items()]
    return np.array(rows).reshape(-1, 3)


def observe_seats(
    truth: Truth, placed: Iterable[tuple[Scenelet, Placement]], shares: Mapping[str, float]
) -> Array:
    """How often the nearest scenelet's seat has the label of the true one.

    Parameters
    ----------
    truth : Truth
    placed : iterable of (Scenelet, Placement)
        Of each window, the scenelet nearest to the true motion, placed at it.
    shares : mapping of str to float
        Shares of labels among the library's seats.

    Returns
    -------
    (n, 2) float
        One row for each true seat whose label the library has: the fraction of its windows in which
        the scenelet's seat has its label, and that label's share.
    """
    agree: dict[int, list[bool]] = defaultdict(list)
    for scenelet, placement in placed:
        for said in (o.moved(placement) for o in scenelet.objects if o.label in SEATS):
            seats = [k for k, o in enumerate(truth.objects) if o.label in shares]
            k = min(seats, key=lambda k: _between(truth.objects[k], said), default=-1)
            if k >= 0 and _between(truth.objects[k], said) <= _NEAR:
                agree[k].append(truth.objects[k].label == said.label)
    rows = [(np.mean(own), shares[truth.objects[k].label]) for k, own in agree.items()]
    return np.array(rows, np.float64).reshape(-1, 2)


def _along_axes(o: SceneObject, said: SceneObject) -> Array:
    low, high = o.bounds
    offset = o.placement.rotation.T @ (o.centre - said.centre)[:2]
    result: Array = offset / (high[0] - low[0], 1.0)
    return result


def _mean_turn(angles: Sequence[float]) -> float:
    """Mean of angles that are the same a quarter turn apart, radians; it is within an eighth."""
    return float(np.angle(np.exp(4j * np.array(angles)).mean()) / 4)


Ints = NDArray[np.intp]

_STANDS_FOR = 1.0
"""Greatest distance in metres of a scenelet's piece from the true piece it corresponds to."""


def sights_past(truth: Truth, scenelet: Scenelet, place: Placement, frames: Ints) -> Array:
    """Lines of sight to true joints, past a scenelet's furniture and past the true furniture.

    Every piece of the scenelet corresponds to the nearest true piece. Joints hidden by anything
    else are left out.

    Parameters
    ----------
    truth : Truth
    scenelet : Scenelet
    place : Placement
        Its placement at the true motion.
    frames : (m,) int
        Annotated frames that the scenelet covers.

    Returns
    -------
    (2, n) float
        Clearance of the line of sight from the scenelet's furniture, metres; and 1 if the true
        pieces hide the joint, else 0. Empty if a piece is more than a metre from any true one.
    """
    claimed = [o.moved(place) for o in scenelet.objects]
    meant = [min(truth.objects, key=lambda t: _between(t, o), default=o) for o in claimed]
    if not claimed or max(map(_between, meant, claimed)) > _STANDS_FOR:
        return np.empty((2, 0))
    joints = truth.joints[frames][:, list(DETECTED)]
    camera = truth.camera.to_world(np.zeros(3))
    clearance, real = (
        sight_clearance(camera, joints, pack_boxes(pieces)) for pieces in (claimed, meant)
    )
    elsewhere = np.asarray(truth.hidden)[frames][:, list(DETECTED)] & (real >= 0)
    return np.stack([clearance, real < 0])[:, ~elsewhere]


def _between(one: SceneObject, other: SceneObject) -> float:
    """Distance of centres on the floor, metres."""
    return float(np.linalg.norm((one.centre - other.centre)[:2]))
