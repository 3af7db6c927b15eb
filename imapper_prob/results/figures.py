"""Figures of a posterior: scenes, certainty, visibility, convergence, energy by term.

Each function returns a ``Figure`` that can be saved or shown; matplotlib's current figure is not
changed. In views from above the camera is at the origin and looks up the page.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from imapper_prob.models.drawing import (
    INK,
    LINES,
    QUIET,
    draw_clip,
    draw_furniture,
    draw_outlines,
    draw_paths,
    name_axes_of_floor,
    rgb,
    tidy,
)
from imapper_prob.models.scene import Clip
from imapper_prob.models.skeleton import JOINTS, PELV
from imapper_prob.models.text import with_error
from imapper_prob.people import by_person, everybody, in_a_row, names_of_rows
from imapper_prob.plotting import Colour, action_colour, category_colour
from imapper_prob.results.posterior import Posterior
from imapper_prob.uncertainty.drawing import draw_clusters, draw_occupancy
from imapper_prob.uncertainty.energy import Explanation, Worth

__all__ = [
    "chains_figure",
    "clip_figure",
    "energy_figure",
    "floor_figure",
    "hidden_figure",
    "nuisance_figure",
    "person_figure",
    "scenes_figure",
]

Array = NDArray[np.float64]
_TERM_COLOURS: Final = {
    "camera": "#bab0ac",
    "assignment": "#9c755f",
    "placement": "#edc948",
    "path": "#76b7b2",
    "detections": "#4e79a7",
    "free_pose": "#f28e2b",
    "reprojection": "#4e79a7",
    "occlusion": "#f28e2b",
    "smoothness": "#59a14f",
    "collision": "#b07aa1",
    "motion": "#e15759",
    "ground": "#ff9da7",
    "support": "#5f6b7a",
    "given": "#a0cbe8",
}
"""Hues of Tableau 10, which can be told apart with most kinds of colour blindness."""
_SHOWN: Final = 0.5
"""Least nats of a term in the legend; smaller bars are invisible."""


def energy_figure(explanation: Explanation, *, title: str) -> Figure:
    """Draw the decomposition of a scene's log-posterior.

    Parameters
    ----------
    explanation : Explanation
    title : str
        Name of the scene.

    Returns
    -------
    matplotlib.figure.Figure
    """
    parts = len(explanation.scenelets) + len(explanation.objects)
    figure = Figure(figsize=(15, max(8.0, 2.5 + 0.42 * parts)), layout="constrained")
    figure.suptitle(f"{title}: why this scene?", color=INK, fontsize=13)
    grid = figure.add_gridspec(5, 2, width_ratios=(2.1, 1), height_ratios=(0.9, 1.6, 1.6, 1, 1))
    first = figure.add_subplot(grid[0, 0])
    panels = [first, *(figure.add_subplot(grid[row, 0], sharex=first) for row in range(1, 5))]
    _scenelets(panels[0], explanation)
    _gain(panels[1], explanation)
    _sum(panels[2], explanation)
    _costs(panels[3], explanation)
    _probabilities(panels[4], explanation)
    ids = explanation.rows
    first.set_xlim(ids[0] - 0.5, ids[-1] + 0.5)
    for axes in panels:
        tidy(axes)
        _people_in_a_row(axes, ids, explanation.actors)
        for worth in explanation.scenelets:
            begin, end = _edges(worth.frames[0], ids)
            axes.axvspan(begin, end, color=rgb(action_colour(worth.action)), alpha=0.07, lw=0)
    for axes in panels[:-1]:
        axes.tick_params(labelbottom=False)
        axes.set_xlabel("")
    _worths(figure.add_subplot(grid[:, 1]), explanation)
    return figure


def _scenelets(axes: Axes, explanation: Explanation) -> None:
    """Draw the frames of each scenelet, with name and value."""
    for row, worth in enumerate(explanation.scenelets):
        begin, end = _edges(worth.frames[0], explanation.rows)
        # Alternate heights, so that names of neighbouring short scenelets do not overlap.
        height = -(row % 2)
        colour = rgb(action_colour(worth.action))
        axes.barh(height, end - begin, left=begin, height=0.42, color=colour, lw=0)
        axes.text(
            (begin + end) / 2, height + 0.27, f"{worth.name} ({worth.total:+.0f})",
            ha="center", va="bottom", fontsize=7.5, color=INK, clip_on=True,
        )  # fmt: skip
    axes.set(ylim=(-1.4, 0.85), yticks=[])
    _title(axes, "scenelets, and nats lost without each")


def _gain(axes: Axes, explanation: Explanation) -> None:
    """Draw the gain over the empty scene by frame, stacked by term, nats."""
    ids = explanation.rows
    above, below = np.zeros(len(ids)), np.zeros(len(ids))
    for name, nats in explanation.frames.terms.items():
        gained = nats - explanation.bare_frames.terms[name]
        bottom = np.where(gained >= 0, above, below)
        axes.bar(ids, gained, bottom=bottom, width=1.0, color=_TERM_COLOURS[name], lw=0)
        above, below = above + np.maximum(gained, 0), below + np.minimum(gained, 0)
    axes.use_sticky_edges = False  # room above the highest bar
    axes.axhline(0, color=QUIET, lw=0.8)
    axes.set_ylabel("nat a frame", color=QUIET)
    _title(axes, "gained over no scenelet")


def _sum(axes: Axes, explanation: Explanation) -> None:
    """Draw the cumulative gain from the first frame on."""
    gained = explanation.frames.total - explanation.bare_frames.total
    axes.plot(explanation.rows, np.cumsum(gained), color=INK, lw=1.4)
    axes.axhline(0, color=QUIET, lw=0.8)
    axes.set_ylabel("nat", color=QUIET)
    _title(axes, "gained so far: what has to pay for path, placement and layout")


def _costs(axes: Axes, explanation: Explanation) -> None:
    """Draw the term of detections by frame, with the scene and without scenelets."""
    ids, name = explanation.rows, next(iter(explanation.frames.terms))
    bare, nats = explanation.bare_frames.terms[name], explanation.frames.terms[name]
    axes.plot(ids, bare, color=QUIET, lw=1, label="no scenelet")
    axes.plot(ids, nats, color=_TERM_COLOURS[name], lw=1.4, label="scene")
    axes.set_ylabel("nat a frame", color=QUIET)
    _title(axes, f"{name} alone")
    _legend(axes)


def _probabilities(axes: Axes, explanation: Explanation) -> None:
    """Draw the probabilities by frame of hidden joints and of left-right flips."""
    ids, frames = explanation.rows, explanation.frames
    axes.fill_between(ids, frames.hidden, color="#59a14f", alpha=0.35, lw=0, label="joint hidden")
    axes.plot(ids, frames.flipped, color=_TERM_COLOURS["motion"], lw=1.4, label="sides flipped")
    axes.set(ylim=(0, 1), yticks=[0, 0.5, 1])
    _title(axes, "probability")
    _legend(axes)


def _worths(axes: Axes, explanation: Explanation) -> None:
    """Draw the value of each part, stacked by term: scenelets on top, objects below."""
    ids = explanation.frame_ids
    names: list[str] = []
    seen: set[str] = set()
    row = 0
    for heading, parts in (
        ("without the scenelet", explanation.scenelets),
        ("without the object alone", explanation.objects),
    ):
        names.append(heading)
        axes.text(0, row, heading, ha="center", va="center", fontsize=9, color=QUIET)
        for worth in parts:
            row += 1
            seen |= _stack(axes, worth, row)
            spans = ", ".join(
                f"{ids[a]}-{ids[b]}{explanation.actor_of(a)}" for a, b in worth.frames
            )
            names.append(worth.name if worth.action else f"{worth.name} ({spans})")
        row += 1
    axes.axvline(0, color=QUIET, lw=0.8)
    axes.set_yticks(range(len(names)), names)
    tidy(axes)
    axes.tick_params(left=False)
    for label, part in zip(axes.get_yticklabels(), _heads_and_parts(explanation), strict=True):
        label.set_color(INK if part is None else rgb(_colour_of(part)))
        label.set_visible(part is not None)
    axes.set_ylim(len(names) - 0.4, -0.7)
    axes.use_sticky_edges = False  # room for the numbers beside the bars
    axes.margins(x=0.16)
    shown = [
        axes.barh(0, 0, color=_TERM_COLOURS[t], label=t.replace("_", " "))
        for t in explanation.terms
        if t in seen or t in explanation.frames.terms
    ]
    axes.legend(
        handles=shown, loc="upper center", bbox_to_anchor=(0.5, -0.05), ncols=4,
        frameon=False, fontsize=8, labelcolor=INK,
    )  # fmt: skip
    _title(axes, "nats that the scene would lose")


def _stack(axes: Axes, worth: Worth, row: int) -> set[str]:
    """Draw the bar of one part; returns the terms that are visible in it."""
    right = left = 0.0
    for name, value in worth.terms.items():
        start = right if value >= 0 else left
        axes.barh(row, value, left=start, height=0.62, color=_TERM_COLOURS[name], lw=0)
        right, left = right + max(value, 0), left + min(value, 0)
    axes.text(
        right,
        row,
        f" {round(worth.total, 1) + 0.0:+.1f}",
        va="center",
        fontsize=8,
        color=INK,
        fontweight="bold",
    )
    return {name for name, value in worth.terms.items() if abs(value) >= _SHOWN}


def _heads_and_parts(explanation: Explanation) -> Sequence[Worth | None]:
    """Rows of the panel of values; None for a heading."""
    return [None, *explanation.scenelets, None, *explanation.objects]


def _colour_of(worth: Worth) -> Colour:
    return action_colour(worth.action) if worth.action else category_colour(worth.name)


def _edges(span: tuple[int, int], ids: NDArray[np.int64]) -> tuple[float, float]:
    return float(ids[span[0]]) - 0.5, float(ids[span[1]]) + 0.5


def _title(axes: Axes, text: str) -> None:
    axes.set_title(text, fontsize=10, color=INK, loc="left")


def _legend(axes: Axes) -> None:
    """Put the legend above the panel on the right, where it covers no curve."""
    axes.legend(
        frameon=False, fontsize=8, labelcolor=INK, ncols=2, loc="lower right",
        bbox_to_anchor=(1, 0.96),
    )  # fmt: skip


# ------------------------------------------------------------------------------------------------
# Scenes, certainty and convergence.

_CHAINS: Final = ("#4e79a7", "#f28e2b", "#59a14f", "#b07aa1", "#e15759", "#76b7b2")
_AXES: Final = {"across the view": "#4e79a7", "depth": "#f28e2b", "height": "#59a14f"}
_MARGIN: Final = 0.4
"""Margin in metres around the drawn area."""

_LINE: Final = 42
"""Characters of a line of text below a view from above."""
_BELOW: Final = 0.05
"""Share of a figure's height that is reserved for differences in words."""


