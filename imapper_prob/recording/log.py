"""Everything a run found, in one recording for the rerun viewer.

Entities, in metres in the world frame (z up, floor at z = 0)::

    description                       what one sees, and the layouts in a table
    world/floor, world/camera         the ground, and the camera of the best layout
    world/camera/image/...            detections and reprojected joints, pixels
    world/layout_1 … layout_K/...     furniture, names, positions, person, path, ghosts
    world/truth/...                   what really was there, where somebody knows
    world/by_layout/..., summary      the layouts one after the other, on timeline `layout`
    fit/...                           curves over frames
    traces/...                        curves over the draws of the chains

Timelines are `frame` (the input's own numbers), `layout` (from 1) and `draw`. Nothing is
stamped with the time of day, so the same run makes the same recording.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import rerun as rr
from numpy.typing import ArrayLike, NDArray

from imapper_prob.files import written_whole
from imapper_prob.models.errors import InputError
from imapper_prob.models.geometry import pack_boxes
from imapper_prob.models.scene import Clip, Scene, SceneObject, Truth
from imapper_prob.models.skeleton import PELV
from imapper_prob.recording import palette, shapes
from imapper_prob.recording.blueprint import make_blueprint
from imapper_prob.recording.caption import caption, contents, layout_name
from imapper_prob.recording.curves import log_fit, log_traces
from imapper_prob.recording.entities import PATH_RADIUS, log_moving, log_person, log_static
from imapper_prob.results.scenes import WeightedScene

__all__ = ["write_recording"]

Array = NDArray[np.float64]

_GHOSTS = 8
"""Most doubles drawn of a layout's person: more hide the person and swell the file."""
_GHOST_RADIUS = 0.006
"""Radius in metres, chosen by eye: a ghost is thinner than a limb."""


def write_recording(
    path: str | os.PathLike[str],
    *,
    clip: Clip,
    scenes: Sequence[WeightedScene],
    traces: Mapping[str, ArrayLike],
    truth: Truth | None = None,
    description: str,
    application_id: str = "imapper-prob",
) -> None:
    """Write one ``.rrd`` file, its layout of views inside; a file in the way is replaced.

    Parameters
    ----------
    path : path
        Written beside and renamed, so that it is never half there.
    clip : Clip
        What was seen; the detections of its first track are drawn.
    scenes : sequence of WeightedScene
        The layouts, most probable first; at least one.
    traces : mapping of str to (chains, draws) float
        What to plot of the chains, by name; NaN where a chain has no draw.
    truth : Truth, optional
        Drawn in grey outlines.
    description : str
        Markdown that heads the text panel.
    application_id : str
        Under which the viewer remembers its settings.

    Raises
    ------
    InputError
        If there is no scene, a motion does not fit the clip, a trace is not two-dimensional
        or the folder does not exist.
    """
    path = Path(path)
    scenes = tuple(scenes)
    curves = {name: np.asarray(values, float) for name, values in traces.items()}
    _check(path, clip, scenes, curves, truth)
    recording = rr.RecordingStream(
        application_id,
        recording_id=_digest(clip, scenes, curves, truth, description),
        # The start time is a property; without it, equal runs make equal recordings.
        send_properties=False,
    )
    blueprint = make_blueprint(scenes, traces=tuple(curves), truth=truth, fps=clip.fps)
    # Leaving the recording writes its footer: only then may the file take its name.
    with written_whole(path) as beside, recording:
        recording.save(beside, default_blueprint=blueprint)
        _log_all(recording, clip, scenes, curves, truth, description)


def _check(
    path: Path,
    clip: Clip,
    scenes: Sequence[WeightedScene],
    curves: Mapping[str, Array],
    truth: Truth | None,
) -> None:
    if not path.parent.is_dir():
        raise InputError(f"{path}: the folder {path.parent} does not exist; make it first")
    if not scenes:
        raise InputError(f"{path}: a recording needs at least one scene")
    motions = {f"layout {i}": s.scene.joints for i, s in enumerate(scenes, 1)}
    if truth is not None:
        motions["the truth"] = truth.joints
    for name, joints in motions.items():
        if len(joints) != clip.n_frames:
            raise InputError(
                f"{path}: {name} has {len(joints)} frames, clip {clip.name} has {clip.n_frames}"
            )
    for name, values in curves.items():
        if values.ndim != 2:
            raise InputError(f"{path}: trace {name} has shape {values.shape}, not (chains, draws)")


