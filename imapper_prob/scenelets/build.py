"""Build libraries from captures: cut motion, convert to local frames, add objects and weights.

The construction follows Monszpart et al. (2019, section 4), with three additions. All motion is
converted to one frame rate and one stature, because a library has one of each. The furniture is
scaled with the person, so that both fit. Each scenelet has a weight: one over the number of
scenelets that begin near it in the same room.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.distance import cdist

from imapper_prob.models.errors import InputError
from imapper_prob.models.scenelet import Library, Scenelet
from imapper_prob.models.skeleton import (
    BONE_LENGTHS,
    HEAD,
    LANK,
    LHIP,
    LKNE,
    LSHO,
    PELV,
    RANK,
    REFERENCE_STATURE,
    RHIP,
    RKNE,
    RSHO,
    THRX,
)
from imapper_prob.scenelets.captures import (
    Capture,
    i3db_folders,
    joints_at,
    read_capture,
    read_i3db_capture,
)
from imapper_prob.scenelets.frames import localised
from imapper_prob.scenelets.pigraphs import pigraphs_recordings, read_pigraphs

__all__ = [
    "SOURCES",
    "body_scale",
    "build_library_from",
    "captures_from",
    "cut",
    "smooth_path",
    "stretches",
    "weights_by_density",
]

Array = NDArray[np.float64]
# ------------------------------------------------------------------------------------------------
# Cutting.
#
# Monszpart et al. (2019, section 4) cut where the pelvis has moved a constant distance in top view,
# after smoothing the sway of a standing person. The paper states neither that distance nor the
# spacing of clips. Literally, the rule would skip people who stay in one place: in the truth of
# four i3DB scenes one metre takes 13 to 16 frames (1.5 s) of walking, as published, but 29 to 42 (3
# to 4 s) of sitting. So a clip ends after a second on either side even if the distance is shorter,
# and clips are centred at least every second. Several clips of one stay count as one by their
# weights.

Ints = NDArray[np.int64]

_WAY: Final = 1.0
"""Length of the pelvis path in a clip, metres. In i3DB 1 m gives the 14-20 frames of the paper's
clips."""
_WAY_BETWEEN: Final = 0.25
"""Metres of path between the centres of clips, so four clips share each place of a walk; chosen."""
_LONGEST: Final = 2.0
"""Longest duration of a clip in seconds, that of the paper's longest clips."""
_TIME_BETWEEN: Final = 1.0
"""Longest time between the centres of clips, seconds; chosen."""
_SHORTEST: Final = 0.6
"""Shortest duration of a clip in seconds, that of a metre of fast walking. Shorter ones were cut
off by the end of tracking, or are jumps of the tracker."""
_SMOOTHING_RADIUS: Final = 0.01
"""Metres of path on either side over which a point of the path is averaged (paper)."""
_SMOOTHING_PASSES: Final = 10
"""Number of averaging passes (paper)."""


def smooth_path(path: ArrayLike, *, radius: float, passes: int) -> Array:
    """Smooth a path (n, 2) by averaging over the points within ``radius`` of path length.

    Steps longer than the radius are unchanged; the sway of a standing person is averaged out.

    Parameters
    ----------
    path : path
    radius : float
        Metres.
    passes : int

    Returns
    -------
    (n, 2) float
    """
    smooth: Array = np.asarray(path, float)
    for _ in range(passes):
        way = _way(smooth)
        first = np.searchsorted(way, way - radius, "left")
        last = np.searchsorted(way, way + radius, "right")
        sums = np.concatenate([np.zeros((1, 2)), np.cumsum(smooth, 0)])
        smooth = (sums[last] - sums[first]) / (last - first)[:, None]
    return smooth


def cut(path: ArrayLike, *, fps: float) -> Ints:
    """Cut an uninterrupted motion into clips.

    Parameters
    ----------
    path : (n, 2) float
        Pelvis in top view, metres, regular frames.
    fps : float
        Frames per second.

    Returns
    -------
    (C, 2) int
        First frame of each clip and the frame after its last one, in order and without duplicates;
        empty if the motion is too short.
    """
    path = np.asarray(path, float)
    if len(path) < 2:
        return np.empty((0, 2), dtype=np.int64)
    way = _way(smooth_path(path, radius=_SMOOTHING_RADIUS, passes=_SMOOTHING_PASSES))
    # A centre wherever the next step of path or of time is complete, whichever comes first.
    hurry = np.maximum(np.diff(way) / _WAY_BETWEEN, 1.0 / fps / _TIME_BETWEEN)
    progress = np.concatenate([[0.0], np.cumsum(hurry)])
    # Rounding errors of sums must not delay a centre to the next frame.
    centres = np.searchsorted(progress + 1e-9, np.arange(0.5, progress[-1]))
    half = round(_LONGEST / 2 * fps)
    first = np.searchsorted(way, way[centres] - _WAY / 2 - 1e-9, "left")
    end = np.searchsorted(way, way[centres] + _WAY / 2 + 1e-9, "right")
    clips = np.stack([np.maximum(first, centres - half), np.minimum(end, centres + half + 1)], 1)
    lasting = clips[:, 1] - clips[:, 0] > _SHORTEST * fps - 1e-9
    unique: Ints = np.unique(clips[lasting], axis=0)
    return unique


