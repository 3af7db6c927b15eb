"""Compiled steps are those of the sampler, and what chains say is the log-posterior."""

from __future__ import annotations

import math

import numpy as np
import pytest

from imapper_prob.models.log_posterior import State, empty_state, log_posterior
from imapper_prob.models.settings import ModelSettings
from imapper_prob.samplers.reversible_jump import init, step
from imapper_prob.samplers.tempering import POSTERIOR, PRIOR, Rung
from imapper_prob.sampling import steps
from imapper_prob.sampling.learning import learn
from imapper_prob.sampling.reference import Reference
from imapper_prob.sampling.reference_density import log_reference
from imapper_prob.sampling.steps import MOVES, SceneChain, parts_of
from imapper_prob.sampling.visits import Visits
from tests.models import worlds
from tests.sampling.scenes import mixture_of, moves_of, random_gains, random_state, similarity

PROBLEM = worlds.problem(20)


def reference() -> Reference:
    visits = Visits()
    visits.note(empty_state(PROBLEM).with_item(1, 4, np.array([0.1, 4.0, 0.3])))
    return learn(PROBLEM, random_gains(PROBLEM), similarity(), visits)


@pytest.mark.parametrize("energy", ["default", "paper"])
def test_walkers_say_of_every_proposal_what_the_model_says(energy: str) -> None:
    problem = worlds.problem(20, settings=ModelSettings(energy=energy))
    state, rng = empty_state(problem), np.random.default_rng(4)
    moves = moves_of(problem)
    mixture, scene_chain = mixture_of(moves), SceneChain(problem, moves, state)
    counts = set()
    for _ in range(1000):
        proposal = mixture.choose(rng).propose(rng, state)
        if proposal is None:
            continue
        told, whole = (
            scene_chain(proposal.state),
            parts_of(problem, moves.reference, proposal.state),
        )
        assert told.log_prior == pytest.approx(whole.log_prior, abs=1e-4)
        assert told.log_likelihood == pytest.approx(whole.log_likelihood, abs=1e-4)
        if np.isfinite(whole.at(Rung(0.5))) and rng.random() < 0.3:
            state = proposal.state
            scene_chain.move(state)
            counts.add(state.n_scenelets)
    assert len(counts) > 2


def test_a_density_that_is_no_number_stops_the_chain() -> None:
    broken = PROBLEM._replace(path_scale=np.full_like(PROBLEM.path_scale, np.nan))
    moves = moves_of(PROBLEM)
    scene_chain = SceneChain(PROBLEM, moves, empty_state(PROBLEM))
    scene_chain.advance(np.random.default_rng(5), Rung(0.5, (0.0,) * 4), 20)
    with pytest.raises(FloatingPointError):
        SceneChain(broken, moves, empty_state(broken)).advance(
            np.random.default_rng(5), Rung(0.5, (0.0,) * 4), 300
        )


@pytest.mark.parametrize("energy", ["default", "paper"])
def test_compiled_steps_are_those_of_the_sampler(energy: str) -> None:
    """Step by step, from the same numbers at random; values differ in their last digits.

    Compiled steps abandon proposals that are certain to be rejected.
    """
    problem = worlds.problem(20, settings=ModelSettings(energy=energy, scenelet_rate=0.3))
    moves = moves_of(problem)
    kinds = int(moves.reference.kinds.max()) + 1
    rung = Rung(0.02, tuple(np.linspace(-0.8, 0.8, kinds).tolist()))

    def density(state: State) -> float:
        return parts_of(problem, moves.reference, state).at(rung)

    one, other = (np.random.default_rng(5) for _ in range(2))
    scene_chain, mixture = SceneChain(problem, moves, empty_state(problem)), mixture_of(moves)
    at, seen, abandoned = init(density, empty_state(problem)), set(), 0
    for _ in range(1500):
        chain, (made,) = scene_chain.advance(one, rung, 1)
        # A mixture draws one number to choose by, as compiled steps do.
        at, info = step(other, at, log_density_fn=density, mixture=mixture)
        assert (made.move, made.accepted) == (info.move, info.accepted)
        if made.log_acceptance == -math.inf < info.log_acceptance:
            abandoned += 1
        else:
            assert made.log_acceptance == pytest.approx(info.log_acceptance, abs=1e-4)
        np.testing.assert_array_equal(chain.state.items, at.state.items)
        np.testing.assert_allclose(chain.state.placements, at.state.placements)
        assert chain.log_density == pytest.approx(at.log_density, abs=1e-4)
        seen.add((made.move, made.accepted))
    assert {move for move, _ in seen} == {move.name for move in mixture.moves}
    assert len({move for move, accepted in seen if accepted}) > 8
    assert (abandoned > 100) == (energy == "default")


