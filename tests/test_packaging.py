"""What gets installed: one name, all its files, and nothing else."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tomllib
import venv
import zipfile
from pathlib import Path

import pytest

import imapper_prob

ROOT = Path(__file__).parents[1]
pytestmark = pytest.mark.slow


def expected_files() -> set[str]:
    """Every module, as the package reaches it."""
    found = {
        "imapper_prob/py.typed", "imapper_prob/models/calibrated.toml",
        "imapper_prob/results/report.js",
    }  # fmt: skip
    for folder in ("imapper_prob", "imapper_prob/models", "imapper_prob/samplers"):
        found |= {str(p.relative_to(ROOT)) for p in (ROOT / folder).rglob("*.py")}
    return found


def pip(*arguments: str | Path) -> None:
    command = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check"]
    subprocess.run([*command, *map(str, arguments)], check=True)


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel, built from a source distribution as an installer would.

    From a copy, because a build leaves things in the folder it works in.
    """
    folder = tmp_path_factory.mktemp("wheel")
    checkout = folder / "checkout"
    checkout.mkdir()
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, checkout)
    for name in ("imapper_prob", "lab", "models", "samplers"):
        shutil.copytree(ROOT / name, checkout / name, symlinks=True)
    build = (
        "import os, sys, setuptools.build_meta as build;"
        "os.chdir(sys.argv[1]); build.build_sdist(sys.argv[2])"
    )
    subprocess.run(
        [sys.executable, "-W", "ignore", "-c", build, str(checkout), str(folder)],
        capture_output=True,
        check=True,
    )
    source = next(folder.glob("*.tar.gz"))
    pip("wheel", "--no-deps", "--no-build-isolation", "--wheel-dir", folder, source)
    return next(folder.glob("*.whl"))


def test_wheel_holds_every_file_under_one_name(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
    metadata = f"imapper_prob-{imapper_prob.__version__}.dist-info"
    assert {name.split("/")[0] for name in names} == {"imapper_prob", metadata}
    assert {n for n in names if n.startswith("imapper_prob/")} >= expected_files()


def test_installed_wheel_imports_from_elsewhere(wheel: Path, tmp_path: Path) -> None:
    venv.create(tmp_path / "venv", with_pip=False, system_site_packages=False)
    python = tmp_path / "venv" / "bin" / "python"
    pip("--python", python, "install", "--no-deps", "--no-index", wheel)
    program = (
        "import importlib.util as u, imapper_prob as p;"
        "assert u.find_spec('models') is None and u.find_spec('samplers') is None;"
        "assert u.find_spec('imapper_prob.models') and u.find_spec('imapper_prob.samplers');"
        "print(p.__version__, p.__file__)"
    )
    done = subprocess.run(
        [str(python), "-c", program], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    version, file = done.stdout.split()
    assert version == imapper_prob.__version__
    assert str(tmp_path) in file


def test_versions_agree() -> None:
    assert f"version: {imapper_prob.__version__}\n" in (ROOT / "CITATION.cff").read_text()
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert project["dynamic"] == ["version"]
