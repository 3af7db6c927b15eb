"""The truth of i3DB scenes as captures, to cut scenelets from.

Never for a scene that is then inferred: leave it out by name.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from imapper_prob.inputs.captures import Capture
from imapper_prob.inputs.i3db import ACTIONS, DETECTIONS, action_words, read_i3db, read_i3db_truth
from imapper_prob.inputs.timeline import joints_at
from imapper_prob.models.errors import InputError

__all__ = ["i3db_folders", "read_i3db_capture"]

_BRIDGED: Final = 0.3
"""Seconds between annotated frames that are bridged; every second frame is one, 0.2 s apart."""

_WORDS: Final = {
    "walking": "walk",
    "sitting": "sit",
    "standing(from sitting)": "stand-up",
    "reaching": "reach",
    "standing": "stand",
    "": "",
}
"""The benchmark's words for what is done, and ours."""


def read_i3db_capture(folder: str | Path) -> Capture:
    """The annotated motion and furniture of one scene.

    Parameters
    ----------
    folder : path
        ``Scene04`` and the like, with its ``gt/``.

    Returns
    -------
    Capture
        All frames from the first to the last annotated one; those between two annotated
        ones lie on straight lines.

    Raises
    ------
    InputError
        A file is missing, damaged, or holds something other than the format says.
    """
    folder = Path(folder)
    clip = read_i3db(folder)
    truth = read_i3db_truth(folder, clip)
    times = np.arange(clip.n_frames) / clip.fps
    path = folder / "gt" / ACTIONS
    words = action_words(path, clip.n_frames)
    strange = sorted(set(words) - set(_WORDS))
    if strange:
        raise InputError(
            f"{path}: unknown action {strange[0]!r}; known are {', '.join(filter(None, _WORDS))}"
        )
    return Capture(
        name=clip.name,
        scene=clip.name,
        joints=joints_at(times, times, truth.joints, bridged=_BRIDGED),
        objects=truth.objects,
        fps=clip.fps,
        actions=tuple(_WORDS[word] for word in words),
    )


def i3db_folders(path: str | Path) -> list[Path]:
    """Scene folders: ``path`` itself if it is one, or else those in it."""
    path = Path(path)
    candidates = [path, *sorted(p for p in path.iterdir() if p.is_dir())] if path.is_dir() else []
    folders = [folder for folder in candidates if any(folder.glob(DETECTIONS))]
    if not folders:
        raise InputError(f"{path}: no i3DB scene there (a folder with {DETECTIONS}, and gt/)")
    return folders
