"""Damaged inputs and files; each command writes a section of ``docs/reference/robustness.md``."""

from __future__ import annotations

from pathlib import Path
from typing import Final

__all__ = ["write_section"]

DOCUMENT: Final = Path(__file__).parents[2] / "docs" / "reference" / "robustness.md"


def write_section(heading: str, text: str) -> None:
    """Replace the section under a second-level heading; nothing else changes."""
    before, marked, after = DOCUMENT.read_text(encoding="utf-8").partition(f"## {heading}\n")
    if not marked:
        raise ValueError(f"{DOCUMENT} has no section {heading!r}")
    _, found, rest = after.partition("\n## ")
    end = f"\n## {rest}" if found else ""
    DOCUMENT.write_text(f"{before}## {heading}\n\n{text.strip()}\n{end}", encoding="utf-8")
