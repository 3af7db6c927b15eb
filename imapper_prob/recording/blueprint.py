"""How the viewer lays a recording out: one large view of the best layout, the rest around it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import rerun.blueprint as rrb
from numpy.typing import NDArray

from imapper_prob.models.camera import Camera
from imapper_prob.models.scene import Scene, Truth
from imapper_prob.models.skeleton import PELV
from imapper_prob.recording.caption import layout_name
from imapper_prob.recording.certainty import Certainty
from imapper_prob.recording.curves import trace_entity
from imapper_prob.recording.draws import chain_entity
from imapper_prob.results.scenes import WeightedScene

__all__ = ["make_blueprint"]

Array = NDArray[np.float64]

_BACKGROUND = (18, 20, 25)
_FROM = np.array([0.75, -0.60, 0.50])
"""Where the eye is as seen from the middle of the room: to the right of the camera's line of
sight and above it, so that camera, person and furniture stand side by side, left to right."""
_NEAR, _FAR = 1.2, 1.4
"""Distance of the eye in units of the radius of what it looks at. With the camera the scene is
long, which suits the wide main view, so that the eye may come nearer."""
_SIDE_BY_SIDE = 2.0
"""Number of views beside each other up to which the height limits what one sees, not the width."""
_ABOVE, _ABOVE_SHAPE = 2.0, 0.9
"""Height of the eye above the floor in units of half the depth it looks at; width of that view
in units of its height."""
_AIR = 0.03
"""Around the image, in units of its height."""
_BESIDE = 3
"""Other layouts that are shown side by side: more would be too narrow to read."""
_LOOK_AT_HEIGHT = 0.6
_MARGIN = 0.3
"""Metres: the height of a seated person's middle, and some air around."""


def make_blueprint(
    scenes: Sequence[WeightedScene],
    *,
    traces: Sequence[str],
    truth: Truth | None,
    fps: float,
    image: Camera,
    certainty: Certainty | None = None,
    chains: int = 0,
    moves: bool = False,
) -> rrb.Blueprint:
    """Views for the entities that :func:`~imapper_prob.recording.log.write_recording` logs.

    Parameters
    ----------
    scenes : sequence of WeightedScene
        Most probable first.
    traces : sequence of str
        Names of the traces, one plot each.
    truth : Truth, optional
        Shown in the main view if there is one.
    fps : float
        Frames a second at which the motion plays.
    image : Camera
        Of the recorded image.
    certainty : Certainty, optional
        Shown as a map, a text and curves if there is one.
    chains : int
        How many chains have draws to show.
    moves : bool
        Whether there is a table of accepted moves.
    """
    truly = ["world/truth/**"] if truth is not None else []
    eye = _eye([scenes[0].scene], stand_off=_NEAR, with_camera=True)
    shown = ["world/floor/**", "world/occupancy", "world/camera/**", "world/layout_1/**", *truly]
    main = _room(layout_name(1, scenes[0]), shown, eye)
    picture = rrb.Spatial2DView(
        origin="world/camera/image",
        contents=["$origin/**", "world/layout_1/furniture"],
        name="Image: detections and reprojection",
        background=_BACKGROUND,
        visual_bounds=_whole(image),
    )
    below = [*_from_above(scenes, certainty, truly), *_alternatives(scenes, chains)]
    left = [main, rrb.Horizontal(*below, column_shares=[3, 5][-len(below) :])] if below else [main]
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(*left, row_shares=[5, 4][: len(left)]),
            rrb.Vertical(
                picture,
                _texts(certainty),
                _plots(traces, sure=certainty is not None, moves=moves),
                row_shares=[3, 4, 3],
            ),
            column_shares=[5, 3],
        ),
        rrb.TimePanel(timeline="frame", fps=fps, state="collapsed", play_state="paused"),
        rrb.TopPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
    )


def _whole(image: Camera) -> rrb.VisualBounds2D:
    """The image from edge to edge, and a little air around it."""
    air = _AIR * image.height
    return rrb.VisualBounds2D(x_range=(-air, image.width + air), y_range=(-air, image.height + air))


def _texts(certainty: Certainty | None) -> rrb.Container | rrb.View:
    what = rrb.TextDocumentView(origin="description", name="What you see")
    if certainty is None:
        return what
    how_sure = rrb.TextDocumentView(origin="certainty", name="How sure it is")
    return rrb.Tabs(what, how_sure, active_tab=0)


def _from_above(
    scenes: Sequence[WeightedScene], certainty: Certainty | None, truly: list[str]
) -> list[rrb.View]:
    """The floor with all draws at once; nothing if nothing is known of them."""
    if certainty is None:
        return []
    shown = ["world/floor/**", "world/occupancy", "world/all_draws/**", "world/layout_1/path"]
    eye = _eye_above(scenes[0].scene, certainty)
    return [_room("All draws, from above", [*shown, *(f"{t[:-3]}/furniture" for t in truly)], eye)]


