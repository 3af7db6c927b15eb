"""What does it cost that people hide nobody? Somebody passes between a person and the camera.

    python -m lab.passers FOLDER [--clips 6] [--steps N] [--seed 0] [--workers 2]

simulates clips of one person, and the same with a second one who walks to and fro before the first
all the while, as wide as a body. What a detector says of the first is drawn for both, with joints
behind the passer as hidden as those behind furniture, and both are sampled. The model knows of no
passer: such joints are lost for no reason, or speak for furniture. Printed is, in Markdown, how
well furniture and motion are found with and without. Runs are kept in FOLDER, where the same
command goes on; it takes a minute a clip.
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
from imapper_prob.evaluate.score import Score, known_clip, score, summarise
from imapper_prob.evaluate.tables import markdown_table, object_rows, pose_rows
from imapper_prob.models.scene import Clip, Cuboid, Placement, SceneObject
from imapper_prob.models.skeleton import PELV
from imapper_prob.scenelets.library import load_library
from imapper_prob.simulate.clips import simulate_clip, simulate_track
from imapper_prob.simulate.scene import hidden_joints
from lab.kept import sampled

__all__ = ["passed", "passing"]

SPEED: Final = 1.2
"""Metres a second at which people walk."""
SIZE: Final = (0.5, 0.3, 1.7)
"""Metres: shoulders, depth and height of somebody who passes."""
NEARER: Final = 0.6
"""The passer's distance, as a part of the person's."""
WAY: Final = 2.0
"""Metres to either side of the person's line of sight before the passer turns round."""


def passing(clip: Clip) -> NDArray[np.bool_]:
    """(T, 16) joints behind somebody who walks to and fro before the person of a clip."""
    truth = clip.truth
    assert truth is not None
    x, y = np.median(truth.joints[:, PELV, :2], axis=0) * NEARER
    gone = SPEED * np.arange(clip.n_frames) / clip.fps % (4 * WAY)
    aside = np.abs(gone - 2 * WAY) - WAY
    body = Cuboid("body", np.array([0.0, 0.0, SIZE[2] / 2]), np.array(SIZE))
    hidden = np.zeros(truth.hidden.shape, bool)
    for t in range(clip.n_frames):
        # What is in the way is a box, whatever it is called.
        passer = SceneObject("shelf", Placement(float(x + aside[t]), float(y), 0.0), (body,))
        hidden[t] = hidden_joints(truth.camera, truth.joints[t][None], (passer,))[0]
    return hidden


def passed(clip: Clip, seed: int) -> tuple[Clip, Clip]:
    """The clip as it would be seen without a passer, and with one."""
    truth = clip.truth
    assert truth is not None

    def seen(behind: NDArray[np.bool_]) -> Clip:
        rng = np.random.default_rng(seed)
        hidden = truth.hidden | behind
        track = simulate_track(rng, truth.joints, hidden, camera=truth.camera, fps=clip.fps)
        return replace(clip, tracks=(track,))

    return seen(np.zeros_like(truth.hidden)), seen(passing(clip))


def main(arguments: Sequence[str] | None = None) -> None:
    """Simulate, sample, score; print both tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--clips", type=int, default=6)
    parser.add_argument("--steps", type=int, default=SampleSettings().steps // 5)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args(arguments)
    library, found = load_library(), dict[str, list[Score]]()
    shares = []
    for k in range(options.clips):
        seed = options.seed * 1000 + k
        clip = simulate_clip(np.random.default_rng(seed), library, name=f"clip-{seed}")
        shares.append(passing(clip).mean())
        for kind, seen in zip(("alone", "passed"), passed(clip, seed), strict=True):
            posterior = sampled(
                seen, options.folder / f"{clip.name}-{kind}", seed=seed, steps=options.steps,
                workers=options.workers,
            )  # fmt: skip
            likely = posterior_predictions(posterior)[1]
            found.setdefault(kind, []).append(
                score(replace(likely, name=kind), known_clip(seen).truth)
            )
    summaries = [summarise(scores) for scores in found.values()]
    sys.stdout.write(
        f"Behind the passer are {np.mean(shares):.2f} of the joints.\n\n"
        + markdown_table(object_rows(summaries))
        + "\n\n"
        + markdown_table(pose_rows(summaries))
        + "\n"
    )


if __name__ == "__main__":
    main()
