"""Interactive plots of the report, drawn by plotly in the browser.

Each function returns a figure whose traces have metadata ``meta``: ``scene`` with its index from 0,
or ``moves`` for elements that the slider moves. Legends are HTML beside the plots, where they wrap
on narrow screens. In views from above the camera is at the bottom; units are metres.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any, Final

import numpy as np
import plotly.graph_objects as go
from numpy.typing import ArrayLike, NDArray

from imapper_prob.models.camera import Camera, floor_edges
from imapper_prob.models.drawing import INK, LINES, QUIET
from imapper_prob.models.scene import Clip, SceneObject
from imapper_prob.models.skeleton import JOINTS, PELV
from imapper_prob.models.text import as_probability, with_error
from imapper_prob.people import by_person
from imapper_prob.plotting import category_colour
from imapper_prob.uncertainty.clusters import LEAST_NAMED, ObjectCluster, cells_of_object, names_of
from imapper_prob.uncertainty.hidden import HiddenJoints
from imapper_prob.uncertainty.occupancy import Occupancy
from imapper_prob.uncertainty.scenes import WeightedScene

__all__ = [
    "CHAIN_COLOURS",
    "HIDDEN_COLOURS",
    "JOINT_WORDS",
    "SEEN_COLOUR",
    "SIGHT_COLOUR",
    "Floor",
    "chains_plot",
    "floor_plot",
    "hiding_plot",
    "hue",
    "line_of_object",
    "map_plot",
    "person_colour",
    "view_plot",
]

Array = NDArray[np.float64]
CHAIN_COLOURS: Final = ("#4e79a7", "#f28e2b", "#59a14f", "#b07aa1", "#e15759", "#76b7b2")
"""Colours of chains, in order."""
HIDDEN_COLOURS: Final = ("#ffffff", "#d62728")
"""Colours of joints that are certainly visible, and certainly hidden."""
SEEN_COLOUR: Final = "#7d848f"
"""Colour of detected joints."""
SIGHT_COLOUR: Final = "#b4bac4"
"""Colour of the limits of the camera's field of view."""
JOINT_WORDS: Final = (
    "right ankle", "right knee", "right hip", "left hip", "left knee", "left ankle", "pelvis",
    "chest", "neck", "head", "right wrist", "right elbow", "right shoulder", "left shoulder",
    "left elbow", "left wrist",
)  # fmt: skip
"""Names of joints, in the order of the skeleton."""
_FROM_HEAD: Final = tuple(
    JOINTS.index(name)
    for name in (
        "HEAD", "NECK", "THRX", "LSHO", "RSHO", "LELB", "RELB", "LWRI", "RWRI", "PELV",
        "LHIP", "RHIP", "LKNE", "RKNE", "LANK", "RANK",
    )
)  # fmt: skip
"""Joints from top to bottom."""
_PEOPLE: Final = (INK, "#4e79a7", "#e15759", "#59a14f", "#b07aa1")
_DASHES: Final = ("solid", "dash", "dot", "dashdot")
"""Line styles of objects of one category, in order."""
_MARGIN: Final = 0.4
"""Margin in metres around the drawn area."""
_NINETY: Final = 4.605
"""The .9 quantile of chi-square with two degrees of freedom."""
_ROUND: Final = np.linspace(0, 2 * np.pi, 49)
_CELLS: Final = 20_000
"""Largest number of map cells; larger rooms get larger cells."""
_FREE: Final = 0.005
"""Probability below which the map shows no text for a cell."""
_POINTS: Final = 150
"""Largest number of draws of an object on the map."""
_TRACE: Final = 500
"""Largest number of points of a chain's trace, more than a screen shows."""
_NEAREST: Final = 0.1
"""Distance from the camera in metres from which edges are drawn."""
_TALLEST: Final = 1.25
"""Largest ratio of height to width of a plot."""
_FONT: Final = "system-ui, 'Segoe UI', 'DejaVu Sans', sans-serif"


