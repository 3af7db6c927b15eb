"""Two people at one table, simulated: clip and library for ``imapper-prob run``.

``python -m benchmarks.couple DIR [SEED]`` writes ``DIR/couple.npz`` and ``DIR/chairs.npz``, the
scenelets of chairs, tables and none; ``docs/actors.md`` says what comes of them.
"""

from __future__ import annotations

import sys
from pathlib import Path

from imapper_prob.inputs import write_clip
from imapper_prob.scenelets.library_file import save_library
from tests.staged.couples import at_one_table, chairs_and_tables


def main() -> None:
    """Write both files."""
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    write_clip(folder / "couple.npz", at_one_table(int(sys.argv[2]) if len(sys.argv) > 2 else 1))
    save_library(chairs_and_tables(1), folder / "chairs.npz")


if __name__ == "__main__":
    main()