def clip_figure(clip: Clip, *, moments: int = 5) -> Figure:
    """Draw the detections: people at several frames, and the confidence of each joint.

    Parameters
    ----------
    clip : Clip
    moments : int
        Number of frames.

    Returns
    -------
    matplotlib.figure.Figure
    """
    figure = Figure(figsize=(12, 5.6), layout="constrained")
    image, sure = figure.subplots(1, 2, width_ratios=(1.2, 1))
    for track in clip.tracks:
        dots = image.scatter(
            *track.keypoints.reshape(-1, 2).T, c=track.confidences.ravel(), s=3,
            cmap="RdYlGn", vmin=0, vmax=1, alpha=0.5, lw=0, zorder=0,
        )  # fmt: skip
    draw_clip(image, clip, moments=moments)
    image.set_title("2D joints, earlier poses lighter", color=INK, fontsize=10)
    confidences, ids = everybody(clip).confidences, in_a_row(clip)
    shown = np.where(confidences > 0, confidences, np.nan).T
    edges = (ids[0] - 0.5, ids[-1] + 0.5, len(JOINTS) - 0.5, -0.5)
    sure.imshow(shown, aspect="auto", cmap="RdYlGn", vmin=0, vmax=1, extent=edges)
    sure.set_yticks(range(len(JOINTS)), JOINTS, fontsize=7)
    sure.set_title("confidence; white where nothing was detected", color=INK, fontsize=10)
    _people_in_a_row(sure, ids, names_of_rows(clip).tolist())
    figure.colorbar(dots, ax=sure, shrink=0.7)
    tidy(sure)
    return figure


