"""The statistics of a run, held against its draws."""

from __future__ import annotations

import numpy as np

from imapper_prob.models.log_posterior import motion, side_flips
from imapper_prob.models.path_prior import CAMERA
from imapper_prob.models.skeleton import PELV
from imapper_prob.uncertainty.hidden import cut_by
from imapper_prob.uncertainty.motion import height_deviation
from imapper_prob.uncertainty.occupancy import occupancy
from tests.models.worlds import deviations
from tests.runs import posterior


def test_occupancy_is_that_of_the_draws() -> None:
    run = posterior()
    found = run.occupancy(cell=0.2)
    everything = [o for objects in run.samples.objects for o in objects]
    assert set(found.categories) == {o.label for o in everything}
    assert 0 < found.anything.max() <= 1
    assert (found.by_category.max(0) <= found.anything + 1e-12).all()
    assert (found.anything <= found.by_category.sum(0) + 1e-12).all()
    # The furniture of all draws, displaced by the errors of its place.
    direct = occupancy(run.furniture, cell=0.2)
    np.testing.assert_array_equal(found.anything, direct.anything)
    assert not np.array_equal(found.anything, occupancy(run.samples.objects, cell=0.2).anything)


def test_clusters_add_up_to_the_number_of_objects() -> None:
    run = posterior()
    clusters = run.clusters(least=0.0)
    number = np.mean([len(objects) for objects in run.samples.objects])
    assert np.isclose(sum(c.presence for c in clusters), number)
    presence = [c.presence for c in clusters]
    assert presence == sorted(presence, reverse=True)
    assert len(run.clusters()) <= len(clusters)


def test_joints_are_those_of_the_draws() -> None:
    run = posterior()
    found = run.joints()
    problem = run.solution.problem
    pelvis = np.array([motion(problem, state)[:, PELV] for state in run.samples.states])
    np.testing.assert_allclose(found.mean[:, PELV], pelvis.mean(0))
    np.testing.assert_allclose(
        found.standard_deviation[:, PELV, :2], pelvis.std(0, ddof=1)[:, :2], atol=1e-9
    )
    # Heights are less sure than what is drawn of scene and path.
    variance = pelvis.var(0, ddof=1)[:, 2] + height_deviation(problem, found.mean) ** 2
    np.testing.assert_allclose(found.standard_deviation[:, PELV, 2] ** 2, variance)
    assert np.linalg.eigvalsh(found.covariance).min() > -1e-9


def test_hidden_joints_of_one_draw_are_in_the_mean() -> None:
    run = posterior()
    found = run.hidden()
    assert found.probability.shape == (run.clip.n_frames, 16)
    assert (found.by_object <= found.probability + 1e-12).all()
    assert 0 < found.probability.max() <= 1
    assert [c.label for c in found.clusters] == [c.label for c in run.clusters()]
    # Each draw has its own furniture, motion and camera.
    total = np.zeros(found.probability.shape)
    for objects, state in zip(run.samples.objects, run.samples.states, strict=True):
        joints = motion(run.solution.problem, state)
        cut = [cut_by(o, joints, float(state.camera[1])) for o in objects]
        total += np.any(cut, axis=0) if cut else 0.0
    np.testing.assert_allclose(found.probability, total / len(run.samples.states))


def test_flipped_sides_are_means_over_draws() -> None:
    run = posterior()
    flips = [side_flips(run.solution.problem, state) for state in run.samples.states]
    # They are stored in single precision.
    np.testing.assert_allclose(run.sides_flipped, np.mean(flips, 0), rtol=1e-5, atol=1e-7)


def test_nuisances_have_the_prior_of_the_solution() -> None:
    run = posterior()
    found = run.nuisances()
    assert tuple(found) == CAMERA
    prior = run.solution.camera
    np.testing.assert_array_equal([n.prior_mean for n in found.values()], prior.mean)
    spreads = [n.prior_standard_deviation for n in found.values()]
    np.testing.assert_allclose(spreads, deviations(prior))
    first = run.samples.states[0]
    assert [n.draws[0, 0] for n in found.values()] == first.camera.tolist()
    assert motion(run.solution.problem, first).shape == run.joints().mean.shape
