"""Figures as pictures."""

from __future__ import annotations

import io

from matplotlib.figure import Figure
from PIL import Image


def png_size(figure: Figure) -> tuple[int, int]:
    """Width and height in pixels of a figure at 50 dots per inch."""
    file = io.BytesIO()
    figure.savefig(file, dpi=50)
    with Image.open(file) as image:
        return image.size
