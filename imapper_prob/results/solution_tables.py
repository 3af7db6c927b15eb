"""The staged solution in tables for the terminal."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from rich.table import Table

from imapper_prob.results.solved import Solved
from imapper_prob.results.summary import distances_to_truth
from imapper_prob.staged.shortlist import Fate

__all__ = ["furniture_table", "maxima_table", "scenes_table", "stage_table"]


def stage_table(solved: Solved, times: Sequence[tuple[str, float]]) -> Table:
    """What every stage found, and how long it took.

    Parameters
    ----------
    solved : Solved
    times : sequence of (str, float)
        Stages as they reported themselves, and their seconds.
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
    """By name of a stage, actors' own stages by ``actor: stage`` where there are several."""
    words: dict[str, str] = {}
    for actor in solved.actors:
        name = f"{actor.clip.tracks[0].name}: " if len(solved.actors) > 1 else ""
        frames = {k: n for k, n in actor.frames.counts().items() if n}
        found = actor.combinations
        judged = sum(len(t.rows) for t in actor.shortlists)
        kept = sum(r.fate is Fate.KEPT for t in actor.shortlists for r in t.rows)
        words |= {
            f"{name}static path": "frames: " + ", ".join(f"{n} {k}" for k, n in frames.items()),
            f"{name}fitting scenelets": (
                f"{len(actor.library)} scenelets in {len(actor.fits.centres)} windows"
            ),
            f"{name}judging candidates": (
                f"{len(actor.curve.maxima)} maxima of charness; {judged} candidates there, "
                f"{kept} kept"
            ),
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
    """How many candidates are left after each step, by actor and maximum."""
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
    """The scenes with what they have and cost."""
    table = Table(title="Scenes", title_justify="left")
    for name in ("", "log-posterior", "objects"):
        table.add_column(name, justify="right" if name != "objects" else "left")
    for number, scene in enumerate(solved.scenes, 1):
        labels = [o.label for o in scene.objects]
        counted = ", ".join(f"{labels.count(n)} {n}" for n in dict.fromkeys(labels))
        table.add_row(str(number), f"{scene.log_posterior:.1f}", counted or "none")
    return table


def furniture_table(solved: Solved) -> Table:
    """The furniture of the best scene, with its distance from the truth where that is known."""
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