@dataclass(frozen=True)
class Floor:
    """The part of the floor that all views from above show, so that they are comparable.

    Parameters
    ----------
    low, high : (2,) float
        Corners, metres.
    """

    low: Array
    high: Array

    @classmethod
    def of(cls, clip: Clip, scenes: Sequence[WeightedScene]) -> Floor:
        """The part that contains all furniture and all paths, but not the camera.

        Parameters
        ----------
        clip : Clip
        scenes : sequence of WeightedScene

        Returns
        -------
        Floor
        """
        rooms = [w.scene.objects for w in scenes]
        rooms += [clip.truth.objects] if clip.truth is not None else []
        points = [o.footprint for objects in rooms for o in objects]
        points += [w.scene.joints[:, PELV, :2] for w in scenes]
        everything = np.concatenate(points)
        everything = everything[np.isfinite(everything).all(1)]
        return cls(everything.min(0) - _MARGIN, everything.max(0) + _MARGIN)

    @property
    def proportion(self) -> float:
        """Width divided by height, limited so that a plot is at most a little higher than wide."""
        across, away = self.high - self.low
        return max(float(across / away), 1 / _TALLEST)


def hue(label: str) -> str:
    """The colour of a category in CSS.

    Parameters
    ----------
    label : str

    Returns
    -------
    str
    """
    return "#{:02x}{:02x}{:02x}".format(*category_colour(label))


def person_colour(number: int) -> str:
    """The colour of a person in CSS.

    Parameters
    ----------
    number : int
        Index of the track.

    Returns
    -------
    str
    """
    return _PEOPLE[number % len(_PEOPLE)]


def line_of_object(clusters: Sequence[ObjectCluster], number: int) -> tuple[str, str]:
    """Colour and line style of an object among several.

    Parameters
    ----------
    clusters : sequence of ObjectCluster
    number : int

    Returns
    -------
    colour, dashes : str
    """
    label = clusters[number].label
    before = sum(cluster.label == label for cluster in clusters[:number])
    return hue(label), _DASHES[before % len(_DASHES)]


def floor_plot(floor: Floor, clip: Clip, scenes: Sequence[WeightedScene]) -> go.Figure:
    """All scenes from above, one of them visible, with all people at the slider's frame.

    Parameters
    ----------
    floor : Floor
    clip : Clip
    scenes : sequence of WeightedScene

    Returns
    -------
    plotly.graph_objects.Figure
    """
    figure = _floor(floor)
    if clip.truth is not None and clip.truth.objects:
        _line(figure, _closed(o.footprint for o in clip.truth.objects), QUIET, dash="dash")
    for number, weighted in enumerate(scenes):
        own: dict[str, Any] = {"meta": {"scene": number}, "visible": number == 0}
        _sight(figure, weighted.scene.camera, floor, **own)
        for ghost in weighted.ghosts:
            ways = [joints[:, PELV, :2] for joints in by_person(clip, ghost)]
            _line(figure, _apart(ways), QUIET, width=0.6, **own)
        for o, covariance in zip(weighted.objects, weighted.covariances, strict=True):
            _object(figure, o, covariance, **own)
        for person, joints in enumerate(by_person(clip, weighted.scene.joints)):
            _line(
                figure, joints[:, PELV, :2], person_colour(person), width=1.8,
                customdata=clip.frame_ids, hoverinfo=None, hovertemplate="pelvis in frame "
                "%{customdata}<br>x %{x:.2f} m<br>y %{y:.2f} m<extra></extra>", **own,
            )  # fmt: skip
    for person in range(len(clip.tracks)):
        colour = person_colour(person)
        _line(figure, np.zeros((0, 2)), colour, width=3.5, meta={"moves": "bones"})
        head = {"size": 13, "color": colour, "line": {"color": "white", "width": 1.5}}
        figure.add_scatter(
            x=[], y=[], mode="markers", marker=head, hoverinfo="skip", meta={"moves": "joints"}
        )
    return figure


