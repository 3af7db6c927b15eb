"""Are frames found in which the detector was elsewhere, and how many others are taken for such?

    python -m lab.elsewhere [CLIP ...] [--draws 5] [--simulated N] [--picture PNG]

inserts intervals in which the detector was elsewhere into clips, as `lab.spoiled.spoilings` does,
and prints Markdown: how many of the inserted frames and intervals are found, and false alarms in
the other frames and in the unchanged clips. Clips are anything that `imapper-prob run` accepts, by
default the i3DB scenes in ../shared/i3db, or N simulated ones of 15 s. The function that is tested
is `imapper_prob.solver.elsewhere.frames_elsewhere`. With ``--picture`` the static path of each clip
with intervals of usual confidences is drawn from above: without the found frames, with all frames,
and the truth if it is known. It takes under a minute for the scenes.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final
from unittest.mock import patch

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from imapper_prob.clips.i3db import read_i3db_truth
from imapper_prob.clips.load import load_clip
from imapper_prob.evaluate.score import scenes_with_truth
from imapper_prob.evaluate.tables import markdown_table
from imapper_prob.models.camera import Camera
from imapper_prob.models.detector import DetectionModel
from imapper_prob.models.scene import Clip, Track
from imapper_prob.models.skeleton import PELV
from imapper_prob.plotting import save_figure
from imapper_prob.scenelets.library import load_library
from imapper_prob.simulate.clips import simulate_clip
from imapper_prob.solver.detections import elsewhere_frames
from imapper_prob.solver.static_path import estimate_static_path
from lab.spoiled.scores import UNSPOILED, spoil
from lab.spoiled.spoilings import SPOILINGS

__all__ = ["Counts", "count"]

Flags = NDArray[np.bool_]
SCENES: Final = Path("../shared/i3db")
KINDS: Final = tuple(s.name for s in SPOILINGS if s.apart)


@dataclass(frozen=True)
class Counts:
    """Counts of flagged frames and intervals.

    Parameters
    ----------
    inserted, found : int
        Frames put elsewhere, and those of them that were flagged.
    stretches, noticed : int
        The same for intervals; one is noticed if any of its frames is flagged.
    others, false : int
        Unchanged frames, and those of them that were flagged.
    """

    inserted: int = 0
    found: int = 0
    stretches: int = 0
    noticed: int = 0
    others: int = 0
    false: int = 0

    def __add__(self, other: Counts) -> Counts:
        return Counts(*(a + b for a, b in zip(self.values, other.values, strict=True)))

    @property
    def values(self) -> tuple[int, ...]:
        """Values in the order of the fields."""
        return self.inserted, self.found, self.stretches, self.noticed, self.others, self.false


def count(flagged: Flags, affected: Flags) -> Counts:
    """Compare flags (T,) with the frames (T,) that were put elsewhere."""
    edges = np.flatnonzero(np.diff(affected.astype(int), prepend=0, append=0))
    stretches = [slice(a, b) for a, b in edges.reshape(-1, 2).tolist()]
    return Counts(
        inserted=int(affected.sum()),
        found=int((flagged & affected).sum()),
        stretches=len(stretches),
        noticed=sum(bool(flagged[s].any()) for s in stretches),
        others=int((~affected).sum()),
        false=int((flagged & ~affected).sum()),
    )


def total(clips: Sequence[Clip], kind: str, draws: int) -> Counts:
    """Counts over clips and draws of one kind of intervals, or over the unchanged clips."""
    result = Counts()
    for clip in clips:
        for seed in range(draws if kind != UNSPOILED else 1):
            changed, affected = spoil(clip, kind, seed)
            flagged = elsewhere_frames(changed)[0]
            result += count(flagged, affected)
    return result


def with_truth(path: Path) -> Clip:
    """Read a clip, with the ground truth of an i3DB scene if there is one."""
    clip = load_clip(path)
    known = path.is_dir() and (path / "gt").is_dir()
    return replace(clip, truth=read_i3db_truth(path, clip)) if known else clip


def _nowhere(track: Track, *, camera: Camera, fps: float, detections: DetectionModel) -> Flags:
    return np.zeros(len(track.confidences), bool)


def paths_figure(clips: Sequence[Clip]) -> Figure:
    """The static path of spoiled clips with and without the filter, and the truth, from above."""
    figure = Figure(figsize=(3.6 * len(clips), 4.2), layout="constrained")
    row = figure.subplots(1, len(clips), squeeze=False)[0]
    for axes, clip in zip(row, clips, strict=True):
        spoiled, affected = spoil(clip, KINDS[-1], 0)
        camera = spoiled.camera
        with patch("imapper_prob.solver.detections.frames_elsewhere", _nowhere):
            everything = estimate_static_path(spoiled).pelvis
        paths = {
            "all frames believed": everything,
            "frames elsewhere left out": estimate_static_path(spoiled).pelvis,
        }
        if clip.truth is not None:
            joints = clip.truth.joints
            known = np.isfinite(joints).all((1, 2))
            axes.plot(*joints[known][:, PELV, :2].T, color="black", lw=2.5, label="truth")
            camera = clip.truth.camera
        for (name, pelvis), colour in zip(paths.items(), ("#e15759", "#4e79a7"), strict=True):
            axes.plot(*camera.to_world(pelvis)[:, :2].T, color=colour, lw=1.2, label=name)
        stretch = camera.to_world(paths["frames elsewhere left out"])[affected, :2]
        axes.plot(*stretch.T, ".", color="#4e79a7", ms=4, label="detector elsewhere")
        axes.set(title=clip.name, xlabel="x [m]", aspect="equal")
    row[0].set_ylabel("y, away from the camera [m]")
    figure.legend(*row[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure


def main(arguments: Sequence[str] | None = None) -> None:
    """Print one row for each kind of interval."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("clips", type=Path, nargs="*")
    parser.add_argument("--draws", type=int, default=5, help="of stretches in each clip")
    parser.add_argument("--simulated", type=int, default=0, metavar="N")
    parser.add_argument("--picture", type=Path)
    options = parser.parse_args(arguments)
    paths = options.clips or ([] if options.simulated else scenes_with_truth(SCENES))
    clips = [with_truth(path) for path in paths]
    library = load_library() if options.simulated else None
    for seed in range(options.simulated):
        assert library is not None
        clips.append(simulate_clip(np.random.default_rng(seed), library))
    rows: list[tuple[str, ...]] = [("", "frames found", "stretches noticed", "false alarms")]
    for kind in (UNSPOILED, *KINDS):
        found = total(clips, kind, options.draws)
        cells = ("–", "–")
        if found.inserted:
            cells = (
                f"{found.found} of {found.inserted}", f"{found.noticed} of {found.stretches}",
            )  # fmt: skip
        rows.append((kind, *cells, f"{found.false} of {found.others}"))
    sys.stdout.write(markdown_table(rows) + "\n")
    if options.picture is not None:
        save_figure(paths_figure(clips), options.picture, dpi=90)


if __name__ == "__main__":
    main()
