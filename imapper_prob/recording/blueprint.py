"""How the viewer lays a recording out: one large view of the best layout, the rest around it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import rerun.blueprint as rrb
from numpy.typing import NDArray

from imapper_prob.models.scene import Scene, Truth
from imapper_prob.models.skeleton import PELV
from imapper_prob.recording.caption import layout_name
from imapper_prob.recording.curves import trace_entity
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
_SIDE_BY_SIDE = 2.4
"""Number of views beside each other up to which the height limits what one sees, not the width."""
_LOOK_AT_HEIGHT = 0.6
_MARGIN = 0.3
"""Metres: the height of a seated person's middle, and some air around."""


def make_blueprint(
    scenes: Sequence[WeightedScene],
    *,
    traces: Sequence[str],
    truth: Truth | None,
    fps: float,
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
    """
    eye = _eye([scenes[0].scene], stand_off=_NEAR, with_camera=True)
    shown = ["world/floor/**", "world/camera/**", "world/layout_1/**"]
    if truth is not None:
        shown.append("world/truth/**")
    best = _room(layout_name(1, scenes[0]), shown, eye)
    image = rrb.Spatial2DView(
        origin="world/camera/image",
        contents=["$origin/**", "world/layout_1/furniture"],
        name="Image: detections and reprojection",
        background=_BACKGROUND,
    )
    text = rrb.TextDocumentView(origin="description", name="What you see")
    left = [best, _other_layouts(scenes)] if len(scenes) > 1 else [best]
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(*left, row_shares=[5, 3][: len(left)]),
            rrb.Vertical(image, text, _plots(traces), row_shares=[3, 4, 3]),
            column_shares=[5, 3],
        ),
        rrb.TimePanel(timeline="frame", fps=fps, state="collapsed", play_state="paused"),
        rrb.TopPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
    )


def _other_layouts(scenes: Sequence[WeightedScene]) -> rrb.Container:
    # One eye for all layouts, so that they can be compared at a glance; further away the more
    # there are, for the field of view is fixed vertically and the views grow narrow.
    narrow = max(1.0, (len(scenes) - 1) / _SIDE_BY_SIDE)
    eye = _eye([s.scene for s in scenes], stand_off=_FAR * narrow)
    side_by_side = [
        _room(
            f"{i}: {s.probability:.2f} ± {s.error:.2f}",
            ["world/floor/**", f"world/layout_{i}/**"],
            eye,
        )
        for i, s in enumerate(scenes[1:], 2)
    ]
    return rrb.Tabs(
        rrb.Horizontal(*side_by_side, name="Other layouts and their probability"),
        rrb.Horizontal(
            _room("Room", ["world/floor/**", "world/by_layout/**"], eye),
            rrb.TextDocumentView(origin="summary", name="This layout"),
            column_shares=[3, 1],
            name="One by one (timeline layout)",
        ),
        active_tab=0,
    )


def _plots(traces: Sequence[str]) -> rrb.Container:
    fit = rrb.Horizontal(
        rrb.TimeSeriesView(
            origin="fit/distance",
            name="Distance to the camera (m)",
            plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.RightBottom),
        ),
        rrb.TimeSeriesView(
            origin="fit/miss",
            name="Reprojection miss (px)",
            plot_legend=rrb.PlotLegend(visible=False),
        ),
        name="Fit over frames",
    )
    chains = [rrb.TimeSeriesView(origin=trace_entity(t), name=t.capitalize()) for t in traces]
    tabs = [fit, rrb.Grid(*chains, name="Chains (timeline draw)")] if chains else [fit]
    return rrb.Tabs(*tabs, active_tab=0)


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
