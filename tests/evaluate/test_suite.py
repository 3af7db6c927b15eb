"""The whole benchmark: what is done is not done again, and what is scored is written."""

from __future__ import annotations

import json
from argparse import Namespace
from concurrent.futures import Executor, Future
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import imapper_prob.cli.evaluate as evaluate_command
from imapper_prob.cli import main
from imapper_prob.cli.evaluate import _require_files_of_methods
from imapper_prob.clips.load import load_clip, write_clip
from imapper_prob.config import Config, SampleSettings
from imapper_prob.evaluate.i3db import read_authors
from imapper_prob.evaluate.prediction import SOLVER, write_prediction
from imapper_prob.evaluate.probability import LIKELY
from imapper_prob.evaluate.report import Exploration, exploration_figure
from imapper_prob.evaluate.score import scenes_with_truth
from imapper_prob.evaluate.suite import (
    evaluate,
    first_part,
    library_of,
    prepare_suite,
    sample_all,
    sampled,
    solve_all,
    tasks_of,
    truth_of_part,
)
from imapper_prob.models.errors import InputError
from imapper_prob.results.posterior import Posterior
from tests.conftest import CORPUS
from tests.evaluate.scenes import prediction, truth
from tests.evaluate.test_prediction_file import clip
from tests.runs import small_posterior

corpus = pytest.mark.skipif(not CORPUS.is_dir(), reason=f"the i3DB scenes are not at {CORPUS}")


class Nobody(Executor):
    """Refuses all work."""

    def submit(self, *_: Any, **__: Any) -> Future[Any]:
        raise AssertionError("nothing is left to do")


@pytest.fixture
def suite(tmp_path: Path) -> Path:
    """A suite whose solver found what the authors did."""
    folder = tmp_path / "suite"
    prepare_suite(folder, Config(), others=None)
    for scene in scenes_with_truth(CORPUS):
        (folder / scene.name).mkdir()
        solution = folder / scene.name / "solver.json"
        found = replace(read_authors(scene), name=SOLVER)
        write_prediction(solution, found, load_clip(scene))
    return folder


def test_a_part_of_a_clip_has_its_first_frames() -> None:
    whole, known = clip(), truth()
    half = first_part(whole, 0.5)
    assert half.n_frames == 6
    np.testing.assert_array_equal(half.tracks[0].keypoints, whole.tracks[0].keypoints[:6])
    cut = truth_of_part(known, 0.5)
    assert len(cut.joints) == len(cut.pixels) == len(cut.hidden) == 6
    assert cut.used == known.used
    assert first_part(whole, 1.0) is whole
    # Rows of a second person follow those of the first.
    both = {
        name: np.concatenate([getattr(known, name)] * 2) for name in ("joints", "pixels", "hidden")
    }
    actions = tuple(f"{who} {t}" for who in "ab" for t in range(len(known.joints)))
    cut = truth_of_part(replace(known, **both, actions=actions), 0.5)
    np.testing.assert_array_equal(cut.joints[6:], known.joints[:6])
    assert cut.actions == tuple(f"{who} {t}" for who in "ab" for t in range(6))


def test_a_folder_of_other_settings_is_refused(tmp_path: Path) -> None:
    folder = tmp_path / "suite"
    prepare_suite(folder, Config(), others=None)
    prepare_suite(folder, Config(), others=None)
    with pytest.raises(InputError, match="results of another config"):
        prepare_suite(folder, Config(sample=SampleSettings(steps=500, draws=9)), others=None)
    with pytest.raises(InputError, match="scenelets of the other scenes"):
        prepare_suite(folder, Config(), others=tmp_path)
    (tmp_path / "thesis.txt").write_text("years of work")
    with pytest.raises(InputError, match="holds no suite"):
        prepare_suite(tmp_path, Config(), others=None)


