"""A recording as rerun's own reader gives it back."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path
from typing import Any

from rerun.chunk import RrdReader

Columns = dict[tuple[str, str], dict[int | None, Any]]


def read(path: Path) -> Columns:
    """(entity, component) to time to value; static values stand at time ``None``."""
    found: Columns = defaultdict(dict)
    for chunk in RrdReader(path).stream():
        assert len(chunk.timeline_names) == (0 if chunk.is_static else 1), chunk.entity_path
        table = chunk.to_record_batch().to_pydict()
        times = [None] if chunk.is_static else table[chunk.timeline_names[0]]
        for name, values in table.items():
            if ":" in name:
                found[chunk.entity_path, name].update(zip(times, values, strict=True))
    return found
