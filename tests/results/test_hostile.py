"""A run's files that were changed: read, or refused with one sentence, and soon."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import xarray as xr

from imapper_prob.models.errors import InputError
from imapper_prob.models.text import readable
from imapper_prob.models.valid import check_problem, check_state
from imapper_prob.results.load import load_posterior
from imapper_prob.results.scenes_file import read_scenes
from imapper_prob.uncertainty.tree import write_tree
from lab.robustness.attack import attack
from lab.robustness.runs import RUN_READERS
from tests.runs import posterior, small_posterior

INPUTS = 3
"""Of each kind; ``python -m lab.robustness`` tries more."""
_LONG = ("posterior.nc", "posterior.nc, reported", "checkpoint")


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[pytest.mark.slow] * (n in _LONG)) for n in RUN_READERS]
)
def test_damaged_files_of_a_run_are_read_or_refused(name: str) -> None:
    outcomes = attack(RUN_READERS[name], inputs=INPUTS)
    assert [fault for row in outcomes.values() for fault in row.faults] == []
    refused = sum(row.counts["refused"] for row in outcomes.values())
    assert refused > 0  # the damage was real


@pytest.fixture(scope="module")
def small_tree(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, xr.DataTree]:
    """A posterior in a file, and what is read from it."""
    path = tmp_path_factory.mktemp("small") / "posterior.nc"
    write_tree(path, small_posterior().data)
    with xr.open_datatree(path, engine="h5netcdf") as opened:
        return path, opened.load()


@pytest.mark.parametrize(
    ("variable", "value", "words"),
    [
        ("problem/box_label", 10**9, "box_label points at nothing"),
        ("problem/joint_first", 10**9, "joint_first does not fit"),
        ("problem/box_first", 10**9, "box_first does not fit"),
        ("problem/box_object", 10**9, "box_object points at nothing"),
        ("problem/label_chance", -0.1, "label_chance are no probabilities"),
        ("problem/label_sides", 1e6, "label_sides are of no furniture"),
        ("problem/path_mean", np.nan, "path_mean has a number that is not finite"),
        ("draws/start", 10**9, "stick out of the clip"),
        ("draws/scenelet", 10**9, "unknown scenelet"),
        ("draws/object_number", 10**9, "none of its scenelet"),
        ("draws/scenelet_log_size", 1e300, "sizes of a state"),
        ("latent/latent", np.inf, "latent of a state"),
        ("posterior/pitch", np.nan, "camera of a state"),
        ("counts/layout", 10**9, "layouts and their leaders differ"),
        ("layouts/leader", 10**9, "a leader is no draw"),
        ("layouts/by_chain", np.nan, "a probability is none"),
        ("sample_stats/log_posterior", np.nan, "log_posterior is not finite"),
        ("motion/sides_flipped", 1e30, "no probabilities"),
    ],
)
def test_numbers_that_compiled_code_would_trust_are_refused(
    small_tree: tuple[Path, xr.DataTree],
    monkeypatch: pytest.MonkeyPatch,
    variable: str,
    value: float,
    words: str,
) -> None:
    path, tree = small_tree
    changed = tree.copy()
    array = changed[variable]
    values = array.values.copy()
    values.reshape(-1)[0] = value
    changed[variable] = array.copy(data=values)
    monkeypatch.setattr(xr, "open_datatree", lambda *_, **__: changed)
    with pytest.raises(InputError, match=words):
        load_posterior(path)


@pytest.mark.parametrize(
    ("categories", "words"),
    [
        ("[" * 100_000, "categories are no list"),
        ('{"couch": 1}', "categories are no list"),
        ('["couch"]', "other categories"),
        ('["a", "b", "c", "d", "e", "f", "g", "h"]', "other categories"),
    ],
)
def test_labels_that_are_not_those_of_the_library_are_refused(
    small_tree: tuple[Path, xr.DataTree],
    monkeypatch: pytest.MonkeyPatch,
    categories: str,
    words: str,
) -> None:
    path, tree = small_tree
    changed = tree.copy()
    changed.attrs["categories"] = categories
    monkeypatch.setattr(xr, "open_datatree", lambda *_, **__: changed)
    with pytest.raises(InputError, match=words):
        load_posterior(path)


def test_a_number_that_is_changed_in_the_file_is_refused(
    small_tree: tuple[Path, xr.DataTree], tmp_path: Path
) -> None:
    shutil.copy(small_tree[0], tmp_path)
    with h5py.File(tmp_path / "posterior.nc", "r+") as file:
        file["draws/scenelet"][...] = 10**9
    with pytest.raises(InputError, match="unknown scenelet"):
        load_posterior(tmp_path)


def test_a_changed_posterior_is_known_by_its_checksum(run_of_demo: Path, tmp_path: Path) -> None:
    shutil.copytree(run_of_demo, tmp_path / "run")
    path = tmp_path / "run" / "posterior.nc"
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"checksum differs from that in manifest\.json"):
        load_posterior(tmp_path / "run")


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda d: d["scenes"][0]["objects"][0].update(label=7), "must be text"),
        (lambda d: d["scenes"][0].update(probability="1e999"), "too large"),
        (lambda d: d.update(scenes=[[]] * 3), "scene 1"),
    ],
)
def test_scenes_that_are_none_are_refused(
    run_of_demo: Path, tmp_path: Path, spoil: Callable[[Any], None], words: str
) -> None:
    document = json.loads((run_of_demo / "scenes.json").read_text())
    spoil(document)
    path = tmp_path / "scenes.json"
    path.write_text(json.dumps(document))
    with pytest.raises(InputError, match=words):
        read_scenes(path)
    for text in ("", '{"format": Infinity}', "[" * 100_000):
        path.write_text(text)
        with pytest.raises(InputError, match="is not JSON"):
            read_scenes(path)


def test_what_was_packed_and_drawn_is_valid() -> None:
    run = posterior()
    check_problem(run.solution.problem)
    for state in run.samples.states:
        check_state(run.solution.problem, state)
    with pytest.raises(InputError, match="used has shape"):
        check_problem(run.solution.problem._replace(keypoints=np.zeros((3, 16, 2))))


@pytest.mark.parametrize("name", ["path_draw", "path_mean", "path_scale", "path_centre"])
def test_a_path_through_the_camera_is_refused(name: str) -> None:
    problem = posterior().solution.problem
    values = getattr(problem, name).copy()
    values.flat[-1] = 1e5
    with pytest.raises(InputError, match=f"{name} is too large for the path of a person"):
        check_problem(problem._replace(**{name: values}))


def test_names_are_made_readable() -> None:
    assert readable("Küche 7 – ✓") == "Küche 7 – ✓"
    assert readable("Sc\udce8ne\ta\x00\ud800\u202e") == "Scène a\ufffd\ufffd\ufffd"
