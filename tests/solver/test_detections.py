"""Confidences on the scale of the detector's tables."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from imapper_prob.models.detector import DetectionModel, DetectorSettings
from imapper_prob.models.scene import Track
from imapper_prob.solver.detections import own_detections, with_usual_confidences
from imapper_prob.solver.static_path import estimate_static_path
from tests.solver.walkers import walk

CLIP = walk(np.random.default_rng(0), pixel_error=5.0).clip
TRACK = CLIP.tracks[0]


def graded(factor: float, seed: int = 0) -> Track:
    """The track with confidences of .5 to .95, of which every joint has some, times a factor."""
    rng = np.random.default_rng(seed)
    drawn = factor * rng.uniform(0.5, 0.95, TRACK.confidences.shape)
    return replace(TRACK, confidences=np.where(TRACK.confidences > 0, drawn, 0.0))


def test_usual_confidences_are_left_alone() -> None:
    track = graded(1.0)
    assert with_usual_confidences(track) is track


@pytest.mark.parametrize("factor", [0.3, 0.5, 0.6])
def test_low_confidences_are_brought_to_the_scale_of_the_tables(factor: float) -> None:
    """Another unit of confidence changes neither detections nor path."""
    low = with_usual_confidences(graded(factor))
    other = with_usual_confidences(graded(factor / 1.2))
    np.testing.assert_allclose(low.confidences, other.confidences, rtol=1e-12)
    hidden, seen = DetectionModel().confidence_density(np.quantile(low.confidences, 0.95))
    assert seen > hidden
    paths = [
        estimate_static_path(replace(CLIP, tracks=(graded(f),))).pelvis
        for f in (factor, factor / 1.2)
    ]
    np.testing.assert_allclose(*paths, rtol=1e-9)


def test_own_detections_have_usual_confidences() -> None:
    (own,) = own_detections(replace(CLIP, tracks=(graded(0.5),))).tracks
    assert np.array_equal(own.confidences, with_usual_confidences(graded(0.5)).confidences)


def test_confidences_are_judged_by_the_tables_of_the_settings() -> None:
    """For a detector that is as sure of nothing, low confidences are usual."""
    low = graded(0.3)
    assert with_usual_confidences(low) is not low
    detector = DetectorSettings()
    flipped = replace(
        detector,
        seen_confidence=detector.hidden_confidence,
        hidden_confidence=detector.seen_confidence,
    )
    assert with_usual_confidences(low, flipped) is low
    (own,) = own_detections(replace(CLIP, tracks=(low,)), flipped).tracks
    assert np.array_equal(own.confidences, low.confidences)


def test_a_track_without_detections_is_left_alone() -> None:
    track = replace(TRACK, confidences=np.zeros_like(TRACK.confidences))
    assert with_usual_confidences(track) is track
