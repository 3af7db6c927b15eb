"""From a video to a clip: joints detected by MediaPipe with the weights in its wheel.

:func:`detect` decodes the video, checks that its camera does not move, and assembles a clip.
:func:`contact_sheet` draws the detections.
"""

from __future__ import annotations

import logging
import math
import os
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from imapper_prob.clips.assemble import assemble
from imapper_prob.clips.mediapipe import Landmarks, sightings_of_landmarks
from imapper_prob.clips.options import ClipOptions
from imapper_prob.clips.video import Video, grey_thumbnail, needs, open_video, stillness
from imapper_prob.models.errors import InputError
from imapper_prob.models.scene import Clip, Track
from imapper_prob.models.skeleton import BONES, JOINTS
from imapper_prob.progress import Progress

__all__ = ["Detector", "contact_sheet", "detect", "usual_step"]


class Detector(Protocol):
    """A function that detects one person in an image.

    Parameters
    ----------
    *args, **kwargs : Of whatever class it is.
    """

    def __call__(self, frame: int, image: NDArray[np.uint8]) -> Landmarks | None:
        """The person in an (H, W, 3) RGB image, if there is one."""


@contextmanager
def _pose_landmarker() -> Iterator[Detector]:
    """MediaPipe's pose detector, which tracks the person from frame to frame.

    Raises
    ------
    InputError
        MediaPipe is not installed.
    """
    os.environ.setdefault("GLOG_minloglevel", "2")  # silences its log messages
    solution = needs("mediapipe").solutions.pose.Pose(
        static_image_mode=False,
        model_complexity=1,  # the model whose weights are in the wheel
        smooth_landmarks=True,
    )

    def detect(frame: int, image: NDArray[np.uint8]) -> Landmarks | None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # it calls deprecated functions of protobuf
            found = solution.process(image)
        if found.pose_landmarks is None:
            return None
        image_points = found.pose_landmarks.landmark
        return Landmarks(
            frame=frame,
            image=np.array([[p.x, p.y] for p in image_points]),
            visibility=np.array([p.visibility for p in image_points]),
            world=_world(found.pose_world_landmarks),
        )

    with solution:
        yield detect


def _world(found: Any) -> NDArray[np.float64] | None:
    return None if found is None else np.array([[p.x, p.y, p.z] for p in found.landmark])


# ------------------------------------------------------------------------------------------------
# Contact sheets.

_ACROSS: Final = 3
_DOWN: Final = 2
"""Frames beside and below each other on a sheet."""
_WIDTH: Final = 640
"""Width in pixels of each frame on the sheet."""
_COLOURS: Final = {"R": (242, 142, 43), "L": (78, 121, 167)}
"""Orange for the body's right side, blue for its left; red and green are often confused."""
_MIDDLE: Final = (186, 176, 172)
"""Grey of bones that are on neither side, sRGB."""
_DOUBTFUL: Final = 0.5
"""Confidence below which a bone is drawn thin."""


def contact_sheet(video: Video, clip: Clip, *, first: int, step: int) -> Image.Image:
    """Draw the detections of six frames, evenly spaced over the clip.

    Parameters
    ----------
    video : Video
    clip : Clip
        The detections in that video.
    first, step : int
        Video frame that is the clip's first frame, and step between clip frames in the video.

    Returns
    -------
    PIL.Image.Image
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


# ------------------------------------------------------------------------------------------------
# Detection.

_log = logging.getLogger(__name__)
_RATE: Final = 10.0
"""Target frame rate in frames a second, at which the model's constants were measured."""
_LOOKS: Final = 12
"""Number of frames in which the background is compared."""


def usual_step(fps: float) -> int:
    """Frame step that gives ten frames a second, or slightly more.

    Parameters
    ----------
    fps : float
        Frames a second of the video.

    Returns
    -------
    int
    """
    return max(1, int(fps / _RATE + 0.05))


