"""Sequences: which scenelets, one after the other, explain a stretch of a clip best.

A stay at a seat is longer than a scenelet. What explains it is somebody who sits down, somebody
who sits and somebody who gets up, and they gain most where one goes on where another ends: the
step from one to the next is charged like any step, free frames between them like two jumps.
Candidates come every .4 s, each where it is best by itself, so that hardly two of them join. Here
each may start up to half that time earlier or later, two that join are brought to one distance
from the camera, and dynamic programming (Viterbi's, over what each gains alone, and what two
that join gain or lose together) finds the best sequences. The paper has no such step.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.posterior import State
from imapper_prob.models.problem import Problem
from imapper_prob.models.skeleton import PELV
from imapper_prob.staged.candidates import Candidate, apart_from_stays

__all__ = ["best_before", "best_sequences"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Links = Mapping[int, Sequence[tuple[int, float]]]

_WORTH = 15.0
"""Nats by which a candidate may be worse than the best of its window."""
_JOINED, _ALIKE = 6, 2
"""Candidates that end in a frame and are joined with as many that start there, and how many of
these may be of one kind of furniture."""


def best_sequences(
    problem: Problem,
    context: State,
    candidates: Sequence[Candidate],
    *,
    within: tuple[int, int],
    slide: int,
    count: int,
) -> tuple[tuple[Candidate, ...], ...]:
    """The best sequences by what candidates gain alone and joined, the best first.

    No two of them have the same scenelets in the same order. What scenelets that do not join
    do to each other, by furniture in each other's way, is left to whoever judges the whole;
    what a stay is worth is shared by those that hold it.

    Parameters
    ----------
    problem : Problem
    context : State
        The scene they are for, without scenelets in the stretch.
    candidates : sequence of Candidate
    within : (int, int)
        First frame of the stretch, and the frame after its last.
    slide : int
        Frames that a candidate may start earlier or later.
    count : int
        How many are wanted.
    """
    shared = apart_from_stays(problem, context)

    def gain(*members: Candidate) -> float:
        return shared(members)

    options = _slid(problem, candidates, within, slide, gain)
    body = float(np.exp(context.camera[3]))
    gains = np.array([c.gain for c in options])
    starts = np.array([c.start for c in options], dtype=np.int64)
    ends = np.array([_end(problem, c) for c in options], dtype=np.int64)
    before, after = _links(problem, options, starts, ends, body, gain)
    first, came = best_before(starts, ends, gains, before)
    # With time reversed, the best that can follow is the best that came before.
    last, goes = best_before(-ends, -starts, gains, after)
    found: dict[tuple[int, ...], tuple[Candidate, ...]] = {}
    for k in np.argsort(gains - first - last, kind="stable").tolist():
        if len(found) == count:
            break
        members = [options[m] for m in [*_chain(k, came)[:0:-1], *_chain(k, goes)]]
        story = tuple(c.scenelet for c in members)
        if story not in found:
            found[story] = _at_one_distance(problem, members, body)
    return tuple(found.values())


def _slid(
    problem: Problem,
    candidates: Sequence[Candidate],
    within: tuple[int, int],
    slide: int,
    gain: Callable[..., float],
) -> list[Candidate]:
    """The good ones at every start, with what they gain in the scene there."""
    best: defaultdict[int, float] = defaultdict(float)
    for c in candidates:
        best[c.window] = max(best[c.window], c.gain)
    begin, end = within
    result = []
    for c in candidates:
        if c.gain < best[c.window] - _WORTH:
            continue
        latest = min(c.start + slide, end - int(problem.lengths[c.scenelet]))
        for start in range(max(c.start - slide, begin), latest + 1):
            moved = replace(c, start=start)
            worth = gain(moved)
            if np.isfinite(worth):
                result.append(replace(moved, gain=worth))
    return result


def _links(
    problem: Problem,
    options: Sequence[Candidate],
    starts: Ints,
    ends: Ints,
    body: float,
    gain: Callable[..., float],
) -> tuple[Links, Links]:
    """By option what it may join before and after it, with the nats that they gain by joining."""
    best_first = sorted(range(len(options)), key=lambda k: -options[k].gain)
    ending, starting = _best_in(best_first, ends, options), _best_in(best_first, starts, options)
    before, after = defaultdict(list), defaultdict(list)
    for frame in sorted(ending.keys() & starting.keys()):
        for one in ending[frame]:
            for other in starting[frame]:
                pair = options[one], options[other]
                extra = gain(*_at_one_distance(problem, pair, body)) - sum(c.gain for c in pair)
                if np.isfinite(extra):
                    before[other].append((one, extra))
                    after[one].append((other, extra))
    return before, after


def _best_in(
    best_first: Sequence[int], frames: Ints, options: Sequence[Candidate]
) -> dict[int, list[int]]:
    """The few best options of each frame, no scenelet twice, few of one kind."""
    found: defaultdict[int, list[int]] = defaultdict(list)
    kinds: Counter[tuple[int, tuple[int, ...]]] = Counter()
    for k in best_first:
        own, frame, option = found[int(frames[k])], int(frames[k]), options[k]
        known = any(options[other].scenelet == option.scenelet for other in own)
        if len(own) < _JOINED and not known and kinds[frame, option.kind] < _ALIKE:
            own.append(k)
            kinds[frame, option.kind] += 1
    return found


def best_before(starts: Ints, ends: Ints, gains: Array, before: Links) -> tuple[Array, Ints]:
    """The best sequence that ends with each option.

    Before it comes one that it joins, or whatever has ended at least a frame ago, or nothing.

    Parameters
    ----------
    starts, ends : (n,) int
        First frames, and frames after the last.
    gains : (n,) float
        Of each alone.
    before : mapping of int to sequence of (int, float)
        What an option may join, and what it gains by that beyond what both gain alone.

    Returns
    -------
    value : (n,) float
        What the whole sequence gains.
    came : (n,) int
        The option before; -1 where there is none.
    """
    value, came = np.zeros(len(gains)), np.full(len(gains), -1)
    ended, past, best, whose = np.argsort(ends, kind="stable"), 0, 0.0, -1
    for k in np.argsort(starts, kind="stable").tolist():
        while past < len(ended) and ends[ended[past]] < starts[k]:
            if value[ended[past]] > best:
                best, whose = float(value[ended[past]]), int(ended[past])
            past += 1
        value[k], came[k] = best, whose
        for other, extra in before.get(k, ()):
            if value[other] + extra > value[k]:
                value[k], came[k] = value[other] + extra, other
        value[k] += gains[k]
    return value, came


def _chain(option: int, links: Ints) -> list[int]:
    """The option, what it is linked to, and so on."""
    chain = []
    while option >= 0:
        chain.append(option)
        option = int(links[option])
    return chain


def _at_one_distance(
    problem: Problem, members: Sequence[Candidate], body: float
) -> tuple[Candidate, ...]:
    """Candidates in order of time; those that join as far away as the others where they do.

    Who joins keeps the look and comes along the ray, to the mean of the log distances.
    """
    result: list[Candidate] = []
    run: list[tuple[Candidate, float]] = []
    for c in members:
        apart = 0.0
        if run and _end(problem, run[-1][0]) == c.start:
            known, back = run[-1]
            apart = back + _log_distance(problem, known, body, last=True)
            apart -= _log_distance(problem, c, body, last=False)
        else:
            result += _together(run)
            run = []
        run.append((c, apart))
    return (*result, *_together(run))


def _together(run: Sequence[tuple[Candidate, float]]) -> list[Candidate]:
    """Candidates of one run, each with by how much it is nearer than the first."""
    middle = float(np.mean([apart for _, apart in run])) if run else 0.0
    return [_nearer(c, middle - apart) for c, apart in run]


def _nearer(candidate: Candidate, by: float) -> Candidate:
    """It looks the same, nearer by a log distance."""
    scale = np.array([np.exp(-by), np.exp(-by), 1.0])
    return replace(candidate, placement=candidate.placement * scale, size=candidate.size - by)


def _log_distance(problem: Problem, candidate: Candidate, body: float, *, last: bool) -> float:
    """Log of the metres from below the camera to its pelvis, in its first or last frame."""
    first, stop = problem.joint_first[candidate.scenelet : candidate.scenelet + 2].tolist()
    px, py = problem.joints[stop - 1 if last else first, PELV, :2]
    x, y, yaw = candidate.placement
    size = body * np.exp(candidate.size)
    c, s = size * np.cos(yaw), size * np.sin(yaw)
    return float(np.log(np.hypot(x + c * px - s * py, y + s * px + c * py)))


def _end(problem: Problem, candidate: Candidate) -> int:
    """The frame after its last."""
    return candidate.start + int(problem.lengths[candidate.scenelet])