def scenes_figure(posterior: Posterior, count: int = 4) -> Figure:
    """Draw the most probable scenes side by side from above, with other draws of the path in grey.

    Parameters
    ----------
    posterior : Posterior
    count : int
        Largest number of scenes.

    Returns
    -------
    matplotlib.figure.Figure
    """
    scenes = posterior.scenes(count)
    everything = [o.footprint for w in scenes for o in w.scene.objects]
    everything += [w.scene.joints[:, PELV, :2] for w in scenes]
    low, high = _bounds(np.concatenate(everything))
    figure = _floors(low, high, len(scenes), width=3.6)
    panels = np.atleast_1d(figure.subplots(1, len(scenes), sharex=True, sharey=True))
    people, truth = len(posterior.clip.tracks), posterior.clip.truth
    for i, (axes, weighted) in enumerate(zip(panels, scenes, strict=True), 1):
        for ghost in weighted.ghosts:
            draw_paths(axes, ghost, people=people, label="other draws", quiet=True)
        draw_paths(axes, weighted.scene.joints, people=people, label="pelvis")
        draw_furniture(axes, weighted.scene.objects)
        draw_outlines(axes, truth.objects if truth is not None else (), label="truth")
        title = f"{i}: p = {with_error(weighted.probability, weighted.error)}"
        axes.set_title(title, color=INK, fontsize=11)
        name_axes_of_floor(axes)
        told = f"{axes.get_xlabel()}\n{_wrapped(weighted.difference)}".rstrip()
        axes.set_xlabel(told, color=INK, fontsize=8)
        axes.label_outer()
    panels[0].set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    # The layout reserves less than the four lines that a label may have.
    figure.set_layout_engine("constrained", rect=(0, _BELOW, 1, 1 - _BELOW))
    entries = dict(zip(*panels[0].get_legend_handles_labels()[::-1], strict=True))
    paths = [entries[name] for name in entries if name.startswith(("pelvis", "other", "truth"))]
    figure.legend(
        handles=paths, loc="outside upper center", ncols=4, fontsize=8, frameon=False,
        labelcolor=INK,
    )  # fmt: skip
    return figure


