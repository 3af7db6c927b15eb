"""Layout of a recording in the viewer, and its text panels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import rerun.blueprint as rrb
from numpy.typing import NDArray

from imapper_prob.models.camera import Camera
from imapper_prob.models.scene import Clip, Scene, Truth
from imapper_prob.models.skeleton import PELV
from imapper_prob.models.text import counted, in_markdown, with_error
from imapper_prob.recording.palette import BACKGROUND
from imapper_prob.recording.posterior import HIDDEN, Certainty, chain_entity, trace_entity
from imapper_prob.recording.shapes import own_entity
from imapper_prob.uncertainty.clusters import cells_of_object, names_of
from imapper_prob.uncertainty.parameters import cells_of_parameter
from imapper_prob.uncertainty.scenes import WeightedScene

__all__ = [
    "caption",
    "certainty_text",
    "make_blueprint",
    "moves_text",
    "scene_name",
]

_LEGEND = """\
**Boxes** are furniture, in a colour for each category. **Ellipses** on the floor hold 50 and
90 % of an object's position. The **yellow person** moves as in the most probable scene; **thin
doubles** are other draws of the same motion, blue people those of other scenes. **Grey
outlines** are the truth, where it is known.

The **coloured floor** is a map: the stronger the colour, the more probable that such an object
stands there, over all draws.

In the image, **dots** are detections, from red (unsure) to green (sure); the yellow skeleton is
the person projected back. **Squares** say that a joint is probably hidden, in the colour of what
hides it; in the room such joints are large.

Play `frame` to see the motion. Choose the timeline `scene` for one scene after the other, and
`draw` for what the chains did.
"""
_CERTAINTY_LEGEND = f"""\
An object is *there* in that share of all draws; its label is what it is called if it is there;
± are standard deviations, of *there* the Monte-Carlo error. *Hides* counts the joints, over all
frames, that it hides with a probability of at least {HIDDEN:.1f}.

Camera and body are first fitted to the feet alone, then drawn given everything that is seen.
*Variance less by* is how much less the variance is then: 0 % if only the feet tell of the number,
100 % if the rest tells everything; below 0 it is wider.
"""
_DOTS = 25
"""Number of dots in a full bar."""


def scene_name(number: int, weighted: WeightedScene) -> str:
    """Title of a scene: its number, and its probability with the Monte-Carlo error.

    Parameters
    ----------
    number : int
        From 1.
    weighted : WeightedScene

    Returns
    -------
    str
    """
    return f"Scene {number}: p = {with_error(weighted.probability, weighted.error)}"


def caption(description: str, scenes: Sequence[WeightedScene]) -> str:
    """The text panel in Markdown: a description, the scenes in a table, and a legend.

    Parameters
    ----------
    description : str
    scenes : sequence of WeightedScene

    Returns
    -------
    str
    """
    rows = [
        f"| {i} | {with_error(s.probability, s.error)} | "
        f"{in_markdown(counted(s.names))} | {in_markdown(s.difference)} |"
        for i, s in enumerate(scenes, 1)
    ]
    header = "| scene | probability | furniture | unlike the first |"
    table = [header, "|---|---|---|---|", *rows]
    return "\n\n".join([description.strip(), "\n".join(table), _LEGEND])


def certainty_text(certainty: Certainty) -> str:
    """Text on the uncertainty of objects and parameters (tables) and of people (a sentence).

    Parameters
    ----------
    certainty : Certainty

    Returns
    -------
    str
        Markdown.
    """
    hidden = certainty.hidden
    clusters = certainty.clusters
    objects = [
        "| object | label | there | right [m] | away [m] | facing | hides |",
        "|---|---|---|---|---|---|---|",
        *(
            _row(name, *cells_of_object(c), f"{(hidden.by_object[k] >= HIDDEN).sum()}")
            for k, (name, c) in enumerate(zip(names_of(clusters), clusters, strict=True))
        ),
    ]
    parameters = [
        "| parameter | from the feet alone | from everything | variance less by |",
        "|---|---|---|---|",
        *(_row(*cells_of_parameter(n)) for n in certainty.nuisances.values()),
    ]
    spread = 100 * certainty.joints.standard_deviation[:, PELV].mean(0)
    person = (
        f"The pelvis is known to {spread[0]:.0f} cm across the view, {spread[1]:.0f} cm in depth "
        f"and {spread[2]:.0f} cm in height (standard deviation, mean over frames)."
    )
    return "\n\n".join(["\n".join(objects), person, "\n".join(parameters), _CERTAINTY_LEGEND])


def moves_text(acceptance: Mapping[str, float]) -> str:
    """Table of the acceptance rate of each move, highest first, with a bar; empty without rates.

    Parameters
    ----------
    acceptance : mapping of str to float
        Acceptance rate by move.

    Returns
    -------
    str
        Markdown.
    """
    if not acceptance:
        return ""
    ranked = sorted(acceptance.items(), key=lambda item: (-item[1], item[0]))
    rows = [f"| {name} | {100 * rate:.1f} % | {_bar(rate)} |" for name, rate in ranked]
    return "\n".join(["| move | accepted | |", "|---|---|---|", *rows])


def _row(*cells: str) -> str:
    return f"| {' | '.join(map(in_markdown, cells))} |"


def _bar(share: float) -> str:
    return "•" * round(_DOTS * share)


# ------------------------------------------------------------------------------------------------
# Layout: one large view of the most probable scene, with the other views around it.

Array = NDArray[np.float64]
_FROM = np.array([0.75, -0.60, 0.50])
"""Direction of the eye from the middle of the room: to the right of the camera's line of sight and
above it, so that camera, person and furniture are side by side from left to right."""
_ABOVE = np.array([0.0, 0.0, 1.0])
_MAIN_SHAPE, _ROW_SHAPE, _MAP_SHAPE = 2.0, 1.6, 0.95
"""Aspect ratios (width over height) of the large view, of all views of other scenes together, and
of the map of the floor, in a window of 1600 x 1000."""
_HALF_VIEW = np.tan(np.radians(55.0) / 2)
"""Tangent of half the viewer's vertical field of view."""
_MARGIN = 1.05
"""Factor on the distance of the eye that leaves a margin around what is shown."""
_PERSON = 1.7
"""Height in metres that is kept visible above a person's path."""
_AIR = 0.03
"""Margin around the image, in units of its height."""
_BESIDE = 3
"""Most other scenes shown side by side; with more, views are too narrow to read."""


