"""Pieces of the report: escaped HTML, and pictures as PNG inside the page."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse, Polygon
from numpy.typing import NDArray

from imapper_prob.models.scene import Clip, SceneObject, Truth
from imapper_prob.models.skeleton import PELV
from imapper_prob.people import by_person
from imapper_prob.plotting import category_colour, save_figure
from imapper_prob.uncertainty.clusters import ObjectCluster
from imapper_prob.uncertainty.occupancy import Occupancy
from imapper_prob.uncertainty.scenes import WeightedScene

__all__ = [
    "Floor",
    "details",
    "figure",
    "heading",
    "map_picture",
    "notes",
    "page",
    "paragraph",
    "scene_picture",
    "section",
    "table",
    "trace_picture",
]

_STYLE: Final = """
:root { color-scheme: light; }
body { font: 16px/1.55 system-ui, "Segoe UI", "DejaVu Sans", sans-serif; color: #2b2f36;
  background: #f6f7f9; margin: 0; }
main { max-width: 1060px; margin: 0 auto; padding: 2rem 1.5rem 4rem; }
h1 { font-size: 1.15rem; font-weight: 600; color: #6b7280; margin: 0 0 .4rem; }
h2 { font-size: 1.15rem; margin: 2.6rem 0 .6rem; }
.answer { font-size: 1.5rem; line-height: 1.35; margin: 0 0 1rem; font-weight: 600; }
.verdict { border-left: 4px solid #59a14f; padding: .3rem .9rem; background: #fff; margin: 1rem 0; }
.verdict.doubt { border-color: #e15759; }
ul.notes { list-style: none; padding: 0; margin: 0 0 1rem; }
ul.notes li { background: #fff6e5; border-left: 4px solid #f28e2b; margin: .4rem 0;
  padding: .35rem .9rem; }
.scenes { display: grid; grid-template-columns: repeat(auto-fill, minmax(310px, 1fr)); gap: 1rem; }
figure { margin: 0; background: #fff; border: 1px solid #e4e7ec; border-radius: 8px;
  padding: .8rem; }
figure img { max-width: 100%; display: block; margin: 0 auto; }
figcaption { font-size: .88rem; color: #4b5563; margin-top: .4rem; }
figcaption b { color: #2b2f36; }
.scroll { overflow-x: auto; margin: 1rem 0; }
table { border-collapse: collapse; background: #fff; font-size: .92rem; min-width: 50%; }
caption { text-align: left; color: #6b7280; font-size: .88rem; padding: .3rem 0; }
th, td { padding: .32rem .8rem; border-bottom: 1px solid #e4e7ec; text-align: right;
  font-variant-numeric: tabular-nums; }
th { font-weight: 600; color: #4b5563; background: #fbfbfc; }
th.text, td.text { text-align: left; }
td:not(.text), th { white-space: nowrap; }
pre { background: #fff; border: 1px solid #e4e7ec; padding: .8rem; overflow-x: auto;
  font-size: .82rem; }
summary { cursor: pointer; color: #4b5563; }
p.hint { color: #6b7280; font-size: .92rem; margin: .2rem 0 .8rem; }
"""


def page(title: str, body: Sequence[str]) -> str:
    """A whole page of pieces.

    Parameters
    ----------
    title : str
    body : sequence of str
        HTML.

    Returns
    -------
    str
        HTML.
    """
    return "\n".join(
        [
            "<!DOCTYPE html>",
            '<html lang="en"><head><meta charset="utf-8">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            f"<title>{escape(title)}</title><style>{_STYLE}</style></head><body><main>",
            *body,
            "</main></body></html>\n",
        ]
    )


def heading(text: str) -> str:
    """What the page is of.

    Parameters
    ----------
    text : str

    Returns
    -------
    str
        HTML.
    """
    return f"<h1>{escape(text)}</h1>"


def section(title: str, *pieces: str, hint: str = "") -> str:
    """A heading, a grey line that says what one sees, and pieces.

    Parameters
    ----------
    title : str
    *pieces : str
        HTML.
    hint : str
        What one sees.

    Returns
    -------
    str
        HTML.
    """
    lead = paragraph(hint, style="hint") if hint else ""
    return "\n".join([f"<section><h2>{escape(title)}</h2>", lead, *pieces, "</section>"])


def paragraph(text: str, *, style: str = "") -> str:
    """A paragraph of plain text; nothing if there is none.

    Parameters
    ----------
    text : str
    style : str
        Class of the paragraph.

    Returns
    -------
    str
        HTML.
    """
    if not text:
        return ""
    return f'<p class="{style}">{escape(text)}</p>' if style else f"<p>{escape(text)}</p>"


def notes(texts: Sequence[str]) -> str:
    """Warnings, one a line; nothing if there are none.

    Parameters
    ----------
    texts : sequence of str

    Returns
    -------
    str
        HTML.
    """
    if not texts:
        return ""
    return '<ul class="notes">' + "".join(f"<li>{escape(t)}</li>" for t in texts) + "</ul>"


def figure(picture: str, *, alt: str, title: str = "", text: str = "") -> str:
    """A picture that lies in the page, and what is said of it.

    Parameters
    ----------
    picture : str
        A ``data:`` address.
    alt : str
        For who does not see it.
    title, text : str

    Returns
    -------
    str
        HTML.
    """
    heading = f"<b>{escape(title)}</b><br>" if title else ""
    return (
        f'<figure><img src="{escape(picture)}" alt="{escape(alt)}">'
        f"<figcaption>{heading}{escape(text)}</figcaption></figure>"
    )


def table(
    columns: Sequence[str], rows: Sequence[Sequence[str]], *, words: int = 1, caption: str = ""
) -> str:
    """A table of texts.

    Parameters
    ----------
    columns : sequence of str
    rows : sequence of sequence of str
    words : int
        How many columns, from the first, are words and not numbers.
    caption : str

    Returns
    -------
    str
        HTML.
    """

    def row(cells: Sequence[str], tag: str) -> str:
        styles = [' class="text"' if k < words else "" for k in range(len(cells))]
        pairs = zip(cells, styles, strict=True)
        styled = (f"<{tag}{style}>{escape(cell)}</{tag}>" for cell, style in pairs)
        return f"<tr>{''.join(styled)}</tr>"

    said = f"<caption>{escape(caption)}</caption>" if caption else ""
    body = "".join(row(cells, "td") for cells in rows)
    return (
        f'<div class="scroll"><table>{said}<thead>{row(columns, "th")}</thead>'
        f"<tbody>{body}</tbody></table></div>"
    )


def details(summary: str, text: str) -> str:
    """Something long that is folded away.

    Parameters
    ----------
    summary : str
    text : str

    Returns
    -------
    str
        HTML.
    """
    return f"<details><summary>{escape(summary)}</summary><pre>{escape(text)}</pre></details>"


# ------------------------------------------------------------------------------------------------
# Pictures. Top views have the camera below and what it sees above, in metres.

Array = NDArray[np.float64]
_INK: Final = "#2b2f36"
_QUIET: Final = "#8a919c"
_LINES: Final = "#e4e7ec"
_WAY: Final = "#3b4252"
_DOTS_PER_INCH: Final = 110
_SLIMMEST: Final = 1.25
"""Height over width of a picture, at most: rooms are deep and screens are not."""
_MARGIN: Final = 0.4
"""Metres around what is drawn."""
_NINETY: Final = 4.605
"""Quantile .9 of chi-square with two degrees of freedom."""
_NAMED: Final = 0.2
"""Probability below which an object has no name on the map."""
_CHAINS: Final = ("#4e79a7", "#f28e2b", "#59a14f", "#b07aa1", "#e15759", "#76b7b2")


@dataclass(frozen=True)
class Floor:
    """The part of the floor that all pictures of a report show, so that they can be compared.

    Parameters
    ----------
    low, high : (2,) float
        Corners, metres.
    """

    low: Array
    high: Array

    @classmethod
    def of(cls, clip: Clip, scenes: Sequence[WeightedScene]) -> Floor:
        """The part that holds all furniture and all ways; the camera is further down.

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

    def axes(self, *, width: float) -> tuple[Figure, Axes]:
        """An empty floor, at most a little higher than it is wide.

        Parameters
        ----------
        width : float
            Inches, at most.

        Returns
        -------
        figure : matplotlib.figure.Figure
        axes : matplotlib.axes.Axes
        """
        across, away = self.high - self.low
        scale = min(width / across, _SLIMMEST * width / away)
        size = (float(scale * across), float(scale * away) + 0.35)
        figure = Figure(figsize=size, layout="constrained")
        axes = figure.add_subplot()
        axes.set_xlim(self.low[0], self.high[0])
        axes.set_ylim(self.low[1], self.high[1])
        axes.set_aspect("equal")
        axes.grid(color=_LINES, lw=0.8)
        axes.set_axisbelow(True)
        axes.tick_params(colors=_QUIET, labelsize=7, length=0)
        axes.set_xlabel("metres; the camera is at (0, 0), looking up", color=_QUIET, fontsize=7)
        for spine in axes.spines.values():
            spine.set_color(_LINES)
        return figure, axes


def scene_picture(floor: Floor, weighted: WeightedScene, clip: Clip, *, width: float = 4.2) -> str:
    """One scene from above: furniture, 90 % ellipses of where it stands, and ways walked.

    Parameters
    ----------
    floor : Floor
    weighted : WeightedScene
    clip : Clip
    width : float
        Inches.

    Returns
    -------
    str
        A ``data:`` address.
    """
    figure, axes = floor.axes(width=width)
    _sight(axes, weighted, floor)
    for ghost in weighted.ghosts:
        for joints in by_person(clip, ghost):
            axes.plot(*joints[:, PELV, :2].T, color=_QUIET, lw=0.6, alpha=0.6)
    if clip.truth is not None:
        _truth(axes, clip.truth)
    for o, covariance in zip(weighted.scene.objects, weighted.covariances, strict=True):
        _object(axes, o)
        _ellipse(axes, o, covariance)
    for joints in by_person(clip, weighted.scene.joints):
        axes.plot(*joints[:, PELV, :2].T, color=_WAY, lw=1.6)
        axes.plot(*joints[0, PELV, :2], "o", color=_WAY, ms=4)
    for o in weighted.scene.objects:
        _name(axes, o.centre, o.label)
    return _as_png(figure)


def map_picture(
    floor: Floor, occupancy: Occupancy, clusters: Sequence[ObjectCluster], *, width: float = 6.5
) -> str:
    """Where furniture stands over all draws: the stronger the colour, the more probable.

    Parameters
    ----------
    floor : Floor
    occupancy : Occupancy
    clusters : sequence of ObjectCluster
    width : float
        Inches.

    Returns
    -------
    str
        A ``data:`` address.
    """
    figure, axes = floor.axes(width=width)
    if occupancy.categories:
        half = occupancy.cell / 2
        edges = (
            occupancy.x[0] - half, occupancy.x[-1] + half,
            occupancy.y[0] - half, occupancy.y[-1] + half,
        )  # fmt: skip
        axes.imshow(_mixed(occupancy), extent=edges, origin="lower", interpolation="nearest")
        axes.set_xlim(floor.low[0], floor.high[0])
        axes.set_ylim(floor.low[1], floor.high[1])
    for cluster in clusters:
        for share, style in ((0.5, "-"), (0.9, ":")):
            region = cluster.region(share)
            axes.add_patch(
                Ellipse(
                    (float(region.centre[0]), float(region.centre[1])),
                    *(2 * region.half_axes).tolist(),
                    angle=float(np.degrees(region.angle)),
                    fill=False, ls=style, lw=1.2, ec=_INK,
                    alpha=float(np.clip(cluster.presence, 0.15, 1)),
                )
            )  # fmt: skip
        if cluster.presence >= _NAMED:
            _name(axes, cluster.mean, f"{cluster.label} {cluster.presence:.2f}")
    return _as_png(figure)


def trace_picture(traces: Array, *, burn_in: float, width: float = 9.0) -> str:
    """Log-posterior of each chain over the whole run; what is grey was not kept.

    Parameters
    ----------
    traces : (C, n) float
        Nats.
    burn_in : float
        Share that was not kept.
    width : float
        Inches.

    Returns
    -------
    str
        A ``data:`` address.
    """
    figure = Figure(figsize=(width, 2.4), layout="constrained")
    axes = figure.add_subplot()
    part = np.linspace(0, 1, traces.shape[1])
    for number, trace in enumerate(traces):
        axes.plot(part, trace, lw=0.7, color=_CHAINS[number % len(_CHAINS)],
                  label=f"chain {number + 1}")  # fmt: skip
    axes.axvspan(0, burn_in, color=_LINES, alpha=0.8, lw=0)
    kept = traces[:, int(burn_in * traces.shape[1]) :]
    if np.isfinite(kept).any():
        low, high = np.nanquantile(kept, (0.002, 1.0))
        axes.set_ylim(low - 0.3 * (high - low) - 1, high + 0.1 * (high - low) + 1)
    axes.set_xlim(0, 1)
    axes.set_xlabel("part of the run", color=_INK, fontsize=8)
    axes.set_ylabel("log-posterior [nat]", color=_INK, fontsize=8)
    axes.tick_params(colors=_QUIET, labelsize=7)
    axes.legend(fontsize=7, frameon=False, ncols=len(traces), loc="lower right")
    for name in ("top", "right"):
        axes.spines[name].set_visible(False)
    return _as_png(figure)


def _mixed(occupancy: Occupancy) -> Array:
    """(Y, X, 3) white where nothing stands; colours of categories mixed by probability."""
    image = np.ones((*occupancy.anything.shape, 3))
    colours = np.array([category_colour(c) for c in occupancy.categories]) / 255
    total = np.maximum(occupancy.by_category.sum(0), 1e-12)
    hue = np.einsum("cyx,cr->yxr", occupancy.by_category / total, colours)
    weight = occupancy.anything[..., None]
    return np.asarray(image * (1 - weight) + hue * weight)


def _sight(axes: Axes, weighted: WeightedScene, floor: Floor) -> None:
    """The edges of what the camera sees."""
    camera, far = weighted.scene.camera, floor.high[1]
    for pixel in (0.0, float(camera.width)):
        slope = (pixel - camera.cx) / camera.fx
        axes.plot([0, slope * far], [0, far], color=_QUIET, lw=0.8, ls=(0, (4, 4)))


def _object(axes: Axes, o: SceneObject) -> None:
    red, green, blue = (part / 255 for part in category_colour(o.label))
    colour = (red, green, blue)
    for c in sorted(o.cuboids, key=lambda c: float(c.centre[2] + c.size[2] / 2)):
        corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) / 2 * c.size[:2]
        outline = np.concatenate([c.centre[:2] + corners, np.zeros((4, 1))], 1)
        axes.add_patch(
            Polygon(o.placement.apply(outline)[:, :2], fc=(*colour, 0.35), ec=colour, lw=1.2)
        )
    low, high = o.bounds
    middle = (low + high) / 2
    tip = o.placement.apply([[middle[0], middle[1], 0], [middle[0], high[1] + 0.15, 0]])[:, :2]
    axes.annotate("", tip[1], tip[0], arrowprops={"arrowstyle": "->", "color": colour, "lw": 1.5})


def _ellipse(axes: Axes, o: SceneObject, covariance: Array) -> None:
    variances, directions = np.linalg.eigh(covariance)
    width, height = 2 * np.sqrt(_NINETY * np.maximum(variances, 0))
    angle = np.degrees(np.arctan2(directions[1, 0], directions[0, 0]))
    x, y = o.centre[:2].tolist()
    axes.add_patch(Ellipse((x, y), width, height, angle=angle, fill=False, ec=_INK, lw=1, ls=":"))


def _truth(axes: Axes, truth: Truth) -> None:
    for o in truth.objects:
        axes.add_patch(Polygon(o.footprint, fill=False, ec=_QUIET, lw=1.2, ls="--"))


def _name(axes: Axes, centre: Array, text: str) -> None:
    axes.text(
        float(centre[0]), float(centre[1]), text, ha="center", va="center", fontsize=8, color=_INK,
        bbox={"boxstyle": "round,pad=0.15", "fc": "white", "ec": "none", "alpha": 0.75},
    )  # fmt: skip


def _as_png(figure: Figure) -> str:
    """The figure as the address of an image that lies in the page itself."""
    file = io.BytesIO()
    # Without the name of its maker, the same figure is the same file everywhere.
    save_figure(
        figure, file, dpi=_DOTS_PER_INCH, format="png", bbox_inches="tight", pad_inches=0.05,
        metadata={"Software": None},
    )  # fmt: skip
    return "data:image/png;base64," + base64.b64encode(file.getvalue()).decode()
