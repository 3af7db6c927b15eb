"""Are rooms found whose recordings the library knows nothing of? Hold one out.

    python -m lab.held_out RECORDINGS FOLDER --from {i3db,pigraphs,npz} [--room NAME ...]
        [--beside built-in] [--seconds 30] [--steps N] [--seed 0] [--workers 2]

For each room the library consists of the recordings of all other rooms, and of the furniture-free
scenelets of the built-in library, as alternatives to frames without scenelets; ``--beside`` names
another library in place of the latter. Each recording of the room, or the first ``--seconds`` of
the longest interval in which its person is tracked, is viewed by a simulated camera from a side
from which enough is visible, detected and lifted with simulated errors, and sampled. The output, in
Markdown, is errors of the furniture that is used in the recording, for each room and for all. The
paper (section 7, *Hold-one-out validation*) gives 110 cm (s.d. 56) for one room of PiGraphs, from
video.

Runs are kept in FOLDER, where the same command goes on and ``imapper-prob view`` finds them. The
recordings of PiGraphs are not part of this program (README, *Data*).
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.config import SampleSettings
from imapper_prob.evaluate.probability import posterior_predictions
from imapper_prob.evaluate.score import Score, Summary, known_clip, score, summarise
from imapper_prob.evaluate.tables import markdown_table, object_rows
from imapper_prob.models.errors import InputError
from imapper_prob.models.problem import resample
from imapper_prob.models.scene import Clip, Placement, Truth
from imapper_prob.models.scenelet import Library
from imapper_prob.models.skeleton import DETECTED, PELV
from imapper_prob.scenelets.build import SOURCES, build_library_from, captures_from
from imapper_prob.scenelets.captures import Capture
from imapper_prob.scenelets.library import joined, load_library
from imapper_prob.simulate.clips import ACTION_WORDS, FEWEST_IN_IMAGE, draw_camera, simulate_track
from imapper_prob.simulate.scene import FEWEST_SEEN, hidden_joints, in_image
from lab.stored import sampled
from lab.unseen.clips import CAMERA, DISTANCES, FPS

__all__ = ["filmed"]

Array = NDArray[np.float64]

NEAREST: Final = 1.5
"""Least distance in metres of the person from the camera."""
_TRIES: Final = 500


def _longest_stretch(capture: Capture, seconds: float) -> tuple[Array, tuple[str, ...]]:
    """The first seconds of the longest interval of frames in which the person is tracked.

    Joints (T, 16, 3) in metres at ten frames a second, and one action a frame or none.
    """
    there = np.isfinite(capture.joints).all((1, 2))
    edges = np.flatnonzero(np.diff(np.concatenate([[False], there, [False]])))
    begins, ends = edges[::2], edges[1::2]
    longest = int((ends - begins).argmax())
    first = int(begins[longest])
    last = min(int(ends[longest]), first + round(seconds * capture.fps))
    joints = resample(capture.joints[first:last], fps=capture.fps, to_fps=FPS)
    words = [ACTION_WORDS.get(word, word) for word in capture.actions[first:last]]
    at = np.linspace(0, len(words) - 1, len(joints)).round().astype(int) if words else ()
    return joints, tuple(words[k] for k in at)


def filmed(rng: np.random.Generator, capture: Capture, seconds: float) -> Clip:
    """Simulate what a camera, a detector and a lifter report of a recording.

    Parameters
    ----------
    rng : numpy.random.Generator
    capture : Capture
    seconds : float
        Greatest duration of the recording that is used.

    Returns
    -------
    Clip
        Includes its ground truth.

    Raises
    ------
    InputError
        Too little of the person is visible from every side.
    """
    joints, actions = _longest_stretch(capture, seconds)
    middle = np.median(joints[:, PELV, :2], axis=0)
    for _ in range(_TRIES):
        camera = draw_camera(rng, nominal=CAMERA)
        turn = Placement(0.0, 0.0, float(rng.uniform(-np.pi, np.pi)))
        x, y = turn.rotation @ middle
        place = Placement(-float(x), float(rng.uniform(*DISTANCES) - y), turn.yaw)
        motion = place.apply(joints)
        inside = in_image(camera, motion)
        if motion[:, PELV, 1].min() < NEAREST or inside.mean(1).min() < FEWEST_IN_IMAGE:
            continue
        objects = tuple(piece.moved(place) for piece in capture.objects)
        hidden = hidden_joints(camera, motion, objects)
        if (inside & ~hidden)[:, list(DETECTED)].mean() < FEWEST_SEEN:
            continue
        track = simulate_track(rng, motion, hidden, camera=camera, fps=FPS)
        return Clip(
            name=capture.name,
            camera=CAMERA,
            fps=FPS,
            frame_ids=np.arange(len(motion)),
            tracks=(track,),
            truth=Truth(camera, objects, motion, hidden, actions),
        )
    raise InputError(f"{capture.name}: too little of the person is seen from {_TRIES} sides")


def main(arguments: Sequence[str] | None = None) -> None:
    """Simulate, sample and score the recordings of each room; print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("recordings", type=Path)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--from", dest="source", choices=SOURCES, required=True)
    parser.add_argument("--room", nargs="+", metavar="NAME", help="held out (default: each)")
    parser.add_argument(
        "--beside", metavar="LIBRARY", help="beside (default: what has no furniture)"
    )
    parser.add_argument("--seconds", type=float, default=30.0, help="of a recording, at most")
    parser.add_argument("--steps", type=int, default=SampleSettings().steps)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args(arguments)
    captures = captures_from(options.source, options.recordings)
    rooms = list(dict.fromkeys(capture.scene for capture in captures))
    bare = Library("bare", tuple(s for s in load_library() if not s.objects))
    beside = bare if options.beside is None else load_library(options.beside)
    summaries: list[Summary] = []
    everything: dict[str, list[Score]] = {}
    for room in options.room or rooms:
        others = captures_from(options.source, options.recordings, leave_out=room)
        recorded, _ = build_library_from(others, name=f"without {room}")
        library = joined([beside, recorded])
        found: dict[str, list[Score]] = {}
        for capture in captures:
            if capture.scene != room:
                continue
            rng = np.random.default_rng([options.seed, len(everything), captures.index(capture)])
            clip = filmed(rng, capture, options.seconds)
            posterior = sampled(
                clip, options.folder / clip.name, library=library, seed=options.seed,
                steps=options.steps, workers=options.workers,
            )  # fmt: skip
            truth = known_clip(clip).truth
            for prediction in posterior_predictions(posterior):
                found.setdefault(prediction.name, []).append(score(prediction, truth))
        for name, scores in found.items():
            everything.setdefault(name, []).extend(scores)
            summaries.append(replace(summarise(scores), clips=(room,)))
    summaries += [summarise(scores) for scores in everything.values()]
    sys.stdout.write(markdown_table(object_rows(summaries)) + "\n")


if __name__ == "__main__":
    main()