def _digest(
    clip: Clip,
    scenes: Sequence[WeightedScene],
    curves: Mapping[str, Array],
    truth: Truth | None,
    description: str,
) -> str:
    """A name for the recording that depends on nothing but its contents."""
    state = hashlib.sha256(repr((clip.name, description, clip.fps, list(curves))).encode())
    rooms = [(s.scene.camera, s.scene.objects) for s in scenes]
    rooms += [(truth.camera, truth.objects)] if truth is not None else []
    state.update(repr([(s.probability, s.error) for s in scenes]).encode())
    for camera, objects in rooms:
        state.update(repr((camera, [(o.label, o.placement) for o in objects])).encode())
        state.update(pack_boxes(objects).tobytes())
    arrays = [clip.frame_ids, *(a for t in clip.tracks for a in (t.keypoints, t.confidences))]
    arrays += [a for s in scenes for a in (s.scene.joints, s.covariances, s.ghosts)]
    arrays += [truth.joints] if truth is not None else []
    for array in (*arrays, *curves.values()):
        state.update(np.ascontiguousarray(array).tobytes())
    return state.hexdigest()[:32]


def _log_all(
    recording: rr.RecordingStream,
    clip: Clip,
    scenes: Sequence[WeightedScene],
    curves: Mapping[str, Array],
    truth: Truth | None,
    description: str,
) -> None:
    everything = [o for s in scenes for o in s.scene.objects]
    everything += truth.objects if truth is not None else ()
    categories = palette.category_ids(o.label for o in everything)
    frames = rr.TimeColumn("frame", sequence=clip.frame_ids)

    log_static(recording, "/", palette.annotation_context(categories))
    log_static(recording, "world", rr.ViewCoordinates.RIGHT_HAND_Z_UP)
    text = caption(description, scenes)
    document = rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN)
    log_static(recording, "description", document)

    _log_floor(recording, everything, [s.scene.joints for s in scenes])
    _log_camera(recording, clip, scenes[0].scene, frames)
    for i, weighted in enumerate(scenes, 1):
        _log_layout(recording, f"world/layout_{i}", weighted, categories, frames, best=i == 1)
    if truth is not None:
        log_static(
            recording, "world/truth/furniture", shapes.boxes(truth.objects, {}, outlined=True)
        )
        log_person(recording, "world/truth", truth.joints, palette.TRUTH, frames)
    _log_by_layout(recording, scenes, categories)
    log_fit(recording, clip, scenes, truth)
    log_traces(recording, curves)


def _log_floor(
    recording: rr.RecordingStream, objects: Sequence[SceneObject], motions: Sequence[Array]
) -> None:
    on_floor = [np.zeros((1, 2)), *(o.footprint for o in objects)]
    on_floor += [m[:, PELV, :2][np.isfinite(m[:, PELV, 0])] for m in motions]
    points = np.concatenate(on_floor)
    low, high = np.floor(points.min(0) - 0.3), np.ceil(points.max(0) + 0.3)
    log_static(recording, "world/floor", shapes.floor_plane(low, high))
    log_static(recording, "world/floor/lines", shapes.floor_lines(low, high))


