"""Compiled kernels are kept for as long as nothing that they are made of changes."""

from __future__ import annotations

import os
import re
import shutil
import time
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from imapper_prob.models import jit
from imapper_prob.models.kernel_sources import digest

MODELS = Path(jit.__file__).resolve().parent


@cache
def present() -> str:
    return digest(MODELS)


@pytest.fixture
def models(tmp_path: Path) -> Path:
    """A copy of the model's sources."""
    folder = tmp_path / "models"
    shutil.copytree(MODELS, folder, ignore=shutil.ignore_patterns("__pycache__"))
    return folder


def changed(folder: Path, name: str, pattern: str, replacement: str) -> str:
    """The digest once a file says something else."""
    path = folder / name
    text = path.read_text(encoding="utf-8")
    other, count = re.subn(pattern, replacement, text, count=1, flags=re.MULTILINE)
    assert count == 1
    path.write_text(other, encoding="utf-8")
    return digest(folder)


@pytest.mark.parametrize(
    ("name", "pattern", "replacement"),
    [
        pytest.param("kernels/visibility.py", r"^def ", "# Note\ndef ", id="comment"),
        pytest.param("kernels/visibility.py", r'^"""', '"""Note: ', id="docstring"),
        pytest.param("kernels/path.py", r'^    """', '    """Note: ', id="of a function"),
        pytest.param("settings.py", r'^"""Least ', '"""The least ', id="of a constant"),
        pytest.param("scene.py", r"\Z", "\nLAST = 1\n", id="scenes"),
        pytest.param("problem.py", r"\Z", "\nLAST = 1\n", id="what no kernel names"),
        pytest.param("settings.py", r"\Z", "\nLAST = 1\n", id="settings"),
        pytest.param("calibrated.toml", r"^error = ", "error = 1", id="error of a constant"),
    ],
)
def test_what_is_no_part_of_a_kernel_leaves_it(
    models: Path, name: str, pattern: str, replacement: str
) -> None:
    assert changed(models, name, pattern, replacement) == present()


@pytest.mark.parametrize(
    ("name", "pattern", "replacement"),
    [
        pytest.param("kernels/visibility.py", r"\Z", "\nLAST = 1\n", id="module of kernels"),
        pytest.param("settings.py", r"^NEAREST: Final = ", "NEAREST: Final = 1 + ", id="constant"),
        pytest.param("skeleton.py", r'"RANK", "RKNE"', '"RKNE", "RANK"', id="what it is made of"),
        pytest.param("calibrated.py", r"^    value = constants", "    v = 1\n    value = constants",
                     id="function that reads constants"),
        pytest.param("calibrated.toml", r"^value = ", "value = 1", id="calibrated constant"),
        pytest.param("problem.py", r"^    fx: float\n    fy: float",
                     "    fy: float\n    fx: float", id="order of what kernels are handed"),
        pytest.param("settings.py", r"\Z", "\nglobals().update(LEVEL=1.0)\n", id="in passing"),
        pytest.param("jit.py", r'{"nsz"}', '{"contract", "nsz"}', id="liberties of the compiler"),
    ],
)  # fmt: skip
def test_what_kernels_are_made_of_makes_others(
    models: Path, name: str, pattern: str, replacement: str
) -> None:
    assert changed(models, name, pattern, replacement) != present()


def test_what_only_a_type_checker_reads_is_no_part(models: Path) -> None:
    changed(
        models, "kernels/visibility.py", r"^import ", "from typing import TYPE_CHECKING\nimport "
    )
    before = digest(models)
    later = "if TYPE_CHECKING:\n    from imapper_prob.models.scene import Clip\n\nimport "
    assert changed(models, "kernels/visibility.py", r"^import ", later) == before


@pytest.mark.parametrize(
    ("line", "name"),
    [
        ("from imapper_prob.models import scene", "scene.py"),
        ("import imapper_prob.models.scene as other", "scene.py"),
        ("from imapper_prob.models.scene import *", "scene.py"),
        ("from imapper_prob.models.scene import Clip as Other", "scene.py"),
        ("from imapper_prob.models import detector", "detector.py"),
    ],
)
def test_all_ways_to_import_count(models: Path, line: str, name: str) -> None:
    before = changed(models, "kernels/visibility.py", r"^import ", f"{line}\nimport ")
    later = changed(models, name, r"^class (\w+)(.*):$", r"class \1\2:\n    x = 1")
    assert before != later


def test_caches_that_nobody_opened_for_a_day_are_removed(tmp_path: Path) -> None:
    week = time.time() - 7 * 24 * 3600
    for name in ("kernels-0123456789abcdef", "kernels-fedcba9876543210", "kernels-of-mine", "else"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "kernel.nbc").write_bytes(b"")
        if "fed" not in name:
            os.utime(tmp_path / name, (week, week))
    jit.remove_unused(tmp_path)
    left = {path.name for path in tmp_path.iterdir()}
    assert left == {"kernels-fedcba9876543210", "kernels-of-mine", "else"}


def test_kernels_in_use_are_kept_under_their_digest() -> None:
    import imapper_prob.models.kernels.incremental as kernels

    folder = Path(kernels.change.stats.cache_path)
    assert f"kernels-{present()}" in folder.parts


def test_a_kernel_for_kernels_alone_says_so() -> None:
    """There is no code in it that takes Python's objects: to run it would end the process."""
    from imapper_prob.models.kernels.intersection import set_footprint

    with pytest.raises(TypeError, match="set_footprint is for other kernels"):
        set_footprint(np.zeros(8), np.zeros(4), np.zeros(8))
