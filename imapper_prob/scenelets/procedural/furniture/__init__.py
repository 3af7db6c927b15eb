"""Furniture as unions of cuboids, with the sizes people live with.

Every piece stands on the floor with its origin below the middle of its bounding box in top
view and its front towards +y: a seat is left that way, a table or shelf is used from there,
a bed's foot end points there. All lengths are metres; each piece names the source of its
sizes.
"""

from __future__ import annotations

from imapper_prob.scenelets.procedural.furniture.parts import ORIGIN
from imapper_prob.scenelets.procedural.furniture.seats import (
    bed,
    bench,
    chair,
    couch,
    office_chair,
    stool,
)
from imapper_prob.scenelets.procedural.furniture.storage import shelf
from imapper_prob.scenelets.procedural.furniture.tables import (
    counter,
    desk,
    knee_room,
    low_table,
    table,
)

__all__ = [
    "ORIGIN",
    "bed",
    "bench",
    "chair",
    "couch",
    "counter",
    "desk",
    "knee_room",
    "low_table",
    "office_chair",
    "shelf",
    "stool",
    "table",
]
