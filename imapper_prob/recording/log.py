"""Write all results of a run into one recording.

Entities, in metres in the world frame (z up, floor at z = 0)::

    description, certainty, moves     legend, uncertainty, and acceptance rates, as text
    world/floor, world/camera         the floor, and the camera of the most probable scene
    world/camera/image/...            pictures, detections, reprojected and hidden joints, pixels
    world/occupancy, world/all_draws  the floor and the objects over all draws
    world/scene_1 … scene_K/...       furniture, names, positions, person, path, ghosts
    world/truth/...                   ground truth, if it is known
    world/by_scene/..., summary       the scenes one after the other, on timeline `scene`
    world/draws/chain_1 …             draws one after the other, on timeline `draw`
    fit/..., sure/...                 curves over frames
    traces/...                        curves over the draws of the chains

If there are several people, the person, limbs, path and curves of each have entities of their own,
named after their tracks. Timelines are `frame` (the input's own numbers), `scene` (from 1) and
`draw`. No time of day is recorded, so equal runs make equal recordings. ``recording.md`` describes
the panels.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import ArrayLike, NDArray

from imapper_prob.files import written_whole
from imapper_prob.models.camera import Camera
from imapper_prob.models.errors import InputError
from imapper_prob.models.scene import Clip, Scene, SceneObject, Truth
from imapper_prob.models.skeleton import PELV
from imapper_prob.models.text import counted
from imapper_prob.people import at_one_time, by_person, everybody
from imapper_prob.recording import palette, shapes
from imapper_prob.recording.blueprint import (
    caption,
    certainty_text,
    make_blueprint,
    moves_text,
    scene_name,
)
from imapper_prob.recording.palette import digest, drawable
from imapper_prob.recording.posterior import (
    Certainty,
    DrawnChain,
    log_certainty,
    log_draws,
    log_fit,
    log_hidden_joints,
    log_traces,
)
from imapper_prob.recording.shapes import (
    PATH_RADIUS,
    log_moving,
    log_person,
    log_static,
    own_entity,
)
from imapper_prob.recording.video import Video
from imapper_prob.uncertainty.scenes import WeightedScene

__all__ = ["saved", "write_recording"]


@contextmanager
def saved(recording: rr.RecordingStream, path: Path, blueprint: rrb.Blueprint) -> Iterator[None]:
    """Write what is logged inside the context to a file.

    The content is collected in memory, because rerun's file-writing thread blocks forever if the
    disk is full at the start.

    Parameters
    ----------
    recording : rerun.RecordingStream
    path : Path
    blueprint : rerun.blueprint.Blueprint

    Yields
    ------
    None
    """
    memory = recording.memory_recording()
    with recording:
        # Viewers in a browser, and those that have shown another recording, keep the layout that
        # they have unless a new one is made active.
        recording.send_blueprint(blueprint, make_active=True, make_default=True)
        yield
    content = memory.drain_as_bytes()
    with written_whole(path) as beside:
        beside.write_bytes(content)


# ------------------------------------------------------------------------------------------------
# The image.

Array = NDArray[np.float64]


def _image_camera(camera: Camera, video: Video | None) -> Camera:
    """The camera scaled to the size of the recorded pictures, which share their pixels."""
    if video is None:
        return camera
    scale = video.width / camera.width
    return replace(
        camera,
        width=video.width,
        height=video.height,
        fx=scale * camera.fx,
        fy=scale * camera.fy,
        cx=scale * camera.cx,
        cy=scale * camera.cy,
    )


def _log_image(
    recording: rr.RecordingStream,
    clip: Clip,
    best: Scene,
    frames: rr.TimeColumn,
    video: Video | None,
) -> Array:
    """Log camera, pictures, detections and reprojected joints; return the latter.

    Returns
    -------
    (K T, 16, 2) float
        Joints of the K people of the scene, in recorded pixels.
    """
    camera = _image_camera(best.camera, video)
    scale = camera.width / best.camera.width
    log_static(recording, "world/camera", shapes.camera_pose(camera))
    log_static(recording, "world/camera/image", shapes.pinhole(camera))
    border = rr.Boxes2D(mins=[(0, 0)], sizes=[(camera.width, camera.height)], colors=(90, 95, 105))
    log_static(recording, "world/camera/image/border", border)
    if video is not None:
        _log_video(recording, video)
    everyone = everybody(clip)
    keypoints = at_one_time(clip, everyone.keypoints)
    confidences = at_one_time(clip, everyone.confidences)
    seen = np.isfinite(keypoints).all(-1) & (confidences > 0)
    log_moving(
        recording,
        "world/camera/image/detections",
        frames,
        rr.Points2D.columns(
            positions=scale * keypoints[seen],
            colors=palette.confidence_colours(confidences[seen]),
        ).partition(seen.sum(1)),
        style=rr.Points2D.from_fields(radii=rr.Radius.ui_points(4.0), draw_order=20.0),
    )
    pixels = camera.project(best.joints)
    for person, own in enumerate(by_person(clip, pixels)):
        drawn = np.isfinite(own).all(-1)
        log_moving(
            recording,
            own_entity(clip, "world/camera/image/reprojection", person),
            frames,
            rr.Points2D.columns(positions=own[drawn], keypoint_ids=np.nonzero(drawn)[1]).partition(
                drawn.sum(1)
            ),
            style=rr.Points2D.from_fields(
                class_ids=palette.REPROJECTION, radii=rr.Radius.ui_points(2.0), show_labels=False
            ),
        )
    return pixels


def _log_video(recording: rr.RecordingStream, video: Video) -> None:
    log_moving(
        recording,
        "world/camera/image/video",
        rr.TimeColumn("frame", sequence=video.frame_ids),
        rr.EncodedImage.columns(
            blob=list(video.pictures), media_type=["image/jpeg"] * len(video.pictures)
        ),
        style=rr.EncodedImage.from_fields(draw_order=-20.0),
    )


# ------------------------------------------------------------------------------------------------
# The recording.

_APPLICATION = "imapper-prob"
"""Name under which the viewer stores its settings."""
_GHOSTS = 8
"""Most other draws drawn of a scene's person; more hide the person and enlarge the file."""
_GHOST_RADIUS = 0.006
"""Radius in metres, chosen by eye: thinner than a limb."""