def _log_camera(
    recording: rr.RecordingStream, clip: Clip, best: Scene, frames: rr.TimeColumn
) -> None:
    log_static(recording, "world/camera", shapes.camera_pose(best.camera))
    log_static(recording, "world/camera/image", shapes.pinhole(best.camera))
    frame_of_image = rr.Boxes2D(
        mins=[(0, 0)], sizes=[(best.camera.width, best.camera.height)], colors=(90, 95, 105)
    )
    log_static(recording, "world/camera/image/border", frame_of_image)

    track = clip.tracks[0]
    seen = np.isfinite(track.keypoints).all(-1) & (track.confidences > 0)
    detections = rr.Points2D.columns(
        positions=track.keypoints[seen],
        colors=palette.confidence_colours(track.confidences[seen]),
    ).partition(seen.sum(1))
    log_moving(
        recording,
        "world/camera/image/detections",
        frames,
        detections,
        style=rr.Points2D.from_fields(radii=rr.Radius.ui_points(4.0), draw_order=20.0),
    )

    pixels = best.camera.project(best.joints)
    drawn = np.isfinite(pixels).all(-1)
    reprojection = rr.Points2D.columns(
        positions=pixels[drawn], keypoint_ids=np.nonzero(drawn)[1]
    ).partition(drawn.sum(1))
    log_moving(
        recording,
        "world/camera/image/reprojection",
        frames,
        reprojection,
        style=rr.Points2D.from_fields(
            class_ids=palette.REPROJECTION, radii=rr.Radius.ui_points(2.0), show_labels=False
        ),
    )


def _log_layout(
    recording: rr.RecordingStream,
    entity: str,
    weighted: WeightedScene,
    categories: dict[str, int],
    frames: rr.TimeColumn,
    *,
    best: bool,
) -> None:
    objects = weighted.scene.objects
    log_static(recording, f"{entity}/furniture", shapes.boxes(objects, categories))
    log_static(recording, f"{entity}/names", shapes.names(objects, categories))
    positions = shapes.position_ellipses(objects, weighted.covariances)
    log_static(recording, f"{entity}/positions", positions)
    person = palette.ESTIMATE if best else palette.ALTERNATIVE
    log_person(recording, entity, weighted.scene.joints, person, frames)
    _log_ghosts(recording, f"{entity}/ghosts", weighted.ghosts, person, frames)


def _log_ghosts(
    recording: rr.RecordingStream, entity: str, ghosts: Array, number: int, frames: rr.TimeColumn
) -> None:
    ghosts = ghosts[:_GHOSTS]
    if not len(ghosts):
        return
    strips = [
        [s for ghost in ghosts for s in shapes.limbs(ghost[t])] for t in range(ghosts.shape[1])
    ]
    columns = rr.LineStrips3D.columns(strips=[s for row in strips for s in row])
    log_moving(
        recording,
        entity,
        frames,
        columns.partition([len(row) for row in strips]),
        style=rr.LineStrips3D.from_fields(colors=palette.GHOSTS[number], radii=_GHOST_RADIUS),
    )


def _log_by_layout(
    recording: rr.RecordingStream, scenes: Sequence[WeightedScene], categories: dict[str, int]
) -> None:
    layouts = rr.TimeColumn("layout", sequence=np.arange(1, len(scenes) + 1))
    furniture = shapes.box_columns([s.scene.objects for s in scenes], categories)
    log_moving(
        recording,
        "world/by_layout/furniture",
        layouts,
        furniture,
        style=rr.Boxes3D.from_fields(
            radii=0.006,
            fill_mode=rr.components.FillMode.TransparentFillMajorWireframe,
            show_labels=False,
        ),
    )

    pieces = [shapes.paths(s.scene.joints[:, PELV]) for s in scenes]
    columns = rr.LineStrips3D.columns(strips=[p for row in pieces for p in row])
    lengths = [len(row) for row in pieces]
    log_moving(
        recording,
        "world/by_layout/path",
        layouts,
        columns.partition(lengths),
        style=rr.LineStrips3D.from_fields(
            class_ids=palette.ESTIMATE, radii=PATH_RADIUS, show_labels=False
        ),
    )

    texts = [f"{layout_name(i, s)}: {contents(s.scene)}" for i, s in enumerate(scenes, 1)]
    summaries = rr.TextDocument.columns(text=texts)
    recording.send_columns("summary", indexes=[layouts], columns=summaries, strict=True)