def stretches(there: ArrayLike) -> Ints:
    """(S, 2) first index, and index after the last, of each run of true values (n,).

    Parameters
    ----------
    there : (n,) bool

    Returns
    -------
    (S, 2) int
    """
    flags = np.concatenate([[False], np.asarray(there, bool), [False]])
    edges: Ints = np.flatnonzero(flags[1:] != flags[:-1]).reshape(-1, 2)
    return edges


def _way(path: Array) -> Array:
    """(n,) path length until each point, metres."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])


# ------------------------------------------------------------------------------------------------
# Building.

UNKNOWN_ACTION: Final = "motion"
"""Action of a clip whose frames have no action."""
_STEADY_BONES: Final = ((PELV, THRX), (RKNE, RHIP), (LKNE, LHIP), (RHIP, LHIP), (RSHO, LSHO))
"""Segments whose end points are consistent between recordings. Wrists, ankles and head are not:
shins of the i3DB truth have .83-.90 of the reference length and forearms .73-.86, but thighs, trunk
and girdles .94-1.08."""
_STATURES: Final = (1.0, 2.4)
"""Range of statures in metres; outside it is a child or a wrong unit."""
_CELLS: Final = 20
"""Floor cells per kernel width. Scenelets of one cell are counted together, so that the cost grows
with the area walked on and not with the duration."""
_ROWS_AT_ONCE: Final = 1000
"""Rows of the distance matrix between the cells of a room that are computed at once."""
_FPS: Final = 10.0
"""Frames per second of all scenelets, those of the built-in library."""
_BRIDGED: Final = 0.3
"""Longest gap in tracking that is interpolated linearly, seconds; longer ones end a clip.
Chosen."""
_DENSITY_WIDTH: Final = 0.2
"""Standard deviation in metres of the kernel over origins of scenelets (paper)."""


@dataclass(frozen=True)
class BuildReport:
    """Summary of a build; as text, a few lines for a person.

    Parameters
    ----------
    n_scenelets : dict of str to int
        Number of scenelets by capture.
    n_bare : int
        Scenelets without furniture.
    scales : dict of str to float
        Size of each body relative to the reference body.
    lost : dict of str to float
        Seconds of each capture without tracking.
    skipped : dict of str to str
        Captures without any scenelet, with the reason.
    """

    n_scenelets: dict[str, int]
    n_bare: int
    scales: dict[str, float]
    lost: dict[str, float]
    skipped: dict[str, str]

    def __str__(self) -> str:
        total = sum(self.n_scenelets.values())
        lines = [
            f"{total} scenelets from {len(self.n_scenelets)} captures, "
            f"{self.n_bare} of them without furniture"
        ]
        for name, count in self.n_scenelets.items():
            stature = self.scales[name] * REFERENCE_STATURE
            lost = f", nobody tracked for {self.lost[name]:.1f} s" if self.lost[name] > 0 else ""
            lines.append(f"  {name}: {count} (stature {stature:.2f} m{lost})")
        lines += [f"  {name}: left out: {reason}" for name, reason in self.skipped.items()]
        return "\n".join(lines)


@dataclass(frozen=True)
class _Motion:
    """A capture at the library's frame rate, and its clips."""

    capture: Capture
    joints: Array  # (n, 16, 3)
    actions: tuple[str, ...]  # n words, or none
    clips: NDArray[np.int64]  # (C, 2)

    @property
    def origins(self) -> Array:
        """(C, 2) origins of the clips' local frames, metres."""
        middle = self.clips[:, 0] + (self.clips[:, 1] - self.clips[:, 0]) // 2
        return self.joints[middle, PELV, :2]


