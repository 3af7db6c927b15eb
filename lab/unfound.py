"""What would it cost to find what was not found, and to call what was found by its name?

    python -m lab.unfound I3DB_FOLDER

solves every scene with the built-in library. For each true object without a partner within a metre,
it puts candidates with an object of its kind near its true place into the best scene, one at a
time, replacing whatever they overlap, and refines the most promising. For each seat that was found
with a wrong label, it searches the best sequence of candidates with a seat of the true label near
the true place, replacing the scenelets of the one that was found. The output is the difference in
nats between the best scene with the object and the best without it: if it is near zero, the search
missed the object; if it is large, the model excludes it.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np

from imapper_prob.evaluate.objects import Pair, pair_up
from imapper_prob.evaluate.score import known_scene, scenes_with_truth
from imapper_prob.evaluate.truth import Outline, outline_of
from imapper_prob.layouts import placed_objects
from imapper_prob.models.log_posterior import State, log_posterior, state_camera, terms
from imapper_prob.scenelets.library import built_in_library
from imapper_prob.solver.candidates import Candidate, assigned, refine
from imapper_prob.solver.combinations import polish, state_of
from imapper_prob.solver.sequences import best_sequences
from imapper_prob.solver.solver import Solution, solve
from lab.ablation import prediction_of_state

_NEAR = 0.5
"""Metres from the true centre, half the distance that counts as found."""
_REFINED, _POLISHED = 24, 4
"""Number of scenes with the object that are refined, and of these that are polished."""

HEAD = "| scene | true | candidates | best with it | nats | mostly |\n|---|---|---:|---|---:|---|\n"


def with_it(solution: Solution, truth: Outline) -> Iterator[tuple[Candidate, State]]:
    """Candidates with the object, each with the best scene after it was put there."""
    problem, best = solution.problem, solution.states[0]
    starts = best.items[:, 1]
    ends = starts + problem.lengths[best.items[:, 0]]
    for candidate in solution.candidates:
        placed = _placed(solution, state_of(problem, [candidate]))
        away = [
            np.linalg.norm(o.centre - truth.centre) for _, o in placed if o.group == truth.group
        ]
        if not away or min(away) > _NEAR:
            continue
        first = candidate.start
        last = first + problem.lengths[candidate.scenelet]
        state = best
        for index in np.flatnonzero((starts < last) & (first < ends))[::-1].tolist():
            state = state.without_item(index)
        yield candidate, assigned(state, [candidate])


def called_so(solution: Solution, pair: Pair) -> Iterator[tuple[Candidate, State]]:
    """The best sequences with an object of the true label in place of the one that was found."""
    truth, found = pair.truth, pair.found
    problem, best = solution.problem, solution.states[0]
    own = [
        index
        for index, o in _placed(solution, best)
        if o.group == truth.group and np.linalg.norm(o.centre - found.centre) < _NEAR
    ]
    # One stay only; later stays at the same object are unchanged.
    own = [index for k, index in enumerate(own) if index == own[0] + k]
    ends = best.items[:, 1] + problem.lengths[best.items[:, 0]]
    begin = int(ends[min(own) - 1]) if min(own) else 0
    last = max(own) + 1 == best.n_scenelets
    end = problem.n_frames if last else int(best.items[max(own) + 1, 1])
    rest = best
    for index in range(max(own), min(own) - 1, -1):
        rest = rest.without_item(index)
    candidates = [
        candidate
        for candidate in solution.candidates
        if any(
            o.label == truth.label and np.linalg.norm(o.centre - truth.centre) < _NEAR
            for _, o in _placed(solution, state_of(problem, [candidate]))
        )
    ]
    sequences = best_sequences(
        problem, rest, candidates, within=(begin, end), slide=solution.curve.step // 2,
        count=_REFINED,
    )  # fmt: skip
    for members in sequences:
        yield members[0], assigned(rest, members)


def _placed(solution: Solution, state: State) -> list[tuple[int, Outline]]:
    camera = state_camera(solution.clip.camera, state)
    placed = placed_objects(state, solution.library)
    return [(index, outline_of(o, camera)) for index, o in placed]


def row(
    solution: Solution, scene: str, what: str, scenes: Iterable[tuple[Candidate, State]]
) -> str:
    """One line of the table: the best of some scenes with the object."""
    problem = solution.problem
    cells = [scene, what]
    found = sorted(scenes, key=lambda one: -log_posterior(problem, one[1]))
    if not found:
        return "| " + " | ".join([*cells, "no candidate", "", "", ""]) + " |\n"
    refined = [(c, refine(problem, state)) for c, state in found[:_REFINED]]
    refined.sort(key=lambda one: -log_posterior(problem, one[1]))
    polished = [(c, polish(problem, refine(problem, s))) for c, s in refined[:_POLISHED]]
    candidate, state = max(polished, key=lambda one: log_posterior(problem, one[1]))
    with_terms, without = terms(problem, state), terms(problem, solution.states[0])
    apart = {name: with_terms[name] - without[name] for name in with_terms}
    largest = sorted(apart, key=lambda name: -abs(apart[name]))[:4]
    cells += [
        f"{len(found)}",
        f"{solution.library[candidate.scenelet].name}, frame {candidate.start}",
        f"{sum(apart.values()):+.1f}",
        ", ".join(f"{name} {apart[name]:+.1f}" for name in largest),
    ]
    return "| " + " | ".join(cells) + " |\n"


def main(arguments: Sequence[str] | None = None) -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("scenes", type=Path, help="folder of i3DB scenes with their truth")
    options = parser.parse_args(arguments)
    out, library = sys.stdout.write, built_in_library()
    unfound, misnamed = [], []
    for scene in scenes_with_truth(options.scenes):
        known = known_scene(scene)
        solution = solve(known.clip, library)
        answer = prediction_of_state(solution, solution.states[0], name="staged")
        partner = {id(p.truth): p for p in pair_up(known.truth.used_objects, answer.objects)}
        for truth in known.truth.used_objects:
            pair = partner.get(id(truth))
            what = f"{truth.label} at {truth.centre[0]:.1f}, {truth.centre[1]:.1f} m"
            if pair is None or not pair.near:
                unfound.append(row(solution, scene.name, what, with_it(solution, truth)))
            elif pair.found.label != truth.label:
                what += f", found as {pair.found.label}"
                misnamed.append(row(solution, scene.name, what, called_so(solution, pair)))
    out(HEAD + "".join(unfound))
    out("\n" + HEAD.replace("candidates", "sequences") + "".join(misnamed))


if __name__ == "__main__":
    main()
