"""Library files: what comes back, and what bad ones are told."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from imapper_prob.models.errors import InputError
from imapper_prob.models.scenelet import Library
from imapper_prob.scenelets import load_library, save_library
from imapper_prob.scenelets.library import built_in_library


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    scenelets = built_in_library().scenelets
    path = tmp_path / "some.npz"
    save_library(Library("some", (scenelets[0], *scenelets[100:104])), path)
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
    with pytest.raises(InputError, match=r"notes\.npz: damaged, or no \.npz at all"):
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
        ({"object_label": None}, "part object_label is missing"),
        ({"joints": np.zeros((5, 16, 3))}, "first_frame does not fit"),
        ({"joints": np.zeros((5, 15, 3))}, r"joints has shape \(5, 15, 3\)"),
        ({"actions": np.array(["walk"])}, r"actions has shape \(1,\), expected \(5,\)"),
        ({"object_label": np.array(["chair"])}, "object_scenelet has shape"),
        ({"cuboid_size": np.full((999, 3), -1.0)}, "cuboid_size has shape"),
        ({"first_frame": np.array([0, 9, 3, 40, 60, 80])}, "first_frame does not fit"),
        ({"name": None}, "part name is missing"),
        ({"fps": np.array(["quick"] * 5)}, "quick"),
        ({"fps": np.full(5, np.nan)}, "frame rate"),
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
