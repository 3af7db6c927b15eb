"""What one reaches into."""

from __future__ import annotations

import numpy as np

from imapper_prob.models.scene import SceneObject
from imapper_prob.scenelets.procedural.furniture.parts import BOARD, ORIGIN, box

__all__ = ["shelf"]


def shelf(rng: np.random.Generator) -> SceneObject:
    """A bookshelf: sides, a back and boards, open to the front.

    1.40-2.25 high as annotated in i3DB; boards .36 apart, .28-.38 deep, for folders and
    tall books (Neufert, *Architects' Data*).
    """
    width, depth = rng.uniform(0.8, 1.2), rng.uniform(0.28, 0.38)
    height = rng.uniform(1.40, 2.25)
    x, y = width / 2, depth / 2
    levels = np.linspace(BOARD, height, round(height / 0.36) + 1)
    return SceneObject(
        "shelf",
        ORIGIN,
        (
            box("side", (-x, -y, 0.0), (-x + BOARD, y, height)),
            box("side", (x - BOARD, -y, 0.0), (x, y, height)),
            box("back", (-x, -y, 0.0), (x, -y + BOARD, height)),
            *(box("board", (-x + BOARD, -y + BOARD, z - BOARD), (x - BOARD, y, z)) for z in levels),
        ),
    )
