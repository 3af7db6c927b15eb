"""What every stage of the solver had on the floor, for a recording."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.posterior import State, empty_state, state_camera
from imapper_prob.models.scene import SceneObject
from imapper_prob.recording.stages import Curve, StageView
from imapper_prob.results.limbs import limbs_of
from imapper_prob.results.solved import Solved
from imapper_prob.sampling.layouts import placed_objects
from imapper_prob.staged.candidates import Candidate
from imapper_prob.staged.combine import state_of
from imapper_prob.staged.solver import Solution

__all__ = ["charness_curves", "stage_views"]

Array = NDArray[np.float64]


def stage_views(solved: Solved) -> tuple[StageView, ...]:
    """Static path, candidates judged, candidates kept, best combination, scenes."""
    actors = solved.actors
    empty = [empty_state(a.problem) for a in actors]
    alone = _motions(actors, empty)
    judged = [[r.candidate for t in a.shortlists for r in t.rows] for a in actors]
    best_of_kind = [_best_of_kind(candidates) for candidates in judged]
    kept = [a.combinations.pool for a in actors]
    together = [
        state_of(a.problem, [a.combinations.pool[k] for k in a.combinations.tried[0].members])
        for a in actors
    ]
    views = [
        StageView("Static path", _frames(solved), (), alone),
        StageView(
            "Candidates judged",
            f"{sum(map(len, judged))} fits at {sum(len(a.shortlists) for a in actors)} maxima of "
            "charness, judged by the full log-posterior. Shown is the best of each kind of "
            "furniture.",
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
    """The best combination of each actor after its exchanges."""
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
    """By name of the actor, charness over the clip's frames."""
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
