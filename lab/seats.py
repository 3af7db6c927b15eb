"""What does the person sit on at the end of finished runs, how surely, and how far away?

    python -m lab.seats RUN [RUN ...] [-o PNG]

reads folders of ``imapper-prob run`` for clips that end with a seated person, and prints a line for
each; with ``-o`` it draws maps of the runs side by side. It takes seconds.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from imapper_prob.models.scene import SceneObject
from imapper_prob.plotting import save_figure
from imapper_prob.results.load import load_posterior
from imapper_prob.results.posterior import Posterior
from imapper_prob.samplers.diagnostics import ess

Array = NDArray[np.float64]

SITTABLE = frozenset({"armchair", "bed", "bench", "chair", "couch", "office-chair", "stool"})
NEAR = 0.15
"""Greatest distance in metres from pelvis to footprint; people sit in front of the middle."""
LAST = 1.0
"""Seconds at the end of the clip over which the pelvis is averaged."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Print one line for each run."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("runs", type=Path, nargs="+")
    parser.add_argument("-o", "--picture", type=Path, help="maps of the runs side by side (PNG)")
    said = parser.parse_args(arguments)
    posteriors = [load_posterior(run) for run in said.runs]
    for run, posterior in zip(said.runs, posteriors, strict=True):
        sys.stdout.write(f"{run.name}: {describe(posterior)}\n")
    if said.picture is not None:
        save_figure(floor_maps(posteriors), said.picture)


def floor_maps(posteriors: Sequence[Posterior]) -> Figure:
    """Occupancy of the floor over all draws, from above, one panel for each run."""
    figure = Figure(figsize=(6.4 * len(posteriors), 5.6), layout="constrained")
    panels = figure.subplots(1, len(posteriors), squeeze=False)[0]
    for axes, posterior in zip(panels, posteriors, strict=True):
        posterior.occupancy().plot(axes)
        axes.set_aspect("equal", adjustable="box")
        axes.set_title(posterior.clip.name, fontsize=10)
    return figure


def describe(posterior: Posterior) -> str:
    """The object under the person, and the uncertainty of the focal length."""
    samples, clip = posterior.samples, posterior.clip
    frames = slice(-max(1, round(LAST * clip.fps)), None)
    pelvis = posterior.data["motion"]["pelvis"].to_numpy()[:, :, frames, :2].mean(2)
    seats = [
        under(objects, where)
        for objects, where in zip(samples.objects, pelvis.reshape(-1, 2), strict=True)
    ]
    found = [seat for seat in seats if seat is not None]
    shares = ", ".join(
        f"{label} {count / len(seats):.2f}"
        for label, count in Counter(s.label for s in found).most_common()
    )
    away = np.array([np.hypot(*seat.centre[:2]) for seat in found])
    focal = np.array([state.camera[2] for state in samples.states]).reshape(samples.shape)
    far = f"{away.mean():.2f} ± {away.std():.2f} m away" if len(away) else "nowhere"
    return (
        f"something to sit on with p = {len(found) / len(seats):.3f} ({shares}), "
        f"{far}; focal length ± {100 * focal.std():.1f} %, before ± {100 * clip.focal_spread:.1f} "
        f"%, {float(ess(focal)):.0f} effective draws of it"
    )


def under(objects: Sequence[SceneObject], pelvis: Array) -> SceneObject | None:
    """The object that somebody with the pelvis at (2,) metres sits on, or None."""
    seats = [(gap(o, pelvis), o) for o in objects if o.label in SITTABLE]
    nearest = min(seats, key=lambda pair: pair[0], default=None)
    return None if nearest is None or nearest[0] > NEAR else nearest[1]


def gap(thing: SceneObject, point: Array) -> float:
    """Distance in metres of a point (2,) on the floor from an object's bounding box; 0 inside."""
    here = thing.placement
    c, s = np.cos(here.yaw), np.sin(here.yaw)
    local = np.array([[c, s], [-s, c]]) @ (point - (here.x, here.y))
    low, high = (corner[:2] for corner in thing.bounds)
    return float(np.linalg.norm(np.maximum(0.0, np.maximum(low - local, local - high))))


if __name__ == "__main__":
    main()
