"""Simulated clips that differ from the model in one thing."""

from __future__ import annotations

import numpy as np
import pytest

from imapper_prob.models.errors import InputError
from imapper_prob.models.skeleton import DETECTED
from imapper_prob.simulate.clips import NOMINAL_CAMERA
from lab.coverage import MODELS, simulated


@pytest.mark.parametrize("model", MODELS)
def test_a_clip_is_that_of_its_seed_and_hides_its_camera(model: str) -> None:
    clip, library = simulated(model, 3)
    again, _ = simulated(model, 3)
    assert clip.camera == NOMINAL_CAMERA
    assert clip.truth is not None
    assert clip.truth.camera != clip.camera
    np.testing.assert_array_equal(clip.tracks[0].keypoints, again.tracks[0].keypoints)
    assert library.name == simulated("plausible", 3)[1].name


def test_each_differs_in_one_thing() -> None:
    clips = {model: simulated(model, 3)[0] for model in MODELS}
    right, noisy, tilted = (clips[m] for m in ("plausible", "stronger noise", "tilted floor"))
    assert right.truth
    assert noisy.truth
    assert tilted.truth
    exact = right.truth.camera.project(right.truth.joints)
    seen = right.tracks[0].confidences[:, list(DETECTED)] > 0
    errors = [(c.tracks[0].keypoints - exact)[:, list(DETECTED)][seen] for c in (right, noisy)]
    np.testing.assert_allclose(errors[1], 3 * errors[0], atol=1e-9)
    np.testing.assert_array_equal(noisy.truth.joints, right.truth.joints)
    roll = tilted.truth.camera.roll - right.truth.camera.roll
    assert np.rad2deg(roll) == pytest.approx(8)
    other = clips["other scenelets"].truth
    assert other
    sizes = [o.cuboids[0].size.tolist() for t in (right.truth, other) for o in t.objects]
    assert sizes[0] not in sizes[1:]


def test_an_unknown_model_is_refused() -> None:
    with pytest.raises(InputError, match="no model 'left'"):
        simulated("left", 0)
