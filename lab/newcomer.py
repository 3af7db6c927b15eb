"""Does the first hour go well? Installs the wheel, and types what README says and what people do.

    python -m lab.newcomer FOLDER [--borrow] [--brief]

builds the wheel, installs it in an environment of its own in FOLDER, runs the commands of README.md
and its lines of Python (as a script, by ``python -`` and in a notebook), asks every command for its
help, and makes typical mistakes. Each row printed is one thing done: what, how it ended, seconds.
The exit code is 1 if one went otherwise than it should. It takes ten minutes; with ``--borrow``
packages and compiled kernels come from this checkout, with ``--brief`` the demo is a short one.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import re
import shlex
import shutil
import site
import subprocess
import sys
import time
import venv
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from imapper_prob.cli.main import command_parser
from imapper_prob.cli.parser import commands_of

__all__ = ["main"]

ROOT: Final = Path(__file__).parents[1]
_SOURCES: Final = ("imapper_prob", "models", "samplers")
_FILES: Final = ("pyproject.toml", "README.md", "LICENSE", "constraints.txt")
_BRIEF: Final = ("--steps", "400")
_INSTALLS: Final = ("python -m venv", ". .venv", "pip ")
"""Beginnings of lines of README that :meth:`Newcomer.install` replaces."""
_LENT: Final = 24 * 3600.0
"""Age in seconds of the last use of kernels that are lent; checkouts keep older ones no longer."""
_CELL: Final = """
import sys, nbclient, nbformat
notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(sys.stdin.read())])
nbclient.NotebookClient(notebook, timeout=600).execute()
"""

MISTAKES: Final = (
    ("rnu clip.npz -o out/x", "did you mean run?"),
    ("run clip.npz -o out/x --step 5", "did you mean --steps?"),
    ("run clip.npz", "-o/--output"),
    ("run missing.npz -o out/x", "no such file"),
    ("run notes.txt -o out/x", "not a known clip"),
    ("run empty -o out/x", "not a known clip"),
    ("run cut.json -o out/x", "cut.json"),
    ("run cut.npz -o out/x", "cut.npz"),
    ("run out/demo -o out/x", "not a known clip"),
    ("demo -o out/demo", "go on with"),
    ("demo -o mine", "notes.txt"),
    ("demo -o out/x --workers 0", "at least 1"),
    ("demo -o out/x --seed -1", "must be at least 0"),
    ("demo -o out/x --steps many", "invalid int value"),
    ("info nowhere", "nowhere"),
    ("view nowhere", "nowhere"),
    ("export out/demo --format glb --scene 99 -o s.glb", "counted from 1"),
    ("export out/demo --format glb -o out", "is a folder"),
    ("export out/demo --format obj -o s.obj", "none of glb, json, i3db"),
    ("evaluate nowhere", "nowhere"),
)
"""Typical wrong commands, and what the answer must contain."""


@dataclass
class Newcomer:
    """A user with a folder and an environment of their own.

    Parameters
    ----------
    folder : Path
        It is made; the environment is ``venv`` in it, and commands run in ``home``.
    borrow : bool
        Take packages and compiled kernels from the environment and the checkout that run this.
    wrong : list of str
        What went otherwise than it should.
    """

    folder: Path
    borrow: bool
    wrong: list[str] = field(default_factory=list)

    @property
    def home(self) -> Path:
        """Folder in which commands run."""
        return self.folder / "home"

    @property
    def bin(self) -> Path:
        """Folder of the environment's programs."""
        return self.folder / "venv" / "bin"

    def note(self, what: str, problem: str, seconds: float) -> None:
        """Print a row; an empty ``problem`` means success."""
        print(f"| {what} | {problem or 'well'} | {seconds:.1f} |", flush=True)
        if problem:
            self.wrong.append(what)

    def install(self) -> None:
        """Build the wheel from a copy, make the environment, and install the wheel in it."""
        begun = time.perf_counter()
        copy = self.folder / "clone"
        copy.mkdir(parents=True)
        self.home.mkdir()
        for name in _FILES:
            shutil.copy(ROOT / name, copy)
        for name in _SOURCES:
            shutil.copytree(
                ROOT / name,
                copy / name,
                symlinks=True,
                ignore=shutil.ignore_patterns("__pycache__"),
            )
        pip: list[str | Path] = [
            sys.executable,
            "-m",
            "pip",
            "--quiet",
            "--disable-pip-version-check",
        ]
        self._must([*pip, "wheel", "--no-deps", "--no-build-isolation", "-w", self.folder, copy])
        wheel = next(self.folder.glob("*.whl"))
        venv.create(self.folder / "venv", with_pip=False)
        into: list[str | Path] = [*pip, "--python", self.bin / "python", "install"]
        if self.borrow:
            self._must([*into, "--no-deps", "--no-index", wheel])
            (place,) = (self.folder / "venv").glob("lib/python*/site-packages")
            (place / "borrowed.pth").write_text("\n".join(site.getsitepackages()) + "\n")
            _lend_kernels(place / "imapper_prob")
        else:
            self._must([*into, "-c", copy / "constraints.txt", f"{wheel}[notebook]"])
        self.note("install the wheel", "", time.perf_counter() - begun)

    def _must(self, command: Sequence[str | Path]) -> None:
        subprocess.run([str(word) for word in command], check=True)

    def type(self, words: Sequence[str], said: str | None = None) -> tuple[int, str, str]:
        """Exit status, output and errors of a command, with ``said`` on its standard input."""
        path = f"{self.bin}{os.pathsep}{os.environ['PATH']}"
        kept = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "DISPLAY")}
        done = subprocess.run(
            [str(self.bin / words[0]), *words[1:]],
            input=said,
            cwd=self.home,
            env={**kept, "PATH": path},
            capture_output=True,
            text=True,
            check=False,
        )
        return done.returncode, done.stdout, done.stderr

    def done(self, what: str, words: Sequence[str], said: str | None = None) -> None:
        """Run a command that must succeed."""
        begun = time.perf_counter()
        status, _, errors = self.type(words, said)
        last = errors.strip().splitlines()[-1:] or [""]
        problem = "" if status == 0 else f"status {status}: {last[0]}"
        self.note(what, problem, time.perf_counter() - begun)

    def mistake(self, line: str, answer: str) -> None:
        """Run a command that must fail with a one-line answer."""
        begun = time.perf_counter()
        status, _, errors = self.type(["imapper-prob", *shlex.split(line)])
        problem = ""
        if status != 2:
            problem = f"status {status}"
        elif errors.count("\n") != 1 or "Traceback" in errors:
            problem = f"{errors.count(chr(10))} lines"
        elif answer not in errors:
            problem = f"does not say {answer!r}: {errors.strip()}"
        elif (self.home / "out" / "x").exists():
            problem = "leaves out/x behind"
        self.note(f"`{line}`: {errors.strip()}", problem, time.perf_counter() - begun)