def write_recording(
    path: str | os.PathLike[str],
    *,
    clip: Clip,
    scenes: Sequence[WeightedScene],
    traces: Mapping[str, ArrayLike],
    truth: Truth | None = None,
    description: str,
    certainty: Certainty | None = None,
    draws: Sequence[DrawnChain] = (),
    acceptance: Mapping[str, float] | None = None,
    video: Video | None = None,
) -> None:
    """Write one ``.rrd`` file, including its layout of views; an existing file is replaced.

    Parameters
    ----------
    path : path
        Written atomically.
    clip : Clip
        The observed clip.
    scenes : sequence of WeightedScene
        The scenes, most probable first; at least one. Their motions are those of all tracks,
        concatenated.
    traces : mapping of str to (chains, draws) float
        Values to plot for the chains, by name; NaN where a chain has no draw.
    truth : Truth, optional
        Drawn as grey outlines.
    description : str
        Markdown at the top of the text panel.
    certainty : Certainty, optional
        Summary of all draws.
    draws : sequence of DrawnChain
        Draws to show one after the other, by chain.
    acceptance : mapping of str to float, optional
        Acceptance rate of each move of the sampler.
    video : Video, optional
        Pictures to show behind the detections.

    Raises
    ------
    InputError
        There is no scene, a motion does not fit the clip, a trace is not two-dimensional or the
        folder does not exist.
    """
    path = Path(path)
    scenes = tuple(scenes)
    curves = {name: np.asarray(values, float) for name, values in traces.items()}
    _check(path, clip, scenes, curves, truth)
    told = _RecordingContent(
        clip, scenes, curves, truth, description, certainty, tuple(draws), video
    )
    texts = {
        "description": caption(description, scenes),
        "certainty": "" if certainty is None else certainty_text(certainty),
        "moves": moves_text(acceptance or {}),
    }
    recording = rr.RecordingStream(
        _APPLICATION,
        recording_id=digest(told, texts),
        # The start time is a property; without properties, equal runs make equal recordings.
        send_properties=False,
    )
    blueprint = make_blueprint(
        scenes,
        traces=tuple(curves),
        truth=truth,
        clip=clip,
        image=_image_camera(scenes[0].scene.camera, video),
        certainty=certainty,
        chains=len(draws),
        moves=bool(acceptance),
    )
    with saved(recording, path, blueprint):
        _log_all(recording, told)
        for entity, text in texts.items():
            if text:
                document = rr.TextDocument(drawable(text), media_type=rr.MediaType.MARKDOWN)
                log_static(recording, entity, document)


