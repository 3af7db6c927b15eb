"""What a clip holds, and what is missing in it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from imapper_prob.models.scene import Clip, Track
from imapper_prob.models.skeleton import DETECTED, JOINTS

if TYPE_CHECKING:
    from rich.table import Table

__all__ = ["clip_table", "never_seen"]


def never_seen(track: Track) -> tuple[str, ...]:
    """Joints that no frame of a track has, of those that detectors report."""
    seen = track.confidences.max(0) > 0
    return tuple(JOINTS[joint] for joint in DETECTED if not seen[joint])


def clip_table(clip: Clip) -> Table:
    """A row a track, under a line on camera and frames."""
    from rich.table import Table

    camera = clip.camera
    doubt = "" if clip.focal_known else f" (assumed, ± {100 * clip.focal_spread:.0f} %)"
    focal = f"focal length {camera.fx:.0f} px{doubt}"
    table = Table(
        title=f"{clip.name}: {clip.n_frames} frames at {clip.fps:g} a second, "
        f"{camera.width} x {camera.height}, {focal}",
        title_justify="left",
    )
    table.add_column("person")
    for column in ("frames seen", "joints a frame", "mean confidence", "frames with a pose"):
        table.add_column(column, justify="right")
    table.add_column("joints never seen")
    for track in clip.tracks:
        there = track.confidences > 0
        frames = there.any(1)
        table.add_row(
            track.name,
            str(frames.sum()),
            f"{there.sum() / max(frames.sum(), 1):.1f}",
            f"{np.mean(track.confidences[there]) if there.any() else 0:.2f}",
            str(track.has_pose.sum()),
            ", ".join(never_seen(track)) or "none",
        )
    return table
