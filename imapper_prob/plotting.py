"""Colours of objects and actions, and writing of figures."""

from __future__ import annotations

from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from imapper_prob.models.colours import Colour, action_colour, category_colour
from imapper_prob.models.drawing import take_texts_as_they_stand

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Colour", "action_colour", "category_colour", "save_figure"]


def save_figure(figure: Figure, file: Path | IO[bytes], *, dpi: int = 120, **options: Any) -> None:
    """Write a figure as an image, without interpreting its texts as markup.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
    file : Path or binary file
    dpi : int
        Dots an inch; 120 makes figures of 8 to 12 inches as wide as a page of a browser.
    **options : Of ``Figure.savefig``.
    """
    take_texts_as_they_stand(figure)
    figure.savefig(file, dpi=dpi, **options)
