"""What joins a scenelet is drawn from a density that is known, and can be taken away again."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm

from imapper_prob.models.posterior import State, empty_state, motion
from imapper_prob.models.skeleton import PELV
from imapper_prob.sampling.extend import Continuations, Extend, Retract
from imapper_prob.sampling.proposals import Proposals
from tests.models import worlds
from tests.sampling.test_moves import candidates, random_state

PROBLEM = worlds.problem(20)
CONTINUATIONS = Continuations(Proposals(PROBLEM, candidates()))
LENGTH = int(PROBLEM.lengths[0])


def one_in_the_middle() -> State:
    state = empty_state(PROBLEM).with_item(0, 7, np.array([0.3, 4.0, 0.5]), 0.02)
    camera = PROBLEM.camera_mean + np.array([0.01, 0.05, -0.02, 0.03, 0.02])
    return State(camera, state.items, state.placements, state.sizes, state.latent)


@pytest.mark.parametrize("later", [False, True])
def test_what_may_join_has_a_density(later: bool) -> None:
    """The mean of h / q over draws of q is the integral of h, here of a density: one."""
    state, rng = one_in_the_middle(), np.random.default_rng(1)
    drawn = [CONTINUATIONS.draw(rng, state, 0, later=later) for _ in range(20_000)]
    own = np.array([[*d[2], d[3]] for d in drawn if d is not None and d[0] == 0])
    mean, spread = own.mean(0), 0.6 * own.std(0)
    ratios = []
    for d in drawn:
        assert d is not None
        values = np.array([*d[2], d[3]])
        log_h = norm.logpdf(values, mean, spread).sum() if d[0] == 0 else -np.inf
        ratios.append(np.exp(log_h - CONTINUATIONS.log_density(state, 0, d, later=later)))
    error = np.std(ratios) / np.sqrt(len(ratios))
    assert error < 0.1
    assert abs(np.mean(ratios) - 1) < 4.5 * error


@pytest.mark.parametrize("later", [False, True])
def test_who_joins_goes_on_where_the_other_ends(later: bool) -> None:
    state, rng = one_in_the_middle(), np.random.default_rng(2)
    gaps = []
    for _ in range(200):
        drawn = CONTINUATIONS.draw(rng, state, 0, later=later)
        assert drawn is not None
        new = state.with_item(*drawn)
        starts, lengths = new.items[:, 1], PROBLEM.lengths[new.items[:, 0]]
        assert starts[1] == starts[0] + lengths[0]
        pelvis = motion(PROBLEM, new)[:, PELV]
        gaps.append(pelvis[starts[1]] - pelvis[starts[1] - 1])
    # Half of the blurs are 1 % of 4 m and half 3 %: .09 m root mean square along the ray.
    assert np.median(np.linalg.norm(np.array(gaps)[:, :2], axis=1)) < 0.1


def test_ratios_are_explained_by_both_directions() -> None:
    extend, retract = Extend(CONTINUATIONS), Retract(CONTINUATIONS)
    seen = {"extend": 0, "retract": 0}
    for seed in range(300):
        state, rng = random_state(PROBLEM, seed), np.random.default_rng(seed)
        for move, back in ((extend, retract), (retract, extend)):
            proposal = move.propose(rng, state)
            if proposal is None:
                continue
            seen[move.name] += 1
            forward = move.explain(state, proposal.state)
            backward = back.explain(proposal.state, state)
            assert proposal.log_ratio == pytest.approx(backward - forward, abs=1e-8)
    assert min(seen.values()) > 20


def test_one_between_two_can_have_come_from_either() -> None:
    extend = Extend(CONTINUATIONS)
    place = np.array([0.3, 4.0, 0.5])
    outer = empty_state(PROBLEM).with_item(0, 1, place).with_item(0, 1 + 2 * LENGTH, place)
    rng = np.random.default_rng(3)
    drawn = next(
        d
        for d in (CONTINUATIONS.draw(rng, outer, 0, later=True) for _ in range(1000))
        if d is not None and d[0] == 0
    )
    both = outer.with_item(*drawn)
    ways = [
        CONTINUATIONS.log_density(outer, index, drawn, later=later)
        for index, later in ((0, True), (1, False))
    ]
    assert extend.explain(outer, both) == pytest.approx(np.logaddexp(*ways) - np.log(4))
    assert Retract(CONTINUATIONS).explain(both, outer) == pytest.approx(np.log(2 / 6))
    alone = empty_state(PROBLEM).with_item(0, 1, place)
    assert Retract(CONTINUATIONS).propose(rng, alone) is None
