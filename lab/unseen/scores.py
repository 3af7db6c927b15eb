"""What an answer to a clip of one motion has under its person, and what speaks against another."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.api import sample, solve
from imapper_prob.config import Config, SampleSettings
from imapper_prob.layouts import merged_objects
from imapper_prob.models.log_posterior import (
    State,
    camera_at,
    empty_state,
    log_posterior,
    motion,
    terms,
)
from imapper_prob.models.problem import Problem
from imapper_prob.models.scene import SceneObject
from imapper_prob.models.skeleton import PELV
from imapper_prob.solver.candidates import Candidate, assigned, refine
from imapper_prob.solver.combinations import polish
from imapper_prob.solver.sequences import best_sequences
from imapper_prob.solver.solver import Solution
from lab.seats import NEAR, SITTABLE, gap
from lab.unseen.clips import CARRIED, Performance, searched_library, simulate_performance

__all__ = ["Answer", "Outcome", "Share", "outcome_of", "score"]

Array = NDArray[np.float64]

SETTINGS: Final = SampleSettings(
    chains=2, steps=2000, temperatures=3, draws=100, ensemble_steps=2,
)  # fmt: skip
"""Short: what the staged solver starts them with they keep or lose."""
AWAY: Final = 0.6
"""Metres from the true pelvis to the footprint of what is said to carry it, at most."""
_JUDGED, _POLISHED = 12, 2
"""Rival sequences that are refined, and of these polished."""


@dataclass(frozen=True)
class Share:
    """What is in an answer, as a share of its draws; 0 or 1 of a single scene.

    Parameters
    ----------
    carried : float
        A seat or bed is under the answer's own person during the stay.
    supported : float
        The same, and it is within :data:`AWAY` of the true pelvis too, seen from the camera.
    furnished : float
        Any object is anywhere.
    """

    carried: float
    supported: float
    furnished: float


@dataclass(frozen=True)
class Answer:
    """A single scene, and why it is as good as it is.

    Parameters
    ----------
    scenelets : tuple of (str, int)
        Names and first frames, in order of time.
    terms : mapping of str to float
        Nats by term.
    """

    scenelets: tuple[tuple[str, int], ...]
    terms: dict[str, float]

    @property
    def total(self) -> float:
        """Nats in all."""
        return sum(self.terms.values())


@dataclass(frozen=True)
class Outcome:
    """What came of a clip.

    Parameters
    ----------
    family : str
    unseen : bool
        Whether the library that was searched is without the family.
    index : int
        Of the clip in its family.
    performed : str
        Name of the scenelet.
    stay : (int, int)
        First frame in which it is performed, and the frame after the last.
    hidden : float
        Share of the joints that furniture hides in these frames.
    signs : tuple of (int, int, float)
        Stays that the solver sees: first frame, frame after the last, nats.
    staged, sampled : Share
        Of the staged solver's best scene, and of the draws of the chains.
    best, empty : Answer
        The staged solver's best scene, and the mean camera and path without scenelets.
    rival : Answer, optional
        If draws or best scene say the wrong thing about furniture: the best scene found among the
        candidates that say the right one during the stay.
    """

    family: str
    unseen: bool
    index: int
    performed: str
    stay: tuple[int, int]
    hidden: float
    signs: tuple[tuple[int, int, float], ...]
    staged: Share
    sampled: Share
    best: Answer
    empty: Answer
    rival: Answer | None

    def as_json(self) -> dict[str, Any]:
        """For a file."""
        return asdict(self)

    @classmethod
    def from_json(cls, document: dict[str, Any]) -> Outcome:
        """From :meth:`as_json`, also after a file has made lists of tuples."""
        said = dict(document)
        said["stay"] = tuple(said["stay"])
        said["signs"] = tuple((int(a), int(b), float(c)) for a, b, c in said["signs"])
        for name in ("staged", "sampled"):
            said[name] = Share(**said[name])
        for name in ("best", "empty", "rival"):
            said[name] = _answer(said[name]) if said[name] else None
        return cls(**said)

    def right(self, share: Share) -> bool:
        """Whether an answer says the right thing: carried or not."""
        if self.family in CARRIED:
            return share.supported > 0.5
        return share.furnished <= 0.5


def _answer(document: dict[str, Any]) -> Answer:
    named = tuple((str(name), int(start)) for name, start in document["scenelets"])
    return Answer(named, dict(document["terms"]))


def outcome_of(family: str, index: int, *, unseen: bool, seed: int = 0) -> Outcome:
    """Simulate, solve, sample and score one clip."""
    performance = simulate_performance(family, index, seed=seed)
    library = searched_library(seed, family if unseen else None)
    solution = solve(performance.clip, library).actors[0]  # there is one person
    posterior = sample(
        performance.clip, library, start=solution, config=Config(seed=seed, sample=SETTINGS)
    )
    samples, best = posterior.samples, solution.states[0]
    staged = _share_of(performance, solution.problem, [best], [_objects(solution, best)])
    sampled = _share_of(performance, solution.problem, samples.states, samples.objects)
    assert performance.clip.truth is not None  # it is simulated
    outcome = Outcome(
        family=family,
        unseen=unseen,
        index=index,
        performed=performance.scenelet.name,
        stay=performance.stay,
        hidden=float(performance.clip.truth.hidden[slice(*performance.stay)].mean()),
        signs=tuple((int(a), int(b), float(c)) for a, b, c in solution.problem.stays),
        staged=staged,
        sampled=sampled,
        best=_described(solution, best),
        empty=_described(solution, empty_state(solution.problem)),
        rival=None,
    )
    if outcome.right(staged) and outcome.right(sampled):
        return outcome
    rival = best_rival(solution, performance, carried=family in CARRIED)
    described = None if rival is None else _described(solution, rival)
    return Outcome(**{**vars(outcome), "rival": described})


def _share_of(
    performance: Performance,
    problem: Problem,
    states: Sequence[State],
    objects: Sequence[Sequence[SceneObject]],
) -> Share:
    """Of states with their merged furniture."""
    each = [_found_in(performance, problem, *one) for one in zip(states, objects, strict=True)]
    carried, supported, furnished = np.mean(each, axis=0).tolist()
    return Share(carried, supported, furnished)


def _found_in(
    performance: Performance, problem: Problem, state: State, objects: Sequence[SceneObject]
) -> tuple[bool, bool, bool]:
    """Of one state: carried, supported, furnished, as of :class:`Share`."""
    own = np.median(motion(problem, state)[slice(*performance.stay), PELV, :2], axis=0)
    truth, nominal = performance.clip.truth, performance.clip.camera
    assert truth is not None  # it is simulated
    seen = truth.camera.to_camera(performance.pelvis)
    true = camera_at(nominal, state.camera).to_world(seen)[:2]
    return (*score(objects, own, true), bool(objects))


def score(objects: Sequence[SceneObject], own: Array, true: Array) -> tuple[bool, bool]:
    """Whether a seat or bed is under the answer's person, and whether that is near the true one.

    Parameters
    ----------
    objects : sequence of SceneObject
        Of the answer.
    own, true : (2,) float
        Pelvis of the answer and of the truth on the answer's floor, metres.
    """
    under = [o for o in objects if o.label in SITTABLE and gap(o, own) <= NEAR]
    return bool(under), any(gap(o, true) <= AWAY for o in under)


def best_rival(solution: Solution, performance: Performance, *, carried: bool) -> State | None:
    """The best scene of the candidates that say the right thing about furniture.

    With ``carried``, what is in the best scene during the stay makes room for sequences of
    scenelets with a seat or bed; otherwise all of it for sequences of scenelets without anything.

    Returns
    -------
    State or None
        None if there is no such candidate, or none of the sequences is right.
    """
    problem = solution.problem
    context, begin, end = solution.states[0], 0, problem.n_frames
    if carried:
        context, begin, end = _cleared(problem, context, performance.stay)
    else:
        context = _emptied(context)
    candidates = [c for c in solution.candidates if _is_right(solution, c, carried=carried)]
    if not candidates:
        return None
    sequences = best_sequences(
        problem, context, candidates, within=(begin, end), slide=solution.curve.step // 2,
        count=4 * _JUDGED,
    )  # fmt: skip
    states = [assigned(context, members) for members in sequences]
    if not carried:
        states.append(context)
    right = list(_right(solution, performance, states, carried=carried))
    right.sort(key=lambda s: -log_posterior(problem, s))
    refined = sorted(
        (refine(problem, s) for s in right[:_JUDGED]), key=lambda s: -log_posterior(problem, s)
    )
    polished = [polish(problem, s) for s in refined[:_POLISHED]]
    kept = list(_right(solution, performance, polished + refined, carried=carried))
    return max(kept, key=lambda s: log_posterior(problem, s), default=None)


def _right(
    solution: Solution, performance: Performance, states: Sequence[State], *, carried: bool
) -> Iterator[State]:
    for state in states:
        objects = _objects(solution, state)
        _, supported, furnished = _found_in(performance, solution.problem, state, objects)
        if supported if carried else not furnished:
            yield state


def _is_right(solution: Solution, candidate: Candidate, *, carried: bool) -> bool:
    labels = solution.library[candidate.scenelet].labels
    return bool(SITTABLE.intersection(labels)) if carried else not labels


def _cleared(problem: Problem, state: State, stay: tuple[int, int]) -> tuple[State, int, int]:
    """The state without what overlaps a stay, and the stretch (begin, end) that is free then."""
    begin, end = 0, problem.n_frames
    for k in range(state.n_scenelets - 1, -1, -1):
        first = int(state.items[k, 1])
        last = first + int(problem.lengths[state.items[k, 0]])
        if last <= stay[0]:
            begin = max(begin, last)
        elif first >= stay[1]:
            end = min(end, first)
        else:
            state = state.without_item(k)
    return state, begin, end


def _emptied(state: State) -> State:
    for k in range(state.n_scenelets - 1, -1, -1):
        state = state.without_item(k)
    return state


def _objects(solution: Solution, state: State) -> tuple[SceneObject, ...]:
    return merged_objects(solution.problem, solution.library, state)


def _described(solution: Solution, state: State) -> Answer:
    named = tuple((solution.library[k].name, start) for k, start in state.items.tolist())
    return Answer(named, terms(solution.problem, state))