def floor_figure(posterior: Posterior) -> Figure:
    """Draw furniture over all draws: an occupancy map, and regions of 50 and 90 %.

    Parameters
    ----------
    posterior : Posterior

    Returns
    -------
    matplotlib.figure.Figure
    """
    occupancy, clusters = posterior.occupancy(), posterior.clusters()
    best = posterior.scenes(1)[0].scene.joints[:, PELV, :2]
    low, high = _bounds(np.concatenate([best, *(c.positions for c in clusters)]))
    figure = _floors(low, high, 2, width=6.0)
    left, right = figure.subplots(1, 2, sharex=True, sharey=True)
    draw_occupancy(left, occupancy)
    left.set_title("what stands where, over all draws", color=INK, fontsize=11)
    draw_clusters(right, clusters)
    right.set_title("objects: draws, and regions of 50 and 90 %", color=INK, fontsize=11)
    for axes in (left, right):
        for path in by_person(posterior.clip, best):
            axes.plot(*path.T, color=INK, lw=1.0, alpha=0.7)
    left.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    return figure


def hidden_figure(posterior: Posterior) -> Figure:
    """Draw the probability of hidden joints by frame and joint, and by object.

    Parameters
    ----------
    posterior : Posterior

    Returns
    -------
    matplotlib.figure.Figure
    """
    hidden, ids = posterior.hidden(), in_a_row(posterior.clip)
    figure = Figure(figsize=(12, 5.6), layout="constrained")
    grid, count = figure.subplots(2, 1, sharex=True, height_ratios=(1.6, 1))
    edges = (ids[0] - 0.5, ids[-1] + 0.5, len(JOINTS) - 0.5, -0.5)
    shades = grid.imshow(
        hidden.probability.T, aspect="auto", cmap="Purples", vmin=0, vmax=1, extent=edges
    )
    grid.set_yticks(range(len(JOINTS)), JOINTS, fontsize=7)
    grid.set_title("probability that a joint is hidden", color=INK, fontsize=11)
    figure.colorbar(shades, ax=grid)
    count.plot(ids, hidden.probability.sum(-1), color=QUIET, lw=1, ls="--", label="by anything")
    for c, by in zip(hidden.clusters, hidden.by_object, strict=True):
        if by.any():
            name = f"{c.label} at ({c.mean[0]:.1f}, {c.mean[1]:.1f})"
            count.plot(ids, by.sum(-1), color=rgb(category_colour(c.label)), lw=1.6, label=name)
    _people_in_a_row(count, ids, names_of_rows(posterior.clip).tolist())
    count.set_ylabel("joints hidden", color=INK)
    count.legend(fontsize=8, frameon=False)
    for axes in (grid, count):
        tidy(axes)
    return figure


