"""Are frames found in which the detector was elsewhere, and how many others are taken for such?

    python -m lab.elsewhere [--scenes ../shared/i3db] [--draws 5]

puts stretches elsewhere into the i3DB scenes, as `lab.spoiled.spoilings` does, and prints Markdown:
how many of the frames put in, and of their stretches, are found, and false alarms in the other
frames and in the scenes as they are. What looks for them is
`imapper_prob.solver.elsewhere.frames_elsewhere`.
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

from imapper_prob.clips.load import load_clip
from imapper_prob.evaluate.score import scenes_with_truth
from imapper_prob.evaluate.tables import markdown_table
from imapper_prob.models.scene import Clip
from imapper_prob.solver.elsewhere import frames_elsewhere
from lab.spoiled.scores import UNSPOILED, spoil
from lab.spoiled.spoilings import SPOILINGS

__all__ = ["Counts", "count"]

Flags = NDArray[np.bool_]
KINDS: Final = tuple(s.name for s in SPOILINGS if s.apart)


@dataclass(frozen=True)
class Counts:
    """What became of some frames and stretches.

    Parameters
    ----------
    inserted, found : int
        Frames put elsewhere, and those of them that were flagged.
    stretches, noticed : int
        The same of whole stretches; one is noticed if any of its frames is flagged.
    others, false : int
        Frames that were left alone, and those of them that were flagged.
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
        """In the order of the fields."""
        return self.inserted, self.found, self.stretches, self.noticed, self.others, self.false


def count(flagged: Flags, affected: Flags) -> Counts:
    """Flags (T,) against the frames (T,) that were put elsewhere."""
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
    """Over clips and draws of one kind of stretches, or over the clips as they are."""
    result = Counts()
    for clip in clips:
        for seed in range(draws if kind != UNSPOILED else 1):
            changed, affected = spoil(clip, kind, seed)
            flagged = frames_elsewhere(changed.tracks[0], camera=changed.camera, fps=changed.fps)
            result += count(flagged, affected)
    return result


def main(arguments: Sequence[str] | None = None) -> None:
    """Print a row a kind of stretches."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenes", type=Path, default=Path("../shared/i3db"))
    parser.add_argument("--draws", type=int, default=5, help="of stretches in each scene")
    options = parser.parse_args(arguments)
    clips = [load_clip(scene) for scene in scenes_with_truth(options.scenes)]
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


if __name__ == "__main__":
    main()
