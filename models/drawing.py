"""Draw clips and scenes on matplotlib axes, for ``plot`` methods and notebooks.

Functions import matplotlib when they draw, so importing this module does not load it. Views from
above use the world frame: the camera is above the origin and looks along y, which points up the
page.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from io import StringIO
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.colours import Colour, category_colour
from imapper_prob.models.skeleton import BONES, PELV

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from imapper_prob.models.scene import Clip, SceneObject

__all__ = [
    "INK",
    "LINES",
    "QUIET",
    "axes_for",
    "draw_clip",
    "draw_furniture",
    "draw_outlines",
    "draw_paths",
    "name_axes_of_floor",
    "picture_of",
    "rgb",
    "show_legend",
    "take_texts_as_they_stand",
    "tidy",
    "write_name",
]

Array = NDArray[np.float64]
INK: Final = "#2b2f36"
"""Colour of texts and of people."""
QUIET: Final = "#7d848f"
"""Colour of secondary elements."""
LINES: Final = "#dcdfe4"
"""Colour of grids and frames."""
_PEOPLE: Final = (INK, "#4e79a7", "#e15759", "#59a14f", "#b07aa1")
"""Colours of people, in order."""
_DOTS: Final = 80
"""Dots per inch of pictures in notebooks."""


def axes_for(ax: Axes | None, *, size: tuple[float, float]) -> Axes:
    """The axes to draw on; new ones if none are given.

    Parameters
    ----------
    ax : matplotlib.axes.Axes, optional
        If not given, the axes of a new pyplot figure.
    size : (float, float)
        Size of the new figure, inches.

    Returns
    -------
    matplotlib.axes.Axes
    """
    if ax is not None:
        return ax
    from matplotlib import pyplot

    return pyplot.subplots(figsize=size, layout="constrained")[1]


def draw_clip(axes: Axes, clip: Clip, *, moments: int) -> None:
    """Draw the 2D joints of all people at several frames, earlier ones lighter.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    clip : Clip
    moments : int
        Number of frames, evenly spread over those in which the person was detected.
    """
    for number, track in enumerate(clip.tracks):
        known = np.flatnonzero(np.any(np.isfinite(track.keypoints).all(-1), axis=1))
        if not len(known):
            continue
        colour = np.array(_parts(_PEOPLE[number % len(_PEOPLE)]))
        shown = known[np.unique(np.linspace(0, len(known) - 1, moments).round().astype(int))]
        label = f"{track.name}, frames {', '.join(map(str, clip.frame_ids[shown].tolist()))}"
        for t in shown:
            light = 0.75 * (1 - (t - known[0]) / max(known[-1] - known[0], 1))
            hue = tuple((colour + light * (1 - colour)).tolist())
            for k, bone in enumerate(BONES):
                named = label if t == shown[-1] and k == 0 else None
                axes.plot(*track.keypoints[t, list(bone)].T, color=hue, lw=1.6, label=named)
    axes.set(xlim=(0, clip.camera.width), ylim=(clip.camera.height, 0), aspect="equal")
    axes.set_xlabel("u, to the right [px]", color=INK)
    axes.set_ylabel("v, down [px]", color=INK)
    tidy(axes)


def draw_furniture(axes: Axes, objects: Iterable[SceneObject]) -> None:
    """Draw furniture from above: cuboids in order of height, and the label.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    objects : iterable of SceneObject
    """
    from matplotlib.patches import Polygon

    known: set[str] = set()
    for o in objects:
        colour = rgb(category_colour(o.label))
        for part in sorted(o.cuboids, key=lambda c: float(c.centre[2] + c.size[2] / 2)):
            corners = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]) * part.size / 2
            outline = o.placement.apply(part.centre + corners)[:, :2]
            patch = Polygon(outline, fc=(*colour, 0.3), ec=colour, lw=0.8)
            if o.label not in known:
                patch.set_label(o.label)
            known.add(o.label)
            axes.add_patch(patch)
        write_name(axes, o.centre, o.label)
    # Adding patches does not update automatic axis limits.
    axes.autoscale_view()


def draw_outlines(axes: Axes, objects: Iterable[SceneObject], *, label: str) -> None:
    """Draw dashed outlines of furniture from above.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    objects : iterable of SceneObject
    label : str
        Legend entry of all outlines together.
    """
    from matplotlib.patches import Polygon

    for k, o in enumerate(objects):
        named = label if k == 0 else None
        axes.add_patch(Polygon(o.footprint, fill=False, ec=QUIET, lw=0.9, ls="--", label=named))
    axes.autoscale_view()


def draw_paths(
    axes: Axes, joints: Array, *, people: int = 1, label: str | None, quiet: bool = False
) -> None:
    """Draw the paths of pelvises from above.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    joints : (K T, 16, 3) float
        World frame, metres; all frames of one person, then of the next.
    people : int
        Number of people.
    label : str, optional
        Legend entry.
    quiet : bool
        Draw thin and grey, for a path that is only for comparison.
    """
    ways = joints[:, PELV, :2].reshape(people, -1, 2)
    for number, way in enumerate(ways):
        colour = QUIET if quiet else _PEOPLE[number % len(_PEOPLE)]
        named = label if label is None or people == 1 else f"{label}, person {number + 1}"
        if quiet and number:
            named = None
        style = {"lw": 0.5, "alpha": 0.7} if quiet else {"lw": 1.4}
        axes.plot(*way.T, color=colour, label=named, **style)  # type: ignore[arg-type]


def name_axes_of_floor(axes: Axes) -> None:
    """Label the axes of a view from above, with units and equal scales.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    """
    # Keep the box where possible, so that layouts account for its surroundings.
    shared = len(axes.get_shared_x_axes().get_siblings(axes)) > 1
    axes.set_aspect("equal", adjustable="box" if shared else "datalim")
    axes.grid(color=LINES, lw=0.6)
    axes.set_axisbelow(True)
    axes.set_xlabel("x, to the right [m]", color=INK)
    axes.set_ylabel("y, away from the camera [m]", color=INK)
    tidy(axes)


def show_legend(axes: Axes, *, below: bool = False) -> None:
    """Show a legend of all labelled elements; its texts are not parsed as formulas.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    below : bool
        Place it under the axes, if there is no room inside.
    """
    if not axes.get_legend_handles_labels()[0]:
        return
    where: dict[str, Any] = {}
    if below:
        where = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.14), "ncols": 3}
    legend = axes.legend(fontsize=8, labelcolor=INK, framealpha=0.8, edgecolor=LINES, **where)
    for text in legend.get_texts():
        text.set_parse_math(False)


def write_name(axes: Axes, place: Sequence[float] | Array, text: str) -> None:
    """Write a name at a position on the floor.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    place : (2,) or (3,) float
        Position in metres.
    text : str
    """
    x, y = (float(value) for value in place[:2])
    axes.annotate(
        text, (x, y), color=INK, fontsize=8, ha="center", va="center", parse_math=False
    )  # fmt: skip


def tidy(axes: Axes) -> None:
    """Hide the top and right frame lines and make the others light.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    """
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(LINES)
    axes.tick_params(colors=QUIET, labelsize=8)


def rgb(colour: Colour) -> tuple[float, float, float]:
    """Convert a colour to matplotlib's range of 0 to 1.

    Parameters
    ----------
    colour : (int, int, int)

    Returns
    -------
    (float, float, float)
    """
    red, green, blue = colour
    return red / 255, green / 255, blue / 255


def _parts(colour: str) -> tuple[float, float, float]:
    """Red, green and blue of ``#rrggbb``, from 0 to 1."""
    red, green, blue = bytes.fromhex(colour[1:])
    return rgb((red, green, blue))


def take_texts_as_they_stand(figure: Figure) -> None:
    """Turn off formula parsing for all texts of a figure, because names come from users.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
    """
    from matplotlib.text import Text

    text: Any
    for text in figure.findobj(Text):
        text.set_parse_math(False)


def picture_of(plot: Callable[[Axes], object], *, size: tuple[float, float]) -> str:
    """Render a picture for a notebook as SVG, without touching pyplot's current figure.

    Parameters
    ----------
    plot : callable
        Draws on the axes that are passed to it.
    size : (float, float)
        Inches.

    Returns
    -------
    str
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained")
    plot(figure.subplots())
    take_texts_as_they_stand(figure)
    drawn = StringIO()
    figure.savefig(drawn, dpi=_DOTS, format="svg")
    picture = drawn.getvalue()
    return picture[picture.index("<svg") :]
