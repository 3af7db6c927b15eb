"""The posterior in a recording: draws, curves over time, and uncertainty."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from imapper_prob.models.camera import Camera
from imapper_prob.models.log_posterior import motion
from imapper_prob.models.problem import Problem
from imapper_prob.models.scene import Clip, SceneObject, Track, Truth
from imapper_prob.models.skeleton import PELV
from imapper_prob.models.text import as_probability, brief
from imapper_prob.people import at_one_time, by_person, own_part
from imapper_prob.plotting import category_colour
from imapper_prob.recording import palette, shapes
from imapper_prob.recording.palette import FLOOR, SCENE_COLOURS, TRUE_COLOUR, UNCLAIMED, drawable
from imapper_prob.recording.shapes import PATH_RADIUS, log_moving, log_static, own_entity
from imapper_prob.sampling.sample import Samples
from imapper_prob.uncertainty.clusters import LEAST_NAMED, ObjectCluster
from imapper_prob.uncertainty.hidden import HiddenJoints
from imapper_prob.uncertainty.motion import JointSummary
from imapper_prob.uncertainty.occupancy import Occupancy
from imapper_prob.uncertainty.parameters import Nuisance
from imapper_prob.uncertainty.scenes import WeightedScene

__all__ = [
    "HIDDEN",
    "Certainty",
    "DrawnChain",
    "chain_entity",
    "curve",
    "drawn_chains",
    "hidden_colours",
    "log_certainty",
    "log_draws",
    "log_fit",
    "log_hidden_joints",
    "log_traces",
    "trace_entity",
]

Array = NDArray[np.float64]
_TRACE_POINTS = 2000
"""Most points kept of a trace, more than the columns of a screen."""
_WIDTH = 1.5
"""Width of a curve, in points of the screen."""


def trace_entity(name: str) -> str:
    """Entity of the chains of a trace.

    Parameters
    ----------
    name : str
        Name of the trace.

    Returns
    -------
    str
    """
    return f"traces/{rr.escape_entity_path_part(name)}"


def log_fit(
    recording: rr.RecordingStream,
    clip: Clip,
    scenes: Sequence[WeightedScene],
    truth: Truth | None,
) -> None:
    """Log distance and reprojection error for each scene, person and frame.

    Parameters
    ----------
    recording : rerun.RecordingStream
    clip : Clip
    scenes : sequence of WeightedScene
    truth : Truth, optional
    """
    frames = clip.frame_ids
    for i, weighted in enumerate(scenes, 1):
        camera = weighted.scene.camera
        for person, joints in enumerate(by_person(clip, weighted.scene.joints)):
            entity = own_entity(clip, f"scene_{i}", person)
            style = _line(i, drawable(f"scene {i}{own_part(clip, person)}"))
            far = _distance(camera, joints)
            curve(recording, f"fit/distance/{entity}", "frame", frames, far, style)
            miss = _mean_miss(camera, joints, clip.tracks[person])
            curve(recording, f"fit/miss/{entity}", "frame", frames, miss, style)
    if truth is not None:
        for person, joints in enumerate(by_person(clip, truth.joints)):
            entity = own_entity(clip, "truth", person)
            name = drawable(f"truth{own_part(clip, person)}")
            style = rr.SeriesLines(colors=TRUE_COLOUR, names=name, widths=_WIDTH)
            far = _distance(truth.camera, joints)
            curve(recording, f"fit/distance/{entity}", "frame", frames, far, style)


def log_traces(recording: rr.RecordingStream, traces: Mapping[str, Array]) -> None:
    """Log traces of the chains, thinned to the resolution of a screen.

    Parameters
    ----------
    recording : rerun.RecordingStream
    traces : mapping of str to (chains, draws) float
    """
    for name, chains in traces.items():
        step = -(-chains.shape[1] // _TRACE_POINTS) or 1
        draws = np.arange(0, chains.shape[1], step)
        for k, chain in enumerate(chains, 1):
            entity = f"{trace_entity(name)}/chain_{k}"
            curve(recording, entity, "draw", draws, chain[draws], _line(k, f"chain {k}"))


def _distance(camera: Camera, joints: Array) -> Array:
    """(T,) distance from the optical centre to the pelvis, metres."""
    distance: Array = np.linalg.norm(joints[:, PELV] - camera.centre, axis=-1)
    return distance


def _mean_miss(camera: Camera, joints: Array, track: Track) -> Array:
    """(T,) mean distance of detections from reprojected joints, pixels; NaN in frames without
    either."""
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
    """Log one curve, without its NaN values.

    Parameters
    ----------
    recording : rerun.RecordingStream
    entity : str
    timeline : str
    times : (n,) int
    values : (n,) float
    style : rerun.SeriesLines
    """
    known = np.isfinite(values)
    if not known.any():
        return
    index = rr.TimeColumn(timeline, sequence=times[known])
    columns = rr.Scalars.columns(scalars=values[known])
    recording.send_columns(entity, indexes=[index], columns=columns, strict=True)
    recording.log(entity, style, static=True, strict=True)


# ------------------------------------------------------------------------------------------------
# Uncertainty over all draws: the floor, the objects, and hidden joints.

HIDDEN = 0.5
"""Probability from which a joint is drawn as hidden."""
_FAINT = 0.03
"""Probability below which a cell is not drawn, because it would look like the floor."""
_MAP_HEIGHT = 0.002
"""Height in metres of the map above the floor, which avoids flickering."""
_RING = 0.075
"""Radius in metres of the mark of a hidden joint, larger than a joint."""
_FRAME = 0.015
"""Half the side of the square around a hidden joint, in units of the image's height."""
_AXES = {"across the view": (134, 188, 240), "depth": (255, 214, 102), "height": (150, 215, 170)}
"""Colours of the curves of standard deviations by direction, sRGB."""


