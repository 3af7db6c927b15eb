"""The file of constants is what the script makes of the scenes, and what the program uses."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from imapper_prob.clips.i3db import read_i3db, read_i3db_truth
from imapper_prob.models.calibrated import PATH, calibrated, constants, parsed
from imapper_prob.models.detector import DetectionModel
from imapper_prob.models.scene import Clip, Truth
from imapper_prob.models.settings import CameraSettings, ModelSettings, StaticPathSettings
from imapper_prob.scenelets.library import built_in_library
from lab.calibrate import as_markdown, as_toml, calibrate
from lab.calibrate.constants import FROM_FITS, FROM_PATH, FROM_TRUTH, KEPT, estimate
from lab.calibrate.evidence import look, place
from lab.calibrate.procedure import rounded

ROOT = Path(__file__).parents[3]
CORPUS = ROOT.parent / "shared" / "i3db"
corpus = pytest.mark.skipif(not CORPUS.is_dir(), reason="i3DB scenes are not beside the repository")


def scenes() -> list[tuple[Clip, Truth]]:
    clips = [(f, read_i3db(f)) for f in sorted(CORPUS.iterdir()) if (f / "gt").is_dir()]
    return [(clip, read_i3db_truth(folder, clip)) for folder, clip in clips]


def test_every_constant_has_figure_unit_source_and_spread() -> None:
    estimators = {e.name: e for e in (*FROM_TRUTH, *FROM_PATH, *FROM_FITS)}
    assert set(constants()) == set(estimators)
    for name, constant in constants().items():
        own = estimators[name]
        assert (constant.unit, constant.meaning, constant.source) == (
            own.unit, own.meaning, own.source,
        )  # fmt: skip
        assert len(constant.folds) == 4, name
        assert np.shape(constant.error) == np.shape(constant.measured) == np.shape(constant.value)
        assert np.all(np.asarray(constant.value) > 0), name


def test_what_is_used_is_what_was_measured_or_there_is_a_reason() -> None:
    for name, constant in constants().items():
        if name in KEPT:
            assert (constant.value, constant.kept) == KEPT[name]
        else:
            assert (constant.value, constant.kept) == (constant.measured, ""), name


def test_the_settings_take_their_values_from_the_file() -> None:
    model, path, camera = ModelSettings(), StaticPathSettings(), CameraSettings()
    assert model.frame_weight == 1 / (10 * calibrated("scores.repeat_time"))
    assert (model.walk_bearing, path.walk_bearing) == (calibrated("walk.bearing"),) * 2
    assert model.pose_tolerance == constants()["pose.tolerance"].value
    assert path.bias_factor_along == calibrated("bias.along")
    assert camera.ankle_spread == calibrated("ankle.spread")
    detections = DetectionModel()
    np.testing.assert_array_equal(
        detections.error_dof[1, 1:], constants()["detections.seen_error_dof"].value
    )
    np.testing.assert_allclose(
        detections.confidence[0], constants()["detections.hidden_confidence"].value, atol=2e-3
    )


def test_a_row_is_not_a_number() -> None:
    with pytest.raises(TypeError, match="row of numbers"):
        calibrated("detections.seen_confidence")


def test_the_file_can_be_written_and_read() -> None:
    quoted = dict(constants())
    quoted["walk.bearing"] = replace(quoted["walk.bearing"], kept='a "reason" \\ why')
    assert dict(parsed(as_toml(quoted, heading=("one", "two")))) == quoted


def test_the_documentation_holds_the_same_table() -> None:
    document = (ROOT / "docs" / "research" / "calibration.md").read_text(encoding="utf-8")
    assert as_markdown(constants()) in document


@pytest.mark.corpus
@corpus
@pytest.mark.slow
def test_the_scenes_give_what_is_stored() -> None:
    evidence = [look(*scene) for scene in scenes()]
    for name, value in estimate(FROM_TRUTH, evidence).items():
        assert rounded(value) == constants()[name].measured, name
    values = {name: constant.value for name, constant in constants().items()}
    placed = [place(one, built_in_library(), values) for one in evidence[:2]]
    for name, value in estimate(FROM_PATH, placed).items():
        assert np.all(np.isfinite(value)), name


@pytest.mark.slow
@pytest.mark.corpus
@corpus
def test_the_whole_file_is_reproduced() -> None:
    found = calibrate(scenes(), built_in_library())
    assert set(found) == set(parsed(PATH.read_text(encoding="utf-8")))
    for name, constant in found.items():
        stored = constants()[name]
        np.testing.assert_allclose(constant.measured, stored.measured, rtol=0.02, err_msg=name)
        np.testing.assert_allclose(constant.folds, stored.folds, rtol=0.05, err_msg=name)