@dataclass(frozen=True)
class _RecordingContent:
    """The content of a recording, except for its texts."""

    clip: Clip
    scenes: tuple[WeightedScene, ...]
    curves: Mapping[str, Array]
    truth: Truth | None
    description: str
    certainty: Certainty | None
    draws: tuple[DrawnChain, ...]
    video: Video | None


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
    people, n_frames = len(clip.tracks), clip.n_frames
    motions = {f"scene {i}": s.scene.joints for i, s in enumerate(scenes, 1)}
    if truth is not None:
        motions["the truth"] = truth.joints
    for name, joints in motions.items():
        first_alone = joints is motions.get("the truth") and len(joints) == n_frames
        if len(joints) != people * n_frames and not first_alone:
            raise InputError(
                f"{path}: {name} has {len(joints)} frames, clip {clip.name} has {n_frames}"
                + (f" of each of {people} people" if people > 1 else "")
            )
    for name, values in curves.items():
        if values.ndim != 2:
            raise InputError(f"{path}: trace {name} has shape {values.shape}, not (chains, draws)")


def _log_all(recording: rr.RecordingStream, told: _RecordingContent) -> None:
    clip, scenes, truth = told.clip, told.scenes, told.truth
    everything = [o for s in scenes for o in s.scene.objects]
    everything += truth.objects if truth is not None else ()
    drawn = [o for chain in told.draws for objects in chain.objects for o in objects]
    categories = palette.category_ids(o.label for o in [*everything, *drawn])
    frames = rr.TimeColumn("frame", sequence=clip.frame_ids)

    log_static(recording, "/", palette.annotation_context(categories))
    log_static(recording, "world", rr.ViewCoordinates.RIGHT_HAND_Z_UP)
    _log_floor(recording, everything, [s.scene.joints for s in scenes])
    pixels = _log_image(recording, clip, scenes[0].scene, frames, told.video)
    for i, weighted in enumerate(scenes, 1):
        _log_scene(recording, f"world/scene_{i}", weighted, clip, categories, best=i == 1)
    if truth is not None:
        log_static(
            recording, "world/truth/furniture", shapes.boxes(truth.objects, {}, outlined=True)
        )
        log_static(recording, "world/truth/outlines", shapes.outlines(truth.objects))
        for person, joints in enumerate(by_person(clip, truth.joints)):
            log_person(
                recording, own_entity(clip, "world/truth", person), joints, palette.TRUTH, frames
            )
    if told.certainty is not None:
        log_certainty(recording, told.certainty, clip)
        log_hidden_joints(
            recording,
            told.certainty,
            clip,
            scenes[0].scene.joints,
            pixels,
            frames,
            image_height=_image_camera(scenes[0].scene.camera, told.video).height,
        )
    _log_by_scene(recording, scenes, clip, categories)
    log_draws(recording, told.draws, categories)
    log_fit(recording, clip, scenes, truth)
    log_traces(recording, told.curves)


