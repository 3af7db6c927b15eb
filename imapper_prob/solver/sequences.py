"""Sequences of scenelets for a stretch of a clip, by dynamic programming, and exchanges.

A stay on a seat is longer than a scenelet. It is explained by a person who sits down, sits, and
gets up. Such scenelets gain most if one begins where another ends: the step from one to the next
then costs like one jump, and free frames between them cost two. But candidates are .4 s apart, each
at its own best placement, so hardly any two of them adjoin. Here each may start earlier or later by
up to half that time, two that adjoin are moved to a common distance from the camera, and dynamic
programming (Viterbi, with the gain of each alone and of each adjoining pair) finds the best
sequences. The paper has no such step.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.log_posterior import State, log_posterior
from imapper_prob.models.problem import Problem
from imapper_prob.models.skeleton import PELV
from imapper_prob.solver.candidates import Candidate, apart_from_stays, assigned, refine

__all__ = ["Exchange", "best_before", "best_sequences", "exchange"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Links = Mapping[int, Sequence[tuple[int, float]]]
_CANDIDATE_LOSS = 15.0
"""Nats by which a candidate may be worse than the best of its window."""
_JOINED, _ALIKE = 6, 2
"""Number of candidates that end in a frame and are combined with as many that start there, and how
many of these may have the same kind of furniture."""


def best_sequences(
    problem: Problem,
    context: State,
    candidates: Sequence[Candidate],
    *,
    within: tuple[int, int],
    slide: int,
    count: int,
) -> tuple[tuple[Candidate, ...], ...]:
    """The best sequences by the gains of single candidates and adjoining pairs, the best first.

    No two of them have the same scenelets in the same order. Interactions of scenelets that do not
    adjoin, such as collisions of furniture, are not included. The value of a stay is shared by the
    scenelets that support it.

    Parameters
    ----------
    problem : Problem
    context : State
        Scene to which the sequences are added, without scenelets in the stretch.
    candidates : sequence of Candidate
    within : (int, int)
        First frame of the stretch, and the frame after its last.
    slide : int
        Frames by which a candidate may start earlier or later.
    count : int
        Number of sequences.

    Returns
    -------
    tuple of tuple of Candidate
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
    # With time reversed, the best continuation is the best predecessor.
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
    """The good candidates at every start within ``slide``, with their gain there."""
    best: defaultdict[int, float] = defaultdict(float)
    for c in candidates:
        best[c.window] = max(best[c.window], c.gain)
    begin, end = within
    result = []
    for c in candidates:
        if c.gain < best[c.window] - _CANDIDATE_LOSS:
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
    """Adjoining options before and after each option, with the additional gain of the pair in
    nats."""
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
    """The few best options of each frame, with distinct scenelets and few of one kind."""
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
    """The best sequence that ends with each option, by dynamic programming.

    Its predecessor adjoins it, or ended at least a frame earlier, or does not exist.

    Parameters
    ----------
    starts, ends : (n,) int
        First frames, and frames after the last.
    gains : (n,) float
        Gain of each option alone.
    before : mapping of int to sequence of (int, float)
        Adjoining predecessors of an option, with the additional gain of the pair.

    Returns
    -------
    value : (n,) float
        Gain of the whole sequence.
    came : (n,) int
        The option before; -1 if there is none.
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
    """The option, the option it is linked to, and so on."""
    chain = []
    while option >= 0:
        chain.append(option)
        option = int(links[option])
    return chain


def _at_one_distance(
    problem: Problem, members: Sequence[Candidate], body: float
) -> tuple[Candidate, ...]:
    """Candidates in order of time, with those that adjoin moved to a common distance.

    They keep their look and move along the ray to the mean of the log distances.
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
    """Candidates of one adjoining run, each with its log distance relative to the first."""
    middle = float(np.mean([apart for _, apart in run])) if run else 0.0
    return [_nearer(c, middle - apart) for c, apart in run]


def _nearer(candidate: Candidate, by: float) -> Candidate:
    """Move a candidate nearer by a log distance, so that it looks the same."""
    scale = np.array([np.exp(-by), np.exp(-by), 1.0])
    return replace(candidate, placement=candidate.placement * scale, size=candidate.size - by)


def _log_distance(problem: Problem, candidate: Candidate, body: float, *, last: bool) -> float:
    """Log distance in metres from below the camera to the pelvis, in the first or last frame."""
    first, stop = problem.joint_first[candidate.scenelet : candidate.scenelet + 2].tolist()
    px, py = problem.joints[stop - 1 if last else first, PELV, :2]
    x, y, yaw = candidate.placement
    size = body * np.exp(candidate.size)
    c, s = size * np.cos(yaw), size * np.sin(yaw)
    return float(np.log(np.hypot(x + c * px - s * py, y + s * px + c * py)))


def _end(problem: Problem, candidate: Candidate) -> int:
    """The frame after its last one."""
    return candidate.start + int(problem.lengths[candidate.scenelet])


