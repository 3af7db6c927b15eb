"""The detections that the model uses: on the scale of its tables, and of the person alone.

The tables of the detector (`models.detector`) are of confidences as i3DB's detector gives them. A
detector whose confidences are in another unit would have every joint taken for hidden.
"""

from __future__ import annotations

import logging
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.detector import ERROR_EDGES, DetectionModel, DetectorSettings
from imapper_prob.models.errors import InputError
from imapper_prob.models.scene import Clip, Track
from imapper_prob.models.skeleton import DETECTED
from imapper_prob.solver.elsewhere import frames_elsewhere

__all__ = ["elsewhere_frames", "own_detections", "with_usual_confidences"]

Flags = NDArray[np.bool_]
_log = logging.getLogger(__name__)

_SUREST: Final = 0.95
"""Quantile of a track's confidences by which its scale is known. Even of somebody who is mostly
hidden, a twentieth of the detected joints is in full view."""
_USUAL: Final = 0.92
"""That quantile of the confidences above .02 in i3DB: .920 to .923 in each of four scenes."""
_MOST: Final = 0.9
"""Share of frames elsewhere above which a track is rejected."""


def with_usual_confidences(track: Track, detector: DetectorSettings | None = None) -> Track:
    """Scale the confidences of a track if even the greatest are as those of hidden joints.

    Confidences are left alone if the tables take their 95 % quantile for that of a joint in view.
    Otherwise they are multiplied by one factor, which makes that quantile what it is in i3DB.

    Parameters
    ----------
    track : Track
    detector : DetectorSettings, optional
        Has the tables.

    Returns
    -------
    Track
    """
    detected = track.confidences[:, list(DETECTED)]
    located = detected[detected >= ERROR_EDGES[0]]
    if not located.size:
        return track
    greatest = float(np.quantile(located, _SUREST))
    hidden, seen = DetectionModel.of(detector or DetectorSettings()).confidence_density(greatest)
    if seen >= hidden:
        return track
    factor = _USUAL / greatest
    _log.info("%s: confidences are low; they are multiplied by %.2f", track.name, factor)
    return replace(track, confidences=np.minimum(1.0, factor * track.confidences))


def elsewhere_frames(clip: Clip, detector: DetectorSettings | None = None) -> tuple[Flags, ...]:
    """Frames of each track in which the detector followed something else.

    Parameters
    ----------
    clip : Clip
    detector : DetectorSettings, optional
        Has the tables of confidences and errors.

    Returns
    -------
    tuple of (T,) bool
        One array per track.
    """
    model = DetectionModel.of(detector or DetectorSettings())
    return tuple(
        frames_elsewhere(
            with_usual_confidences(track, detector),
            camera=clip.camera,
            fps=clip.fps,
            detections=model,
        )
        for track in clip.tracks
    )


def own_detections(clip: Clip, detector: DetectorSettings | None = None) -> Clip:
    """Detections of the persons alone, with usual confidences.

    In frames in which the detector followed something else, there is no detection, and no lifted
    pose either, because that was computed from the same detections.

    Parameters
    ----------
    clip : Clip
    detector : DetectorSettings, optional
        Has the tables of confidences and errors.

    Returns
    -------
    Clip

    Raises
    ------
    InputError
        Nearly all frames of a track are of this kind.
    """
    tracks = []
    for given, away in zip(clip.tracks, elsewhere_frames(clip, detector), strict=True):
        track = with_usual_confidences(given, detector)
        detected = (track.confidences > 0).any(1)
        if away.any() and away.sum() > _MOST * detected.sum():
            raise InputError(
                f"clip {clip.name}, track {track.name}: in {away.sum()} of the {detected.sum()} "
                "frames with detections all joints jump across the picture as nobody does, "
                f"first in frame {clip.frame_ids[away.argmax()]}; leave the track out, or "
                "detect again"
            )
        tracks.append(_without(track, away))
    return replace(clip, tracks=tuple(tracks))


def _without(track: Track, away: Flags) -> Track:
    if not away.any():
        return track
    return replace(
        track,
        keypoints=np.where(away[:, None, None], np.nan, track.keypoints),
        confidences=np.where(away[:, None], 0.0, track.confidences),
        poses=np.where(away[:, None, None], np.nan, track.poses),
    )
