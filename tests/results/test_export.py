"""scenes.json comes back as it went in, and a bad file is told apart in one sentence."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from imapper_prob.models.camera import Camera
from imapper_prob.models.errors import InputError
from imapper_prob.models.scene import Cuboid, Placement, Scene, SceneObject
from imapper_prob.models.text import readable
from imapper_prob.results import scenes_file
from imapper_prob.results.scenes_file import read_scenes, write_scenes
from imapper_prob.uncertainty.scenes import Explains, WeightedScene

LENGTHS = st.floats(-1e3, 1e3)
SIZES = st.floats(1e-3, 10)
COUNTS = st.integers(0, 999)
SPANS = st.lists(st.tuples(COUNTS, COUNTS), max_size=2).map(tuple)
POINTS = st.tuples(LENGTHS, LENGTHS, LENGTHS)


TEXT = st.text(max_size=5).map(readable)


@st.composite
def weighted_scenes(draw: st.DrawFn) -> WeightedScene:
    cuboid = st.builds(Cuboid, st.text(max_size=4), POINTS, st.tuples(SIZES, SIZES, SIZES))
    placement = st.builds(Placement, LENGTHS, LENGTHS, st.floats(-7, 7))
    item = st.builds(
        SceneObject, st.text(min_size=1, max_size=5), placement, st.lists(cuboid, min_size=1)
    )
    objects = draw(st.lists(item, max_size=3))
    angle = st.floats(-1, 1)
    camera = Camera(640, 480, 500.0, 510.0, 320.0, 240.0, draw(angle), draw(angle), 1.4)
    layout = draw(st.lists(st.tuples(TEXT, st.integers(0, 999)), max_size=3))
    spread = np.random.default_rng(len(objects)).normal(size=(len(objects), 2, 2))
    return WeightedScene(
        Scene(camera, objects, np.zeros((3, 16, 3)), layout, draw(st.floats(-1e6, 1e6))),
        draw(st.floats(0, 1)),
        draw(st.floats(0, 0.5)),
        spread @ spread.swapaxes(1, 2),
        np.zeros((2, 3, 16, 3)),
        layouts=tuple(draw(st.lists(st.integers(1, 99), max_size=3))),
        explains=draw(st.none() | st.builds(Explains, SPANS, COUNTS, COUNTS, COUNTS, COUNTS)),
        difference=draw(TEXT),
        draw=draw(COUNTS),
    )


def contents(weighted: WeightedScene) -> object:
    """All that scenes.json keeps, in a form that compares exactly."""
    scene = weighted.scene
    objects = [
        (o.label, o.placement, [(c.part, c.centre.tolist(), c.size.tolist()) for c in o.cuboids])
        for o in scene.objects
    ]
    numbers = (weighted.probability, weighted.error, scene.log_posterior)
    words = (weighted.layouts, weighted.explains, weighted.difference, weighted.draw)
    return scene.camera, scene.assignment, objects, numbers, words, weighted.covariances.tolist()


def chair(covariance: float = 0.01) -> WeightedScene:
    item = SceneObject("chair", Placement(1, 4, 0.5), (Cuboid("seat", (0, 0, 0.4), (1, 1, 0.1)),))
    scene = Scene(Camera(640, 480, 5, 5, 1, 1), (item,), np.zeros((1, 16, 3)), (("sit", 7),), -3.0)
    return WeightedScene(scene, 0.75, 0.02, np.full((1, 2, 2), covariance), np.zeros((0, 1, 16, 3)))


@given(scenes=st.lists(weighted_scenes(), max_size=3))
@settings(
    max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_what_is_read_is_what_was_written(tmp_path: Path, scenes: list[WeightedScene]) -> None:
    path = tmp_path / "scenes.json"
    write_scenes(path, scenes)
    back = read_scenes(path)
    assert [contents(s) for s in back] == [contents(s) for s in scenes]


def test_the_file_is_plain_json_with_units_and_frames(tmp_path: Path) -> None:
    write_scenes(tmp_path / "scenes.json", [chair()])

    def refuse(constant: str) -> None:
        pytest.fail(f"{constant} is not JSON")

    text = (tmp_path / "scenes.json").read_text(encoding="utf-8")
    document = json.loads(text, parse_constant=refuse)
    assert document["version"] == 3
    assert document["units"] == {"length": "metre", "angle": "radian", "image": "pixel"}
    assert set(document["frames"]) == {"world", "object"}
    (scene,) = document["scenes"]
    assert scene["probability"] == 0.75
    assert scene["assignment"] == [{"scenelet": "sit", "start": 7}]
    (item,) = scene["objects"]
    assert (item["label"], item["position"], item["yaw"]) == ("chair", [1, 4], 0.5)
    assert item["cuboids"] == [{"part": "seat", "centre": [0, 0, 0.4], "size": [1, 1, 0.1]}]


def test_an_unknown_number_is_null_and_comes_back_as_nan(tmp_path: Path) -> None:
    path = tmp_path / "scenes.json"
    write_scenes(path, [chair(covariance=np.nan)])
    item = json.loads(path.read_text())["scenes"][0]["objects"][0]
    assert item["position_covariance"] == [[None, None], [None, None]]
    assert np.isnan(read_scenes(path)[0].covariances).all()


@pytest.mark.parametrize(
    ("spoil", "complaint"),
    [
        (lambda d: d.pop("format"), "not a file of scenes"),
        (lambda d: d.update(version=1), "has version 1"),
        (lambda d: d.pop("scenes"), "scenes are missing"),
        (lambda d: d["scenes"][0].pop("camera"), "scene 1 lacks 'camera'"),
        (lambda d: d["scenes"][0]["camera"].update(fx=-1), "focal length fx"),
        (lambda d: d["scenes"][0]["camera"].update(zoom=1), "zoom"),
        (lambda d: d["scenes"][0]["objects"][0].pop("yaw"), "object 1 lacks 'yaw'"),
        (lambda d: d["scenes"][0]["objects"][0].update(cuboids=[]), "no cuboids"),
        (lambda d: d["scenes"][0]["objects"][0].update(position_covariance=[1]), "scene 1"),
        (lambda d: d.update(scenes=[3]), "scene 1"),
    ],
)
def test_a_bad_file_is_named_with_its_fault(tmp_path: Path, spoil, complaint: str) -> None:
    path = tmp_path / "scenes.json"
    write_scenes(path, [chair()])
    document = json.loads(path.read_text())
    spoil(document)
    path.write_text(json.dumps(document))
    with pytest.raises(InputError, match=complaint) as caught:
        read_scenes(path)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize("text", ["", "{", "[1]", "\x00"])
def test_a_file_that_is_no_scenes_at_all(tmp_path: Path, text: str) -> None:
    path = tmp_path / "scenes.json"
    path.write_text(text)
    with pytest.raises(InputError, match=r"scenes\.json: is not"):
        read_scenes(path)


def test_a_missing_file_and_a_missing_folder(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        read_scenes(tmp_path / "scenes.json")
    with pytest.raises(InputError, match="does not exist; make it first"):
        write_scenes(tmp_path / "nowhere" / "scenes.json", [])


def test_a_failed_write_leaves_the_old_file_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "scenes.json"
    write_scenes(path, [chair()])
    before = path.read_bytes()

    def full(*_: object) -> None:
        raise OSError("no space left")

    monkeypatch.setattr(scenes_file.os, "replace", full)
    with pytest.raises(OSError, match="no space"):
        write_scenes(path, [])
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]