def _alternatives(scenes: Sequence[WeightedScene], chains: int) -> list[rrb.Container]:
    """Other layouts side by side, then in other tabs one by one, and the draws of the chains."""
    # One eye for all layouts, so that they can be compared at a glance; further away the more
    # there are, for the field of view is fixed vertically and the views grow narrow.
    beside = scenes[1 : 1 + _BESIDE]
    narrow = max(1.0, max(len(beside), chains) / _SIDE_BY_SIDE)
    eye = _eye([s.scene for s in scenes], stand_off=_FAR * narrow)
    tabs: list[rrb.Container] = []
    if beside:
        side_by_side = [
            _room(
                f"{i}: {s.probability:.2f} ± {s.error:.2f}",
                ["world/floor/**", f"world/layout_{i}/**"],
                eye,
            )
            for i, s in enumerate(beside, 2)
        ]
        one_by_one = rrb.Horizontal(
            _room("Room", ["world/floor/**", "world/by_layout/**"], eye),
            rrb.TextDocumentView(origin="summary", name="This layout"),
            column_shares=[3, 1],
            name="One by one (timeline layout)",
        )
        tabs += [rrb.Horizontal(*side_by_side, name="Other layouts"), one_by_one]
    if chains:
        each = [
            _room(f"Chain {k}", ["world/floor/**", f"{chain_entity(k)}/**"], eye)
            for k in range(1, chains + 1)
        ]
        tabs.append(rrb.Horizontal(*each, name="Draws (timeline draw)"))
    return [rrb.Tabs(*tabs, active_tab=0)] if tabs else []


def _plots(traces: Sequence[str], *, sure: bool, moves: bool) -> rrb.Container:
    tabs = [
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
    chains: list[rrb.View] = [_plot(trace_entity(t), t.capitalize()) for t in traces]
    if moves:
        chains.append(rrb.TextDocumentView(origin="moves", name="Moves accepted"))
    if chains:
        tabs.append(rrb.Horizontal(*chains, name="Chains (timeline draw)"))
    return rrb.Tabs(*tabs, active_tab=1 if sure else 0)


def _plot(origin: str, name: str, *, legend: bool = False) -> rrb.TimeSeriesView:
    corner = rrb.PlotLegend(corner=rrb.Corner2D.RightTop, visible=legend)
    return rrb.TimeSeriesView(origin=origin, name=name, plot_legend=corner)


def _room(name: str, contents: Sequence[str], eye: rrb.EyeControls3D) -> rrb.Spatial3DView:
    return rrb.Spatial3DView(
        origin="world",
        contents=["world", *contents],
        name=name,
        background=_BACKGROUND,
        line_grid=rrb.LineGrid3D(visible=False),
        eye_controls=eye,
    )


def _eye(
    scenes: Sequence[Scene], *, stand_off: float, with_camera: bool = False
) -> rrb.EyeControls3D:
    """An eye that has the furniture and the motion of these layouts in sight."""
    seen = [scenes[0].camera.centre[None, :2]] if with_camera else []
    for scene in scenes:
        pelvis = scene.joints[:, PELV, :2]
        seen += [pelvis[np.isfinite(pelvis).all(1)], *(o.footprint for o in scene.objects)]
    points = np.concatenate(seen) if sum(map(len, seen)) else scenes[0].camera.centre[None, :2]
    low, high = points.min(0), points.max(0)
    target = np.array([*((low + high) / 2), _LOOK_AT_HEIGHT])
    radius = float(np.linalg.norm(high - low)) / 2 + _MARGIN
    return rrb.EyeControls3D(
        kind=rrb.Eye3DKind.Orbital,
        position=target + stand_off * radius * _FROM / np.linalg.norm(_FROM),
        look_target=target,
        eye_up=(0.0, 0.0, 1.0),
    )


def _eye_above(best: Scene, certainty: Certainty) -> rrb.EyeControls3D:
    """An eye straight above all that probably stands somewhere, depth upwards on the screen."""
    regions = [c.region(0.9) for c in certainty.clusters]
    points = [r.centre + s * r.half_axes.max() for r in regions for s in (-1, 1)]
    points += [corner for o in best.objects for corner in o.footprint]
    pelvis = best.joints[:, PELV, :2]
    points += list(pelvis[np.isfinite(pelvis).all(1)])
    seen = np.array(points) if points else best.camera.centre[None, :2]
    low, high = seen.min(0), seen.max(0)
    middle, size = (low + high) / 2, (high - low) / 2 + _MARGIN
    height = _ABOVE * float(max(size[0] / _ABOVE_SHAPE, size[1]))
    return rrb.EyeControls3D(
        kind=rrb.Eye3DKind.Orbital,
        position=(*middle, height),
        look_target=(*middle, 0.0),
        eye_up=(0.0, 1.0, 0.0),
    )