def person_figure(posterior: Posterior) -> Figure:
    """Draw the depth of people with two standard deviations, and the uncertainty of each axis.

    Parameters
    ----------
    posterior : Posterior

    Returns
    -------
    matplotlib.figure.Figure
    """
    found, ids = posterior.joints(), in_a_row(posterior.clip)
    mean, spread = found.mean[:, PELV], found.standard_deviation[:, PELV]
    figure = Figure(figsize=(12, 3.8), layout="constrained")
    depth, sure = figure.subplots(1, 2)
    low, high = mean[:, 1] - 2 * spread[:, 1], mean[:, 1] + 2 * spread[:, 1]
    depth.fill_between(ids, low, high, color=_AXES["depth"], alpha=0.25, lw=0)
    depth.plot(ids, mean[:, 1], color=_AXES["depth"], lw=1.6, label="posterior, ± 2 s.d.")
    truth = posterior.clip.truth
    if truth is not None:
        true = truth.joints[:, PELV, 1]
        depth.plot(ids[: len(true)], true, color=INK, lw=1, ls="--", label="truth")
    depth.set_ylabel("depth of the pelvis [m]", color=INK)
    depth.legend(fontsize=8, frameon=False)
    for axis, (name, colour) in enumerate(_AXES.items()):
        sure.plot(ids, 100 * spread[:, axis], color=colour, lw=1.6, label=name)
    sure.set_ylabel("standard deviation [cm]", color=INK)
    sure.set_ylim(bottom=0)
    sure.legend(fontsize=8, frameon=False)
    for axes in (depth, sure):
        _people_in_a_row(axes, ids, names_of_rows(posterior.clip).tolist())
        tidy(axes)
    return figure