def view_plot(clip: Clip, scenes: Sequence[WeightedScene]) -> go.Figure:
    """The camera view at the slider's frame: furniture of a scene, detected and drawn joints.

    Parameters
    ----------
    clip : Clip
    scenes : sequence of WeightedScene

    Returns
    -------
    plotly.graph_objects.Figure
    """
    figure = go.Figure(layout=_layout("u, to the right [px]", "v, down [px]"))
    figure.update_xaxes(range=[0, clip.camera.width], constrain="domain")
    figure.update_yaxes(range=[clip.camera.height, 0], scaleanchor="x", constrain="domain")
    for number, weighted in enumerate(scenes):
        for o in weighted.objects:
            edges = _apart(_edges(weighted.scene.camera, o))
            _line(
                figure, edges, hue(o.label), width=1.4, text=_plain(o.label), hoverinfo="text",
                meta={"scene": number}, visible=number == 0,
            )  # fmt: skip
    for person in range(len(clip.tracks)):
        _line(figure, np.zeros((0, 2)), person_colour(person), width=2.5, meta={"moves": "bones"})
        joints = {
            "size": 9, "color": [], "cmin": 0, "cmax": 100, "colorscale": _scale(),
            "line": {"color": person_colour(person), "width": 1.2},
        }  # fmt: skip
        _moving(
            figure, "joints", joints, text=list(JOINT_WORDS),
            hovertemplate="%{text}<br>hidden with %{marker.color} %<extra></extra>",
        )  # fmt: skip
        seen = {"symbol": "x-thin", "size": 9, "line": {"color": SEEN_COLOUR, "width": 2}}
        _moving(figure, "seen", seen, hoverinfo="skip")
    return figure