def _log_floor(
    recording: rr.RecordingStream, objects: Sequence[SceneObject], motions: Sequence[Array]
) -> None:
    on_floor = [np.zeros((1, 2)), *(o.footprint for o in objects)]
    on_floor += [m[:, PELV, :2][np.isfinite(m[:, PELV, 0])] for m in motions]
    points = np.concatenate(on_floor)
    low, high = np.floor(points.min(0) - 0.3), np.ceil(points.max(0) + 0.3)
    log_static(recording, "world/floor", shapes.floor_plane(low, high))
    log_static(recording, "world/floor/lines", shapes.floor_lines(low, high))


def _log_scene(
    recording: rr.RecordingStream,
    entity: str,
    weighted: WeightedScene,
    clip: Clip,
    categories: dict[str, int],
    *,
    best: bool,
) -> None:
    objects, frames = weighted.scene.objects, rr.TimeColumn("frame", sequence=clip.frame_ids)
    log_static(recording, f"{entity}/furniture", shapes.boxes(objects, categories))
    log_static(recording, f"{entity}/names", shapes.names(objects, categories))
    positions = shapes.position_ellipses(objects, weighted.covariances)
    log_static(recording, f"{entity}/positions", positions)
    person = palette.ESTIMATE if best else palette.ALTERNATIVE
    for k, joints in enumerate(by_person(clip, weighted.scene.joints)):
        log_person(recording, own_entity(clip, entity, k), joints, person, frames)
    ghosts = [own for ghost in weighted.ghosts[:_GHOSTS] for own in by_person(clip, ghost)]
    _log_ghosts(recording, f"{entity}/ghosts", ghosts, person, frames)


def _log_ghosts(
    recording: rr.RecordingStream,
    entity: str,
    ghosts: Sequence[Array],
    number: int,
    frames: rr.TimeColumn,
) -> None:
    if not ghosts:
        return
    moments = zip(*ghosts, strict=True)
    strips = [[s for pose in poses for s in shapes.limbs(pose)] for poses in moments]
    columns = rr.LineStrips3D.columns(strips=[s for row in strips for s in row])
    log_moving(
        recording,
        entity,
        frames,
        columns.partition([len(row) for row in strips]),
        style=rr.LineStrips3D.from_fields(colors=palette.GHOSTS[number], radii=_GHOST_RADIUS),
    )


def _log_by_scene(
    recording: rr.RecordingStream,
    scenes: Sequence[WeightedScene],
    clip: Clip,
    categories: dict[str, int],
) -> None:
    index = rr.TimeColumn("scene", sequence=np.arange(1, len(scenes) + 1))
    furniture = shapes.box_columns([s.scene.objects for s in scenes], categories)
    log_moving(
        recording,
        "world/by_scene/furniture",
        index,
        furniture,
        style=rr.Boxes3D.from_fields(
            radii=0.006,
            fill_mode=rr.components.FillMode.TransparentFillMajorWireframe,
            show_labels=False,
        ),
    )

    pieces = [
        [piece for own in by_person(clip, s.scene.joints[:, PELV]) for piece in shapes.paths(own)]
        for s in scenes
    ]
    columns = rr.LineStrips3D.columns(strips=[p for row in pieces for p in row])
    lengths = [len(row) for row in pieces]
    log_moving(
        recording,
        "world/by_scene/path",
        index,
        columns.partition(lengths),
        style=rr.LineStrips3D.from_fields(
            class_ids=palette.ESTIMATE, radii=PATH_RADIUS, show_labels=False
        ),
    )

    texts = [drawable(f"{scene_name(i, s)}: {counted(s.names)}") for i, s in enumerate(scenes, 1)]
    summaries = rr.TextDocument.columns(text=texts)
    recording.send_columns("summary", indexes=[index], columns=summaries, strict=True)
