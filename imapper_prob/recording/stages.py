"""The stages of the solver one after the other, for the rerun viewer.

Entities, in metres in the world frame (z up, floor at z = 0)::

    world/floor, world/camera    the ground and the camera
    world/furniture              boxes, on timeline `stage`
    world/path/...               paths of all people, on timeline `stage`
    world/truth/...              ground truth, if it is known
    summary                      what the stage did, on timeline `stage`
    charness/...                 bars over frames, by number and name of the actor; the same at
                                 every stage

The timeline is `stage`, from 1.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from imapper_prob.layouts import placed_objects
from imapper_prob.models.camera import Camera
from imapper_prob.models.geometry import pack_boxes
from imapper_prob.models.log_posterior import State, empty_state, state_camera
from imapper_prob.models.scene import Clip, SceneObject
from imapper_prob.models.skeleton import PELV
from imapper_prob.plotting import Colour
from imapper_prob.recording import palette, shapes
from imapper_prob.recording.log import saved
from imapper_prob.recording.palette import BACKGROUND
from imapper_prob.recording.shapes import PATH_RADIUS, entity_part, log_moving, log_static
from imapper_prob.solver.actors import Solved
from imapper_prob.solver.candidates import Candidate
from imapper_prob.solver.combinations import state_of
from imapper_prob.solver.limbs import limbs_of
from imapper_prob.solver.solver import Solution

__all__ = ["charness_curves", "stage_views", "write_stages"]

Array = NDArray[np.float64]
Curve = tuple[NDArray[np.int64], Array]
"""Frame numbers and values."""
_APPLICATION = "imapper-prob-stages"
"""Name under which the viewer stores its settings."""
_AIR = 0.5
"""Metres of floor shown around its content."""


@dataclass(frozen=True)
class StageView:
    """What is shown of one stage.

    Parameters
    ----------
    name, text : str
        Name of the stage, and Markdown on what it did.
    objects : tuple of SceneObject
        Furniture that it considers, in world coordinates.
    motions : tuple of (T, 16, 3) float
        Joints of each actor in world coordinates, metres.
    """

    name: str
    text: str
    objects: tuple[SceneObject, ...]
    motions: tuple[Array, ...]


def write_stages(
    path: Path,
    *,
    clip: Clip,
    camera: Camera,
    stages: Sequence[StageView],
    charness: Mapping[str, Curve],
) -> None:
    """Write one ``.rrd`` file, including its layout of views; an existing file is replaced.

    Parameters
    ----------
    path : Path
    clip : Clip
    camera : Camera
        Its pose defines the world.
    stages : sequence of StageView
        In order; at least one.
    charness : mapping of str to (frames, values)
        Curves by name of the actor.
    """
    recording = rr.RecordingStream(
        _APPLICATION,
        recording_id=_digest(clip, stages),
        # The start time is a property; without properties, equal solutions make equal recordings.
        send_properties=False,
    )
    with saved(recording, path, _blueprint()):
        _log_all(recording, clip, camera, stages, charness)


def _digest(clip: Clip, stages: Sequence[StageView]) -> str:
    state = hashlib.sha256(repr((clip.name, [(s.name, s.text) for s in stages])).encode())
    for stage in stages:
        for array in (pack_boxes(stage.objects), *stage.motions):
            state.update(np.ascontiguousarray(array).tobytes())
    return state.hexdigest()[:32]


def _log_all(
    recording: rr.RecordingStream,
    clip: Clip,
    camera: Camera,
    stages: Sequence[StageView],
    charness: Mapping[str, Curve],
) -> None:
    truth = clip.truth.objects if clip.truth is not None else ()
    everything = [*(o for s in stages for o in s.objects), *truth]
    categories = palette.category_ids(o.label for o in everything)
    log_static(recording, "/", palette.annotation_context(categories))
    log_static(recording, "world", rr.ViewCoordinates.RIGHT_HAND_Z_UP)
    log_static(recording, "world/camera", shapes.camera_pose(camera))
    log_static(recording, "world/camera/image", shapes.pinhole(camera))
    low, high = _extent(everything, stages)
    log_static(recording, "world/floor", shapes.floor_plane(low, high))
    log_static(recording, "world/floor/lines", shapes.floor_lines(low, high))
    if truth:
        log_static(recording, "world/truth/furniture", shapes.boxes(truth, {}, outlined=True))

    at = rr.TimeColumn("stage", sequence=np.arange(1, len(stages) + 1))
    log_moving(
        recording, "world/furniture", at,
        shapes.box_columns([s.objects for s in stages], categories),
        style=rr.Boxes3D.from_fields(
            radii=0.006,
            fill_mode=rr.components.FillMode.TransparentFillMajorWireframe,
            show_labels=False,
        ),
    )  # fmt: skip
    for k in range(len(stages[0].motions)):
        pieces = [shapes.paths(s.motions[k][:, PELV]) for s in stages]
        columns = rr.LineStrips3D.columns(strips=[p for row in pieces for p in row])
        log_moving(
            recording, f"world/path/actor_{k + 1}", at,
            columns.partition([len(row) for row in pieces]),
            style=rr.LineStrips3D.from_fields(
                class_ids=palette.ALTERNATIVE if k else palette.ESTIMATE,
                radii=PATH_RADIUS,
                show_labels=False,
            ),
        )  # fmt: skip
    texts = [palette.drawable(f"## {k}. {s.name}\n\n{s.text}") for k, s in enumerate(stages, 1)]
    documents = rr.TextDocument.columns(text=texts, media_type=["text/markdown"] * len(texts))
    recording.send_columns("summary", indexes=[at], columns=documents, strict=True)
    for k, (name, (frames, values)) in enumerate(charness.items()):
        entity = f"charness/{entity_part(k + 1, name)}"
        colour = palette.SCENE_COLOURS[k % len(palette.SCENE_COLOURS)]
        # A bar chart, because a curve would be visible only while `frame` is the timeline.
        log_static(recording, entity, _bars(frames, values, colour))


def _bars(frames: NDArray[np.int64], values: Array, colour: Colour) -> rr.BarChart:
    """One bar for each window, as wide as the distance between windows."""
    apart = np.diff(frames)
    widths = np.full(len(frames), apart.min() if len(apart) else 1, dtype=float)
    return rr.BarChart(values, abscissa=frames, widths=widths, color=colour)


def _extent(objects: Sequence[SceneObject], stages: Sequence[StageView]) -> tuple[Array, Array]:
    """Corners of the floor in whole metres that enclose all objects and motions."""
    on_floor = [np.zeros((1, 2)), *(o.footprint for o in objects)]
    on_floor += [m[:, PELV, :2] for s in stages for m in s.motions]
    points = np.concatenate(on_floor)
    return np.floor(points.min(0) - _AIR), np.ceil(points.max(0) + _AIR)


def _blueprint() -> rrb.Blueprint:
    room = rrb.Spatial3DView(
        origin="world",
        name="Room",
        background=BACKGROUND,
        line_grid=rrb.LineGrid3D(visible=False),
    )
    text = rrb.TextDocumentView(origin="summary", name="This stage")
    curve = rrb.BarChartView(origin="charness", name="Charness over frames")
    return rrb.Blueprint(
        rrb.Horizontal(room, rrb.Vertical(text, curve), column_shares=[3, 1]),
        rrb.TimePanel(timeline="stage", state="collapsed", play_state="paused"),
        rrb.TopPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
    )


# ------------------------------------------------------------------------------------------------
# Content of every stage.


def stage_views(solved: Solved) -> tuple[StageView, ...]:
    """Views of static path, candidates judged, candidates kept, best combination, and scenes.

    Parameters
    ----------
    solved : Solved

    Returns
    -------
    tuple of StageView
    """
    actors = solved.actors
    empty = [empty_state(a.problem) for a in actors]
    alone = _motions(actors, empty)
    judged = [[r.candidate for t in a.shortlists for r in t.rows] for a in actors]
    best_of_kind = [_best_of_kind(candidates) for candidates in judged]
    kept = [a.combinations.pool for a in actors]
    by = "published energy" if actors[0].problem.of_paper else "full log-posterior"
    together = [
        state_of(a.problem, [a.combinations.pool[k] for k in a.combinations.tried[0].members])
        for a in actors
    ]
    views = [
        StageView("Static path", _frames(solved), (), alone),
        StageView(
            "Candidates judged",
            f"{sum(map(len, judged))} fits at {sum(len(a.shortlists) for a in actors)} maxima of "
            f"charness, judged by the {by}. Shown is the best of each kind of furniture.",
            _furniture(actors, best_of_kind),
            alone,
        ),
        StageView(
            "Candidates kept",
            f"{sum(map(len, kept))} fits, at most three a maximum, each with other furniture.",
            _furniture(actors, kept),
            alone,
        ),
        StageView(
            "Best combination",
            _combinations(actors),
            tuple(
                o
                for a, s in zip(actors, together, strict=True)
                for _, o in placed_objects(s, a.library)
            ),
            _motions(actors, together),
        ),
    ]
    views += [_exchanged(actors, together)] if any(a.combinations.exchanges for a in actors) else []
    for number, scene in enumerate(solved.scenes, 1):
        name = "Best scene, refined" if number == 1 else f"Diverse scene {number}"
        text = f"Log-posterior {scene.log_posterior:.1f} nat. " + ", ".join(
            o.label for o in scene.objects
        )
        views.append(StageView(name, text, scene.objects, scene.motions))
    return tuple(views)


def _exchanged(actors: Sequence[Solution], together: Sequence[State]) -> StageView:
    """View of each actor's best combination after its exchanges."""
    after = [
        a.combinations.exchanges[-1].state if a.combinations.exchanges else state
        for a, state in zip(actors, together, strict=True)
    ]
    rows = [
        f"- **{a.clip.tracks[0].name}**: {len(a.combinations.exchanges)} stays exchanged for "
        f"others, {sum(e.gain for e in a.combinations.exchanges):.1f} nat gained"
        for a in actors
    ]
    furniture = tuple(
        o for a, s in zip(actors, after, strict=True) for _, o in placed_objects(s, a.library)
    )
    return StageView("Exchanges", "\n".join(rows), furniture, _motions(actors, after))


