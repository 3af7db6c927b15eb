"""What does it cost that people hide nobody? Somebody passes between a person and the camera.

    python -m lab.passers FOLDER [--clips 6] [--steps N] [--seed 0] [--workers 2]

simulates clips of one person, and the same clips with a second person who walks back and forth in
front of the first. Detections of the first are drawn for both, with joints behind the passer hidden
like those behind furniture, and both are sampled. The model has no passers, so that such joints
seem undetected without reason or suggest furniture. The output, in Markdown, is the accuracy of
furniture and motion with and without a passer. Runs are stored in FOLDER, from which the same
command continues; it takes a minute a clip.
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

from imapper_prob.evaluate.probability import posterior_predictions
from imapper_prob.evaluate.score import Score, known_clip, score, summarise
from imapper_prob.evaluate.tables import markdown_table, object_rows, pose_rows
from imapper_prob.models.scene import Clip, Cuboid, Placement, SceneObject
from imapper_prob.models.skeleton import PELV
from imapper_prob.scenelets.library import load_library
from imapper_prob.simulate.clips import simulate_clip, simulate_track
from imapper_prob.simulate.scene import hidden_joints
from lab.stored import SHORT_STEPS, sampled

__all__ = ["passed", "passing"]

SPEED: Final = 1.2
"""Walking speed in metres a second."""
SIZE: Final = (0.5, 0.3, 1.7)
"""Width of shoulders, depth and height of the passer, metres."""
NEARER: Final = 0.6
"""Distance of the passer as a fraction of the person's distance."""
WAY: Final = 2.0
"""Distance in metres from the line of sight at which the passer turns round."""


def passing(clip: Clip) -> NDArray[np.bool_]:
    """(T, 16) joints hidden by a passer who walks back and forth in front of a clip's person."""
    truth = clip.truth
    assert truth is not None
    x, y = np.median(truth.joints[:, PELV, :2], axis=0) * NEARER
    gone = SPEED * np.arange(clip.n_frames) / clip.fps % (4 * WAY)
    aside = np.abs(gone - 2 * WAY) - WAY
    body = Cuboid("body", np.array([0.0, 0.0, SIZE[2] / 2]), np.array(SIZE))
    hidden = np.zeros(truth.hidden.shape, bool)
    for t in range(clip.n_frames):
        # The passer is modelled as a box.
        passer = SceneObject("shelf", Placement(float(x + aside[t]), float(y), 0.0), (body,))
        hidden[t] = hidden_joints(truth.camera, truth.joints[t][None], (passer,))[0]
    return hidden


def passed(clip: Clip, seed: int) -> tuple[Clip, Clip]:
    """The clip as it would be detected without a passer, and with one."""
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
    parser.add_argument("--steps", type=int, default=SHORT_STEPS)
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