def build_library_from(captures: Sequence[Capture], *, name: str) -> tuple[Library, BuildReport]:
    """Build a library from recordings.

    Parameters
    ----------
    captures : sequence of Capture
        Captures of one room have the same ``scene``; names are unique.
    name : str
        Name of the library.

    Returns
    -------
    library : Library
        Scenelets in the order of captures and time, with names ``<capture>-<number>``.
    report : BuildReport
        What was left out, and why.

    Raises
    ------
    InputError
        There are no captures, two of the same name, or none gives a scenelet.
    """
    twice = [n for n, count in Counter(c.name for c in captures).items() if count > 1]
    if twice:
        raise InputError(f"two captures are called {twice[0]!r}; rename one")
    motions: list[_Motion] = []
    scales: dict[str, float] = {}
    skipped: dict[str, str] = {}
    for capture in captures:
        try:
            scales[capture.name] = _checked_scale(capture)
            motions.append(_cut(capture))
        except InputError as error:
            skipped[capture.name] = str(error)
    if not motions:
        reasons = "; ".join(f"{n}: {reason}" for n, reason in skipped.items())
        raise InputError(f"library {name} would be empty; {reasons or 'no captures were given'}")
    weights = _weights(motions)
    scenelets = [
        scenelet
        for motion, own in zip(motions, weights, strict=True)
        for scenelet in _scenelets(motion, own, scales[motion.capture.name])
    ]
    report = BuildReport(
        n_scenelets={m.capture.name: len(m.clips) for m in motions},
        n_bare=sum(not s.objects for s in scenelets),
        scales=scales,
        lost={m.capture.name: _lost(m.joints) / _FPS for m in motions},
        skipped=skipped,
    )
    return Library(name, tuple(scenelets)), report


def body_scale(joints: ArrayLike) -> float:
    """Size of a body relative to the reference body: median over thighs, trunk and girdles.

    Parameters
    ----------
    joints : (T, 16, 3) float
        Metres; frames of NaN are ignored.

    Returns
    -------
    float
    """
    joints = np.asarray(joints, float)
    ratios = [
        np.nanmedian(np.linalg.norm(joints[:, a] - joints[:, b], axis=1)) / BONE_LENGTHS[a, b]
        for a, b in _STEADY_BONES
    ]
    return float(np.median(ratios))


def weights_by_density(origins: ArrayLike, width: float) -> Array:
    """One over the number of scenelets that begin near each, by a Gaussian kernel.

    Parameters
    ----------
    origins : (C, 2) float
        Origins of the scenelets of one room, metres.
    width : float
        Standard deviation of the kernel, metres.

    Returns
    -------
    (C,) float
        1 for a scenelet far from all others, 1/n for each of n in one place.
    """
    cells = np.rint(np.asarray(origins, float) * (_CELLS / width))
    cells, own, counts = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    sums = [
        np.exp(-0.5 * cdist(some, cells, "sqeuclidean") / _CELLS**2) @ counts
        for some in np.split(cells, range(_ROWS_AT_ONCE, len(cells), _ROWS_AT_ONCE))
    ]
    weights: Array = 1.0 / np.concatenate(sums)[own.ravel()]
    return weights


def _checked_scale(capture: Capture) -> float:
    """Scale of the body, after checking that the capture is of a person standing on its floor."""
    scale = body_scale(capture.joints)
    stature = scale * REFERENCE_STATURE
    if not _STATURES[0] <= stature <= _STATURES[1]:
        raise InputError(f"bones of a person {stature:.3g} m tall; joints must be in metres")
    heights = capture.joints[:, HEAD, 2] - capture.joints[:, [RANK, LANK], 2].mean(1)
    if np.nanmedian(heights) < -0.25 * stature:
        raise InputError("the head is below the feet; check which axis is up")
    return scale


def _cut(capture: Capture) -> _Motion:
    times = np.arange(len(capture.joints)) / capture.fps
    moments = np.arange(int(np.floor(times[-1] * _FPS + 1e-9)) + 1) / _FPS
    # A gap includes the steps to and from the lost frames.
    joints = joints_at(moments, times, capture.joints, bridged=_BRIDGED + 1.0 / capture.fps)
    nearest = np.minimum(np.rint(moments * capture.fps).astype(int), len(times) - 1)
    clips = [
        first + cut(joints[first:end, PELV, :2], fps=_FPS)
        for first, end in stretches(np.isfinite(joints[:, PELV, 0]))
    ]
    found = np.concatenate([*clips, np.empty((0, 2), dtype=np.int64)])
    if not len(found):
        raise InputError(f"nobody was tracked for {_SHORTEST:g} s without interruption")
    actions = tuple(capture.actions[i] for i in nearest) if capture.actions else ()
    return _Motion(capture, joints, actions, found)


