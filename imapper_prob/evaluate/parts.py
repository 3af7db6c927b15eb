"""Clips cut short: what is known after a quarter, a half, three quarters of the time."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from imapper_prob.evaluate.truth import TruthInView
from imapper_prob.inputs.window import window
from imapper_prob.models.scene import Clip

__all__ = ["PARTS", "first_part", "truth_of_part"]

PARTS: Final = (0.25, 0.5, 0.75, 1.0)
"""Of a clip's frames."""


def first_part(clip: Clip, part: float) -> Clip:
    """The clip's first frames; without its truth, which is cut by :func:`truth_of_part`."""
    if part == 1:
        return clip
    count = _count(clip.n_frames, part)
    first = int(clip.frame_ids[0])
    return window(clip, first, first + count - 1)


def truth_of_part(truth: TruthInView, part: float) -> TruthInView:
    """The truth of the first frames; all objects of the whole clip are still to be found."""
    count = _count(len(truth.joints), part)
    return replace(
        truth,
        frame_ids=truth.frame_ids[:count],
        joints=truth.joints[:count],
        pixels=truth.pixels[:count],
        hidden=truth.hidden[:count],
        actions=truth.actions[:count],
    )


def _count(frames: int, part: float) -> int:
    return max(1, round(part * frames))