def test_what_is_known_after_parts_of_a_clip_is_drawn() -> None:
    explored = [
        Exploration(part, evaluate([(truth(), [prediction(), empty])]).summaries, spread)
        for empty in [replace(prediction(), name="nothing")]
        for part, spread in ((0.5, 40.0), (1.0, 20.0))
    ]
    found, furniture, joints = exploration_figure(explored).axes
    assert [line.get_label() for line in furniture.lines] == ["guess", "nothing", "between draws"]
    assert furniture.lines[-1].get_ydata().tolist() == [40.0, 20.0]
    for axes, unit in ((found, "share"), (furniture, "[cm]"), (joints, "[cm]")):
        assert unit in axes.get_ylabel()
        assert axes.lines[0].get_xdata().tolist() == [50.0, 100.0]


def test_two_results_of_one_name_are_refused() -> None:
    with pytest.raises(InputError, match=f"two results for {truth().name} are called so"):
        evaluate([(truth(), [prediction(), prediction()])])


def test_no_scenes_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no i3DB scene there"):
        scenes_with_truth(tmp_path)


def test_what_is_sampled_is_not_sampled_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run, calls = small_posterior(), []

    def sample(*_: Any, checkpoints: Path, **__: Any) -> Posterior:
        calls.append(checkpoints)
        checkpoints.mkdir(parents=True, exist_ok=True)
        return replace(run, samples=replace(run.samples, finished=len(calls) > 1))

    monkeypatch.setattr("imapper_prob.evaluate.suite.sample", sample)
    write_clip(tmp_path / "demo.npz", run.clip)
    tasks = tasks_of([tmp_path / "demo.npz"], tmp_path / "out", Config())
    # Interrupted, it is not done; the checkpoints stay, and the same call goes on.
    assert not sample_all(tasks, workers=1)
    assert calls[0].is_dir()
    assert not tasks[0].is_sampled
    assert sample_all(tasks, workers=1)
    assert not calls[0].exists()
    assert sample_all(tasks, workers=1)
    assert len(calls) == 2
    ((_, again),) = sampled(tasks)
    assert again.clip.name == "demo"


@corpus
@pytest.mark.corpus
def test_what_is_solved_is_not_solved_again(suite: Path) -> None:
    solve_all(tasks_of(scenes_with_truth(CORPUS), suite, Config()), Nobody())


@corpus
@pytest.mark.corpus
def test_the_library_leaves_its_own_scene_out() -> None:
    (task, *_) = tasks_of(scenes_with_truth(CORPUS), Path("out"), Config(), others=CORPUS)
    names = [scenelet.name for scenelet in library_of(task)]
    assert any(name.startswith("Scene10-") for name in names)
    assert not any(name.startswith(task.scene.name) for name in names)


@corpus
@pytest.mark.corpus
def test_the_page_has_every_table(suite: Path, capsys: pytest.CaptureFixture[str]) -> None:
    others = suite.parent / "others"
    for scene in scenes_with_truth(CORPUS):
        (others / scene.name).mkdir(parents=True)
        made = json.loads((suite / scene.name / "solver.json").read_text())
        (others / scene.name / "depth.json").write_text(json.dumps(made | {"method": "VNect"}))
    arguments = ["evaluate", "--suite", str(CORPUS), "--solver-only", "-o", str(suite)]
    regions = suite.parent / "regions"
    (regions / "Scene04").mkdir(parents=True)
    # The whole picture is couch: of couch and table one is found.
    seen = [
        {"image_id": f, "category_id": 63, "bbox": [0, 0, 1920, 1080], "score": 0.9}
        for f in range(1, 116)
    ]
    (regions / "Scene04" / "mask-rcnn.json").write_text(json.dumps(seen))
    arguments += ["--detections", str(regions), "--predictions", str(others)]
    assert main([*arguments, "--workers", "1"]) == 0
    assert "Differences object by object" in capsys.readouterr().out
    page = (suite / "benchmark.md").read_text()
    row = "| authors' output | 4 clips | 53 (27) | 46 | 56 | 15 of 17 | 6.9 | 9 | 18 | 19 | 0.27 |"
    assert row in page
    assert row.replace("authors' output", "VNect") in page
    row = "| Scene4 | Scene04 | – / 25.1 / 91.6 | – / 20.7 / 104.1 | – | 61.8 / 13.6 / 46.3 |"
    assert row in page
    assert "| 61.8 / 13.6 / 46.3 | yes |" in page
    assert "| Scene4 | Scene04 | 115 / 115 | 0.77 / 0.70 | 2 / 2 | 2 / 1 (mask-rcnn) |" in page
    assert "| authors' output | couch on static path |" not in page
    document = json.loads((suite / "evaluation.json").read_text())
    (authors,) = [m for m in document["methods"] if m["name"] == "VNect"]
    assert (authors["found"], authors["spurious"]) == (15, 9)
    for name in ("Scene04.png", "Scene14.png"):
        assert (suite / name).stat().st_size > 10_000