def map_plot(
    floor: Floor, occupancy: Occupancy, clusters: Sequence[ObjectCluster], best: Iterable[Array]
) -> go.Figure:
    """Occupancy over all draws; the saturation is the probability.

    Parameters
    ----------
    floor : Floor
    occupancy : Occupancy
    clusters : sequence of ObjectCluster
    best : iterable of (T, 2) float
        Path of each person in the best scene, metres.

    Returns
    -------
    plotly.graph_objects.Figure
    """
    figure = _floor(floor)
    _cells(figure, floor, occupancy)
    for way in best:
        _line(figure, way, INK, width=1)
    names = names_of(clusters)
    for number, (cluster, name) in enumerate(zip(clusters, names, strict=True)):
        colour, _ = line_of_object(clusters, number)
        faint = float(np.clip(cluster.presence, 0.3, 1))
        step = -(-len(cluster.positions) // _POINTS)
        figure.add_scatter(
            **_xy(cluster.positions[::step]), mode="markers", hoverinfo="skip",
            marker={"size": 3, "color": colour, "opacity": 0.5 * faint},
        )  # fmt: skip
        for share, dash in ((0.5, "solid"), (0.9, "dot")):
            region = cluster.region(share)
            c, s = np.cos(region.angle), np.sin(region.angle)
            turned = np.stack([np.cos(_ROUND), np.sin(_ROUND)], 1) * region.half_axes
            edge = region.centre + turned @ np.array([[c, s], [-s, c]])
            _line(figure, edge, INK, width=1.4, dash=dash, opacity=faint)
        named = cluster.presence >= LEAST_NAMED
        figure.add_scatter(
            x=[float(cluster.mean[0])], y=[float(cluster.mean[1])], opacity=max(faint, 0.6),
            mode="markers+text" if named else "markers", text=[_plain(name)] if named else None,
            textposition="top center", marker={"size": 10, "color": colour, "symbol": "diamond",
            "line": {"color": INK, "width": 1}}, hoverinfo="text", hovertext=_told(cluster, name),
        )  # fmt: skip
    return figure


def hiding_plot(clip: Clip, hidden: HiddenJoints, kept: NDArray[np.int64]) -> go.Figure:
    """Probability of hidden joints by frame and joint, and number of joints hidden by each object.

    Parameters
    ----------
    clip : Clip
    hidden : HiddenJoints
        Of all people, one after the other.
    kept : (M,) int
        Indices of the frames that are shown.

    Returns
    -------
    plotly.graph_objects.Figure
    """
    layout = _layout("frame", "")
    figure = go.Figure(layout=layout)
    ids = clip.frame_ids[kept]
    shares = by_person(clip, hidden.probability)[:, kept]
    by_object = (
        np.stack([by_person(clip, own)[:, kept] for own in hidden.by_object])
        if len(hidden.by_object)
        else np.zeros((0, *shares.shape))
    )
    names = [_plain(name) for name in names_of(hidden.clusters)]
    rows, values, told = [], [], []
    for person, track in enumerate(clip.tracks):
        whose = f"{_plain(track.name)}: " if len(clip.tracks) > 1 else ""
        for joint in _FROM_HEAD:
            rows.append(f"{whose}{JOINT_WORDS[joint]}")
            values.append(np.rint(100 * shares[person, :, joint]).astype(int).tolist())
            told.append(_by_whom(names, by_object[:, person, :, joint]))
    figure.add_heatmap(
        x=ids, y=rows, z=values, text=told, zmin=0, zmax=100, colorscale=_scale(), showscale=False,
        hovertemplate="frame %{x}, %{y}<br>hidden with %{z} %%{text}<extra></extra>",
    )  # fmt: skip
    for number, name in enumerate(names):
        colour, dash = line_of_object(hidden.clusters, number)
        figure.add_scatter(
            x=ids, y=np.round(by_object[number].sum((0, 2)), 2), mode="lines", yaxis="y2",
            line={"color": colour, "width": 1.8, "dash": dash},
            hovertemplate=f"frame %{{x}}<br>{name} hides %{{y:.1f}} joints<extra></extra>",
        )  # fmt: skip
    figure.update_layout(
        xaxis={"anchor": "y2", "range": [int(ids[0]) - 0.5, int(ids[-1]) + 0.5]},
        yaxis={"domain": [0.33, 1], "autorange": "reversed", "title": None, "showgrid": False},
        yaxis2=_axis("hidden [joints]") | {"domain": [0, 0.27], "rangemode": "tozero"},
        shapes=[{
            "type": "line", "x0": int(ids[0]), "x1": int(ids[0]), "y0": 0, "y1": 1,
            "yref": "paper", "line": {"color": INK, "width": 1.5},
        }],
        margin={"l": 105 if len(clip.tracks) == 1 else 150},
    )  # fmt: skip
    return figure


def chains_plot(traces: Array, *, unused: int) -> go.Figure:
    """Log-posterior of each chain over the whole run, grey before the first draw.

    Parameters
    ----------
    traces : (C, n) float
        Nats.
    unused : int
        Number of values of each chain from before its first draw.

    Returns
    -------
    plotly.graph_objects.Figure
    """
    figure = go.Figure(layout=_layout("part of the run [1]", "log-posterior [nat]"))
    step = -(-traces.shape[1] // _TRACE)
    part = np.linspace(0, 1, traces.shape[1])[::step]
    for number, trace in enumerate(traces):
        _line(
            figure, np.stack([part, trace[::step]], 1),
            CHAIN_COLOURS[number % len(CHAIN_COLOURS)], width=1, hoverinfo=None,
            hovertemplate=f"chain {number + 1}<br>%{{y:.1f}} nat<extra></extra>",
        )  # fmt: skip
    kept = traces[:, unused:]
    if np.isfinite(kept).any():
        low, high = (float(v) for v in np.nanquantile(kept, (0.002, 1.0)))
        room = high - low
        figure.update_yaxes(range=[low - 0.3 * room - 1, high + 0.1 * room + 1])
    figure.update_xaxes(range=[0, 1])
    grey = min(unused / max(traces.shape[1] - 1, 1), 1.0)
    figure.add_vrect(x0=0, x1=grey, fillcolor=LINES, opacity=0.6, line_width=0, layer="below")
    return figure


# ------------------------------------------------------------------------------------------------
# Pieces.


def _plain(text: str) -> str:
    """Text that plotly shows as it is: it takes some HTML for markup, and decodes few entities."""
    return escape(text, quote=False)


def _axis(title: str) -> dict[str, Any]:
    return {
        "title": {"text": title, "font": {"size": 12, "color": INK}, "standoff": 8},
        "gridcolor": LINES, "zeroline": False, "tickfont": {"size": 11, "color": INK},
        "linecolor": LINES, "automargin": True,
    }  # fmt: skip


def _layout(x: str, y: str) -> dict[str, Any]:
    return {
        "template": "none", "showlegend": False, "hovermode": "closest", "dragmode": "pan",
        # Otherwise the hover text of elements below a line rarely appears.
        "hoverdistance": 8,
        "font": {"family": _FONT, "size": 12, "color": INK},
        "margin": {"l": 52, "r": 12, "t": 12, "b": 46},
        "xaxis": _axis(x), "yaxis": _axis(y),
        "hoverlabel": {"bgcolor": "white", "bordercolor": QUIET, "font": {"color": INK}},
    }  # fmt: skip


def _floor(floor: Floor) -> go.Figure:
    figure = go.Figure(layout=_layout("x, to the right [m]", "y, away from the camera [m]"))
    low, high = floor.low.tolist(), floor.high.tolist()
    figure.update_xaxes(range=[low[0], high[0]], constrain="domain")
    figure.update_yaxes(range=[low[1], high[1]], constrain="domain", scaleanchor="x")
    return figure


def _xy(points: ArrayLike) -> dict[str, Any]:
    """Columns in single precision, which halves the page and is accurate to micrometres."""
    across, along = np.asarray(points, np.float32).reshape(-1, 2).T
    return {"x": across.copy(), "y": along.copy()}


def _line(
    figure: go.Figure, points: ArrayLike, colour: str, *, width: float = 1.2, dash: str = "solid",
    hoverinfo: str | None = "skip", **options: Any,
) -> None:  # fmt: skip
    line = {"color": colour, "width": width, "dash": dash}
    figure.add_scatter(**_xy(points), mode="lines", line=line, hoverinfo=hoverinfo, **options)


def _moving(figure: go.Figure, what: str, marker: Mapping[str, Any], **options: Any) -> None:
    figure.add_scatter(x=[], y=[], mode="markers", marker=marker, meta={"moves": what}, **options)


def _scale() -> list[list[Any]]:
    return [[0, HIDDEN_COLOURS[0]], [1, HIDDEN_COLOURS[1]]]


def _apart(lines: Iterable[Array]) -> Array:
    """Join lines in one array with gaps between them."""
    gap = np.full((1, 2), np.nan)
    pieces = [piece for line in lines for piece in (line, gap)]
    return np.concatenate(pieces) if pieces else np.zeros((0, 2))


def _closed(outlines: Iterable[Array]) -> Array:
    return _apart(np.concatenate([outline, outline[:1]]) for outline in outlines)


def _sight(figure: go.Figure, camera: Camera, floor: Floor, **own: Any) -> None:
    """Draw the edge of the floor that the camera sees, as far as the drawn floor reaches."""
    reach = float(np.linalg.norm(np.maximum(np.abs(floor.low), np.abs(floor.high))))
    edges = floor_edges(camera, reach=reach)
    _line(figure, _apart(edges), SIGHT_COLOUR, width=1, dash="dashdot", **own)


def _object(figure: go.Figure, o: SceneObject, covariance: Array, **own: Any) -> None:
    """Draw an object from above with its front, name and region of 90 %."""
    colour, label = hue(o.label), _plain(o.label)
    spread = np.sqrt(np.diag(covariance))
    low, high = o.bounds
    width, depth, height = high - low
    told = (
        f"<b>{label}</b><br>x {with_error(o.centre[0], spread[0])} m<br>"
        f"y {with_error(o.centre[1], spread[1])} m<br>"
        f"turned by {np.degrees(o.placement.yaw) % 360:.0f}°<br>"
        f"{width:.2f} × {depth:.2f} × {height:.2f} m"
    )
    figure.add_scatter(
        **_xy(_closed([o.footprint])[:-1]), mode="lines", fill="toself", hoveron="fills",
        fillcolor="rgba({},{},{},0.3)".format(*category_colour(o.label)),
        line={"color": colour, "width": 1.4}, text=told, hoverinfo="text", **own,
    )  # fmt: skip
    corners = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]) / 2
    parts = (o.placement.apply(c.centre + corners * c.size)[:, :2] for c in o.cuboids)
    _line(figure, _closed(parts), colour, width=0.7, **own)
    middle = (low + high) / 2
    tip = o.placement.apply([[middle[0], middle[1], 0], [middle[0], high[1] + 0.15, 0]])[:, :2]
    arrow = {"symbol": "arrow", "size": [0, 10], "angleref": "previous", "color": colour}
    figure.add_scatter(
        **_xy(tip), mode="lines+markers", line={"color": colour, "width": 1.5}, marker=arrow,
        hoverinfo="skip", **own,
    )  # fmt: skip
    if np.isfinite(covariance).all():
        variances, directions = np.linalg.eigh(covariance)
        axes = np.sqrt(_NINETY * np.maximum(variances, 0))
        edge = o.centre[:2] + (np.stack([np.cos(_ROUND), np.sin(_ROUND)], 1) * axes) @ directions.T
        _line(figure, edge, INK, width=1, dash="dot", **own)
    nearest = o.footprint[o.footprint[:, 1].argmin()]
    figure.add_scatter(
        **_xy(nearest), mode="text", text=[label], textposition="bottom center", hoverinfo="skip",
        **own,
    )  # fmt: skip


