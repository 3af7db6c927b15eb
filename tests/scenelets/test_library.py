"""Library files: what comes back, and what bad ones are told."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from imapper_prob.models.errors import InputError
from imapper_prob.models.scenelet import Library
from imapper_prob.scenelets import load_library, save_library
from imapper_prob.scenelets.library import built_in_library


def few(name: str, weight: float = 1.0) -> Library:
    """A walk, and four scenelets with furniture."""
    library = built_in_library()
    seated = [replace(s, weight=weight) for s in library if s.objects][:4]
    return Library(name, (library[0], *seated))


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    path = tmp_path / "some.npz"
    save_library(few("some"), path)
    return path


def test_built_in_is_the_default() -> None:
    assert load_library() is built_in_library()
    assert load_library("built-in") is built_in_library()


def test_a_library_survives_its_file(tmp_path: Path) -> None:
    library = built_in_library()
    path = tmp_path / "all.npz"
    save_library(library, path)
    again = load_library(path)
    assert again.digest == library.digest
    assert again.name == library.name
    assert [p.name for p in tmp_path.iterdir()] == ["all.npz"]


def test_a_library_without_objects_survives_its_file(tmp_path: Path) -> None:
    walks = Library("walks", tuple(s for s in built_in_library() if not s.objects))
    save_library(walks, tmp_path / "walks.npz")
    assert load_library(str(tmp_path / "walks.npz")).digest == walks.digest


def test_weights_survive_a_file(tmp_path: Path) -> None:
    save_library(few("some", weight=0.25), tmp_path / "some.npz")
    assert [s.weight for s in load_library(tmp_path / "some.npz")] == [1.0] + [0.25] * 4


def test_libraries_are_joined_by_commas(saved: Path) -> None:
    both = load_library(f"built-in, {saved}")
    own, other = built_in_library(), load_library(saved)
    assert both.name == f"{own.name}+some"
    assert len(both) == len(own) + len(other)
    assert both.scenelets[: len(own)] == own.scenelets
    # All of the file's scenelets are called as those of the built-in library are.
    assert [s.name for s in both][len(own) :] == [f"some/{s.name}" for s in other]


def test_names_that_do_not_clash_stay(saved: Path, tmp_path: Path) -> None:
    renamed = tmp_path / "renamed.npz"
    library = few("renamed")
    save_library(Library("renamed", tuple(replace(s, name="x" + s.name) for s in library)), renamed)
    names = [s.name for s in load_library(f"{saved},{renamed}")]
    assert names == [s.name for s in library] + ["x" + s.name for s in library]


@pytest.mark.parametrize("order", ["{odd},built-in", "built-in,{odd}", "built-in,{odd},{saved}"])
def test_a_comma_in_the_name_of_a_file_does_not_part(
    saved: Path, tmp_path: Path, order: str
) -> None:
    odd = tmp_path / "mine, yours, ours.npz"
    save_library(few("odd"), odd)
    assert load_library(str(odd)).name == "odd"
    joined = load_library(order.format(odd=odd, saved=saved))
    assert set(joined.name.split("+")) >= {"odd", built_in_library().name}


@pytest.mark.parametrize("source", ["", "built-in,", ",built-in", "built-in,,x.npz"])
def test_an_empty_name_is_told(source: str) -> None:
    with pytest.raises(InputError, match=r"a name is empty|x\.npz: no such file"):
        load_library(source)


def test_a_library_named_twice_is_told(saved: Path) -> None:
    with pytest.raises(InputError, match=r"some\.npz is named twice"):
        load_library(f"{saved},built-in,{saved}")


def test_a_missing_file_among_several_is_named(saved: Path) -> None:
    with pytest.raises(InputError, match=r"library nowhere\.npz: no such file"):
        load_library(f"{saved},nowhere.npz")


def test_two_libraries_of_one_name_with_the_same_scenelets_are_told(
    saved: Path, tmp_path: Path
) -> None:
    save_library(few("some"), tmp_path / "again.npz")
    save_library(few("some"), tmp_path / "once more.npz")
    source = f"{saved},{tmp_path / 'again.npz'},{tmp_path / 'once more.npz'}"
    with pytest.raises(InputError, match="twice"):
        load_library(source)


def test_reading_is_quick(tmp_path: Path) -> None:
    library = built_in_library()
    path = tmp_path / "all.npz"
    save_library(library, path)
    start = os.times().user
    load_library(path)
    # 1,800 scenelets of 1,600 objects take 0.2 s; the quadratic reader took seconds.
    assert os.times().user - start < 2.0


def test_a_failed_write_leaves_the_old_file(saved: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = saved.read_bytes()

    def full(file: object, **_: object) -> None:
        file.write(b"half")  # type: ignore[attr-defined]
        raise OSError("disk full")

    monkeypatch.setattr(np, "savez_compressed", full)
    with pytest.raises(OSError, match="disk full"):
        save_library(built_in_library(), saved)
    assert saved.read_bytes() == before
    assert [p.name for p in saved.parent.iterdir()] == [saved.name]


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"nowhere\.npz: no such file"):
        load_library(tmp_path / "nowhere.npz")


def test_a_file_cut_in_half_is_named(saved: Path) -> None:
    saved.write_bytes(saved.read_bytes()[: saved.stat().st_size // 2])
    with pytest.raises(InputError, match=r"some\.npz: damaged"):
        load_library(saved)


def test_text_is_no_library(tmp_path: Path) -> None:
    path = tmp_path / "notes.npz"
    path.write_text("walk, sit, stand")
    with pytest.raises(InputError, match=r"notes\.npz: damaged, or no \.npz of plain arrays"):
        load_library(path)


def test_a_pickle_is_not_opened(tmp_path: Path) -> None:
    path = tmp_path / "pickled.npz"
    np.savez(path, format=np.array([{"a": 1}], dtype=object))
    with pytest.raises(InputError, match=r"pickled\.npz"):
        load_library(path)


def altered(path: Path, **changes: object) -> None:
    with np.load(path, allow_pickle=False) as archive:
        arrays = {key: archive[key] for key in archive.files}
    arrays |= changes
    np.savez(path, **{k: v for k, v in arrays.items() if v is not None})


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"format": np.array("something else")}, "not a scenelet library of this version"),
        ({"format": None}, "not a scenelet library of this version"),
        ({"object_label": None}, "entry object_label is missing"),
        ({"joints": np.zeros((5, 16, 3))}, "first_frame does not fit"),
        ({"joints": np.zeros((5, 15, 3))}, r"joints has shape \(5, 15, 3\)"),
        ({"actions": np.array(["walk"])}, r"actions has shape \(1,\), expected \(5,\)"),
        ({"object_label": np.array(["chair"])}, "object_scenelet has shape"),
        ({"cuboid_size": np.full((999, 3), -1.0)}, "cuboid_size has shape"),
        ({"first_frame": np.array([0, 9, 3, 40, 60, 80])}, "first_frame does not fit"),
        ({"name": None}, "entry name is missing"),
        ({"fps": np.array(["quick"] * 5)}, "expected number"),
        ({"fps": np.full(5, np.nan)}, "nan frames a second"),
        ({"weights": None}, "entry weights is missing"),
        ({"weights": np.zeros(5)}, "weight 0.0 must be positive"),
        ({"names": np.array(["same"] * 5)}, "same occurs twice"),
    ],
)
def test_a_file_that_contradicts_itself_is_named(
    saved: Path, changes: dict[str, object], message: str
) -> None:
    altered(saved, **changes)
    with pytest.raises(InputError, match=message) as caught:
        load_library(saved)
    assert "some.npz" in str(caught.value)


def test_a_joint_that_is_not_finite_is_named(saved: Path) -> None:
    with np.load(saved, allow_pickle=False) as archive:
        joints = archive["joints"]
    joints[3, 7] = np.nan
    altered(saved, joints=joints)
    with pytest.raises(InputError, match=r"some\.npz: scenelet walk-000, frame 3, joint 7"):
        load_library(saved)


def test_an_object_of_nobody_is_named(saved: Path) -> None:
    with np.load(saved, allow_pickle=False) as archive:
        owner = archive["object_scenelet"]
    altered(saved, object_scenelet=owner + 5)
    with pytest.raises(InputError, match=r"some\.npz: object_scenelet names one that does not"):
        load_library(saved)
