"""The staged solution as files, tables and figures.

The JSON file is for reading: scenes, and for each actor the table of every stage. The archive is
for computation: for each actor (``actor0/…``, in the order of the JSON) the frames, the charness
curve and the joints of every scene. Positions are metres in the world frame, angles radians,
energies nats; frame numbers are those of the input.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from numpy.typing import NDArray
from rich.table import Table

from imapper_prob.files import written_whole
from imapper_prob.layouts import placed_objects
from imapper_prob.models.drawing import INK, LINES, QUIET, axes_for, rgb, tidy
from imapper_prob.models.log_posterior import State, empty_state, motion
from imapper_prob.models.scene import SceneObject
from imapper_prob.models.skeleton import PELV
from imapper_prob.models.text import counted
from imapper_prob.plotting import category_colour
from imapper_prob.results.scenes_file import object_to_json
from imapper_prob.solver.actors import Solved, SolvedScene
from imapper_prob.solver.candidates import Candidate, Fate, MaximumTable, Shortlisted
from imapper_prob.solver.combinations import state_of
from imapper_prob.solver.solver import Solution
from imapper_prob.uncertainty.summary import distances_to_truth

__all__ = [
    "SOLUTION_FORMAT",
    "SOLUTION_VERSION",
    "candidate_figure",
    "charness_figure",
    "furniture_table",
    "maxima_table",
    "plot_charness",
    "scenes_table",
    "stage_table",
    "write_solution",
]

SOLUTION_FORMAT: Final = "imapper-prob solution"
SOLUTION_VERSION: Final = 1
_COMBINATIONS: Final = 50
"""Number of combinations in the file with members and gains."""


def write_solution(folder: Path, solved: Solved) -> None:
    """Write both files into a folder, each atomically.

    Parameters
    ----------
    folder : Path
    solved : Solved
    """
    text = json.dumps(_solution_document(solved), indent=1, allow_nan=False, ensure_ascii=False)
    with written_whole(folder / "solution.json") as beside:
        beside.write_text(text + "\n", encoding="utf-8")
    with written_whole(folder / "solution.npz") as beside:
        np.savez_compressed(beside, allow_pickle=False, **_arrays(solved))


def _solution_document(solved: Solved) -> dict[str, Any]:
    """The content of ``solution.json``."""
    library = solved.actors[0].library
    return {
        "format": SOLUTION_FORMAT,
        "version": SOLUTION_VERSION,
        "clip": solved.clip.name,
        "library": library.name,
        "library_digest": library.digest,
        "units": {"length": "metre", "angle": "radian", "energy": "nat"},
        "scenes": [_scene(solved, scene) for scene in solved.scenes],
        "actors": [_stages(actor) for actor in solved.actors],
    }


def _scene(solved: Solved, scene: SolvedScene) -> dict[str, Any]:
    names = [actor.clip.tracks[0].name for actor in solved.actors]
    return {
        "log_posterior": scene.log_posterior,
        "camera": asdict(scene.camera),
        "objects": [
            {**object_to_json(o), "found_by": [names[k] for k in users]}
            for o, users in zip(scene.objects, scene.users, strict=True)
        ],
        "actors": [
            {"name": name, "scenelets": _scenelets(actor, state)}
            for name, actor, state in zip(names, solved.actors, scene.states, strict=True)
        ],
    }


def _scenelets(actor: Solution, state: State) -> list[dict[str, Any]]:
    ids = actor.clip.frame_ids
    return [
        {
            "scenelet": actor.library[scenelet].name,
            "start": int(ids[start]),
            "placement": placement.tolist(),
        }
        for (scenelet, start), placement in zip(state.items.tolist(), state.placements, strict=True)
    ]


def _stages(actor: Solution) -> dict[str, Any]:
    """The tables of all stages of one actor, in order."""
    ids, centres = actor.clip.frame_ids, actor.curve.centres
    combinations = actor.combinations
    return {
        "name": actor.clip.tracks[0].name,
        "frames": actor.frames.counts(),
        "peaks": [
            {
                "frame": int(ids[centres[p.window]]),
                "charness": p.charness,
                "dropped": p.dropped or None,
            }
            for p in actor.curve.peaks
        ],
        "maxima": [
            {
                "frame": int(ids[centres[table.window]]),
                "counts": table.counts(),
                "candidates": [
                    {
                        **_candidate(actor, row.candidate),
                        "gain": row.candidate.gain,
                        "fit": row.fit,
                        "motion": row.motion,
                        "occlusion": row.occlusion,
                        "fate": str(row.fate),
                    }
                    for row in table.rows
                ],
            }
            for table in actor.shortlists
        ],
        "combinations": {
            "tried": len(combinations.tried),
            "complete": combinations.complete,
            "best_score_left": None if combinations.complete else combinations.left,
            "pool": [_candidate(actor, c) for c in combinations.pool],
            "best": [asdict(t) for t in combinations.tried[:_COMBINATIONS]],
        },
        "exchanges": [
            {"gain": e.gain, "candidates": [_candidate(actor, c) for c in e.candidates]}
            for e in combinations.exchanges
        ],
    }


def _candidate(actor: Solution, c: Candidate) -> dict[str, Any]:
    scenelet = actor.library[c.scenelet]
    return {
        "scenelet": scenelet.name,
        "objects": list(scenelet.labels),
        "start": int(actor.clip.frame_ids[c.start]),
        "placement": c.placement.tolist(),
        "log_size": c.size,
    }


def _arrays(solved: Solved) -> dict[str, np.ndarray]:
    arrays: dict[str, np.ndarray] = {"frame": solved.clip.frame_ids}
    for k, actor in enumerate(solved.actors):
        own = f"actor{k}"
        arrays |= {
            f"{own}/joints": np.stack([scene.motions[k] for scene in solved.scenes]),
            f"{own}/pose_source": np.array([str(p) for p in actor.frames.pose]),
            f"{own}/pixel_miss": actor.frames.miss,
            f"{own}/outlier": actor.frames.outlier,
            f"{own}/static_bearing_log_depth": actor.path.estimate,
            f"{own}/window_frame": solved.clip.frame_ids[actor.curve.centres],
            f"{own}/charness": actor.curve.values,
            f"{own}/charness_unsmoothed": actor.curve.raw,
        }
    return arrays


# ------------------------------------------------------------------------------------------------
# Tables for the terminal.


def stage_table(solved: Solved, times: Sequence[tuple[str, float]]) -> Table:
    """A table of stages with results and durations.

    Parameters
    ----------
    solved : Solved
    times : sequence of (str, float)
        Names of stages with their durations in seconds.

    Returns
    -------
    rich.table.Table
    """
    table = Table(title="Stages", title_justify="left")
    table.add_column("stage")
    table.add_column("time [s]", justify="right")
    table.add_column("what came of it")
    words = _in_words(solved)
    for stage, seconds in times:
        table.add_row(stage, f"{seconds:.1f}", words.get(stage, ""))
    table.add_row("all", f"{sum(s for _, s in times):.1f}", "")
    return table


def _in_words(solved: Solved) -> dict[str, str]:
    """Results by stage in words; for several actors by ``actor: stage``."""
    words: dict[str, str] = {}
    for actor in solved.actors:
        name = f"{actor.clip.tracks[0].name}: " if len(solved.actors) > 1 else ""
        frames = {k: n for k, n in actor.frames.counts().items() if n}
        found = actor.combinations
        judged = sum(len(t.rows) for t in actor.shortlists)
        kept = sum(r.fate is Fate.KEPT for t in actor.shortlists for r in t.rows)
        candidates = (
            f"{len(actor.curve.maxima)} maxima of charness; {judged} candidates there, {kept} kept"
        )
        words |= {
            f"{name}static path": "frames: " + ", ".join(f"{n} {k}" for k, n in frames.items()),
            f"{name}fitting scenelets": (
                f"{len(actor.library)} scenelets in {len(actor.fits.centres)} windows"
            ),
            f"{name}judging candidates": candidates,
            f"{name}filtering candidates": candidates,
            f"{name}combining": (
                f"{len(found.tried)} combinations tried: "
                + ("all there are" if found.complete else "pruned, the best by score first")
            ),
            f"{name}exchanging": (
                f"{len(found.exchanges)} exchanges; the best scene gains "
                f"{sum(e.gain for e in found.exchanges):.1f} nat"
            ),
            f"{name}refining scenes": f"{len(found.states)} scenes",
        }
    words["diverse scenes"] = f"{len(solved.scenes)} with no scenelet in common at nearby times"
    return words


def maxima_table(solved: Solved) -> Table:
    """A table of the candidates left after each step, by actor and maximum.

    Parameters
    ----------
    solved : Solved

    Returns
    -------
    rich.table.Table
    """
    table = Table(title="Candidates at the maxima of charness", title_justify="left")
    several = len(solved.actors) > 1
    for name in (*(["actor"] if several else []), "frame", "charness"):
        table.add_column(name, justify="right")
    for name in ("fitted", "judged", "fit", "motion", "occlusion", "kept"):
        table.add_column(name, justify="right")
    table.add_column("best [nat]")
    for actor in solved.actors:
        for maximum in actor.shortlists:
            counts = maximum.counts()
            row = [
                str(actor.clip.frame_ids[actor.curve.centres[maximum.window]]),
                f"{actor.curve.values[maximum.window]:.2f}",
                *(str(n) for n in counts.values()),
            ]
            best = maximum.rows[0].candidate if maximum.rows else None
            row.append(
                "none" if best is None
                else f"{', '.join(actor.library[best.scenelet].labels)} {best.gain:+.0f}"
            )  # fmt: skip
            table.add_row(*([actor.clip.tracks[0].name] if several else []), *row)
    return table


def scenes_table(solved: Solved) -> Table:
    """A table of scenes with their objects and log-posteriors.

    Parameters
    ----------
    solved : Solved

    Returns
    -------
    rich.table.Table
    """
    table = Table(title="Scenes", title_justify="left")
    for name in ("", "log-posterior", "objects"):
        table.add_column(name, justify="right" if name != "objects" else "left")
    for number, scene in enumerate(solved.scenes, 1):
        objects = counted(o.label for o in scene.objects)
        table.add_row(str(number), f"{scene.log_posterior:.1f}", objects)
    return table


def furniture_table(solved: Solved) -> Table:
    """A table of the furniture of the best scene, with distances from the truth if known.

    Parameters
    ----------
    solved : Solved

    Returns
    -------
    rich.table.Table
    """
    scene, truth = solved.scenes[0], solved.clip.truth
    table = Table(title="Furniture of scene 1", title_justify="left")
    for name in ("", "x [m]", "y [m]", "facing [°]"):
        table.add_column(name, justify="right" if name else "left")
    several = len(solved.actors) > 1
    if several:
        table.add_column("found by")
    if truth is not None:
        table.add_column("from truth [cm]", justify="right")
        errors = distances_to_truth(scene.objects, truth.objects)
    for k, (o, users) in enumerate(zip(scene.objects, scene.users, strict=True)):
        row = [
            o.label, f"{o.centre[0]:.2f}", f"{o.centre[1]:.2f}",
            f"{np.degrees(o.placement.yaw) % 360:.0f}",
        ]  # fmt: skip
        if several:
            row.append(", ".join(solved.actors[u].clip.tracks[0].name for u in users))
        if truth is not None:
            row.append("not there" if np.isnan(errors[k]) else f"{100 * errors[k]:.0f}")
        table.add_row(*row)
    return table


# ------------------------------------------------------------------------------------------------
# Figures. Each function returns one; matplotlib's current figure is not changed.

_ACCENT: Final = "#e15759"
_COLUMNS: Final = 4
"""Candidates beside each other in the figure."""
_AROUND: Final = 1.6
"""Metres of floor shown on each side of a candidate."""


def charness_figure(solved: Solved) -> Figure:
    """Draw charness over the clip by actor, with selected and rejected maxima.

    Grey bands are frames with interpolated poses, red ones frames with outlying detections.

    Parameters
    ----------
    solved : Solved

    Returns
    -------
    matplotlib.figure.Figure
    """
    figure = Figure(figsize=(11, 0.8 + 2.6 * len(solved.actors)), layout="constrained")
    rows = figure.subplots(len(solved.actors), 1, sharex=True, sharey=True, squeeze=False)
    for axes, actor in zip(rows[:, 0], solved.actors, strict=True):
        plot_charness(actor, axes)
        name = f", {actor.clip.tracks[0].name}" if len(solved.actors) > 1 else ""
        _title(axes, f"{solved.clip.name}{name}")
        axes.label_outer()
    return figure


def plot_charness(actor: Solution, ax: Axes | None = None) -> Axes:
    """Draw charness over the clip for one person, with its maxima.

    Grey bands are frames with interpolated poses, red ones frames with outlying detections.

    Parameters
    ----------
    actor : Solution
    ax : matplotlib.axes.Axes, optional
        If not given, the axes of a new figure.

    Returns
    -------
    matplotlib.axes.Axes

    Examples
    --------
    >>> axes = plot_charness(im.solve(clip, library).actors[0])
    >>> axes.get_xlabel(), axes.get_ylabel()
    ('frame', 'charness [1]')
    """
    axes = axes_for(ax, size=(9.0, 3.2))
    ids, curve = actor.clip.frame_ids, actor.curve
    frames = ids[curve.centres]
    bands = (
        (actor.frames.filled, QUIET, "pose filled in"),
        (actor.frames.outlier, _ACCENT, "detections left"),
    )
    for flags, colour, label in bands:
        for k, (first, last) in enumerate(_runs(flags)):
            named = label if k == 0 else None
            edges = (ids[first] - 0.5, ids[last] + 0.5)
            axes.axvspan(*edges, color=colour, alpha=0.15, lw=0, label=named)
    axes.plot(frames, curve.raw, ".", ms=3, color=QUIET, label="best fits of a window")
    axes.plot(frames, curve.values, color=INK, lw=1.6, label="smoothed")
    for dropped, inside, label in ((False, _ACCENT, "maximum"), (True, "white", "dropped")):
        peaks = [p for p in curve.peaks if bool(p.dropped) == dropped]
        axes.plot(
            [frames[p.window] for p in peaks], [p.charness for p in peaks],
            "o", ms=7, color=_ACCENT, markerfacecolor=inside, label=label,
        )  # fmt: skip
    axes.set_ylim(bottom=0)
    axes.set_xlim(ids[0] - 0.5, ids[-1] + 0.5)
    axes.set_xlabel("frame", color=INK)
    axes.set_ylabel("charness [1]", color=INK)
    axes.legend(
        frameon=False, fontsize=8, labelcolor=INK, ncols=6, loc="lower right",
        bbox_to_anchor=(1, 1),
    )  # fmt: skip
    tidy(axes)
    return axes


def candidate_figure(solved: Solved) -> Figure:
    """Draw the best candidates at each maximum from above, one panel per maximum.

    The thin line is the person's path through the clip, the thick part that at the maximum; grey
    outlines are the true furniture, if known.

    Parameters
    ----------
    solved : Solved

    Returns
    -------
    matplotlib.figure.Figure
    """
    panels = [(actor, table) for actor in solved.actors for table in actor.shortlists if table.rows]
    rows = max(1, -(-len(panels) // _COLUMNS))
    figure = Figure(figsize=(3.4 * _COLUMNS, 0.6 + 3.5 * rows), layout="constrained")
    figure.suptitle(f"{solved.clip.name}: candidates at the maxima", color=INK, fontsize=12)
    grid = figure.subplots(rows, _COLUMNS, squeeze=False).ravel()
    truth = solved.clip.truth.objects if solved.clip.truth is not None else ()
    for axes, (actor, table) in zip(grid, panels, strict=False):
        _candidates(axes, actor, table, truth)
        if len(solved.actors) > 1:
            axes.set_title(f"{actor.clip.tracks[0].name}, {axes.get_title(loc='left')}", loc="left",
                           fontsize=10, color=INK)  # fmt: skip
    for axes in grid[len(panels) :]:
        axes.set_axis_off()
    return figure


def _candidates(
    axes: Axes, actor: Solution, table: MaximumTable, truth: Sequence[SceneObject]
) -> None:
    kept = [row for row in table.rows if row.fate is Fate.KEPT]
    centre = int(actor.curve.centres[table.window])
    way = motion(actor.problem, empty_state(actor.problem))[:, PELV]
    stretch = way[max(0, centre - 8) : centre + 9]
    for o in truth:
        axes.add_patch(Polygon(o.footprint, fill=False, edgecolor=QUIET, lw=1.2, ls="--"))
    # Draw the best one last, on top.
    for rank, row in reversed(list(enumerate(kept))):
        for o in _furniture(actor, row):
            red, green, blue = rgb(category_colour(o.label))
            axes.add_patch(
                Polygon(
                    o.footprint, facecolor=(red, green, blue, 0.12 if rank else 0.45),
                    edgecolor=(red, green, blue), lw=1.0 if rank else 2.0,
                )
            )  # fmt: skip
            front = o.placement.apply(np.array([[0.0, 0.0, 0.0], [0.0, 0.25, 0.0]]))
            axes.plot(*front[:, :2].T, color=(red, green, blue), lw=1.0 if rank else 2.0)
    axes.plot(*way[:, :2].T, color=LINES, lw=1)
    axes.plot(*stretch[:, :2].T, color=INK, lw=2.4, solid_capstyle="round")
    words = [
        f"{', '.join(actor.library[r.candidate.scenelet].labels)} {r.candidate.gain:+.0f} nat"
        for r in kept
    ]
    axes.text(
        0.03, 0.03, "\n".join(words), transform=axes.transAxes, fontsize=8, color=INK, va="bottom"
    )
    middle = kept[0].candidate.placement if kept else stretch.mean(0)
    axes.set_xlim(middle[0] - _AROUND, middle[0] + _AROUND)
    axes.set_ylim(middle[1] - _AROUND, middle[1] + _AROUND)
    axes.set_aspect("equal")
    tidy(axes)
    _title(axes, f"frame {actor.clip.frame_ids[centre]}")


def _furniture(actor: Solution, row: Shortlisted) -> list[SceneObject]:
    alone = state_of(actor.problem, [row.candidate])
    return [o for _, o in placed_objects(alone, actor.library)]


def _runs(flags: NDArray[np.bool_]) -> Iterable[tuple[int, int]]:
    """First and last index of every run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(int)))
    return [(int(a), int(b) - 1) for a, b in edges.reshape(-1, 2)]


def _title(axes: Axes, text: str) -> None:
    axes.set_title(text, fontsize=10, color=INK, loc="left")
