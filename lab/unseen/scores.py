"""Scores of the furniture under the person of a clip with one motion, and the best rival."""

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
"""Short: chains keep or lose what the staged solver starts them with."""
AWAY: Final = 0.6
"""Greatest distance in metres of the true pelvis from the footprint of its seat."""
_JUDGED, _POLISHED = 12, 2
"""Number of rival sequences that are refined, and of these that are polished."""


@dataclass(frozen=True)
class Share:
    """Properties of an answer as fractions of its draws; 0 or 1 for a single scene.

    Parameters
    ----------
    carried : float
        A seat or bed is under the answer's own person during the stay.
    supported : float
        The same, and it is also within :data:`AWAY` of the true pelvis, seen from the camera.
    furnished : float
        There is any object.
    """

    carried: float
    supported: float
    furnished: float


@dataclass(frozen=True)
class Answer:
    """A single scene, and the terms of its log-posterior.

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
        """Total log-posterior in nats."""
        return sum(self.terms.values())


@dataclass(frozen=True)
class Outcome:
    """Outcome of a clip.

    Parameters
    ----------
    family : str
    unseen : bool
        Whether the searched library lacks the family.
    index : int
        Index of the clip in its family.
    performed : str
        Name of the scenelet that is performed.
    stay : (int, int)
        First frame of the performance, and the frame after the last.
    hidden : float
        Fraction of the joints that furniture hides in these frames.
    signs : tuple of (int, int, float)
        Stays that the solver detects: first frame, frame after the last, nats.
    staged, sampled : Share
        For the staged solver's best scene, and for the draws of the chains.
    best, empty : Answer
        The staged solver's best scene, and the mean camera and path without scenelets.
    rival : Answer, optional
        If draws or best scene are wrong about furniture: the best scene among the candidates that
        are right about it during the stay.
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
        """The outcome as JSON."""
        return asdict(self)

    @classmethod
    def from_json(cls, document: dict[str, Any]) -> Outcome:
        """The outcome from :meth:`as_json`, also if a file has turned tuples into lists."""
        said = dict(document)
        said["stay"] = tuple(said["stay"])
        said["signs"] = tuple((int(a), int(b), float(c)) for a, b, c in said["signs"])
        for name in ("staged", "sampled"):
            said[name] = Share(**said[name])
        for name in ("best", "empty", "rival"):
            said[name] = _answer(said[name]) if said[name] else None
        return cls(**said)

    def right(self, share: Share) -> bool:
        """Whether an answer is right: carried or not."""
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
    assert performance.clip.truth is not None  # simulated clips have ground truth
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
    """Shares over states with their merged furniture."""
    each = [_found_in(performance, problem, *one) for one in zip(states, objects, strict=True)]
    carried, supported, furnished = np.mean(each, axis=0).tolist()
    return Share(carried, supported, furnished)


def _found_in(
    performance: Performance, problem: Problem, state: State, objects: Sequence[SceneObject]
) -> tuple[bool, bool, bool]:
    """Carried, supported and furnished for one state, as in :class:`Share`."""
    own = np.median(motion(problem, state)[slice(*performance.stay), PELV, :2], axis=0)
    truth, nominal = performance.clip.truth, performance.clip.camera
    assert truth is not None  # simulated clips have ground truth
    seen = truth.camera.to_camera(performance.pelvis)
    true = camera_at(nominal, state.camera).to_world(seen)[:2]
    return (*score(objects, own, true), bool(objects))


def score(objects: Sequence[SceneObject], own: Array, true: Array) -> tuple[bool, bool]:
    """Whether a seat or bed is under the answer's person, and whether it is near the true pelvis.

    Parameters
    ----------
    objects : sequence of SceneObject
        Objects of the answer.
    own, true : (2,) float
        Pelvis of the answer and of the truth on the answer's floor, metres.
    """
    under = [o for o in objects if o.label in SITTABLE and gap(o, own) <= NEAR]
    return bool(under), any(gap(o, true) <= AWAY for o in under)


def best_rival(solution: Solution, performance: Performance, *, carried: bool) -> State | None:
    """The best scene of the candidates that are right about furniture.

    With ``carried``, scenelets of the best scene during the stay are replaced by sequences with a
    seat or bed; otherwise all scenelets are replaced by sequences without objects.

    Returns
    -------
    State or None
        There is no such candidate, or no sequence is right.
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
    """The state without scenelets that overlap a stay, and the interval (begin, end) then free."""
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
