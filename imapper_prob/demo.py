"""The clip of ``imapper-prob demo``: a small story whose truth is known."""

from __future__ import annotations

import numpy as np

from imapper_prob.models.scene import Clip
from imapper_prob.models.simulate import simulate_clip
from imapper_prob.scenelets.library import load_library

__all__ = ["STORY", "demo_clip"]

STORY = ("sit-couch-table-003", "reach-shelf-001")
"""Scenelets performed: sitting on a couch at a low table, then reaching into a shelf."""


def demo_clip(seed: int = 4) -> Clip:
    """Thirteen seconds at 10 frames a second: somebody comes in, sits down and goes to a shelf.

    The table hides the feet of whoever sits there. The built-in library holds what
    is performed, so the scene can be recovered; camera, body and detections are drawn from
    the model. The same seed gives the same clip.
    """
    rng = np.random.default_rng(seed)
    return simulate_clip(
        rng, load_library(), n_frames=130, script=STORY, n_bystanders=0, name="demo"
    )