def test_more_scenelets_find_room(monkeypatch: pytest.MonkeyPatch) -> None:
    """Than there was room for in the beginning, in compiled steps and outside of them."""
    monkeypatch.setattr(steps, "_CAPACITY", 1)
    problem = worlds.problem(20, settings=ModelSettings(likelihood=0.0, scenelet_rate=5.0))
    moves, rng = moves_of(problem), np.random.default_rng(1)
    scene_chain, counts = SceneChain(problem, moves, empty_state(problem)), []
    for _ in range(500):
        chain, _ = scene_chain.advance(rng, PRIOR, 10)
        assert scene_chain(chain.state) == scene_chain(State(**vars(chain.state)))
        whole = parts_of(problem, moves.reference, chain.state)
        assert chain.log_density == pytest.approx(whole.at(PRIOR), abs=1e-4)
        counts.append(chain.state.n_scenelets)
    assert max(counts) > 2
    several = max((random_state(problem, seed) for seed in range(20)), key=lambda s: s.n_scenelets)
    scene_chain = SceneChain(problem, moves, empty_state(problem))
    told = scene_chain(several)
    scene_chain.move(several)
    assert scene_chain(several) == told
    assert told.at(POSTERIOR) == pytest.approx(log_posterior(problem, several), abs=1e-4)


def test_steps_at_once_or_one_by_one() -> None:
    moves = moves_of(PROBLEM)
    whole, single = (SceneChain(PROBLEM, moves, empty_state(PROBLEM)) for _ in range(2))
    one, other = (np.random.default_rng(3) for _ in range(2))
    chain, infos = whole.advance(one, Rung(0.5), 200)
    made = [single.advance(other, Rung(0.5), 1) for _ in range(200)]
    assert infos == tuple(info for _, (info,) in made)
    assert chain.log_density == made[-1][0].log_density


def test_no_number_is_refused_by_the_name_of_the_move() -> None:
    moves, only = moves_of(PROBLEM), np.array([float(name == "replace") for name in MOVES])
    back = moves.reference.similar_to.copy()
    back[0, 1:] = np.inf
    moves = moves._replace(reference=moves.reference._replace(similar_to=back), weights=only)
    state = empty_state(PROBLEM).with_item(0, 4, np.array([0.1, 4.0, 0.3]))
    scene_chain = SceneChain(PROBLEM, moves, state)
    with pytest.raises(FloatingPointError, match="move 'replace'"):
        scene_chain.advance(np.random.default_rng(0), POSTERIOR, 200)


def test_parts_go_from_the_reference_to_the_log_posterior() -> None:
    known = reference()
    state: State = empty_state(PROBLEM).with_item(1, 4, np.array([0.1, 4.0, 0.3]))
    parts = parts_of(PROBLEM, known, state)
    assert parts.at(POSTERIOR) == pytest.approx(log_posterior(PROBLEM, state), rel=1e-12)
    of_reference = log_reference(
        known, state.camera, state.items, state.placements, state.sizes
    )  # fmt: skip
    assert parts.at(PRIOR) == of_reference


def test_outside_the_support_of_the_reference_nothing_is_said() -> None:
    state = empty_state(PROBLEM).with_item(1, 4, np.array([0.1, -4.0, 0.3]))
    parts = parts_of(PROBLEM, reference(), state)
    assert parts.at(PRIOR) == parts.at(Rung(0.5)) == -np.inf
