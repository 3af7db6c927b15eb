"""Do several takes of one room say together what each alone does not?

    python -m lab.takes FOLDER [--seeds 1] [--steps N] [--workers 2]

simulates a room with a couch, a shelf and a bed that somebody uses one after the other, in front of
one camera, and cuts the clip into three takes, one for each piece. Each take is sampled alone, and
all together. The output is a Markdown table: for each piece, the fraction of draws with an object
of the same kind, where all objects to sit on are one kind, within a metre of it. Runs are stored in
FOLDER, and can be opened with ``imapper-prob view``. It takes some minutes a seed.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import imapper_prob as im
from imapper_prob.clips.load import window
from imapper_prob.clips.takes import same_room
from imapper_prob.config import SampleSettings
from imapper_prob.models.scene import SEATS, Clip, SceneObject
from imapper_prob.results.posterior import Posterior
from imapper_prob.simulate.clips import simulate_clip
from lab.stored import sampled

_SCRIPT = ("sit-couch-001", "reach-shelf-001", "sit-bed-001")
_FRAMES = 240
"""Frames of the clip, at ten a second; walking to a piece and using it takes some sixty."""
_NEAR = 1.0
"""Metres within which an object counts as the true one, as in the benchmark."""


def takes_of(seed: int) -> tuple[tuple[Clip, ...], tuple[SceneObject, ...]]:
    """Three takes of a simulated room, and its furniture."""
    whole = simulate_clip(
        np.random.default_rng(seed),
        im.load_library(),
        n_frames=_FRAMES,
        script=_SCRIPT,
        n_bystanders=0,
        name="room",
    )
    truth = whole.truth
    assert truth is not None
    borders = [0, *_between(np.array(truth.actions) != "walking"), whole.n_frames]
    takes = tuple(
        replace(window(whole, first, end - 1), name=f"take {number}")
        for number, (first, end) in enumerate(pairwise(borders), 1)
    )
    return takes, truth.objects


def _between(used: NDArray[np.bool_]) -> list[int]:
    """The middle frames between successive uses of furniture."""
    edges = np.diff(np.concatenate([[0], used.astype(int), [0]]))
    begins, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    return [int(end + begin) // 2 for end, begin in zip(ends[:-1], begins[1:], strict=True)]


def presence(posterior: Posterior, true: SceneObject) -> float:
    """Fraction of draws with an object of the same kind near a piece."""
    near = [
        any(
            _kind(found.label) == _kind(true.label)
            and np.linalg.norm(found.centre[:2] - true.centre[:2]) < _NEAR
            for found in objects
        )
        for objects in posterior.samples.objects
    ]
    return float(np.mean(near))


def _kind(label: str) -> str:
    """Kind of an object; beds and seats are one kind, since motion hardly distinguishes them."""
    return "to sit on" if label in (*SEATS, "bed") else label


def table(takes: Sequence[Posterior], together: Posterior, pieces: Sequence[SceneObject]) -> str:
    """Markdown table of pieces by what is sampled."""
    names = [*(f"take {number}" for number in range(1, 1 + len(takes))), "together"]
    lines = [f"| piece | {' | '.join(names)} |", "|---|" + "---:|" * len(names)]
    for piece in pieces:
        shares = [presence(one, piece) for one in (*takes, together)]
        lines.append(f"| {piece.label} | " + " | ".join(f"{share:.2f}" for share in shares) + " |")
    return "\n".join(lines) + "\n"


def main(arguments: Sequence[str] | None = None) -> None:
    """Make the missing runs, and print one table for each seed."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seeds", type=int, default=1, help="rooms")
    parser.add_argument("--steps", type=int, default=SampleSettings().steps)
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args(arguments)
    options.folder.mkdir(parents=True, exist_ok=True)
    for seed in range(options.seeds):
        takes, pieces = takes_of(seed)
        how = {"seed": seed, "steps": options.steps, "workers": options.workers}
        alone = [
            sampled(take, options.folder / f"{seed}-take-{number}", **how)
            for number, take in enumerate(takes, 1)
        ]
        together = sampled(same_room(takes), options.folder / f"{seed}-together", **how)
        sys.stdout.write(f"\nRoom {seed}\n\n" + table(alone, together, pieces))


if __name__ == "__main__":
    main()
