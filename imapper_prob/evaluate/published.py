"""Tables 1 and 2 of the paper: every printed figure, and ours where a clip is public."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from imapper_prob.evaluate.pose import SUBSETS
from imapper_prob.evaluate.score import Score
from imapper_prob.evaluate.tables import Rows, number
from imapper_prob.evaluate.truth import TruthInView

__all__ = ["NAMES", "OBJECTS", "POSES", "OnClip", "published_object_rows", "published_pose_rows"]

NAMES: Final = {
    "Scene04": "Scene4", "Scene10": "Lobby2", "Scene13": "Library1", "Scene14": "Garden",
}  # fmt: skip
"""Scenes of the public files by their names in the paper."""


@dataclass(frozen=True)
class ObjectRow:
    """A row of table 1 (Monszpart et al. 2019).

    Parameters
    ----------
    frames : int
    occluded : float
        Part of the frames with occlusion.
    objects : int
        Objects somebody interacts with.
    region_detector : int
        Of these, found by Mask-RCNN.
    depth, imapper : (float, float)
        Mean and standard deviation of the distance of centroids, cm: of monocular depth, and of
        their method; NaN for the deviation of one.
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
"""Table 1, all fourteen rows. Hold-one-out over PiGraphs, in the text: 110 (56) cm."""

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
"""Table 2 by :data:`METHODS`: world cm, local cm, pixels, of frames with three hidden joints or
more. GrRoom is of MPI-INF-3DHP, the others are of i3DB."""

_CLOSE: Final = 0.05
"""Half a unit of the last printed digit of table 2, within which a row is reproduced."""
_LIFTER: Final = "input path"
"""Our name of the lifter's output among the public files: Tome3D's, in one scene LCR-Net++'s."""


@dataclass(frozen=True, eq=False)
class OnClip:
    """What this program says of a public clip.

    Parameters
    ----------
    truth : TruthInView
    scores : mapping of str to Score
        By method.
    regions : mapping of str to int
        By detector, how many used objects it finds in the image.
    depths : mapping of str to (n,) float
        By depth estimator, distances of centroids, metres.
    """

    truth: TruthInView
    scores: Mapping[str, Score]
    regions: Mapping[str, int] = field(default_factory=dict)
    depths: Mapping[str, np.ndarray] = field(default_factory=dict)

    @property
    def occluded(self) -> float:
        """Part of the annotated frames in which a joint is hidden."""
        return float(self.truth.hidden[self.truth.known].any(1).mean())


def published_object_rows(clips: Mapping[str, OnClip], ours: Sequence[str], theirs: str) -> Rows:
    """Table 1: printed / ours in every column.

    Parameters
    ----------
    clips : mapping of str to OnClip
        By the name of the clip.
    ours : sequence of str
        Methods that have a column of their own.
    theirs : str
        Name of the authors' public files among the scores.
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
    """Table 2: world cm / local cm / pixels; parameters as of :func:`published_object_rows`."""
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
    """Distances of centres in top view, and in space, cm."""
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
