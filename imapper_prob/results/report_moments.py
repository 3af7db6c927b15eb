"""Data for the report's slider: all people's joints at several frames, as small integers."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imapper_prob.models.scene import Clip
from imapper_prob.models.skeleton import BONES, HEAD, N_JOINTS
from imapper_prob.people import by_person
from imapper_prob.results.posterior import Posterior
from imapper_prob.results.report_plots import JOINT_WORDS
from imapper_prob.uncertainty.clusters import names_of

__all__ = ["moments", "moments_of"]

_MOST: Final = 360
"""Largest number of frames times people; more would take megabytes."""


def moments_of(clip: Clip) -> NDArray[np.int64]:
    """Indices of the slider's frames, evenly spaced.

    Parameters
    ----------
    clip : Clip

    Returns
    -------
    (M,) int
    """
    count = min(clip.n_frames, max(2, _MOST // len(clip.tracks)))
    return np.unique(np.linspace(0, clip.n_frames - 1, count).round().astype(np.int64))


def moments(posterior: Posterior) -> dict[str, Any]:
    """Joints of scenes and detections at the slider's frames, and probabilities of occlusion.

    Parameters
    ----------
    posterior : Posterior

    Returns
    -------
    dict
        Lists of integers by frame, person and joint: ``joints`` of each scene in centimetres of its
        world frame, their ``pixels``, the detected pixels ``seen``, and ``confidence``, ``hidden``
        and ``by_object`` in per cent.
    """
    clip = posterior.clip
    kept, hidden = moments_of(clip), posterior.certainty.hidden
    keypoints = np.stack([track.keypoints for track in clip.tracks])
    confidences = np.stack([track.confidences for track in clip.tracks])

    def rows(values: NDArray[Any]) -> list[int | None]:
        return _whole(by_person(clip, values)[:, kept].swapaxes(0, 1))

    return {
        "frames": clip.frame_ids[kept].tolist(),
        "seconds": np.round((clip.frame_ids[kept] - clip.frame_ids[0]) / clip.fps, 2).tolist(),
        "people": len(clip.tracks),
        "names": [track.name for track in clip.tracks],
        "joints": N_JOINTS,
        "words": list(JOINT_WORDS),
        "bones": [list(bone) for bone in BONES],
        "head": HEAD,
        "scenes": [
            {
                "joints": rows(100 * weighted.scene.joints),
                "pixels": rows(weighted.scene.camera.project(weighted.scene.joints)),
            }
            for weighted in posterior.scenes()
        ],
        "seen": _whole(keypoints[:, kept].swapaxes(0, 1)),
        "confidence": _whole(100 * confidences[:, kept].swapaxes(0, 1)),
        "hidden": rows(100 * hidden.probability),
        "objects": list(names_of(hidden.clusters)),
        "by_object": [rows(100 * own) for own in hidden.by_object],
    }


def _whole(values: ArrayLike) -> list[int | None]:
    """Rounded integers in one list; None for unknown values."""
    flat = np.asarray(values, float).ravel()
    return [int(v) if np.isfinite(v) else None for v in np.rint(flat)]
