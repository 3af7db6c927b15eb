"""What becomes of two people at one table? A simulated clip and a library for ``imapper-prob run``.

    python -m lab.couple DIR [SEED]

writes ``DIR/couple.npz`` and ``DIR/chairs.npz``, the scenelets of chairs, tables and none, in
seconds, and prints nothing; ``docs/how-to/several_people.md`` says what comes of them. The truth
of the clip is known.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from imapper_prob.clips.load import write_clip
from imapper_prob.models.camera import Camera
from imapper_prob.models.scene import Clip, Placement, Truth
from imapper_prob.models.scenelet import Library, Scenelet
from imapper_prob.scenelets.library import load_library, save_library
from imapper_prob.simulate.clips import NOMINAL_CAMERA, simulate_track
from imapper_prob.simulate.scene import hidden_joints

CAMERA: Camera = NOMINAL_CAMERA
N_FRAMES = 60


def at_one_table(seed: int = 0, *, depth: float = 3.6, name: str = "sit-table-016") -> Clip:
    """Simulate A and B, who face each other across a table, seen from the side, for six seconds.

    Both perform the same scenelet of the built-in library and share its table.
    """
    rng = np.random.default_rng(seed)
    scenelet = next(s for s in load_library() if s.name == name)
    table = next(o for o in scenelet.objects if o.label == "table")
    # Places of a person whose table is at (0, depth), facing right and facing left.
    places = []
    for yaw in (-np.pi / 2, np.pi / 2):
        turn = Placement(0.0, 0.0, yaw)
        x, y = turn.rotation @ (table.placement.x, table.placement.y)
        places.append(Placement(-x, depth - y, yaw))
    objects = [o.moved(places[0]) for o in scenelet.objects]
    objects += [o.moved(places[1]) for o in scenelet.objects if o.label != "table"]
    motions = [_performed(scenelet, place) for place in places]
    hidden = [hidden_joints(CAMERA, joints, objects) for joints in motions]
    tracks = [
        simulate_track(rng, joints, behind, camera=CAMERA, fps=scenelet.fps, name=actor)
        for actor, joints, behind in zip("AB", motions, hidden, strict=True)
    ]
    truth = Truth(CAMERA, tuple(objects), np.concatenate(motions), np.concatenate(hidden))
    frames = np.arange(N_FRAMES)
    return Clip("couple", CAMERA, scenelet.fps, frames, tuple(tracks), truth=truth)


def chairs_and_tables(every: int, *, name: str = "sit-table-016") -> Library:
    """Every ``every``-th built-in scenelet with chairs, chairs and tables, or no objects."""
    able = [s for s in load_library() if s.labels in ((), ("chair",), ("chair", "table"))]
    kept = [s for k, s in enumerate(able) if k % every == 0 or s.name == name]
    return Library("chairs and tables", tuple(kept))


def _performed(scenelet: Scenelet, place: Placement) -> np.ndarray:
    """The motion forwards and backwards, for the length of the clip."""
    n = scenelet.n_frames
    there = np.abs((np.arange(N_FRAMES) + n - 1) % (2 * n - 2) - (n - 1))
    return place.apply(scenelet.joints)[there]


def main(arguments: Sequence[str] | None = None) -> None:
    """Write the clip and the library."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("seed", type=int, nargs="?", default=1)
    options = parser.parse_args(arguments)
    folder = options.folder
    folder.mkdir(parents=True, exist_ok=True)
    write_clip(folder / "couple.npz", at_one_table(options.seed))
    save_library(chairs_and_tables(1), folder / "chairs.npz")


if __name__ == "__main__":
    main()