def make_blueprint(
    scenes: Sequence[WeightedScene],
    *,
    traces: Sequence[str],
    truth: Truth | None,
    clip: Clip,
    image: Camera,
    certainty: Certainty | None = None,
    chains: int = 0,
    moves: bool = False,
) -> rrb.Blueprint:
    """Make views for the entities that :func:`~imapper_prob.recording.log.write_recording` logs.

    Parameters
    ----------
    scenes : sequence of WeightedScene
        Most probable first.
    traces : sequence of str
        Names of the traces, one plot for each.
    truth : Truth, optional
        Shown in the main view if given.
    clip : Clip
        Gives the frame rate and the people.
    image : Camera
        Camera of the recorded image.
    certainty : Certainty, optional
        Shown as a map, a text and curves if given.
    chains : int
        Number of chains with draws to show.
    moves : bool
        Whether there is a table of acceptance rates.

    Returns
    -------
    rerun.blueprint.Blueprint
    """
    truly = ["world/truth/**"] if truth is not None else []
    best = scenes[0].scene
    room = [_corners(best), best.camera.centre[None]]
    eye = _eye(np.concatenate(room), _FROM, _MAIN_SHAPE)
    shown = ["world/floor/**", "world/occupancy", "world/camera/**", "world/scene_1/**", *truly]
    main = _room(scene_name(1, scenes[0]), shown, eye)
    picture = rrb.Spatial2DView(
        origin="world/camera/image",
        contents=["$origin/**", "world/scene_1/furniture"],
        name="Image: detections and reprojection",
        background=BACKGROUND,
        visual_bounds=_whole(image),
    )
    below: list[rrb.Container | rrb.View] = [
        *_from_above(scenes, certainty, truth, clip),
        *_alternatives(scenes, chains),
    ]
    left: list[rrb.Container | rrb.View] = [main]
    if below:
        left.append(rrb.Horizontal(*below, column_shares=[3, 5][-len(below) :]))
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(*left, row_shares=[5, 4][: len(left)]),
            rrb.Vertical(
                picture,
                _texts(certainty),
                _plots(traces, sure=certainty is not None, moves=moves),
                row_shares=[7, 7, 6],
            ),
            column_shares=[5, 3],
        ),
        rrb.TimePanel(timeline="frame", fps=clip.fps, state="collapsed", play_state="paused"),
        rrb.TopPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
    )


def _whole(image: Camera) -> rrb.VisualBounds2D:
    """The whole image with a small margin."""
    air = _AIR * image.height
    return rrb.VisualBounds2D(x_range=(-air, image.width + air), y_range=(-air, image.height + air))


def _texts(certainty: Certainty | None) -> rrb.Container | rrb.View:
    what = rrb.TextDocumentView(origin="description", name="What you see")
    if certainty is None:
        return what
    how_sure = rrb.TextDocumentView(origin="certainty", name="How sure it is")
    return rrb.Tabs(what, how_sure, active_tab=0)


def _from_above(
    scenes: Sequence[WeightedScene], certainty: Certainty | None, truth: Truth | None, clip: Clip
) -> list[rrb.View]:
    """A view of the floor with all draws at once; none if there is no summary of the draws."""
    if certainty is None:
        return []
    shown = ["world/floor/**", "world/occupancy", "world/all_draws/**"]
    shown += [f"{own_entity(clip, 'world/scene_1', k)}/path" for k in range(len(clip.tracks))]
    truly = ["world/truth/outlines"] if truth is not None else []
    regions = [c.region(0.9) for c in certainty.clusters]
    ends = [r.centre + sign * r.half_axes.max() for r in regions for sign in (-1, 1)]
    edges = _at_height(np.reshape(ends, (-1, 2)), 0.0)
    eye = _eye(np.concatenate([_corners(scenes[0].scene), edges]), _ABOVE, _MAP_SHAPE)
    return [_room("All draws, from above", [*shown, *truly], eye)]


