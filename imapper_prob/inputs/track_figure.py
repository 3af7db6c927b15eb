"""A picture of who is who: where everybody went in the image, and when they were seen."""

from __future__ import annotations

from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from imapper_prob.models.scene import Clip, Track
from imapper_prob.models.skeleton import BONES, LHIP, LSHO, RHIP, RSHO

__all__ = ["track_figure"]

_COLOURS: Final = ("#4e79a7", "#f28e2b", "#59a14f", "#e15759", "#b07aa1", "#76b7b2", "#9c755f")
"""Hues of Tableau 10, which stay apart for most colour-blind eyes."""
_FIGURES: Final = 5
"""Skeletons drawn of each person, evenly over the time they were seen."""


def track_figure(clip: Clip) -> Figure:
    """Draw the tracks of a clip: the image on top, time below.

    Parameters
    ----------
    clip : Clip
    """
    figure = Figure(figsize=(9, 7), layout="constrained")
    image, time = figure.subplots(2, 1, height_ratios=(5, 1))
    for index, track in enumerate(clip.tracks):
        colour = _COLOURS[index % len(_COLOURS)]
        _draw(image, track, colour)
        seen = (track.confidences > 0).sum(1)
        frames = clip.frame_ids[seen > 0]
        time.scatter(frames, np.full(len(frames), index), s=6, marker="|", color=colour)
    image.set(
        xlim=(0, clip.camera.width), ylim=(clip.camera.height, 0), aspect="equal", title=clip.name
    )
    image.legend(loc="upper right", frameon=False)
    time.set(
        yticks=range(len(clip.tracks)),
        yticklabels=[track.name for track in clip.tracks],
        ylim=(len(clip.tracks) - 0.5, -0.5),
        xlabel="frame",
    )
    return figure


def _draw(axes: Axes, track: Track, colour: str) -> None:
    """The way of the trunk, and a few skeletons along it."""
    there = track.confidences[:, [RHIP, LHIP, RSHO, LSHO]].min(1) > 0
    trunk = track.keypoints[:, [RHIP, LHIP, RSHO, LSHO]].mean(1)
    axes.plot(*np.where(there[:, None], trunk, np.nan).T, color=colour, lw=1.5, label=track.name)
    frames = np.flatnonzero(there)
    if not len(frames):
        return
    for frame in frames[np.linspace(0, len(frames) - 1, _FIGURES).astype(int)]:
        for bone in BONES:
            ends = track.keypoints[frame, list(bone)]
            axes.plot(*ends.T, color=colour, lw=1, alpha=0.5)