def nuisance_figure(posterior: Posterior) -> Figure:
    """Draw camera and body from the feet alone (the prior, grey), and the posterior.

    Parameters
    ----------
    posterior : Posterior

    Returns
    -------
    matplotlib.figure.Figure
    """
    found = posterior.nuisances()
    figure = Figure(figsize=(12, 2.8), layout="constrained")
    for axes, one in zip(figure.subplots(1, len(found)), found.values(), strict=True):
        low = min(one.prior_mean - 3 * one.prior_standard_deviation, float(one.draws.min()))
        high = max(one.prior_mean + 3 * one.prior_standard_deviation, float(one.draws.max()))
        x = np.linspace(low, high, 200)
        z = (x - one.prior_mean) / one.prior_standard_deviation
        prior = np.exp(-0.5 * z**2) / (np.sqrt(2 * np.pi) * one.prior_standard_deviation)
        axes.fill_between(x, prior, color=LINES)
        axes.hist(one.draws.ravel(), bins=30, density=True, color=_CHAINS[0], alpha=0.7)
        unit = "" if one.unit == "1" else f" [{one.unit}]"
        axes.set_title(one.name.replace("_", " ") + unit, color=INK, fontsize=10)
        axes.set_xlabel(f"variance less by {100 * one.contraction:.0f} %", color=INK, fontsize=9)
        axes.set_yticks([])
        tidy(axes)
    return figure


def chains_figure(posterior: Posterior) -> Figure:
    """Draw convergence: log-posterior by chain, scene shares by chain, acceptance of moves.

    Parameters
    ----------
    posterior : Posterior

    Returns
    -------
    matplotlib.figure.Figure
    """
    samples, shares = posterior.samples, posterior.scene_probabilities
    figure = Figure(figsize=(12, 3.8), layout="constrained")
    trace, scene, moves = figure.subplots(1, 3, width_ratios=(1.4, 1, 1))
    for c, values in enumerate(samples.log_posterior):
        trace.plot(values, color=_CHAINS[c % len(_CHAINS)], lw=0.8, label=f"chain {c + 1}")
    trace.set_title("log posterior [nat]", color=INK, fontsize=11)
    trace.set_xlabel("draw", color=INK)
    trace.legend(fontsize=8, frameon=False)
    by_chain = np.asarray(shares.by_chain)[:, :5]
    width = 0.8 / len(by_chain)
    for c, own in enumerate(by_chain):
        at = 1 + np.arange(len(own)) + (c - (len(by_chain) - 1) / 2) * width
        scene.bar(at, own, width, color=_CHAINS[c % len(_CHAINS)])
    scene.set_title("probability of each scene, by chain", color=INK, fontsize=11)
    scene.set_xticks(1 + np.arange(by_chain.shape[1]))
    scene.set_xlabel("scene", color=INK)
    rates = sorted(samples.acceptance.rates().items(), key=lambda item: item[1])
    moves.barh([name for name, _ in rates], [100 * rate for _, rate in rates], color=QUIET)
    moves.set_title("moves accepted [%]", color=INK, fontsize=11)
    moves.tick_params(axis="y", labelsize=8)
    for axes in (trace, scene, moves):
        tidy(axes)
    return figure


def _people_in_a_row(axes: Axes, rows: NDArray[np.int64], actors: Sequence[str]) -> None:
    """Label the axis of frames; several people, by the name of each row, follow one another."""
    names = list(dict.fromkeys(actors))
    said = f", of {', then '.join(names)}" if len(names) > 1 else ""
    axes.set_xlabel(f"frame{said}", color=INK)
    for name in names[1:]:
        axes.axvline(rows[actors.index(name)] - 0.5, color=INK, lw=0.8)


def _bounds(points: Array) -> tuple[Array, Array]:
    known = points[np.isfinite(points).all(1)]
    return known.min(0) - _MARGIN, known.max(0) + _MARGIN


def _floors(low: Array, high: Array, count: int, *, width: float) -> Figure:
    """A figure for ``count`` views from above of the same area, with a fitting height."""
    across, away = high - low
    height = float(np.clip(width * away / across, 2.0, 6.0))
    return Figure(figsize=(width * count, height + 1.1), layout="constrained")


def _wrapped(text: str) -> str:
    lines: list[str] = [""]
    for word in text.split():
        if len(lines[-1]) + len(word) > _LINE:
            lines.append("")
        lines[-1] = f"{lines[-1]} {word}".strip()
    return "\n".join(lines)