def _of_methods(folder: Path) -> Namespace:
    return Namespace(suite=folder / "i3db", predictions=None, detections=None, depths=None)


@pytest.mark.parametrize("option", ["predictions", "detections", "depths"])
def test_a_folder_without_files_of_the_scenes_is_refused(tmp_path: Path, option: str) -> None:
    (tmp_path / "theirs").mkdir()
    (tmp_path / "theirs" / "Scene04.json").touch()
    said = _of_methods(tmp_path)
    setattr(said, option, tmp_path / "theirs")
    with pytest.raises(InputError, match=rf"--{option} .*theirs: has no file of any scene"):
        _require_files_of_methods(said, [tmp_path / "i3db" / "Scene04"])
    (tmp_path / "theirs" / "Scene04").mkdir()
    (tmp_path / "theirs" / "Scene04" / f"a.{'npz' if option == 'depths' else 'json'}").touch()
    _require_files_of_methods(said, [tmp_path / "i3db" / "Scene04"])


@pytest.mark.parametrize(
    ("option", "file"),
    [("predictions", "a.json"), ("detections", "a.json"), ("depths", "a.npz")],
)
def test_a_folder_of_no_scene_is_named(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, option: str, file: str
) -> None:
    scenes = [tmp_path / "i3db" / name for name in ("Scene04", "Scene10")]
    for name in ("Scene04", "Scene4", "scene10"):
        (tmp_path / "theirs" / name).mkdir(parents=True)
        (tmp_path / "theirs" / name / file).touch()
    (tmp_path / "theirs" / "pictures").mkdir()
    (tmp_path / "theirs" / "pictures" / "a.png").touch()
    said = _of_methods(tmp_path)
    setattr(said, option, tmp_path / "theirs")
    _require_files_of_methods(said, scenes)
    (told,) = caplog.messages
    assert told == (
        f"--{option} {tmp_path / 'theirs'}: Scene4, scene10 not read, because no scene with truth "
        f"in {tmp_path / 'i3db'} has this name; scenes are Scene04, Scene10"
    )


@corpus
@pytest.mark.corpus
@pytest.mark.parametrize("files", [{"a.json": "VNect", "b.json": "VNect"}, {"a.json": LIKELY}])
def test_two_methods_of_one_name_are_refused_before_the_work(
    files: dict[str, str],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    (scene, *_) = scenes_with_truth(CORPUS)
    others = tmp_path / "others" / scene.name
    others.mkdir(parents=True)
    for file, method in files.items():
        theirs = replace(read_authors(scene), name=method)
        write_prediction(others / file, theirs, load_clip(scene))

    def work(*_: object, **__: object) -> None:
        raise AssertionError("work began")

    monkeypatch.setattr(evaluate_command, "solve_all", work)
    said = ["evaluate", "--suite", str(CORPUS), "-o", str(tmp_path / "out")]
    assert main([*said, "--predictions", str(others.parent)]) == 2
    assert f"{method}: two results for {scene.name} are called so" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