@dataclass(frozen=True)
class Certainty:
    """Summaries of all draws, see `imapper_prob.uncertainty`.

    Parameters
    ----------
    occupancy : Occupancy
    hidden : HiddenJoints
    joints : JointSummary
    nuisances : mapping of str to Nuisance
    """

    occupancy: Occupancy
    hidden: HiddenJoints
    joints: JointSummary
    nuisances: Mapping[str, Nuisance]

    __repr__ = brief

    @property
    def clusters(self) -> tuple[ObjectCluster, ...]:
        """Objects matched across draws, most probable first."""
        return self.hidden.clusters


def log_certainty(recording: rr.RecordingStream, certainty: Certainty, clip: Clip) -> None:
    """Log the map of the floor, where each object is, and uncertainty over frames.

    Parameters
    ----------
    recording : rerun.RecordingStream
    certainty : Certainty
    clip : Clip
    """
    floor = _floor_map(certainty.occupancy)
    if floor is not None:
        log_static(recording, "world/occupancy", floor)
    log_static(recording, "world/all_draws/positions", shapes.regions(certainty.clusters))
    log_static(recording, "world/all_draws/names", _names(certainty.clusters))
    _log_curves(recording, certainty, clip)


def log_hidden_joints(
    recording: rr.RecordingStream,
    certainty: Certainty,
    clip: Clip,
    joints: Array,
    pixels: Array,
    frames: rr.TimeColumn,
    *,
    image_height: int,
) -> None:
    """Mark hidden joints of the most probable scene's people, in the image and in 3D.

    Parameters
    ----------
    recording : rerun.RecordingStream
    certainty : Certainty
    clip : Clip
        Clip of K people.
    joints, pixels : (K T, 16, 3), (K T, 16, 2) float
        Joints of these people; NaN where unknown.
    frames : rerun.TimeColumn
        T times.
    image_height : int
        Pixels.
    """
    joints, pixels = at_one_time(clip, joints), at_one_time(clip, pixels)
    colours = at_one_time(clip, hidden_colours(certainty.hidden))
    marked = at_one_time(clip, certainty.hidden.probability) >= HIDDEN
    seen_3d = marked & np.isfinite(joints).all(-1)
    log_moving(
        recording,
        "world/scene_1/hidden",
        frames,
        rr.Points3D.columns(positions=joints[seen_3d], colors=colours[seen_3d]).partition(
            seen_3d.sum(1)
        ),
        style=rr.Points3D.from_fields(radii=_RING),
    )
    seen_2d = marked & np.isfinite(pixels).all(-1)
    log_moving(
        recording,
        "world/camera/image/hidden",
        frames,
        rr.Boxes2D.columns(
            centers=pixels[seen_2d],
            half_sizes=np.full((int(seen_2d.sum()), 2), _FRAME * image_height),
            colors=colours[seen_2d],
        ).partition(seen_2d.sum(1)),
        style=rr.Boxes2D.from_fields(radii=rr.Radius.ui_points(1.5), draw_order=30.0),
    )


