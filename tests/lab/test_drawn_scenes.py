"""Scenes drawn from the model, and where they lie in their posteriors."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from imapper_prob.models.skeleton import SCORED
from imapper_prob.scenelets.library import built_in_library
from lab import coverage
from lab.coverage import FRAMES, region_ranks
from lab.prior import Experiment
from lab.sbc import SETTINGS, Drawn, short_clip

BRIEF = replace(SETTINGS, steps=400, draws=40)


@cache
def experiment() -> Experiment:
    return short_clip(built_in_library(), every=4, frames=FRAMES)


@pytest.mark.slow
def test_every_joint_of_every_frame_has_a_rank() -> None:
    ranks, again = (region_ranks(experiment(), 5, BRIEF) for _ in range(2))
    assert len(ranks["pelvis"]) == FRAMES
    assert len(ranks["joints"]) == FRAMES * len(SCORED)
    assert len(ranks["hidden"]) < len(ranks["joints"])
    assert len(ranks["objects"]) <= 1
    for kind, values in ranks.items():
        assert ((values >= 0) & (values <= 1)).all()
        np.testing.assert_array_equal(values, again[kind])


def test_who_stands_elsewhere_is_outside(monkeypatch) -> None:  # type: ignore[no-untyped-def]
    """Draws of one scene's posterior, held against a room twice as far away."""
    right = coverage.draw_and_sample

    def elsewhere(*args) -> Drawn:  # type: ignore[no-untyped-def]
        found = right(*args)
        camera, placements = found.truth.camera.copy(), found.truth.placements.copy()
        camera[3] += np.log(2)
        placements[:, :2] *= 2
        far = replace(found.truth, camera=camera, placements=placements)
        return replace(found, truth=far)

    monkeypatch.setattr(coverage, "draw_and_sample", elsewhere)
    ranks = region_ranks(experiment(), 5, BRIEF)
    assert (ranks["pelvis"] > 0.9).mean() > 0.8
