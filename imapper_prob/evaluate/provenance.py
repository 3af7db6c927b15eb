"""What figures were made with, to be written beside them."""

from __future__ import annotations

import subprocess
from importlib.metadata import version
from pathlib import Path

__all__ = ["commit", "made_by"]


def made_by(command: str) -> dict[str, str]:
    """Program, commit and command."""
    return {
        "program": f"imapper-prob {version('imapper-prob')}",
        "commit": commit(),
        "command": command,
    }


def commit() -> str:
    """The commit of the source folder, with a + where files differ from it; else ``unknown``."""
    here = Path(__file__).parent
    try:
        head = _git(here, "rev-parse", "--short=10", "HEAD")
        changed = _git(here, "status", "--porcelain", "--untracked-files=no")
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    return head + ("+" if changed else "")


def _git(folder: Path, *arguments: str) -> str:
    done = subprocess.run(
        ["git", "-C", str(folder), *arguments], capture_output=True, text=True, check=True
    )
    return done.stdout.strip()
