"""How well does a library speak for real motion? Charness and matches on i3DB.

    python -m lab.scenelets I3DB_FOLDER

judges windows of 1.7 s of the annotated motion every 0.4 s, by the built-in library, by real
scenelets of the other scenes, and by both, and prints one row for each library:

- area under the ROC: charness of windows of sitting and reaching against walking;
- seated: fraction of seated windows whose nearest motion is of somebody on a seat;
- kind: fraction of seated windows whose nearest motion is on a seat of the true label, of those on
  a seat, and (in brackets) the fraction if motions and labels were independent;
- height, across, along, offset: median difference between the seat of that scenelet and the true
  one: its height, and its middle relative to the pelvis in top view, sideways, forward and as a
  distance, in the person's frame;
- best guess: the same distance for a constant guess, the true median offset.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.stats import rankdata

from imapper_prob.models.scene import SceneObject
from imapper_prob.models.scenelet import Library, Scenelet
from imapper_prob.models.skeleton import PELV
from imapper_prob.scenelets.build import build_library_from, captures_from
from imapper_prob.scenelets.captures import Capture
from imapper_prob.scenelets.charness import (
    categories,
    charness_maps,
    descriptor_distances,
    motion_descriptors,
    object_histograms,
)
from imapper_prob.scenelets.frames import localised
from imapper_prob.scenelets.library import joined, load_library

Array = NDArray[np.float64]

WINDOW: Final = 1.7
"""Seconds, the length of the built-in library's scenelets."""
STRIDE: Final = 0.4
"""Seconds between windows, as in the solver."""
PURE: Final = 0.75
"""Least fraction of a window's frames that must have its action."""
SEATS: Final = ("chair", "couch", "stool", "bench", "bed")
SEATED: Final = ("sit", "sit-down", "stand-up")
"""Actions of scenelets with somebody on a seat."""


@dataclass(frozen=True)
class Verdicts:
    """Charness and nearest motions by a library, for W windows.

    Parameters
    ----------
    words : (W,) str
        True action.
    charness : (W,) float
    matches : tuple of W Scenelet
        The nearest motion of the library.
    windows : tuple of W Scenelet
        The windows themselves, with the true furniture near them.
    """

    words: NDArray[np.str_]
    charness: Array
    matches: tuple[Scenelet, ...]
    windows: tuple[Scenelet, ...]


def windows_of(capture: Capture) -> list[Scenelet]:
    """Intervals of a capture with a single action, in their local frames."""
    length, stride = round(WINDOW * capture.fps), round(STRIDE * capture.fps)
    known = np.flatnonzero(np.isfinite(capture.joints).all((1, 2)))
    pieces = []
    for start in range(int(known[0]), int(known[-1]) - length + 2, stride):
        span = slice(start, start + length)
        words, counts = np.unique(capture.actions[span], return_counts=True)
        word = str(words[counts.argmax()])
        if word and counts.max() >= PURE * length:
            name = f"{capture.name}-{start}"
            joints = capture.joints[span]
            pieces.append(localised(name, word, joints, capture.objects, fps=capture.fps))
    return pieces


def judge(library: Library, windows: Sequence[Scenelet]) -> Verdicts:
    """Compute charness and nearest motion of every window."""
    labels = categories(library)
    known = motion_descriptors([s.joints for s in library])
    distances = descriptor_distances(motion_descriptors([w.joints for w in windows]), known)
    weights = np.array([s.weight for s in library])
    histograms = object_histograms(library.scenelets, labels)
    maps = charness_maps(distances, histograms, weights)
    return Verdicts(
        np.array([w.action for w in windows]),
        maps.reshape(len(maps), -1).max(1),
        tuple(library[int(i)] for i in distances.argmin(1)),
        tuple(windows),
    )


def area_under_roc(positive: Array, negative: Array) -> float:
    """Probability that a positive value exceeds a negative one."""
    ranks = rankdata(np.concatenate([positive, negative]))[: len(positive)]
    wins = ranks.sum() - len(positive) * (len(positive) + 1) / 2
    return float(wins / len(positive) / len(negative))


