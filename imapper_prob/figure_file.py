"""Figures in files."""

from __future__ import annotations

from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["save_figure"]


def save_figure(figure: Figure, file: Path | IO[bytes], *, dpi: int, **options: Any) -> None:
    """Write a figure as a picture, its texts as they stand.

    Names in them are of others: between two dollar signs they would be read as formulas.
    """
    from matplotlib.text import Text

    for text in figure.findobj(Text):
        text.set_parse_math(False)
    figure.savefig(file, dpi=dpi, **options)