def _edges(camera: Camera, o: SceneObject) -> list[Array]:
    """The edges of all boxes of an object in the image, clipped in front of the camera."""
    corners = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / 2
    pairs = [
        (a, b) for a in range(8) for b in range(a) if np.abs(corners[a] - corners[b]).sum() == 1
    ]
    found = []
    for c in o.cuboids:
        world = o.placement.apply(c.centre + corners * c.size)
        before = camera.to_camera(world)[:, 1] > _NEAREST
        image = camera.project(world)
        found += [image[[a, b]] for a, b in pairs if before[a] and before[b]]
    return found


def _cells(figure: go.Figure, floor: Floor, occupancy: Occupancy) -> None:
    """Draw the map: a colour layer per category, and a layer with the text of cells."""
    columns = (occupancy.x > floor.low[0]) & (occupancy.x < floor.high[0])
    rows = (occupancy.y > floor.low[1]) & (occupancy.y < floor.high[1])
    step = max(1, int(np.ceil(np.sqrt(columns.sum() * rows.sum() / _CELLS))))
    x, y = occupancy.x[columns][::step], occupancy.y[rows][::step]
    layers = occupancy.by_category[:, rows][:, :, columns][:, ::step, ::step]
    anything = occupancy.anything[rows][:, columns][::step, ::step]
    if not anything.size:
        return
    for category, layer in zip(occupancy.categories, layers, strict=True):
        rgb = "rgba({},{},{},".format(*category_colour(category))
        figure.add_heatmap(
            x=x, y=y, z=np.round(layer, 3).astype(np.float32), zmin=0, zmax=1, showscale=False,
            colorscale=[[0, rgb + "0)"], [1, rgb + "1)"]], hoverinfo="skip",
        )  # fmt: skip
    told = [
        [
            f"something {_plain(as_probability(anything[i, j]))}"
            + "".join(
                f"<br>{_plain(category)} {_plain(as_probability(layers[k, i, j]))}"
                for k, category in enumerate(occupancy.categories)
                if layers[k, i, j] >= _FREE
            )
            for j in range(len(x))
        ]
        for i in range(len(y))
    ]
    clear = "rgba(255,255,255,0)"
    figure.add_heatmap(
        x=x, y=y, z=np.round(anything, 3).astype(np.float32), text=told, showscale=False,
        colorscale=[[0, clear], [1, clear]],
        hovertemplate="at (%{x:.1f}, %{y:.1f}) m<br>%{text}<extra></extra>",
    )  # fmt: skip


def _told(cluster: ObjectCluster, name: str) -> str:
    cells = cells_of_object(cluster)
    return (
        f"<b>{_plain(name)}</b>, there with {cells.there}"
        f"<br>called {_plain(cells.labels)}<br>x {cells.right} m"
        f"<br>y {cells.away} m<br>turned by {cells.facing}"
    )


def _by_whom(names: Sequence[str], shares: Array) -> list[str]:
    """Text by frame of the objects that hide a joint, from probabilities (K, M)."""
    return [
        "".join(f"<br>{name} {100 * own:.0f} %" for name, own in zip(names, column, strict=True)
                if own >= _FREE)
        for column in shares.T
    ]  # fmt: skip