def _blocks(language: str) -> Iterator[str]:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    yield from re.findall(rf"^```{language}\n(.*?)^```", text, re.MULTILINE | re.DOTALL)


def _lend_kernels(package: Path) -> None:
    """Put the compiled kernels of this checkout where an installed package looks for them.

    numba names the folder of a module's kernels by a digest of the module's own folder.
    """

    def named(folder: Path) -> str:
        return f"{folder.name}_{hashlib.sha1(str(folder).encode()).hexdigest()}"

    ours = ROOT / "imapper_prob"
    modules = {path.parent for path in package.rglob("*.py")}
    for kernels in (ROOT / "models" / "__pycache__").glob("kernels-*"):
        if kernels.stat().st_mtime > time.time() - _LENT:
            for folder in modules:
                there = kernels / named(ours / folder.relative_to(package))
                if there.is_dir():
                    to = package / "models" / "__pycache__" / kernels.name / named(folder)
                    shutil.copytree(there, to, dirs_exist_ok=True)


def _leave_wrong_files(home: Path) -> None:
    """Create the files that typical mistakes involve."""
    (home / "notes.txt").write_text("years of work")
    (home / "mine").mkdir()
    (home / "mine" / "notes.txt").write_text("years of work")
    (home / "empty").mkdir()
    (home / "cut.json").write_text('[{"image_id": "1.jpg", "keypoints": [1, 2')
    (home / "cut.npz").write_bytes(b"PK\x03\x04 and then nothing")
    (home / "clip.npz").write_bytes(b"")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the whole session; return 1 if anything went wrong."""
    parser = argparse.ArgumentParser(
        prog="python -m lab.newcomer",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="is made")
    parser.add_argument("--borrow", action="store_true", help="what this checkout has installed")
    parser.add_argument("--brief", action="store_true", help="a short demo")
    options = parser.parse_args(arguments)
    if options.folder.exists():
        parser.error(f"{options.folder} is there already")
    print("| what | how it ended | seconds |\n|---|---|---|")
    somebody = Newcomer(options.folder.resolve(), options.borrow)
    somebody.install()
    for line in "".join(_blocks("sh")).splitlines():
        if not line.startswith(_INSTALLS):
            extra = _BRIEF if options.brief and " demo " in line else ()
            somebody.done(line, [*shlex.split(line), *extra])
    (snippet,) = _blocks("python")
    (somebody.home / "script.py").write_text(snippet)
    somebody.done("README's lines as a script", ["python", "script.py"])
    somebody.done("by `python -`", ["python", "-"], snippet)
    somebody.done("in a notebook", ["python", "-c", _CELL], snippet)
    somebody.done("no arguments", ["imapper-prob"])
    for name, _ in commands_of(command_parser()):
        somebody.done(f"{' '.join(name)} --help", ["imapper-prob", *name, "--help"])
    _leave_wrong_files(somebody.home)
    for line, answer in MISTAKES:
        somebody.mistake(line, answer)
    print(f"{len(somebody.wrong)} went otherwise than they should")
    return 1 if somebody.wrong else 0


if __name__ == "__main__":
    sys.exit(main())
