"""The plots of a recording: what happens over frames, and over the draws of the chains."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from imapper_prob.models.camera import Camera
from imapper_prob.models.scene import Clip, Track, Truth
from imapper_prob.models.skeleton import PELV
from imapper_prob.people import by_person, own_part
from imapper_prob.recording.entities import own_entity
from imapper_prob.recording.palette import SCENE_COLOURS, TRUE_COLOUR
from imapper_prob.results.scenes import WeightedScene

__all__ = ["curve", "log_fit", "log_traces", "trace_entity"]

Array = NDArray[np.float64]

_TRACE_POINTS = 2000
"""Most points of a trace that are kept: more than a screen has columns."""
_WIDTH = 1.5
"""Of a curve, in points of the screen."""


def trace_entity(name: str) -> str:
    """Where the chains of a trace are logged."""
    return f"traces/{rr.escape_entity_path_part(name)}"


def log_fit(
    recording: rr.RecordingStream,
    clip: Clip,
    scenes: Sequence[WeightedScene],
    truth: Truth | None,
) -> None:
    """Log, per scene, person and frame, their distance and the miss of the reprojection."""
    frames = clip.frame_ids
    for i, weighted in enumerate(scenes, 1):
        camera = weighted.scene.camera
        for person, joints in enumerate(by_person(clip, weighted.scene.joints)):
            entity = own_entity(clip, f"scene_{i}", person)
            style = _line(i, f"scene {i}{own_part(clip, person)}")
            far = _distance(camera, joints)
            curve(recording, f"fit/distance/{entity}", "frame", frames, far, style)
            miss = _mean_miss(camera, joints, clip.tracks[person])
            curve(recording, f"fit/miss/{entity}", "frame", frames, miss, style)
    if truth is not None:
        far = _distance(truth.camera, truth.joints)
        style = rr.SeriesLines(colors=TRUE_COLOUR, names="truth", widths=_WIDTH)
        curve(recording, "fit/distance/truth", "frame", frames, far, style)


def log_traces(recording: rr.RecordingStream, traces: Mapping[str, Array]) -> None:
    """Log (chains, draws) arrays, thinned to what a screen can show."""
    for name, chains in traces.items():
        step = -(-chains.shape[1] // _TRACE_POINTS) or 1
        draws = np.arange(0, chains.shape[1], step)
        for k, chain in enumerate(chains, 1):
            entity = f"{trace_entity(name)}/chain_{k}"
            curve(recording, entity, "draw", draws, chain[draws], _line(k, f"chain {k}"))


def _distance(camera: Camera, joints: Array) -> Array:
    """(T,) metres from the optical centre to the pelvis."""
    distance: Array = np.linalg.norm(joints[:, PELV] - camera.centre, axis=-1)
    return distance


def _mean_miss(camera: Camera, joints: Array, track: Track) -> Array:
    """(T,) mean pixels between detections and reprojection; NaN in frames without either."""
    miss = np.linalg.norm(camera.project(joints) - track.keypoints, axis=-1)
    usable = (track.confidences > 0) & np.isfinite(miss)
    total, count = np.where(usable, miss, 0).sum(1), usable.sum(1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _line(number: int, name: str) -> rr.SeriesLines:
    colour = SCENE_COLOURS[(number - 1) % len(SCENE_COLOURS)]
    return rr.SeriesLines(colors=colour, names=name, widths=_WIDTH)


def curve(
    recording: rr.RecordingStream,
    entity: str,
    timeline: str,
    times: NDArray[np.int64],
    values: Array,
    style: rr.SeriesLines,
) -> None:
    """Log one curve (n,) over the times (n,) of a timeline, its unknown values left out."""
    known = np.isfinite(values)
    if not known.any():
        return
    index = rr.TimeColumn(timeline, sequence=times[known])
    columns = rr.Scalars.columns(scalars=values[known])
    recording.send_columns(entity, indexes=[index], columns=columns, strict=True)
    recording.log(entity, style, static=True, strict=True)