def hidden_colours(hidden: HiddenJoints) -> NDArray[np.uint8]:
    """Colour of the object that most probably hides each joint.

    Parameters
    ----------
    hidden : HiddenJoints

    Returns
    -------
    (T, 16, 3) uint8
    """
    palette = np.array([UNCLAIMED, *(category_colour(c.label) for c in hidden.clusters)])
    if not hidden.clusters:
        return np.broadcast_to(palette[0], (*hidden.probability.shape, 3)).astype(np.uint8)
    most = hidden.by_object.argmax(0)
    claimed = hidden.by_object.max(0) > 0
    colours: NDArray[np.uint8] = palette[np.where(claimed, most + 1, 0)].astype(np.uint8)
    return colours


def _floor_map(occupancy: Occupancy) -> rr.Mesh3D | None:
    """Tiles in the colour of the most probable category, with strength by probability."""
    rows, columns = np.nonzero(occupancy.anything >= _FAINT)
    if not len(rows):
        return None
    hue = np.array([category_colour(c) for c in occupancy.categories], float)
    kind = occupancy.by_category[:, rows, columns].argmax(0)
    strength = occupancy.anything[rows, columns][:, None]
    colours = (1 - strength) * np.array(FLOOR, float) + strength * hue[kind]
    half = occupancy.cell / 2
    corners = np.array([(-half, -half), (half, -half), (half, half), (-half, half)])
    centres = np.stack([occupancy.x[columns], occupancy.y[rows]], -1)
    on_floor = (centres[:, None] + corners).reshape(-1, 2)
    vertices = np.column_stack([on_floor, np.full(len(on_floor), _MAP_HEIGHT)])
    first = 4 * np.arange(len(rows))[:, None, None]
    return rr.Mesh3D(
        vertex_positions=vertices,
        triangle_indices=(first + np.array([(0, 1, 2), (0, 2, 3)])).reshape(-1, 3),
        vertex_colors=np.repeat(colours.round().astype(np.uint8), 4, axis=0),
    )


def _names(clusters: Sequence[ObjectCluster]) -> rr.Points3D:
    """Label and presence probability of each object, as text."""
    clusters = [c for c in clusters if c.presence >= LEAST_NAMED]
    return rr.Points3D(
        np.reshape([(*c.mean, 0.02) for c in clusters], (-1, 3)),
        labels=[drawable(f"{c.label} {as_probability(c.presence)}") for c in clusters],
        colors=np.reshape([category_colour(c.label) for c in clusters], (-1, 3)),
        radii=0.02,
        show_labels=True,
    )