# ------------------------------------------------------------------------------------------------
# Exchanges: the scenelets of one stay at a time are replaced by better ones.
#
# Combinations consist of the few candidates kept at each maximum of charness, which were evaluated
# in an empty scene. In the scene another candidate, or several in sequence, may be better: its
# motion continues that of its neighbours, its furniture fits beside theirs, or it explains frames
# without any scenelet. The paper has no such step (Monszpart et al. 2019, section 5). It is a
# coordinate ascent over stretches of the clip, with the best sequences of candidates of all
# windows.

_REFINED = 12
"""Sequences that are refined before one is chosen, as candidates were placed in an empty scene."""
_EXCHANGE_GAIN = 0.5
"""Least gain of an exchange in nats; less is within the accuracy of placements."""
_ROUNDS = 4
"""Largest number of passes through the clip. On i3DB one or two suffice."""
_APART = 3
"""Number of windows without a scenelet that separate two stays; 1.2 s."""
_LONGEST = 150
"""Largest number of windows of a stretch, 60 s. Work grows with the square of its length."""


@dataclass(frozen=True)
class Exchange:
    """One exchange of scenelets.

    Parameters
    ----------
    candidates : tuple of Candidate
        Inserted candidates, as placed before refinement; empty if scenelets were only removed.
    gain : float
        Gain in nats.
    state : State
        Scene after the exchange.
    """

    candidates: tuple[Candidate, ...]
    gain: float
    state: State


def exchange(
    problem: Problem, state: State, candidates: Sequence[Candidate], *, step: int
) -> tuple[Exchange, ...]:
    """Make the best exchange in each stretch of the clip, until none has a sufficient gain.

    A stretch reaches from the stay before one to the stay after it, or is a part of this if that is
    longer than a minute. The camera is fixed.

    Parameters
    ----------
    problem : Problem
    state : State
    candidates : sequence of Candidate
    step : int
        Frames from one window to the next.

    Returns
    -------
    tuple of Exchange
    """
    done: list[Exchange] = []
    tried: set[tuple[int, int, bytes, bytes]] = set()
    for _ in range(_ROUNDS):
        before, reached = len(done), -1
        while ahead := [s for s in _stretches(problem, state, step) if s[1] > reached]:
            begin, reached = ahead[0]
            rest = _without(state, begin, reached)
            attempt = (begin, reached, rest.items.tobytes(), rest.placements.tobytes())
            if attempt in tried:
                continue
            tried.add(attempt)
            better = _best(problem, state, rest, candidates, (begin, reached), step)
            if better is not None:
                done.append(better)
                state = better.state
        if len(done) == before:
            break
    return tuple(done)


def _best(
    problem: Problem,
    state: State,
    rest: State,
    candidates: Sequence[Candidate],
    stretch: tuple[int, int],
    step: int,
) -> Exchange | None:
    """The best exchange in a stretch given the rest of the scene; None if its gain is too small."""
    sequences = best_sequences(
        problem, rest, candidates, within=stretch, slide=step // 2, count=_REFINED
    )
    scenes = [rest, *(_refined(problem, rest, members) for members in sequences)]
    values = [log_posterior(problem, scene) for scene in scenes]
    best = int(np.argmax(values))
    gain = values[best] - log_posterior(problem, state)
    return Exchange(((), *sequences)[best], gain, scenes[best]) if gain >= _EXCHANGE_GAIN else None


def _refined(problem: Problem, rest: State, members: Sequence[Candidate]) -> State:
    """Add candidates and refine them twice, because each affects the ones it adjoins."""
    state = assigned(rest, members)
    own = {(c.scenelet, c.start) for c in members}
    added = [k for k, item in enumerate(state.items.tolist()) if tuple(item) in own]
    return refine(problem, state, only=2 * added)


def _stretches(problem: Problem, state: State, step: int) -> list[tuple[int, int]]:
    """For each stay, the frames from the end of the one before to the start of the one after.

    The whole clip if there is none. Long stretches are divided into equal parts.
    """
    whole = [(0, problem.n_frames)]
    if state.n_scenelets:
        starts = state.items[:, 1]
        ends = starts + problem.lengths[state.items[:, 0]]
        parts = np.flatnonzero(starts[1:] - ends[:-1] >= _APART * step)
        before = [0, *ends[parts].tolist()]
        after = [*starts[parts + 1].tolist(), problem.n_frames]
        whole = list(zip(before, after, strict=True))
    return [part for stretch in whole for part in _divided(*stretch, _LONGEST * step)]


def _divided(begin: int, end: int, longest: int) -> list[tuple[int, int]]:
    """Equal parts of a stretch, as few as have at most ``longest`` frames."""
    cuts = np.linspace(begin, end, -(-(end - begin) // longest) + 1).round().astype(int).tolist()
    return list(pairwise(cuts))


def _without(state: State, begin: int, end: int) -> State:
    """The scene without the scenelets in a stretch."""
    for index in reversed(range(state.n_scenelets)):
        if begin <= state.items[index, 1] < end:
            state = state.without_item(index)
    return state
