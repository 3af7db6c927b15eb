"""What the pages tell people to type can be typed, and links lead somewhere."""

from __future__ import annotations

import ast
import importlib.util
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from imapper_prob.cli.main import command_parser
from imapper_prob.config import from_toml
from tests.conftest import ROOT

PAGES = sorted([ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").rglob("*.md")])
GUIDES = [
    ROOT / "README.md",
    *sorted((ROOT / "docs" / "tutorials").glob("*.md")),
    *sorted((ROOT / "docs" / "how-to").glob("*.md")),
]
DEMO = "imapper-prob demo -o out/demo"
SHELL = {"pip", "python", "dask", ".", "make", "imapper-prob", "git", "ln"}
BROUGHT = (
    "clip.mp4",
    "clip.npz",
    "monday.npz",
    "keypoints/",
    "i3db",
    "theirs/",
    "out/Scene04",
    "out/clip",
)
"""Words of commands on files that a reader brings, or makes of those."""
NEITHER = (
    "pip ",
    "python -m venv",
    ". .venv",
    "dask ",
    "git ",
    "ln ",
    "make ",
    " view ",
    "completion",
    "scenelets plot",
    "couple",
)
"""Commands that change the environment, never end, or draw for minutes."""


def blocks(path: Path, language: str) -> list[str]:
    """The fenced blocks of a page in a language."""
    text = path.read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```", text, re.MULTILINE | re.DOTALL)


def lines(path: Path) -> list[str]:
    """The commands of a page."""
    return [line for block in blocks(path, "sh") for line in block.splitlines() if line.strip()]


def name_of(path: Path) -> str:
    return str(path.relative_to(ROOT))


@pytest.mark.parametrize("path", GUIDES, ids=name_of)
def test_commands_are_known_with_all_their_options(path: Path) -> None:
    for line in lines(path):
        words = shlex.split(line.split(" > ")[0], comments=True)
        assert words[0] in SHELL, line
        if words[:2] == ["python", "-m"] and words[2].startswith("lab"):
            assert importlib.util.find_spec(words[2]) is not None, line
        if words[0] == "imapper-prob" and words[1] != "--version":
            command_parser().parse_args(words[1:])


@pytest.mark.parametrize("path", PAGES, ids=name_of)
def test_snippets_parse(path: Path) -> None:
    for block in blocks(path, "python"):
        ast.parse(block)
    for block in blocks(path, "toml"):
        if "settings" in path.name:
            from_toml(block, where=name_of(path))


@pytest.mark.parametrize("path", PAGES, ids=name_of)
def test_links_lead_somewhere(path: Path) -> None:
    for target in re.findall(r"\]\(([^)\s]+)\)", path.read_text(encoding="utf-8")):
        if not target.startswith(("http", "#")):
            assert (path.parent / target.partition("#")[0]).exists(), f"{name_of(path)}: {target}"


@pytest.mark.parametrize("path", PAGES, ids=name_of)
def test_tests_that_a_page_names_are_there(path: Path) -> None:
    for file, name in re.findall(r"`(tests/[\w/]+\.py)::(\w+)", path.read_text(encoding="utf-8")):
        assert (ROOT / file).is_file(), f"{name_of(path)}: {file}"
        tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
        there = [node.name for node in tree.body if isinstance(node, ast.FunctionDef)]
        assert name in there, f"{name_of(path)}: {file} has no {name}"


def test_every_fault_of_the_page_on_robustness_has_a_test() -> None:
    text = (ROOT / "docs" / "reference" / "robustness.md").read_text(encoding="utf-8")
    _, _, section = text.partition("## Faults and the tests that hold them\n")
    rows = [line for line in section.partition("\n## ")[0].splitlines() if line.startswith("| ")]
    assert len(rows) > 30
    for row in rows[1:]:
        assert re.search(r"\| `tests/[\w/]+\.py::test_\w+`[^|]*\|$", row), row


def test_every_page_is_in_an_index() -> None:
    pages = [*(ROOT / "docs").rglob("*.md"), *(ROOT / "docs").rglob("*.ipynb")]
    for path in pages:
        if path.name != "index.md":
            section = ROOT / "docs" / path.relative_to(ROOT / "docs").parts[0]
            index = (section / "index.md").read_text(encoding="utf-8")
            page = path.relative_to(section)
            assert f"({page})" in index
            assert f"\n{page.with_suffix('')}\n" in index


def test_there_are_commands_and_snippets() -> None:
    assert DEMO in lines(ROOT / "README.md")
    assert "load_posterior" in blocks(ROOT / "README.md", "python")[0]
    assert runnable(ROOT / "docs" / "how-to" / "export.md")


def runnable(path: Path) -> list[str]:
    """Commands that need nothing but the demo."""
    return [line for line in lines(path) if not any(w in line for w in (*BROUGHT, *NEITHER))]


@pytest.mark.slow
def test_all_that_needs_only_the_demo_runs(tmp_path: Path) -> None:
    """In the order of the pages, in one folder, as a reader would, but with a brief demo."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    program = [sys.executable, "-m", "imapper_prob.cli"]
    done: set[str] = set()
    for path in GUIDES:
        for line in runnable(path):
            if line in done:
                continue
            done.add(line)
            words = shlex.split(line)
            command = [*program, *words[1:]] if words[0] == "imapper-prob" else words
            command = [sys.executable, *command[1:]] if command[0] == "python" else command
            if line.startswith(DEMO):
                command += ["--minutes", "0.2"] if "--minutes" in line else ["--steps", "2000"]
            ended = subprocess.run(
                command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
            )
            assert ended.returncode == 0, f"{name_of(path)}: {line}\n{ended.stderr}"
        together = "\n".join(blocks(path, "python"))
        ended = subprocess.run(
            [sys.executable, "-W", "error", "-"],
            input=together,
            cwd=tmp_path,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )
        assert ended.returncode == 0, f"{name_of(path)}\n{ended.stderr}"
