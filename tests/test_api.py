"""What the main functions refuse: one error by name, before any work."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import imapper_prob as im
from imapper_prob.config import MOST_STEPS, SampleSettings
from imapper_prob.evaluate.suite import first_part
from imapper_prob.models.errors import InputError
from imapper_prob.models.settings import CameraSettings, ModelSettings, StaticPathSettings
from imapper_prob.sampling.sample import Samples
from tests.runs import half_library, posterior, small_solution, solution

CLIP = im.demo_clip()
PAPER = im.Config(model=replace(ModelSettings(), energy="paper"))
USUAL = im.Config()
COSTLY = replace(USUAL, model=replace(USUAL.model, collision_cost=1.0))
HEAVY = replace(USUAL, model=replace(USUAL.model, frame_weight=1.0))
WALKING = replace(USUAL, path=replace(USUAL.path, walk_time=0.5, dof=3.0))
TILTED = replace(USUAL, camera=replace(USUAL.camera, pitch=0.2))
SHARP = replace(USUAL, detector=replace(USUAL.detector, seen_error_scale=(1.0, 1.0)))


@pytest.fixture(autouse=True)
def _no_work(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fail if anything is solved or sampled."""

    def work(*_: object, **__: object) -> Samples:
        raise AssertionError("work was begun")

    monkeypatch.setattr("imapper_prob.api.solve_actors", work)
    monkeypatch.setattr("imapper_prob.api.sample_scenes", work)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: im.sample(CLIP, workers=0), "workers = 0 must be at least 1"),
        (lambda: im.sample(CLIP, workers=1.5), "workers = 1.5 must be a whole number"),  # type: ignore[arg-type]
        (lambda: im.sample(CLIP, cluster="tcp://x"), "must be a distributed.Client"),  # type: ignore[arg-type]
        (lambda: im.sample(CLIP, given=["a"]), "statement = 'a' must be one such"),  # type: ignore[list-item]
        (lambda: im.sample(CLIP, given="given.toml"), "read a file with read_statements"),  # type: ignore[arg-type]
        (lambda: im.solve(CLIP, scenes=0), "scenes = 0 must be at least 1"),
        (lambda: im.solve("clip.npz"), "clip = 'clip.npz' must be a Clip"),  # type: ignore[arg-type]
        (lambda: im.solve(CLIP, "built-in"), "library = 'built-in' must be a Library"),  # type: ignore[arg-type]
        (lambda: im.solve(CLIP, config="config.toml"), "config = 'config.toml' must be a Config"),  # type: ignore[arg-type]
        (lambda: im.load_clip("clip.npz", frames="0:50"), "frames = '0:50' must be"),  # type: ignore[arg-type]
    ],
)  # fmt: skip
def test_an_argument_is_refused_by_name(call: Callable[[], Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        call()


@pytest.mark.parametrize("arguments", [{"workers": 0}, {"steps": 0}, {"steps": MOST_STEPS + 1}])
def test_given_refuses_bad_numbers_at_once(arguments: dict[str, int]) -> None:
    with pytest.raises(InputError, match=f"{next(iter(arguments))} = "):
        posterior().given([im.Presence("couch")], **arguments)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("start", "config", "words"),
    [
        (lambda: small_solution(), im.Config(), "start is of another clip"),
        (lambda: solution(), PAPER, r"other settings than config \(model.energy\)"),
        (lambda: solution(), COSTLY, r"\(model.collision_cost\); solve with config"),
        (lambda: solution(), HEAVY, r"\(model.frame_weight\)"),
        (lambda: solution(), WALKING, r"\(path.dof, path.walk_time\)"),
        (lambda: solution(), TILTED, r"\(camera.pitch\)"),
        (lambda: solution(), SHARP, r"\(detector.seen_error_scale\)"),
        (lambda: solution(), USUAL.without("Scene04"), r"\(model\..*, .* and \d+ more\)"),
        (lambda: [], im.Config(), "must be the result of solve"),
        (lambda: "x", im.Config(), "must be the result of solve"),
    ],
)
def test_a_start_of_something_else_is_refused(
    start: Callable[[], Any], config: im.Config, words: str
) -> None:
    with pytest.raises(InputError, match=words):
        im.sample(CLIP, half_library(), start=start(), config=config)


@pytest.mark.parametrize("device", ["cpu", "cuda"])
def test_a_start_of_the_same_settings_is_sampled_whatever_its_device(device: str) -> None:
    with pytest.raises(AssertionError, match="work was begun"):
        im.sample(CLIP, half_library(), start=solution(), config=im.Config(seed=5, device=device))


def test_a_start_of_another_library_is_refused() -> None:
    with pytest.raises(InputError, match="start is of another library"):
        im.sample(CLIP, im.load_library(), start=solution())


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: im.ClipOptions(size=(1920,)), "size = "),  # type: ignore[arg-type]
        (lambda: im.ClipOptions(size="1920x1080"), "size = "),  # type: ignore[arg-type]
        (lambda: im.ClipOptions(size=(1920.5, 3)), "whole number"),  # type: ignore[arg-type]
        (lambda: im.ClipOptions(camera="cam.toml"), "see read_camera"),  # type: ignore[arg-type]
        (lambda: im.ClipOptions(people=1.5), "people = 1.5"),  # type: ignore[arg-type]
        (lambda: im.ClipOptions(fps="10"), "fps = '10'"),  # type: ignore[arg-type]
        (lambda: im.Config(seed=1.5), "seed = 1.5"),  # type: ignore[arg-type]
        (lambda: im.Config(seed=float("nan")), "seed = nan"),  # type: ignore[arg-type]
        (lambda: im.Config(sample={}), "sample = {} must be a SampleSettings"),  # type: ignore[arg-type]
        (lambda: im.Config(device="gpu0"), "device = 'gpu0'"),
        (lambda: SampleSettings(chains=2.5), "chains = 2.5"),  # type: ignore[arg-type]
        (lambda: SampleSettings(layout_radius=-1.0), "layout_radius = -1.0 must be positive"),
        (lambda: SampleSettings(steps=10**21), "must be at most"),
        (lambda: CameraSettings(pitch=0.0), "camera setting pitch = 0.0 must be positive"),
        (lambda: StaticPathSettings(dof=0), "path setting dof = 0 must be positive"),
        (lambda: StaticPathSettings(correlation_time=0.0), "correlation_time = 0.0 must be"),
        (lambda: replace(CLIP, frame_ids=CLIP.frame_ids + 0.5), "consecutive integers"),
        (lambda: replace(CLIP, frame_ids=np.full(130, np.nan)), "consecutive integers"),
    ],
)  # fmt: skip
def test_a_value_of_another_type_or_range_is_refused(make: Callable[[], Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        make()


def test_whole_floats_number_frames() -> None:
    clip = first_part(CLIP, 0.5)
    assert replace(clip, frame_ids=clip.frame_ids.astype(float)).frame_ids.dtype == np.int64
