"""Answers of the true scene, and what they do to the entropy of layouts."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import imapper_prob as im
from imapper_prob.models.skeleton import PELV
from imapper_prob.uncertainty.questions import Question
from lab.questions import Settled, answer_of, draw, fall, main, page


def asked(about: im.Presence | im.Measured | im.DepthOf | im.JointAt) -> Question:
    return Question("?", 1.0, 0.1, about)


def test_the_truth_answers(rng: np.random.Generator) -> None:
    clip = im.demo_clip()
    truth = clip.truth
    assert truth is not None
    couch = next(o for o in truth.objects if o.label == "couch").placement
    about = [(couch.x + a, couch.y + b) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    for labels, there in ((("couch",), True), (("bed",), False)):
        presence = im.Presence(labels, region=tuple(about))
        assert answer_of(asked(presence), truth, clip, rng) is there
    height = answer_of(asked(im.Measured("height", 1.0, 0.02)), truth, clip, rng)
    assert height == pytest.approx(truth.camera.elevation, abs=0.1)
    assert answer_of(asked(im.Measured("stature", 1.7, 0.02)), truth, clip, rng) is None
    frame = int(clip.frame_ids[20])
    place = answer_of(asked(im.JointAt("PELV", frame, (0, 0, 0), 0.01)), truth, clip, rng)
    np.testing.assert_allclose(place, truth.joints[20, PELV], atol=0.05)
    depth = answer_of(asked(im.DepthOf((frame,), (1.0,), 0.001)), truth, clip, rng)
    assert depth == pytest.approx(truth.camera.to_camera(truth.joints[20, PELV])[1], rel=0.01)


def test_the_entropy_falls_by_what_weights_tell_of_layouts(rng: np.random.Generator) -> None:
    layouts = rng.choice(20, (2, 400))
    told = np.where(layouts < 10, 0.0, -np.inf).ravel()
    assert fall(layouts, told, rng) == pytest.approx(1.0, abs=0.15)
    # Few effective draws that have nothing to do with the layouts tell nothing of them.
    falls = [fall(layouts, 3.0 * rng.standard_normal(800), rng) for _ in range(40)]
    assert abs(np.mean(falls)) < 4 * np.std(falls) / np.sqrt(40)
    assert np.std(falls) < 1.0


def test_the_page_says_by_how_much_entropies_fell(rng: np.random.Generator, tmp_path: Path) -> None:
    clips = [[Settled("a", 0.8, 0.1, 0.7), Settled("b", 0.2, 0.1, 0.3)]] * 4
    text = page(clips, rng)
    assert "| ranked first | 4 | 0.80 | 0.70 | -0.10" in text
    assert "| another, at random | 4 | 0.20 | 0.30 | +0.10" in text
    assert "| 0.6 bit and more | 4 |" in text
    draw(clips, tmp_path / "picture.png")
    assert (tmp_path / "picture.png").stat().st_size > 5000


@pytest.mark.slow
def test_a_clip_is_asked_and_answered(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for _ in range(2):
        main([str(tmp_path), "--clips", "1", "--steps", "200", "--workers", "1"])
        said = capsys.readouterr()
        assert "predicted, bit" in said.out
        assert "1 of 1" in said.err
