"""Results that commands keep: of which program they are. (No command of its own.)"""

from __future__ import annotations

import hashlib
from pathlib import Path

import imapper_prob

__all__ = ["digest"]


def digest(*more: Path) -> str:
    """Of the whole program, and of ``more`` files: what results of another one are no part of.

    Twelve hexadecimal digits.
    """
    state = hashlib.sha256()
    root = Path(imapper_prob.__file__).parent
    for folder in (root, root / "models", root / "samplers"):
        for path in sorted(folder.rglob("*.py")):
            state.update(path.read_bytes())
    for path in (root / "models" / "calibrated.toml", *more):
        state.update(path.read_bytes())
    return state.hexdigest()[:12]
