"""Scenes that differ throughout: no two of them have the same scenelet at nearby times."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from imapper_prob.models.posterior import State
from imapper_prob.models.problem import Problem
from imapper_prob.staged.candidates import Candidate
from imapper_prob.staged.combine import groups_of, search, state_of
from imapper_prob.staged.maxima import CharnessCurve

__all__ = ["diverse_scenes"]

_NEARBY = 1.6
"""Seconds between the starts of what counts as nearby, about the length of a scenelet."""
_KEPT, _TRIED = 3, 64
"""Candidates a maximum, and combinations judged: an alternative need not be the very best."""


def diverse_scenes(
    problem: Problem,
    candidates: Sequence[Candidate],
    curve: CharnessCurve,
    first: State,
    *,
    finish: Callable[[Problem, State], State],
    fps: float,
    count: int,
) -> tuple[State, ...]:
    """``first`` and the best scenes without what the ones before have, at most ``count``.

    Fewer where nothing is left that improves on the empty scene. The paper asks the same of
    its five solutions of a long clip (Monszpart et al. 2019, section 5). Each is what
    ``finish`` makes of the best combination left.
    """
    scenes = [first]
    while len(scenes) < count:
        used = np.concatenate([scene.items for scene in scenes])
        left = [c for c in candidates if not _nearby(c, used, _NEARBY * fps)]
        groups = groups_of(left, curve, kept=_KEPT)
        tried, _ = search(problem, groups, tried=_TRIED)
        if not tried[0].members:
            break
        pool = [c for group in groups for c in group]
        scenes.append(finish(problem, state_of(problem, [pool[k] for k in tried[0].members])))
    return tuple(scenes)


def _nearby(candidate: Candidate, used: np.ndarray, frames: float) -> bool:
    """Whether its scenelet was used at a start less than so many frames away."""
    same = used[:, 0] == candidate.scenelet
    return bool((same & (np.abs(used[:, 1] - candidate.start) < frames)).any())