def _log_curves(recording: rr.RecordingStream, certainty: Certainty, clip: Clip) -> None:
    """Log the number of joints each object hides, and the uncertainty of each pelvis."""
    frame_ids = clip.frame_ids
    for k, cluster in enumerate(certainty.clusters, 1):
        name = drawable(f"{k} {cluster.label}")
        style = rr.SeriesLines(colors=category_colour(cluster.label), names=name, widths=1.5)
        expected = at_one_time(clip, certainty.hidden.by_object[k - 1]).sum(-1)
        curve(recording, f"sure/hidden/object_{k}", "frame", frame_ids, expected, style)
    everything = at_one_time(clip, certainty.hidden.probability).sum(-1)
    style = rr.SeriesLines(colors=UNCLAIMED, names="by anything", widths=1.0)
    curve(recording, "sure/hidden/anything", "frame", frame_ids, everything, style)
    spread = 100 * certainty.joints.standard_deviation[:, PELV]
    for person, own in enumerate(by_person(clip, spread)):
        for axis, (name, colour) in enumerate(_AXES.items()):
            said = drawable(f"{name}{own_part(clip, person)}")
            style = rr.SeriesLines(colors=colour, names=said, widths=1.5)
            entity = own_entity(clip, f"sure/pelvis/{name.replace(' ', '_')}", person)
            curve(recording, entity, "frame", frame_ids, own[:, axis], style)


# ------------------------------------------------------------------------------------------------
# Draws one after the other, with the chains side by side.

_MOST = 400
"""Most draws kept of all chains together, evenly spaced, to limit the file's size."""


@dataclass(frozen=True)
class DrawnChain:
    """Some draws of one chain.

    Parameters
    ----------
    numbers : (n,) int
        Indices of these draws in the chain, from 0.
    objects : sequence of n sequences of SceneObject
        Furniture in world coordinates.
    paths : (n, K, T, 3) float
        Pelvis of each of K people in world coordinates, metres.
    """

    numbers: NDArray[np.int64]
    objects: Sequence[Sequence[SceneObject]]
    paths: Array


def drawn_chains(clip: Clip, problem: Problem, samples: Samples) -> tuple[DrawnChain, ...]:
    """Evenly spaced draws of each chain, as many as a recording may hold.

    Parameters
    ----------
    clip : Clip
    problem : Problem
        The clip's log-posterior.
    samples : Samples

    Returns
    -------
    tuple of DrawnChain
    """
    chains, draws = samples.shape
    kept = np.unique(np.linspace(0, draws - 1, max(1, _MOST // chains)).round().astype(int))
    numbers = [c * draws + kept for c in range(chains)]
    return tuple(
        DrawnChain(
            kept,
            [samples.objects[n] for n in own],
            np.array([by_person(clip, motion(problem, samples.states[n])[:, PELV]) for n in own]),
        )
        for own in numbers
    )


def chain_entity(number: int) -> str:
    """Entity of the draws of a chain.

    Parameters
    ----------
    number : int
        From 1.

    Returns
    -------
    str
    """
    return f"world/draws/chain_{number}"


def log_draws(
    recording: rr.RecordingStream, chains: Sequence[DrawnChain], categories: Mapping[str, int]
) -> None:
    """Log furniture, names and path of each draw on the timeline `draw`.

    Parameters
    ----------
    recording : rerun.RecordingStream
    chains : sequence of DrawnChain
    categories : mapping of str to int
        Class numbers.
    """
    for number, chain in enumerate(chains, 1):
        entity = chain_entity(number)
        index = rr.TimeColumn("draw", sequence=chain.numbers)
        log_moving(
            recording,
            f"{entity}/furniture",
            index,
            shapes.box_columns(chain.objects, dict(categories)),
            style=rr.Boxes3D.from_fields(
                radii=0.006,
                fill_mode=rr.components.FillMode.TransparentFillMajorWireframe,
                show_labels=False,
            ),
        )
        log_moving(
            recording,
            f"{entity}/names",
            index,
            shapes.name_columns(chain.objects, dict(categories)),
            style=rr.Points3D.from_fields(radii=0.004, show_labels=True),
        )
        log_moving(
            recording,
            f"{entity}/path",
            index,
            rr.LineStrips3D.columns(
                strips=[path for people in chain.paths for path in people]
            ).partition([len(people) for people in chain.paths]),
            style=rr.LineStrips3D.from_fields(
                class_ids=palette.ESTIMATE, radii=PATH_RADIUS, show_labels=False
            ),
        )
