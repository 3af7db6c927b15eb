"""Typical faults of lifters, detectors and cameras, applied to clips.

Every spoiling maps a clip and a random generator to another clip, with a flag for each frame that
says whether anything in it was changed. Pixels are stated for an image of 1080 lines and scale with
its height. Only types of `imapper_prob.models` are used.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.camera import Camera
from imapper_prob.models.scene import Clip, Track
from imapper_prob.models.skeleton import (
    BONES,
    HEAD,
    LANK,
    LELB,
    LHIP,
    LKNE,
    LSHO,
    LWRI,
    N_JOINTS,
    NECK,
    PELV,
    RANK,
    RELB,
    RHIP,
    RKNE,
    RSHO,
    RWRI,
    THRX,
    blend_poses,
)

__all__ = [
    "HIPS", "LEGS", "LIMBS", "SPOILINGS", "TRUNK", "Spoiled", "Spoiling", "at_rate",
    "with_confidences", "with_focal_length", "with_ghosts", "with_jumping_limbs",
    "with_legs_cut_off", "with_lost_joints", "with_scaled_bones",
]  # fmt: skip

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Bones = frozenset[tuple[int, int]]

TRUNK: Final[Bones] = frozenset({(THRX, PELV)})
"""Bones as in :data:`imapper_prob.models.skeleton.BONES`: the further joint, then the nearer."""
HIPS: Final[Bones] = frozenset({(RHIP, PELV), (LHIP, PELV)})
LEGS: Final[Bones] = frozenset({(RANK, RKNE), (RKNE, RHIP), (LANK, LKNE), (LKNE, LHIP)})
LIMBS: Final[Bones] = LEGS | {(RWRI, RELB), (RELB, RSHO), (LWRI, LELB), (LELB, LSHO)}

_LINES: Final = 1080
"""Lines of the image for which pixels are stated."""
_GHOST_EVERY, _GHOST_FRAMES = 12.0, (5, 20)
"""Seconds of a clip for each interval elsewhere, and its least and greatest number of frames."""
_GHOST_AWAY: Final = (300.0, 1200.0)
"""Distance in pixels between the person and the place elsewhere, in every frame."""
_LOW: Final = 0.05
"""Fraction of the frames, those with the lowest sums of confidences, that count as low."""
_SHAPE_NOISE, _CLUTTER_NOISE = 3.0, 10.0
"""Standard deviation in pixels between frames, for detections on a person and on clutter."""
_CLUTTER_SPREAD: Final = 0.25
"""Standard deviation of joints on clutter about their middle, as a fraction of the person's
height."""
_JUMP_EVERY, _JUMP_FRAMES, _JUMP_AWAY = 6.0, (5, 15), (150.0, 400.0)
"""The same parameters for limbs that jump."""
_FEWEST: Final = 2
"""Least number of intervals in a clip."""
_TRIES: Final = 300
"""Places drawn until one is inside the image; otherwise the best one is used."""
_TURN: Final = 3.0
"""Seconds of the intervals in which joints are either lost or not."""
_ENDS: Final = ((RELB, RWRI), (LELB, LWRI), (RKNE, RANK), (LKNE, LANK))


class Spoiled(NamedTuple):
    """A spoiled clip.

    Parameters
    ----------
    clip : Clip
    affected : (T,) bool
        Frames in which anything differs from the original clip.
    """

    clip: Clip
    affected: Flags


@dataclass(frozen=True)
class Spoiling:
    """A named way to spoil a clip.

    Parameters
    ----------
    name : str
        Letters, digits, dots and hyphens, so that it can be a file name.
    apply : callable
        Maps a clip and a random generator to a spoiled clip, without changing the original.
    apart : bool
        Whether affected frames have no true detections, so that errors there count separately.
    """

    name: str
    apply: Callable[[Clip, np.random.Generator], Spoiled]
    apart: bool = False


# Lifters -----------------------------------------------------------------------------------


def with_scaled_bones(
    clip: Clip, rng: np.random.Generator, *, bones: Bones, factor: float
) -> Spoiled:
    """Scale some bones of lifted poses by ``factor``, moving the joints beyond them."""
    tracks = tuple(replace(t, poses=_stretched(t.poses, bones, factor)) for t in clip.tracks)
    return Spoiled(replace(clip, tracks=tracks), _any(t.has_pose for t in tracks))


def _stretched(poses: Array, bones: Bones, factor: float) -> Array:
    nearer = dict(BONES)
    result = poses.copy()
    for joint in range(N_JOINTS):
        end = joint
        while end != PELV:
            if (end, nearer[end]) in bones:
                result[:, joint] += (factor - 1) * (poses[:, end] - poses[:, nearer[end]])
            end = nearer[end]
    return result


# Detectors ---------------------------------------------------------------------------------


def with_ghosts(clip: Clip, rng: np.random.Generator, *, low: bool) -> Spoiled:
    """Move all detections elsewhere for 5 to 20 frames, once in 12 s but at least twice.

    Parameters
    ----------
    clip, rng
    low : bool
        Whether joints are scattered as on clutter, with confidences of the track's least confident
        frames; otherwise they keep the person's shape and have confidences of an interval of the
        track. Lifted poses are unchanged.
    """
    tracks, affected = [], []
    for track in clip.tracks:
        keypoints, confidences = track.keypoints.copy(), track.confidences.copy()
        changed = np.zeros(clip.n_frames, bool)
        filled, rows = _filled(track.keypoints), _rows(track, low=low)
        for frames in _stretches(clip, rng, _GHOST_EVERY, _GHOST_FRAMES) if len(rows) else ():
            body = filled[frames]
            keypoints[frames] = _ghost(body, clip.camera, rng, scattered=low)
            drawn = _some(rng, rows, len(body), together=not low)
            confidences[frames] = np.where(np.isfinite(keypoints[frames]).all(-1), drawn, 0.0)
            changed[frames] = True
        tracks.append(replace(track, keypoints=keypoints, confidences=confidences))
        affected.append(changed)
    return Spoiled(replace(clip, tracks=tuple(tracks)), _any(affected))


def _ghost(body: Array, camera: Camera, rng: np.random.Generator, *, scattered: bool) -> Array:
    """(n, 16, 2) detections about one place, for a person whose detections were ``body``."""
    unit = camera.height / _LINES
    middle = np.nanmean(body, axis=1)
    if scattered:
        height = float(np.nanmedian(np.nanmax(body[..., 1], 1) - np.nanmin(body[..., 1], 1)))
        shape = np.tile(rng.normal(0.0, _CLUTTER_SPREAD * height, (N_JOINTS, 2)), (len(body), 1, 1))
        shape += rng.normal(0.0, _CLUTTER_NOISE * unit, shape.shape)
        shape[:, PELV] = (shape[:, RHIP] + shape[:, LHIP]) / 2
        shape[:, NECK] = (shape[:, THRX] + shape[:, HEAD]) / 2
    else:
        shape = body - middle[:, None]
        shape += rng.normal(0.0, _SHAPE_NOISE * unit, shape.shape)
    low, high = (np.asarray(_GHOST_AWAY) * unit).tolist()
    return shape + _place(middle, shape, camera, rng, low, high)


def with_jumping_limbs(clip: Clip, rng: np.random.Generator) -> Spoiled:
    """Move a forearm or shin elsewhere for 5 to 15 frames, once in 6 s but at least twice.

    Both its ends are moved by the same 150 to 400 pixels, with confidences that they have elsewhere
    in the track.
    """
    unit = clip.camera.height / _LINES
    low, high = (np.asarray(_JUMP_AWAY) * unit).tolist()
    tracks, affected = [], []
    for track in clip.tracks:
        keypoints, confidences = track.keypoints.copy(), track.confidences.copy()
        changed = np.zeros(clip.n_frames, bool)
        filled = _filled(track.keypoints)
        for frames in _stretches(clip, rng, _JUMP_EVERY, _JUMP_FRAMES):
            limb = list(_ENDS[rng.integers(len(_ENDS))])
            body = filled[frames][:, limb]
            rows = track.confidences[:, limb]
            rows = rows[(rows > 0).all(1)]
            if not len(rows) or not np.isfinite(body).all():
                continue
            middle = body.mean((0, 1))
            step = _place(middle[None], body - middle, clip.camera, rng, low, high) - middle
            noise = rng.normal(0.0, _SHAPE_NOISE * unit, body.shape)
            keypoints[frames, limb] = body + step + noise
            confidences[frames, limb] = _some(rng, rows, len(body), together=True)
            changed[frames] = True
        tracks.append(replace(track, keypoints=keypoints, confidences=confidences))
        affected.append(changed)
    return Spoiled(replace(clip, tracks=tuple(tracks)), _any(affected))


def with_legs_cut_off(clip: Clip, rng: np.random.Generator) -> Spoiled:
    """Remove all detections below the median height of the detected knees in the image.

    The size of the image is unchanged.
    """
    tracks, affected = [], []
    for track in clip.tracks:
        knees = track.keypoints[:, (RKNE, LKNE), 1][track.confidences[:, (RKNE, LKNE)] > 0]
        line = float(np.median(knees)) if len(knees) else np.inf
        changed, flags = _without(track, track.keypoints[..., 1] > line)
        tracks.append(changed)
        affected.append(flags)
    return Spoiled(replace(clip, tracks=tuple(tracks)), _any(affected))


def with_lost_joints(
    clip: Clip, rng: np.random.Generator, *, joints: Collection[int], throughout: bool
) -> Spoiled:
    """Remove some joints, ``throughout`` or in a random half of intervals of 3 s."""
    turns = np.arange(clip.n_frames) // max(1, round(_TURN * clip.fps))
    count = int(turns[-1]) + 1
    chosen = np.arange(count) if throughout else rng.permutation(count)[: (count + 1) // 2]
    lost = np.isin(turns, chosen)[:, None] & np.isin(np.arange(N_JOINTS), list(joints))
    pairs = [_without(track, lost) for track in clip.tracks]
    tracks = tuple(track for track, _ in pairs)
    return Spoiled(replace(clip, tracks=tracks), _any(flags for _, flags in pairs))


def _without(track: Track, lost: Flags) -> tuple[Track, Flags]:
    """A track without detections where ``lost`` (T, 16), and frames that had any there."""
    keypoints = np.where(lost[..., None], np.nan, track.keypoints)
    confidences = np.where(lost, 0.0, track.confidences)
    flags: Flags = np.any(lost & (track.confidences > 0), axis=1)
    return replace(track, keypoints=keypoints, confidences=confidences), flags


def with_confidences(
    clip: Clip, rng: np.random.Generator, *, curve: Callable[[Array], Array]
) -> Spoiled:
    """Map confidences by ``curve``, from [0, 1] to [0, 1]."""
    tracks = tuple(replace(t, confidences=curve(t.confidences)) for t in clip.tracks)
    changed = (
        (new.confidences != old.confidences).any(1)
        for new, old in zip(tracks, clip.tracks, strict=True)
    )
    return Spoiled(replace(clip, tracks=tracks), _any(changed))


# Cameras -----------------------------------------------------------------------------------


def with_focal_length(clip: Clip, rng: np.random.Generator, *, factor: float) -> Spoiled:
    """Multiply the stated focal length by ``factor``; detections are unchanged."""
    camera = clip.camera
    camera = replace(camera, fx=factor * camera.fx, fy=factor * camera.fy)
    return Spoiled(replace(clip, camera=camera), np.ones(clip.n_frames, bool))


def at_rate(clip: Clip, rng: np.random.Generator, *, fps: float) -> Spoiled:
    """Resample a clip to ``fps`` frames a second from its first frame on, without its truth.

    Between two frames that both have a joint, its pixels and confidence are interpolated linearly
    and bones rotate uniformly; otherwise the nearer frame is repeated.
    """
    last = clip.n_frames - 1
    count = int(np.floor(last / clip.fps * fps + 1e-9)) + 1
    # Rounded so that a frame of both rates is exactly that frame.
    where = np.minimum(np.round(np.arange(count) * clip.fps / fps, 9), last)
    tracks = tuple(_between(track, where) for track in clip.tracks)
    spoiled = replace(clip, fps=fps, frame_ids=np.arange(count), tracks=tracks, truth=None)
    return Spoiled(spoiled, np.ones(count, bool))


def _between(track: Track, where: Array) -> Track:
    """A track at fractional frames ``where`` (n,)."""
    first = np.floor(where).astype(int)
    second = np.minimum(first + 1, len(track.keypoints) - 1)
    nearest = np.where(where - first < 0.5, first, second)
    weight = (where - first)[:, None, None]
    there: Flags = np.all(np.isfinite(track.keypoints), axis=-1)
    seen = track.confidences > 0
    alike = seen[first] == seen[second]
    both = (there[first] & there[second] & alike)[..., None]

    def mixed(values: Array) -> Array:
        """(n, 16, k) interpolated values of detections."""
        line = (1 - weight) * values[first] + weight * values[second]
        return np.where(both, line, values[nearest])

    posed = track.has_pose[first] & track.has_pose[second]
    poses = track.poses[nearest].copy()
    poses[posed] = blend_poses(
        track.poses[first[posed]], track.poses[second[posed]], weight[posed, 0, 0]
    )
    return Track(
        name=track.name,
        keypoints=mixed(track.keypoints),
        confidences=mixed(track.confidences[..., None])[..., 0],
        poses=poses,
        interpolated=track.interpolated[nearest],
    )


# Tools -------------------------------------------------------------------------------------


def _any(flags: Iterable[Flags]) -> Flags:
    result: Flags = np.any(np.stack(list(flags)), axis=0)
    return result


def _filled(keypoints: Array) -> Array:
    """Each joint at its position in the nearest frame that has it; NaN if there is none."""
    result = keypoints.copy()
    frames = np.arange(len(keypoints))
    for joint in range(N_JOINTS):
        there = np.flatnonzero(np.isfinite(keypoints[:, joint]).all(-1))
        if len(there):
            nearest = there[np.abs(frames[:, None] - there).argmin(1)]
            result[:, joint] = keypoints[nearest, joint]
    return result


def _rows(track: Track, *, low: bool) -> Array:
    """(n, 16) confidences of the frames with detections, or of the least confident ones."""
    rows: Array = track.confidences[(track.confidences > 0).any(1)]
    if not low or not len(rows):
        return rows
    fewest = max(3, round(_LOW * len(rows)))
    return rows[np.argsort(rows.sum(1), kind="stable")[:fewest]]


def _some(rng: np.random.Generator, rows: Array, count: int, *, together: bool) -> Array:
    """``count`` of the rows, consecutive from a random one or drawn independently."""
    if together:
        first = rng.integers(max(1, len(rows) - count + 1))
        chosen = (first + np.arange(count)) % len(rows)
    else:
        chosen = rng.integers(len(rows), size=count)
    result: Array = rows[chosen]
    return result


def _stretches(
    clip: Clip, rng: np.random.Generator, every: float, frames: tuple[int, int]
) -> list[slice]:
    """Separate intervals, one in each equal part of the clip.

    Parameters
    ----------
    clip, rng
    every : float
        Seconds of each part.
    frames : (int, int)
        Least and greatest length of an interval; shorter in clips that are too short.
    """
    count = max(_FEWEST, int(clip.n_frames / clip.fps // every))
    edges = np.linspace(0, clip.n_frames, count + 1).astype(int).tolist()
    found = []
    for begin, end in pairwise(edges):
        length = min(int(rng.integers(frames[0], frames[1] + 1)), end - begin - 2)
        if length > 0:
            # One frame is left free at either end of the part.
            start = int(rng.integers(begin + 1, end - length))
            found.append(slice(start, start + length))
    return found


def _place(
    middle: Array, shape: Array, camera: Camera, rng: np.random.Generator, low: float, high: float
) -> Array:
    """(2,) a place for some joints, entirely inside the image if one is found.

    Parameters
    ----------
    middle : (n, 2) float
        Position of the joints in each frame, pixels.
    shape : (n, J, 2) float
        Joints relative to the place, pixels.
    camera, rng
    low, high : float
        Least distance of the place from all of ``middle``, and greatest distance from their mean,
        pixels.
    """
    corners = np.nanmin(shape, (0, 1)), np.nanmax(shape, (0, 1))
    size = np.array([camera.width, camera.height])
    start: Array = middle.mean(0)
    best, least = start, np.inf
    for _ in range(_TRIES):
        angle, away = rng.uniform(0.0, 2 * np.pi), rng.uniform(low, high)
        place = start + away * np.array([np.cos(angle), np.sin(angle)])
        outside = np.maximum(-(place + corners[0]), 0) + np.maximum(place + corners[1] - size, 0)
        short = max(0.0, low - float(np.linalg.norm(place - middle, axis=-1).min()))
        cost = float(outside.sum()) + short
        if cost < least:
            best, least = place, cost
        if cost == 0:
            break
    return best


# All of them -------------------------------------------------------------------------------


def _squared(confidences: Array) -> Array:
    return confidences**2


def _halved(confidences: Array) -> Array:
    return 0.5 * confidences


def _raised(confidences: Array) -> Array:
    return np.minimum(1.0, 1.3 * confidences)


SPOILINGS: Final = (
    *(
        Spoiling(f"{name}-{factor}", partial(with_scaled_bones, bones=bones, factor=factor))
        for name, bones in (("trunk", TRUNK), ("hips", HIPS), ("legs", LEGS))
        for factor in (0.6, 0.9, 1.1, 1.4)
    ),
    Spoiling("limbs-0.85", partial(with_scaled_bones, bones=LIMBS, factor=0.85)),
    Spoiling("elsewhere-low", partial(with_ghosts, low=True), apart=True),
    Spoiling("elsewhere-usual", partial(with_ghosts, low=False), apart=True),
    Spoiling("limbs-jump", with_jumping_limbs),
    Spoiling("legs-cut-off", with_legs_cut_off),
    Spoiling(
        "left-side-lost",
        partial(with_lost_joints, joints=(LELB, LWRI, LKNE, LANK), throughout=True),
    ),
    Spoiling(
        "right-side-lost-by-halves",
        partial(with_lost_joints, joints=(RELB, RWRI, RKNE, RANK), throughout=False),
    ),
    Spoiling("confidences-squared", partial(with_confidences, curve=_squared)),
    Spoiling("confidences-halved", partial(with_confidences, curve=_halved)),
    Spoiling("confidences-raised", partial(with_confidences, curve=_raised)),
    Spoiling("focal-0.95", partial(with_focal_length, factor=0.95)),
    Spoiling("focal-1.05", partial(with_focal_length, factor=1.05)),
    Spoiling("rate-15", partial(at_rate, fps=15.0)),
    Spoiling("rate-25", partial(at_rate, fps=25.0)),
)
"""Faults of lifters, then of detectors, then of cameras."""