def _alternatives(scenes: Sequence[WeightedScene], chains: int) -> list[rrb.Container]:
    """Other scenes side by side and then one by one in tabs, and the draws of the chains."""
    # All scenes have the same eye, so that they can be compared.
    beside = scenes[1 : 1 + _BESIDE]
    everything = np.concatenate([_corners(s.scene) for s in scenes])
    eye = _eye(everything, _FROM, _ROW_SHAPE / max(len(beside), chains, 1))
    tabs: list[rrb.Container] = []
    if beside:
        side_by_side = [
            _room(
                f"{i}: {with_error(s.probability, s.error)}",
                ["world/floor/**", f"world/scene_{i}/**"],
                eye,
            )
            for i, s in enumerate(beside, 2)
        ]
        one_by_one = rrb.Horizontal(
            _room("Room", ["world/floor/**", "world/by_scene/**"], eye),
            rrb.TextDocumentView(origin="summary", name="This scene"),
            column_shares=[2, 1],
            name="One by one (timeline scene)",
        )
        tabs += [rrb.Horizontal(*side_by_side, name="Other scenes"), one_by_one]
    if chains:
        each = [
            _room(f"{k}", ["world/floor/**", f"{chain_entity(k)}/**"], eye)
            for k in range(1, chains + 1)
        ]
        tabs.append(rrb.Horizontal(*each, name="Draws by chain (timeline draw)"))
    return [rrb.Tabs(*tabs, active_tab=0)] if tabs else []


def _plots(traces: Sequence[str], *, sure: bool, moves: bool) -> rrb.Container:
    tabs: list[rrb.Container | rrb.View] = [
        rrb.Horizontal(
            _plot("fit/distance", "Distance to the camera (m)", legend=True),
            _plot("fit/miss", "Reprojection miss (px)"),
            name="Fit over frames",
        )
    ]
    if sure:
        how_sure = rrb.Horizontal(
            _plot("sure/hidden", "Joints hidden, by object"),
            _plot("sure/pelvis", "Pelvis known to (cm)", legend=True),
            name="How sure",
        )
        tabs.append(how_sure)
    if traces:
        chains = [_plot(trace_entity(t), t.capitalize()) for t in traces]
        tabs.append(rrb.Horizontal(*chains, name="Chains (timeline draw)"))
    if moves:
        tabs.append(rrb.TextDocumentView(origin="moves", name="Moves"))
    return rrb.Tabs(*tabs, active_tab=1 if sure else 0)


def _plot(origin: str, name: str, *, legend: bool = False) -> rrb.TimeSeriesView:
    corner = rrb.PlotLegend(corner=rrb.Corner2D.RightTop, visible=legend)
    return rrb.TimeSeriesView(origin=origin, name=name, plot_legend=corner)


def _room(name: str, contents: Sequence[str], eye: rrb.EyeControls3D) -> rrb.Spatial3DView:
    return rrb.Spatial3DView(
        origin="world",
        contents=["world", *contents],
        name=name,
        background=BACKGROUND,
        line_grid=rrb.LineGrid3D(visible=False),
        eye_controls=eye,
    )


def _corners(scene: Scene) -> Array:
    """(n, 3) points that span the furniture and the motion of a scene."""
    pelvis = scene.joints[:, PELV, :2]
    footprints = [(o.footprint, float(o.bounds[1, 2])) for o in scene.objects]
    footprints.append((pelvis[np.isfinite(pelvis).all(1)], _PERSON))
    found = np.concatenate([_at_height(floor, z) for floor, top in footprints for z in (0.0, top)])
    return found if len(found) else scene.camera.centre[None]


def _at_height(floor: Array, height: float) -> Array:
    """(n, 3) points at a height above points (n, 2) on the floor."""
    return np.column_stack([floor, np.full(len(floor), height)])


def _eye(points: Array, direction: Array, shape: float) -> rrb.EyeControls3D:
    """The nearest eye in a direction that sees all points (n, 3) in a view of given aspect
    ratio."""
    away = direction / np.linalg.norm(direction)
    up = np.array([0.0, 1.0, 0.0]) if away[2] == 1 else np.array([0.0, 0.0, 1.0])
    right = np.cross(up, away) / np.linalg.norm(np.cross(up, away))
    top = np.cross(away, right)
    axes = np.stack([right, top, away])
    local = points @ axes.T
    middle = (local.min(0) + local.max(0)) / 2
    across, upwards, nearer = (local - middle).T
    sight = np.maximum(np.abs(across) / shape, np.abs(upwards)) / _HALF_VIEW + nearer
    target = middle @ axes
    return rrb.EyeControls3D(
        kind=rrb.Eye3DKind.Orbital,
        position=target + max(_MARGIN * float(sight.max()), 1.0) * away,
        look_target=target,
        eye_up=up,
    )
