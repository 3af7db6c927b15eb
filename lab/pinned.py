"""What else moves if the true place of one object is given?

    python -m lab.pinned SCENE PNG [--steps 26000] [--workers 2]

samples the i3DB scene in the folder SCENE with constants that are estimated without it, tells the
posterior the true place of one used object, to 5 cm, and prints what was said, how probable it was,
and the scores of `lab.told` before and after. The picture has both posteriors from above, over the
true furniture (dashed) and the true path of the pelvis (dotted).
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from imapper_prob.models.scene import Truth
from imapper_prob.models.skeleton import PELV
from lab.stored import SHORT_STEPS
from lab.told import row, sampled


def draw_truth(axes: Axes, truth: Truth, used: Sequence[str]) -> None:
    """Add the outlines of true furniture, and the true path."""
    for o in truth.objects:
        corners = np.concatenate([o.footprint, o.footprint[:1]])
        axes.plot(*corners.T, "k--", linewidth=1.2 if o.label in used else 0.6)
    pelvis = truth.joints[:, PELV, :2]
    axes.plot(*pelvis[np.isfinite(pelvis).all(1)].T, "k:", linewidth=1.2)


def main(arguments: Sequence[str] | None = None) -> None:
    """Sample, tell, print, draw."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("scene", type=Path, help="folder of an i3DB scene with its truth")
    parser.add_argument("picture", type=Path, help="PNG that is written")
    parser.add_argument("--steps", type=int, default=SHORT_STEPS, help="of chains")
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args(arguments)
    before, seen, truth, told = sampled(options.scene, options.steps, options.workers)
    after = before.given(told["a place"], workers=options.workers)
    if after.told is not None:
        print(after.told.text)
    figure = Figure((11.0, 5.5), layout="constrained")
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    for axes, (name, one) in zip(panels, (("before", before), ("after", after)), strict=True):
        found = row(one, seen, 0.0)
        print(
            f"{name}: {found['found']} of {found['true']} found, {found['loss']:.0f} cm with "
            f"misses, joints {found['joints']:.1f} cm"
        )
        one.plot(axes)
        draw_truth(axes, truth, [o.label for o in seen.used_objects])
        axes.set_title(name)
    figure.savefig(options.picture, dpi=110)


if __name__ == "__main__":
    main()