def charness_curves(solved: Solved) -> dict[str, Curve]:
    """Charness over the clip's frames, by name of the actor.

    Parameters
    ----------
    solved : Solved

    Returns
    -------
    dict of str to curve
    """
    ids = solved.clip.frame_ids
    return {a.clip.tracks[0].name: (ids[a.curve.centres], a.curve.values) for a in solved.actors}


def _motions(actors: Sequence[Solution], states: Sequence[State]) -> tuple[Array, ...]:
    return tuple(
        limbs_of(a.problem, s, state_camera(a.clip.camera, s)).joints
        for a, s in zip(actors, states, strict=True)
    )


def _best_of_kind(candidates: Sequence[Candidate]) -> list[Candidate]:
    best: dict[tuple[int, tuple[int, ...]], Candidate] = {}
    for c in candidates:
        key = (c.window, c.kind)
        if key not in best or c.gain > best[key].gain:
            best[key] = c
    return list(best.values())


def _furniture(
    actors: Sequence[Solution], candidates: Sequence[Sequence[Candidate]]
) -> tuple[SceneObject, ...]:
    return tuple(
        o
        for actor, own in zip(actors, candidates, strict=True)
        for c in own
        for _, o in placed_objects(state_of(actor.problem, [c]), actor.library)
    )


def _frames(solved: Solved) -> str:
    rows = []
    for actor in solved.actors:
        counts = ", ".join(f"{n} {what}" for what, n in actor.frames.counts().items() if n)
        rows.append(f"- **{actor.clip.tracks[0].name}**, frames: {counts}")
    return "\n".join(rows)


def _combinations(actors: Sequence[Solution]) -> str:
    rows = []
    for actor in actors:
        found = actor.combinations
        extent = "all there are" if found.complete else "the best by score, the others pruned"
        rows.append(
            f"- **{actor.clip.tracks[0].name}**: {len(found.tried)} tried ({extent}); the best "
            f"gains {found.tried[0].gain:.1f} nat"
        )
    return "\n".join(rows)
