"""Notebooks are stored with what they show, and with nothing that differs from run to run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import nbformat
import pytest
from nbclient.exceptions import CellExecutionError

from lab.notebooks import main

PICTURE = "from matplotlib.figure import Figure\nfigure = Figure()\nfigure.subplots()\nfigure"
WIDGET = (
    "from IPython.display import display\n"
    "display({'application/vnd.jupyter.widget-view+json': {}}, raw=True)\nprint('beside it')"
)


def notebook(path: Path, *sources: str) -> Path:
    cells = [nbformat.v4.new_code_cell(source) for source in sources]
    nbformat.write(nbformat.v4.new_notebook(cells=cells), path)
    return path


def test_outputs_are_stored_without_widgets(tmp_path: Path) -> None:
    path = notebook(tmp_path / "one.ipynb", "%matplotlib inline\n" + PICTURE, WIDGET)
    assert main([str(path)]) == 0
    done: Any = nbformat.read(path, as_version=4)
    picture, beside = (cell.outputs for cell in done.cells)
    assert "image/png" in picture[0].data
    assert [output.text for output in beside] == ["beside it\n"]
    assert "widgets" not in done.metadata
    assert all("execution" not in cell.metadata for cell in done.cells)


def test_a_notebook_that_fails_stays_as_it_is(tmp_path: Path) -> None:
    path = notebook(tmp_path / "one.ipynb", "1 / 0")
    before = path.read_bytes()
    with pytest.raises(CellExecutionError, match="ZeroDivisionError"):
        main([str(path)])
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["one.ipynb"]
