"""The detection model is a density, and its draws follow it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad

from imapper_prob.models.detector import DetectionModel, student_t
from imapper_prob.models.problem import pack_problem
from tests.runs import small_solution


def test_confidence_densities_integrate_to_one() -> None:
    model = DetectionModel()
    middles = (model.edges[1:] + model.edges[:-1]) / 2
    mass = (model.confidence_density(middles) * np.diff(model.edges)[:, None]).sum(0)
    np.testing.assert_allclose(mass, 1.0)


@pytest.mark.parametrize(("scale", "dof"), [(14.9, 4.1), (46.0, 1.2)])
def test_student_t_integrates_to_one_over_the_image_plane(scale: float, dof: float) -> None:
    def ring(r: float) -> float:
        return float(2 * np.pi * r * np.exp(student_t(r**2, scale, dof)))

    assert quad(ring, 0, np.inf)[0] == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("hidden", [False, True])
def test_draws_have_the_tabled_confidences_and_errors(hidden: bool) -> None:
    model = DetectionModel()
    rng = np.random.default_rng(3)
    n = 40000
    pixels, confidence = model.draw(rng, np.zeros((n, 2)), np.full(n, hidden), short_side=1080)
    counts = np.histogram(confidence, model.edges)[0] / n
    expected = model.confidence[0 if hidden else 1]
    # Five standard errors of a binomial share.
    assert np.all(np.abs(counts - expected) < 5 * np.sqrt(expected * (1 - expected) / n))
    for c in range(3):
        own = model.error_class(confidence) == c
        scale, dof = model.error_scale[int(not hidden), c], model.error_dof[int(not hidden), c]
        # Median of the radius: P(r > m) = (1 + m^2 / (nu s^2))^(-nu/2) = 1/2.
        median = scale * np.sqrt(dof * (2 ** (2 / dof) - 1))
        below = (np.linalg.norm(pixels[own], axis=1) < median).mean()
        assert abs(below - 0.5) < 5 * 0.5 / np.sqrt(own.sum())


def test_errors_grow_with_the_image() -> None:
    model = DetectionModel()
    small = model.error_tables(0.9, short_side=540)[0]
    np.testing.assert_allclose(2 * small, model.error_tables(0.9, short_side=1080)[0])


def test_a_camera_that_is_turned_has_the_same_errors() -> None:
    solved = small_solution()
    wide = solved.clip.camera
    tall = replace(wide, width=wide.height, height=wide.width)
    assert wide.short_side == tall.short_side == wide.height < wide.width
    scales = [
        pack_problem(
            replace(solved.clip, camera=camera), solved.path, solved.camera, solved.library
        ).error_scale
        for camera in (wide, tall)
    ]
    np.testing.assert_array_equal(*scales)
