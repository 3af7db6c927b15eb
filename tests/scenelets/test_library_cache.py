"""The built-in library on disk: what is read is what would be made, or it is made."""

from __future__ import annotations

import os
import shutil
import time
from pathlib import Path

import numpy as np
import pytest

from imapper_prob.models.scenelet import Library
from imapper_prob.scenelets import library
from imapper_prob.scenelets.library import built_in_library, kept, save_library, sources_digest
from imapper_prob.scenelets.procedural.catalogue import build_library
from tests.test_structure import imports

ROOMS = library._ROOMS


class Maker:
    """Makes a small library, and counts how often."""

    def __init__(self, name: str = "few") -> None:
        self.library = Library(name, built_in_library().scenelets[:5])
        self.times = 0

    def __call__(self) -> Library:
        self.times += 1
        return self.library


def only(folder: Path) -> Path:
    (path,) = folder.iterdir()
    return path


@pytest.mark.slow
def test_the_built_in_library_is_what_its_sources_make() -> None:
    assert built_in_library().digest == build_library(0).digest
    assert built_in_library().name == build_library(0).name


def test_it_is_made_once_and_read_afterwards(tmp_path: Path) -> None:
    make = Maker()
    one, other = (kept("few", make, folder=tmp_path / "new") for _ in range(2))
    assert make.times == 1
    assert one.digest == other.digest == make.library.digest
    assert one.name == other.name


@pytest.mark.parametrize("part", [0.0, 0.5, 0.99])
def test_a_damaged_file_is_made_again(tmp_path: Path, part: float) -> None:
    make = Maker()
    kept("few", make, folder=tmp_path)
    whole = only(tmp_path).read_bytes()
    only(tmp_path).write_bytes(whole[: int(part * len(whole))])
    assert kept("few", make, folder=tmp_path).digest == make.library.digest
    assert make.times == 2
    kept("few", make, folder=tmp_path)
    assert make.times == 2


def test_another_library_under_its_name_is_not_taken(tmp_path: Path) -> None:
    make = Maker()
    kept("few", make, folder=tmp_path)
    save_library(Library("few", make.library.scenelets[:4]), only(tmp_path))
    assert kept("few", make, folder=tmp_path).digest == make.library.digest
    assert make.times == 2
    assert len(list(tmp_path.iterdir())) == 1


def test_who_may_not_write_makes_it_each_time(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder")
    make = Maker()
    for times in (1, 2):
        assert kept("few", make, folder=tmp_path / "file").digest == make.library.digest
        assert make.times == times


@pytest.mark.parametrize(
    "name",
    ["scenelets/procedural/gait.py", "scenelets/procedural/low.py", "models/skeleton.py",
     "models/calibrated.toml"],
)  # fmt: skip
def test_other_sources_are_another_library(tmp_path: Path, name: str) -> None:
    rooms = tuple(tmp_path / room.name for room in ROOMS)
    for room, copy in zip(ROOMS, rooms, strict=True):
        shutil.copytree(room, copy, ignore=shutil.ignore_patterns("__pycache__"))
    before = sources_digest(rooms)
    assert before == sources_digest(ROOMS)
    (tmp_path / name).write_text((tmp_path / name).read_text() + "\n# Note\n")
    assert sources_digest(rooms) != before


def test_another_numpy_is_another_library(monkeypatch: pytest.MonkeyPatch) -> None:
    before = sources_digest(ROOMS)
    monkeypatch.setattr(np, "__version__", "0.0")
    assert sources_digest(ROOMS) != before


def test_another_processor_is_another_library(monkeypatch: pytest.MonkeyPatch) -> None:
    before = sources_digest(ROOMS)
    other = {"SIMD Extensions": {"found": ["OTHER"]}}
    monkeypatch.setattr(np, "show_config", lambda mode: other)
    assert sources_digest(ROOMS) != before


def test_all_that_makes_the_library_is_in_the_digest() -> None:
    """What the catalogue is made of, as it says itself by what it imports."""
    found, asked = set(), [Path(library.__file__).parent / "procedural" / "catalogue.py"]
    package = asked[0].parents[2]
    while asked:
        path = asked.pop()
        if path not in found:
            found.add(path)
            names = {name.removeprefix("imapper_prob.") for name in imports(path) if "." in name}
            modules = (package / Path(*name.split(".")) for name in names)
            files = (m / "__init__.py" if m.is_dir() else m.with_suffix(".py") for m in modules)
            asked += [file for file in files if package in file.parents and file.is_file()]
    rooms = {path.relative_to(package).parts[0] for path in found}
    assert len(found) > 15
    assert rooms == {"models", "scenelets"} == {room.name for room in ROOMS}


def test_files_of_other_sources_go_after_a_day(tmp_path: Path) -> None:
    week = time.time() - 7 * 24 * 3600
    digests = f"{'0' * 16}-{'f' * 16}"
    for name in (f"few-{digests}", f"few-{digests[::-1]}", f"other-{digests}", "few-of-mine"):
        (tmp_path / f"{name}.npz").write_bytes(b"")
        if name != f"few-{digests[::-1]}":
            os.utime(tmp_path / f"{name}.npz", (week, week))
    kept("few", Maker(), folder=tmp_path)
    left = {path.stem for path in tmp_path.iterdir()}
    assert f"few-{digests}" not in left
    assert left > {f"few-{digests[::-1]}", f"other-{digests}", "few-of-mine"}


def test_a_file_in_use_stays(tmp_path: Path) -> None:
    make, week = Maker(), time.time() - 7 * 24 * 3600
    kept("few", make, folder=tmp_path)
    os.utime(only(tmp_path), (week, week))
    kept("few", make, folder=tmp_path)
    assert only(tmp_path).stat().st_mtime > week + 1
