"""The demo's story with other seeds: how often is the true furniture the first answer?

``python benchmarks/demo_seeds.py [COUNT]`` prints a line a seed; ten seconds each.
"""

from __future__ import annotations

import sys

import numpy as np

from imapper_prob.config import SampleSettings
from imapper_prob.demo import demo_clip
from imapper_prob.results.summary import distances_to_truth
from imapper_prob.sampling.sample import sample_scenes
from imapper_prob.scenelets.library import load_library
from imapper_prob.staged.solver import solve

SETTINGS = SampleSettings(steps=2000, draws=150, ensemble_layouts=1, ensemble_steps=2)


def main() -> None:
    """Sample each clip briefly and hold the most probable layout against the truth."""
    for seed in range(1, 1 + int(sys.argv[1] if len(sys.argv) > 1 else 7)):
        clip = demo_clip(seed)
        assert clip.truth is not None
        solution = solve(clip, load_library())
        samples = sample_scenes(solution, SETTINGS, seed=np.random.SeedSequence(0), workers=2)
        found = samples.objects[samples.layouts.leaders[0]]
        centimetres = 100 * distances_to_truth(found, clip.truth.objects)
        told = (f"{o.label} {d:.0f} cm" for o, d in zip(found, centimetres, strict=True))
        share = samples.probabilities.probability[0]
        sys.stdout.write(f"seed {seed}: p = {share:.2f}  {', '.join(told)}\n")


if __name__ == "__main__":
    main()
