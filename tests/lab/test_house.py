"""Measures of the program's sources: a checkout of three files, counted by hand."""

from __future__ import annotations

from pathlib import Path

import pytest

from lab.house import main, measure
from tests.conftest import ROOT

SCENE = '''\
"""What a scene is."""

import math
from pathlib import (
    Path,
)

__all__ = ["Scene", "area", "radius", "refuse"]


class Scene:
    """A scene.

    Parameters
    ----------
    size, kind : float
        Metres.

    Examples
    --------
    >>> Scene(1.0, 2.0)
    """

    size: float
    kind: float

    def name(self):
        """A summary is enough where nothing is said of what is returned."""


def area(scene: Scene) -> float:
    """Complete.

    Parameters
    ----------
    scene : Scene

    Returns
    -------
    float
    """
    return _square(scene.size) + _twice(1.0) + _twice(2.0) + _twice(3.0)


def radius(scene: Scene) -> float:
    """Without what is returned.

    Parameters
    ----------
    scene : Scene
    """


def refuse(*names: str) -> None:
    """Without what is refused.

    Parameters
    ----------
    *names : str
    """
    raise InputError(Path(math.pi))


def _square(x):
    return x * x


def _twice(x):
    return 2 * x
'''


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    (tmp_path / "models").mkdir()
    (tmp_path / "models" / "scene.py").write_text(SCENE)
    package = tmp_path / "imapper_prob"
    package.mkdir()
    (package / "models").symlink_to(Path("..") / "models")
    (package / "scene.py").write_text("from imapper_prob.models.scene import Scene\n")
    (package / "loop.py").write_text("import imapper_prob.loop\nimport json\n")
    return tmp_path


def test_measures_are_those_counted_by_hand(checkout: Path) -> None:
    lines = len(SCENE.splitlines())
    assert measure(checkout) == {
        "files": "3",
        "lines": f"{lines + 3}",
        "lines without docstrings": f"{lines + 3 - 1 - 11 - 1 - 10 - 6 - 6}",
        "median lines of a file": "2",
        "import lines": f"{100 * 7 / (lines + 3):.1f} %",
        "private functions used once": "1 of 2",
        "modules under 120 lines with one importer": f"1 ({lines} lines)",
        "names of files in several folders": "1",
        "longest function, lines": "2 (`refuse`)",
        "complete public docstrings": "60.0 % of 5",
        "public docstrings with an example": "1",
    }


@pytest.mark.slow
def test_checkouts_are_beside_one_another(
    checkout: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([str(checkout), str(ROOT)]) == 0
    head, rule, files, *_ = capsys.readouterr().out.splitlines()
    assert head == f"| | `{checkout.name}` | `{ROOT.name}` |"
    assert rule == "|---|---:|---:|"
    assert files.startswith("| files | 3 | ")


def test_a_folder_without_the_packages_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="holds none of imapper_prob, models, samplers"):
        measure(tmp_path)
