"""What other people call furniture, in the words of our libraries.

Scenelets of several libraries meet in one posterior; a sofa of one and a couch of another
could not share a place there.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import Final

__all__ = ["category", "left_out"]

_SYNONYMS: Final = {
    "sofa": "couch", "loveseat": "couch", "settee": "couch", "sofa chair": "chair",
    "armchair": "chair", "office chair": "chair", "swivel chair": "chair",
    "dining chair": "chair", "seat": "chair", "footstool": "stool", "ottoman": "stool",
    "barstool": "stool", "desk": "table", "coffee table": "table", "dining table": "table",
    "side table": "table", "end table": "table", "bookshelf": "shelf", "bookcase": "shelf",
    "shelves": "shelf", "shelving": "shelf", "countertop": "counter",
    "kitchen counter": "counter",
}  # fmt: skip

_NO_FURNITURE: Final = frozenset({
    "", "unknown", "unlabeled", "unlabelled", "unannotated", "none", "other", "remove",
    "floor", "wall", "ceiling", "room", "door", "window", "pillar", "beam", "stairs", "person",
})  # fmt: skip
"""Labels of scans that say nothing, or that mean the room itself."""


def category(label: str) -> str | None:
    """Our word for a label; ``None`` where it is no furniture.

    Case, underscores and hyphens do not matter; a word that is not known stays what it is.
    """
    words = " ".join(label.lower().replace("_", " ").replace("-", " ").split())
    if words in _NO_FURNITURE:
        return None
    return _SYNONYMS.get(words, words)


def left_out(labels: Iterable[str]) -> str:
    """Half a sentence that counts what was left out, by label."""
    counts = Counter(label or "without a label" for label in labels)
    listed = ", ".join(f"{n} {label}" for label, n in counts.most_common())
    return f"left out what is no furniture ({listed})"