def _weights(motions: Sequence[_Motion]) -> list[Array]:
    """(C,) weights for each motion; all scenelets of a room are counted together."""
    origins = [m.origins for m in motions]
    owner = np.repeat(np.arange(len(motions)), [len(o) for o in origins])
    rooms = np.array([m.capture.scene for m in motions])[owner]
    everything = np.concatenate(origins)
    weights = np.empty(len(everything))
    for room in np.unique(rooms):
        inside = rooms == room
        weights[inside] = weights_by_density(everything[inside], _DENSITY_WIDTH)
    return [weights[owner == i] for i in range(len(motions))]


def _scenelets(motion: _Motion, weights: Array, scale: float) -> list[Scenelet]:
    result = []
    for index, ((first, end), weight) in enumerate(zip(motion.clips, weights, strict=True)):
        own = localised(
            f"{motion.capture.name}-{index:04d}",
            _usual(motion.actions[first:end]),
            motion.joints[first:end],
            motion.capture.objects,
            fps=_FPS,
        )
        result.append(replace(own.scaled(1.0 / scale), weight=float(weight)))
    return result


def _usual(words: Sequence[str]) -> str:
    """The most frequent word, the first among equals; frames without a word are ignored."""
    counts = Counter(word for word in words if word)
    return counts.most_common(1)[0][0] if counts else UNKNOWN_ACTION


def _lost(joints: Array) -> int:
    return int((~np.isfinite(joints[:, PELV, 0])).sum())


# ------------------------------------------------------------------------------------------------
# Reading captures by the name of their format.

_log = logging.getLogger(__name__)
_TOLD: Final = 5
"""Largest number of rejected recordings that are named in a warning."""
SOURCES: Final = ("i3db", "pigraphs", "npz")
"""Formats of captures."""


def captures_from(source: str, path: str | Path, *, leave_out: str | None = None) -> list[Capture]:
    """Read all captures of a folder, or those of one file.

    Parameters
    ----------
    source : str
        One of :data:`SOURCES`: scene folders of the i3DB benchmark, recordings of PiGraphs,
        or capture files (:mod:`imapper_prob.scenelets.captures`).
    path : path
        File or folder.
    leave_out : str, optional
        Name of a room whose captures are left out, because it is to be inferred.

    Returns
    -------
    list of Capture
        At least one. Among several files, unusable ones are skipped with a warning.

    Raises
    ------
    InputError
        There is nothing of this format, no room has the name ``leave_out``, or no usable capture is
        left.
    """
    path = Path(path)
    if not path.exists():
        raise InputError(f"{path}: no such file or folder")
    places, read = _places_and_reader(source, path)
    captures: list[Capture] = []
    refused: list[str] = []
    for place in places:
        try:
            captures += read(place)
        except InputError as error:
            if len(places) == 1:
                raise
            refused.append(str(error))
    if not captures:
        raise InputError(
            f"{path}: none of {len(places)} files is a usable recording of {source}; "
            f"the first: {refused[0]}"
        )
    for reason in refused[:_TOLD]:
        _log.warning("left out: %s", reason)
    if len(refused) > _TOLD:
        _log.warning("left out: %d more", len(refused) - _TOLD)
    if leave_out is None:
        return captures
    scenes = sorted({c.scene for c in captures})
    if leave_out not in scenes:
        raise InputError(
            f"{path}: no scene {leave_out!r} to leave out; there are {', '.join(scenes)}"
        )
    kept = [c for c in captures if c.scene != leave_out]
    if not kept:
        raise InputError(f"{path}: nothing is left without {leave_out}, the only scene there")
    return kept


def _places_and_reader(
    source: str, path: Path
) -> tuple[list[Path], Callable[[Path], list[Capture]]]:
    """Files or folders with one recording each, and the function that reads them."""
    if source == "i3db":
        return i3db_folders(path), _i3db_scene
    if source == "pigraphs":
        folder = path.parent if path.is_file() else path
        return pigraphs_recordings(path), partial(read_pigraphs, folder=folder)
    if source == "npz":
        files = [path] if path.is_file() else sorted(path.glob("*.npz"))
        if not files:
            raise InputError(f"{path}: no capture file (.npz) there")
        return files, _capture_file
    raise InputError(f"unknown format of captures {source!r}; there are {', '.join(SOURCES)}")


def _i3db_scene(folder: Path) -> list[Capture]:
    return [read_i3db_capture(folder)]


def _capture_file(path: Path) -> list[Capture]:
    return [read_capture(path)]