def nearest_seat(scenelet: Scenelet) -> SceneObject | None:
    """The seat nearest to the pelvis in the middle of a scenelet."""
    pelvis = scenelet.joints[scenelet.n_frames // 2, PELV, :2]
    seats = [o for o in scenelet.objects if o.label in SEATS]
    return min(seats, key=lambda o: float(np.linalg.norm(o.centre[:2] - pelvis)), default=None)


def seat_top(seat: SceneObject) -> float:
    """Height of a seat's surface, metres."""
    parts = [c for c in seat.cuboids if c.part in ("seat", "mattress")]
    return max(float(c.centre[2] + c.size[2] / 2) for c in parts)


def seat_place(scenelet: Scenelet) -> tuple[float, float, float]:
    """Seat relative to the pelvis: to the right, forward; and its height; NaN without a seat."""
    seat = nearest_seat(scenelet)
    if seat is None:
        return np.nan, np.nan, np.nan
    across, along = seat.centre[:2] - scenelet.joints[scenelet.n_frames // 2, PELV, :2]
    return float(across), float(along), seat_top(seat)


def kinds_agree(pairs: Sequence[tuple[Scenelet, Scenelet]]) -> tuple[float, float]:
    """Fraction of pairs whose nearest seats have one label, and that fraction by chance.

    The latter is the mean over all combinations of a first with a second of any pair.
    """
    seats = [(nearest_seat(one), nearest_seat(other)) for one, other in pairs]
    labels = np.array([(a.label, b.label) for a, b in seats if a is not None and b is not None])
    agree = labels[:, 0, None] == labels[None, :, 1]
    return float(np.diagonal(agree).mean()), float(agree.mean())


def row(verdicts: Verdicts) -> str:
    """One line of the table."""
    by_word = {w: verdicts.charness[verdicts.words == w] for w in ("sit", "reach", "walk")}
    both = np.concatenate([by_word["sit"], by_word["reach"]])
    areas = [area_under_roc(p, by_word["walk"]) for p in (both, by_word["sit"], by_word["reach"])]
    seated = np.flatnonzero(verdicts.words == "sit")
    pairs = [(verdicts.matches[i], verdicts.windows[i]) for i in seated]
    right = [m.action in SEATED and nearest_seat(m) is not None for m, _ in pairs]
    found, true = (np.array([seat_place(p[k]) for p in pairs]) for k in (0, 1))
    across, along, height = 100 * np.nanmedian(np.abs(found - true), axis=0)
    offset, guess = (
        100 * np.nanmedian(np.linalg.norm(said[:, :2] - true[:, :2], axis=1))
        for said in (found, np.nanmedian(true, axis=0, keepdims=True))
    )
    kinds, by_chance = kinds_agree(pairs)
    medians = "/".join(f"{np.median(v):.2f}" for v in by_word.values())
    return (
        f"{areas[0]:.3f} ({areas[1]:.3f} {areas[2]:.3f})  {medians}  {100 * np.mean(right):4.0f} %"
        f"  {100 * kinds:3.0f} ({100 * by_chance:.0f}) %  {height:5.1f}  {across:6.1f}"
        f"  {along:5.1f}  {offset:6.1f}  {guess:10.1f}"
    )


def pooled(parts: Sequence[Verdicts]) -> Verdicts:
    """Concatenate the verdicts of several scenes."""
    return Verdicts(
        np.concatenate([p.words for p in parts]),
        np.concatenate([p.charness for p in parts]),
        tuple(m for p in parts for m in p.matches),
        tuple(w for p in parts for w in p.windows),
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("scenes", type=Path, help="folder of i3DB scenes")
    folder = parser.parse_args(arguments).scenes
    captures = captures_from("i3db", folder)
    built_in = load_library()
    verdicts: dict[str, list[Verdicts]] = {"built-in": [], "other scenes": [], "both": []}
    for capture in captures:
        windows = windows_of(capture)
        others = captures_from("i3db", folder, leave_out=capture.name)
        real, _ = build_library_from(others, name="others")
        libraries = (built_in, real, joined([built_in, real]))
        for parts, library in zip(verdicts.values(), libraries, strict=True):
            parts.append(judge(library, windows))
    out = sys.stdout.write
    words, counts = np.unique(pooled(verdicts["both"]).words, return_counts=True)
    out(f"windows: {dict(zip(words.tolist(), counts.tolist(), strict=True))}\n")
    out(
        f"{'library':<14} AUC (sit reach)      charness s/r/w  seated  kind       height"
        "  across  along  offset  best guess (cm)\n"
    )
    for name, parts in verdicts.items():
        out(f"{name:<14} {row(pooled(parts))}\n")


if __name__ == "__main__":
    main()
