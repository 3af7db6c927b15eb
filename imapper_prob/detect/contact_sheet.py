"""Frames of a video with the joints that were found in them, to look at."""

from __future__ import annotations

from typing import Final

import numpy as np
from PIL import Image, ImageDraw

from imapper_prob.detect.video import Video
from imapper_prob.models.scene import Clip, Track
from imapper_prob.models.skeleton import BONES, JOINTS

__all__ = ["contact_sheet"]

_ACROSS: Final = 3
_DOWN: Final = 2
_WIDTH: Final = 640
"""Pixels of a frame on the sheet."""
_COLOURS: Final = {"R": (242, 142, 43), "L": (78, 121, 167)}
"""Orange for the right side of the body, blue for the left; red and green look alike to many."""
_MIDDLE: Final = (186, 176, 172)
_DOUBTFUL: Final = 0.5
"""Confidence below which a bone is drawn thin."""


def contact_sheet(video: Video, clip: Clip, *, first: int, step: int) -> Image.Image:
    """Six frames, evenly over the clip.

    Parameters
    ----------
    video : Video
    clip : Clip
        What was found in it.
    first, step : int
        Frame of the video that is the first of the clip, and from one to the next.
    """
    wanted = np.linspace(0, clip.n_frames - 1, _ACROSS * _DOWN).astype(int)
    height = round(_WIDTH * video.height / video.width)
    sheet = Image.new("RGB", (_ACROSS * _WIDTH, _DOWN * height))
    end = first + int(wanted[-1]) * step + 1
    frames = video.frames(start=first, end=end, step=step)
    for index, (_, image) in enumerate(frames):
        for place in np.flatnonzero(wanted == index):
            picture = Image.fromarray(image)
            for track in clip.tracks:
                _draw(picture, track, index)
            row, column = divmod(int(place), _ACROSS)
            sheet.paste(picture.resize((_WIDTH, height)), (column * _WIDTH, row * height))
    return sheet


def _draw(picture: Image.Image, track: Track, frame: int) -> None:
    pen = ImageDraw.Draw(picture)
    thick = max(2, picture.width // 200)
    for far, near in BONES:
        ends = track.keypoints[frame, [far, near]]
        if np.isfinite(ends).all():
            sure = track.confidences[frame, far] >= _DOUBTFUL
            colour = _COLOURS.get(JOINTS[far][0], _MIDDLE)
            pen.line([*ends[0], *ends[1]], fill=colour, width=thick if sure else thick // 2)
