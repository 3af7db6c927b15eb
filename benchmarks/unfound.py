"""What it would cost to find what was not found.

``python benchmarks/unfound.py I3DB_FOLDER`` solves every scene with the built-in library. For
each true object without a partner within a metre it puts the candidates that have something of
its kind near its true place into the best scene, one at a time, instead of whatever they
overlap, and refines the most promising. Printed is how many nats the best scene with the object
is from the best without it: near nothing, the search or luck has missed it; much, the model.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator

import numpy as np

from imapper_prob.evaluate.objects import pair_up
from imapper_prob.evaluate.outline import Outline, outline_of
from imapper_prob.evaluate.prediction import prediction_of_state
from imapper_prob.evaluate.scenes import known_scene, scenes_with_truth
from imapper_prob.models.posterior import State, log_posterior, state_camera, terms
from imapper_prob.sampling.layouts import placed_objects
from imapper_prob.scenelets.library import built_in_library
from imapper_prob.staged.candidates import Candidate, assigned, refine
from imapper_prob.staged.combine import state_of
from imapper_prob.staged.polish import polish
from imapper_prob.staged.solver import Solution, solve

_NEAR = 0.5
"""Metres from the true centre: half of what counts as found."""
_REFINED, _POLISHED = 24, 4
"""Scenes with the object that are refined, and of these polished."""


def with_it(solution: Solution, truth: Outline) -> Iterator[tuple[Candidate, State]]:
    """Candidates with the object, each in the best scene."""
    problem, best = solution.problem, solution.states[0]
    starts = best.items[:, 1]
    ends = starts + problem.lengths[best.items[:, 0]]
    for candidate in solution.candidates:
        alone = state_of(problem, [candidate])
        camera = state_camera(solution.clip.camera, alone)
        placed = [outline_of(o, camera) for _, o in placed_objects(alone, solution.library)]
        away = [np.linalg.norm(o.centre - truth.centre) for o in placed if o.group == truth.group]
        if not away or min(away) > _NEAR:
            continue
        first = candidate.start
        last = first + problem.lengths[candidate.scenelet]
        state = best
        for index in np.flatnonzero((starts < last) & (first < ends))[::-1].tolist():
            state = state.without_item(index)
        yield candidate, assigned(state, [candidate])


def row(solution: Solution, scene: str, truth: Outline) -> str:
    """One line of the table."""
    problem = solution.problem
    cells = [scene, f"{truth.label} at {truth.centre[0]:.1f}, {truth.centre[1]:.1f} m"]
    found = sorted(with_it(solution, truth), key=lambda one: -log_posterior(problem, one[1]))
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


def main() -> None:
    """Print the table."""
    out, library = sys.stdout.write, built_in_library()
    out("| scene | true | candidates | best with it | nats | mostly |\n")
    out("|---|---|---:|---|---:|---|\n")
    for scene in scenes_with_truth(sys.argv[1]):
        known = known_scene(scene)
        solution = solve(known.clip, library)
        answer = prediction_of_state(solution, solution.states[0], name="staged")
        partner = {id(p.truth): p for p in pair_up(known.truth.used_objects, answer.objects)}
        for truth in known.truth.used_objects:
            pair = partner.get(id(truth))
            if pair is None or not pair.near:
                out(row(solution, scene.name, truth))


if __name__ == "__main__":
    main()
