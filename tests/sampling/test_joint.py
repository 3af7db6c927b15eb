"""Scenes and data stay what they were, whatever moves are made (after Geweke 2004).

A scene drawn from the prior is, given data drawn of it, a draw of the posterior: moves that
leave the posterior as it is may be made from there, and scene and data are jointly distributed
as before. Every pair is drawn anew, so that nothing has to mix and errors are those of
independent numbers. Three errors made on purpose show what this sees.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from functools import partial
from itertools import islice
from typing import Any

import numpy as np
import pytest

from imapper_prob.config import SampleSettings
from imapper_prob.models.detector import DetectionModel
from imapper_prob.models.log_posterior import State, empty_state, log_posterior, motion, terms
from imapper_prob.models.problem import Problem
from imapper_prob.models.settings import ModelSettings
from imapper_prob.models.skeleton import PELV
from imapper_prob.samplers.reversible_jump import Mixture, Proposal, init, step
from imapper_prob.samplers.tempering import Parts, start, temper
from imapper_prob.sampling import moves
from imapper_prob.sampling.camera_moves import AdaptedCameraWalk, CompensatedCameraWalk
from imapper_prob.sampling.chain import Setup, scene_moves, tempering_split
from imapper_prob.sampling.learning import learn
from imapper_prob.sampling.proposals import Candidates, Proposals
from imapper_prob.sampling.reference import Reference, draw_scene
from imapper_prob.sampling.reference_moves import SceneRedraw, StretchRedraw
from imapper_prob.sampling.replace_moves import Refurnish, ReplaceAndShift
from imapper_prob.sampling.visits import Visits
from lab.prior import Experiment, draw_state
from tests.models import worlds

N_FRAMES = 20
LIMIT = 4.2
"""Standard errors; the largest of twenty is beyond once in 1,900 times."""
Change = Callable[[Mixture[State]], Mixture[State]]


def poor_data(rate: float = 0.12, depth: float = 0.1) -> Experiment:
    """A joint every fourth frame, and that not well, so that much is left open."""
    settings = ModelSettings(scenelet_rate=rate, start_bearing=0.02, start_log_depth=depth)
    given = worlds.experiment(
        N_FRAMES, joints_a_frame=1, doubt=(0.02, depth), settings=settings,
        scenelets=worlds.mixed_library(),
    )  # fmt: skip
    (track,), model = given.clip.tracks, DetectionModel()
    confidences = track.confidences.copy()
    confidences[np.arange(N_FRAMES) % 4 != 0] = 0.0
    return replace(
        given,
        clip=replace(given.clip, tracks=(replace(track, confidences=confidences),)),
        # Feet may go below the floor, or else the floor would say how far away somebody is.
        settings=replace(given.settings, motion_cost=0.2),
        detections=replace(model, error_scale=6 * model.error_scale),
    )


def setup(problem: Problem, *, fitted: bool = True) -> Setup:
    """Candidates that know nothing of the data, which is slow and allowed; or none at all."""
    n = len(problem.lengths)
    centres = np.arange(3, N_FRAMES - 2, 2)
    places = np.tile([0.0, 4.0, 0.0], (len(centres), n, 1))
    places[..., 2] = 2.5 * np.arange(places[..., 0].size).reshape(len(centres), n)
    similarity = (np.ones((n, n)) - np.eye(n)) / (n - 1)
    weights = fitted * np.linspace(0.5, 1.5, n) * np.ones((len(centres), n))
    candidates = Candidates(centres, places, np.zeros_like(weights), weights)
    return Setup(problem, candidates, similarity, SampleSettings(), (empty_state(problem),))


def asked(problem: Problem, state: State) -> dict[str, float]:
    """Quantities, their squares where these say something else, and how they go with the data."""
    nats = terms(problem, state)
    pelvis = motion(problem, state)[:, PELV]
    where, ends = state.placements[:, 1], state.items[:, 1] + problem.lengths[state.items[:, 0]]
    values = {
        "log-likelihood": nats["detections"],
        "costs": nats["collision"] + nats["motion"] + nats["ground"],
        "scenelets": state.n_scenelets,
        "covered": int(problem.lengths[state.items[:, 0]].sum()),
        "starts": float(state.items[:, 1].sum()),
        "without a gap": int((ends[:-1] == state.items[1:, 1]).sum()),
        "which": float((state.items[:, 0] % 3).sum()),
        "log depth": float(np.log(np.maximum(pelvis[10, 1], 0.1))),
        "bearing": float(pelvis[10, 0] / pelvis[10, 1]),
        "sizes": float(state.sizes.sum()),
        "depths": float(np.log(np.maximum(where / 4.0, 0.1)).sum()),
        "yaws": float(np.cos(state.placements[:, 2] - 1.0).sum()),
        "latent": float(state.latent[5, 1]),
    }
    values |= {f"camera {i}": value for i, value in enumerate(state.camera.tolist())}
    squares = ("log depth", "bearing", "sizes", "latent", "yaws")
    return values | {f"{name} squared": values[name] ** 2 for name in squares}


def scores(
    n_pairs: int,
    *,
    steps: int = 60,
    change: Change = lambda mixture: mixture,
    drawn_with: DetectionModel | None = None,
    given: Experiment | None = None,
    fitted: bool = True,
    reference: Reference | None = None,
    seed: int = 0,
) -> dict[str, float]:
    """How many standard errors each quantity has changed by, on average over pairs."""
    given = given or poor_data()
    source = given if drawn_with is None else replace(given, detections=drawn_with)
    differences: dict[str, list[float]] = {}
    for rng in np.random.default_rng(seed).spawn(n_pairs):
        state = draw_state(rng, given.problem)
        seen = replace(source.observed(rng, state), detections=given.detections)
        problem = seen.problem
        shape = 0.5 * np.linalg.cholesky(np.linalg.inv(problem.camera_precision))
        mixture = change(scene_moves(setup(problem, fitted=fitted), reference, shape))
        density = partial(log_posterior, problem)
        at = init(density, state)
        for _ in range(steps):
            at, _ = step(rng, at, log_density_fn=density, mixture=mixture)
        before, after = asked(problem, state), asked(problem, at.state)
        for name, value in after.items():
            differences.setdefault(name, []).append(value - before[name])
    return in_standard_errors(differences)


def in_standard_errors(differences: dict[str, list[float]]) -> dict[str, float]:
    """Means over pairs of what has changed at all."""
    return {
        name: float(np.mean(d) / (np.std(d) / np.sqrt(len(d))))
        for name, d in differences.items()
        if np.std(d) > 0
    }


def largest(found: dict[str, float]) -> float:
    return max(abs(score) for score in found.values())


def test_scene_and_data_stay_what_they_were() -> None:
    found = scores(500)
    assert len(found) > 15
    assert largest(found) < LIMIT, found


@pytest.mark.slow
def test_scene_and_data_stay_what_they_were_to_a_few_per_cent() -> None:
    assert largest(found := scores(6000, seed=1)) < LIMIT, found


def only(
    kind: type, changed: Callable[[Proposal[State]], Proposal[State]], **options: object
) -> Change:
    """A move with other options and what undoes it, its own proposals changed."""

    class Wrong(kind):  # type: ignore[misc, valid-type]
        def propose(self, rng: np.random.Generator, state: State) -> Proposal[State] | None:
            proposal = super().propose(rng, state)
            return None if proposal is None else changed(proposal)

    def change(mixture: Mixture[State]) -> Mixture[State]:
        (right,) = (move for move in mixture.moves if type(move) is kind)
        given = {f.name: getattr(right, f.name) for f in fields(right) if f.init}
        wrong = Wrong(**given | options)
        undone = [move for move in mixture.moves if move.name == right.reverse != right.name]
        return Mixture([wrong, *undone], [1.0] * (1 + len(undone)))

    return change


@pytest.mark.parametrize(
    "kind",
    [moves.Shift, ReplaceAndShift, Refurnish, CompensatedCameraWalk, AdaptedCameraWalk],
)
def test_a_move_by_itself_leaves_scene_and_data(kind: type) -> None:
    """With so many scenelets that some have no gap to the next."""
    change = only(kind, lambda proposal: proposal)
    found = scores(400, change=change, given=poor_data(rate=0.3))
    assert largest(found) < LIMIT, found


def reference_of(problem: Problem) -> Reference:
    """Learnt from scenes of the prior: it knows nothing of the data."""
    rng, visits = np.random.default_rng(0), Visits()
    for _ in range(200):
        visits.note(draw_state(rng, problem))
    return learn(problem, setup(problem).candidates, setup(problem).similarity, visits)


def two_rungs(n_pairs: int, *, off: float = 0.0) -> dict[str, float]:
    """As :func:`scores`, of the colder of two rungs after a few rounds of exchanges.

    The hotter one is at the reference itself, from which every state of it is drawn, so that both
    are where they should be from the beginning.
    """
    given = poor_data(rate=0.3)
    reference = reference_of(given.problem)
    differences: dict[str, list[float]] = {}
    for rng in np.random.default_rng(0).spawn(n_pairs):
        state = draw_state(rng, given.problem)
        problem = replace(given.observed(rng, state), detections=given.detections).problem

        def target(state: State, problem: Problem = problem) -> Parts:
            parts = tempering_split(problem, reference, state)
            wrong = off * state.n_scenelets
            return Parts(parts.log_prior + wrong, parts.log_likelihood - wrong)

        independent = partial(draw_scene, reference)
        hot = independent(rng)
        while not np.isfinite(log_posterior(problem, hot)):
            hot = independent(rng)
        position = start((hot, state), target=target, betas=(0.0, 1.0))
        rounds = temper(
            rng.spawn(3), position, target=target, steps_per_swap=1, independent=independent,
            kernel=partial(step, mixture=Mixture([moves.PlacementWalk()], [1.0])),
            crossover=moves.TimeCrossover(problem),
        )  # fmt: skip
        *_, last = islice(rounds, 12)
        before, after = asked(problem, state), asked(problem, last.position.chains[-1].state)
        for name, value in after.items():
            differences.setdefault(name, []).append(value - before[name])
    return in_standard_errors(differences)


@pytest.mark.parametrize("off", [0.0, 4.0])
@pytest.mark.parametrize("kind", [SceneRedraw, StretchRedraw])
def test_draws_of_the_reference_leave_scene_and_data(kind: type, off: float) -> None:
    """Unless what is drawn is not as dense as is said, here by a factor a scenelet."""
    given = poor_data(rate=0.3)

    def wrong(proposal: Proposal[State]) -> Proposal[State]:
        return proposal._replace(
            log_ratio=proposal.log_ratio + off * proposal.state.n_scenelets
        )  # fmt: skip

    found = scores(
        400, steps=20, change=only(kind, wrong), given=given,
        reference=reference_of(given.problem),
    )  # fmt: skip
    assert (largest(found) > LIMIT) == (off > 0), found


@pytest.mark.parametrize("off", [0.0, 2.0])
def test_exchanges_with_the_reference_leave_scene_and_data(off: float) -> None:
    """Unless its density is not that of its draws: here by a factor a scenelet."""
    found = two_rungs(500, off=off)
    assert (largest(found) > LIMIT) == (off > 0), found


def test_a_forgotten_look_is_seen() -> None:
    change = only(CompensatedCameraWalk, lambda p: p._replace(log_ratio=0.0), scales=(1.0,))
    found = scores(900, change=change, given=poor_data(rate=0.3, depth=0.4))
    assert largest(found) > LIMIT, found


@pytest.mark.parametrize("forgotten", [False, True])
def test_a_forgotten_jacobian_is_seen(forgotten: bool) -> None:
    change = only(
        moves.PlacementWalk,
        lambda p: p._replace(log_ratio=0.0) if forgotten else p,
        scales=(4.0, 12.0),
    )
    found = scores(300, change=change, given=poor_data(rate=0.3, depth=0.4))
    assert (largest(found) > LIMIT) == forgotten, found


@pytest.mark.parametrize("factor", [1, len(worlds.mixed_library())])
def test_births_off_by_the_number_of_scenelets_are_seen(
    factor: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    right = Proposals.log_density

    def log_density(*args: Any, **options: Any) -> float:
        return right(*args, **options) - np.log(factor)

    monkeypatch.setattr(Proposals, "log_density", log_density)
    # Anything anywhere is tried, which among so little is accepted soonest.
    change = only(moves.Birth, lambda proposal: proposal)
    found = scores(300, change=change, given=poor_data(rate=0.02), fitted=False)
    assert (largest(found) > LIMIT) == (factor > 1), found


def test_hidden_and_seen_exchanged_is_seen() -> None:
    model = poor_data().detections
    exchanged = replace(
        model,
        confidence=model.confidence[::-1],
        error_scale=model.error_scale[::-1],
        error_dof=model.error_dof[::-1],
    )
    found = scores(300, drawn_with=exchanged)
    assert abs(found["log-likelihood"]) > LIMIT, found