def detect(
    path: str | Path,
    *,
    options: ClipOptions | None = None,
    start: float = 0.0,
    end: float | None = None,
    step: int | None = None,
    detector: Detector | None = None,
    progress: Progress | None = None,
) -> Clip:
    """Find the joints of the person in a video.

    Parameters
    ----------
    path : path
        Any video that FFmpeg reads, of a fixed camera and one person.
    options : ClipOptions, optional
        Camera; the focal length is assumed if not given.
    start, end : float
        First and last second to process; to the end of the video if not given.
    step : int, optional
        Process every n-th frame; :func:`usual_step` if not given.
    detector : Detector, optional
        MediaPipe if not given.
    progress : callable, optional
        Called with the name of a stage and the fraction of it that is done.

    Returns
    -------
    Clip
        Has the lifted poses of the detector. Its frame n is n / fps seconds after the start of the
        video.

    Raises
    ------
    InputError
        The file is no video, the camera moves, or nobody was detected.
    """
    options = options or ClipOptions()
    video = open_video(path)
    if options.fps is not None:
        video = replace(video, fps=options.fps)
    step = usual_step(video.fps) if step is None else step
    if step < 1:
        raise InputError(f"step {step}: at least 1")
    if not (0 <= start < math.inf and (end is None or start < end < math.inf)):
        raise InputError(
            f"start {start} and end {end}: the end must be after the start, in seconds"
        )
    first = round(start * video.fps)
    after = None if end is None else max(first + 1, round(end * video.fps))
    number = round(first / step)
    if detector is None:
        with _pose_landmarker() as own:
            found, last, thumbnails = _look(video, own, first, after, step, number, progress)
    else:
        found, last, thumbnails = _look(video, detector, first, after, step, number, progress)
    _refuse_moving(video, thumbnails)
    sightings = sightings_of_landmarks(
        video.path.stem,
        found,
        span=(number, last),
        size=(video.width, video.height),
        fps=video.fps / step,
        likely_focal=video.likely_focal,
    )
    clip = assemble(sightings, replace(options, fps=video.fps / step))
    missed = clip.n_frames - len(found)
    if missed:
        _log.info("%s: nobody found in %d of %d frames", clip.name, missed, clip.n_frames)
    return clip


def _look(
    video: Video,
    detector: Detector,
    first: int,
    after: int | None,
    step: int,
    number: int,
    progress: Progress | None,
) -> tuple[list[Landmarks], int, list[NDArray[np.float64]]]:
    """Detected people, number of the last frame processed, and thumbnails over the clip.

    ``number`` is that of the first frame.
    """
    # Some containers do not say how many frames they have.
    n_frames = video.n_frames or after
    total = max(1, (min(after or n_frames, n_frames) - first) // step) if n_frames else 0
    every = max(1, total // _LOOKS)
    found: list[Landmarks] = []
    thumbnails = []
    index = -1
    frames = video.frames(start=first, end=after, step=step)
    for index, (_, image) in enumerate(frames):
        if index % every == 0:
            thumbnails.append(grey_thumbnail(image))
        if len(thumbnails) == 2 * _LOOKS:
            thumbnails, every = thumbnails[::2], 2 * every
        person = detector(number + index, image)
        if person is not None:
            found.append(person)
        if progress is not None:
            progress("detecting joints", min(1.0, (index + 1) / total) if total else 0.0)
    if index < 0:
        raise InputError(f"{video.path}: no frame after {first / video.fps:.1f} s")
    if progress is not None:
        progress("detecting joints", 1.0)
    return found, number + index, thumbnails


def _refuse_moving(video: Video, thumbnails: list[NDArray[np.float64]]) -> None:
    found = stillness(thumbnails)
    if found.cut:
        raise InputError(
            f"{video.path}: the camera moves, or several shots are put together: the background is "
            "another one at other times; cut out one shot with --start and --end"
        )
    if found.moving:
        raise InputError(
            f"{video.path}: the camera moves (the background shifts by {found.shift:.1%} of the "
            "image's width); only fixed cameras are understood"
        )
