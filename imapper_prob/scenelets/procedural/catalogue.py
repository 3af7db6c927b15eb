"""The catalogue: which interactions the built-in library holds, and how many of each.

Actions are ``walk``, ``stand``, ``sit``, ``sit-down``, ``stand-up`` and ``reach``. Every
recipe draws one motion with its furniture; every second scenelet is the mirror image of the
one before, so that nothing in the library is more left- than right-handed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from imapper_prob.models.scenelet import Library, Scenelet
from imapper_prob.scenelets.frames import localised, mirrored
from imapper_prob.scenelets.procedural.person import draw_person
from imapper_prob.scenelets.procedural.recipes.drawn import FRAMES_PER_SECOND, Recipe
from imapper_prob.scenelets.procedural.recipes.reaching import reach_shelf, stand_at_table
from imapper_prob.scenelets.procedural.recipes.sitting import (
    sit,
    sit_at_low_table,
    sit_at_table,
    sit_down_on,
)
from imapper_prob.scenelets.procedural.recipes.walking import idle, walk

__all__ = ["CATALOGUE", "Entry", "build_library"]


@dataclass(frozen=True)
class Entry:
    """A line of the catalogue: what it is called, what is done, how many, how one is drawn."""

    name: str
    action: str
    count: int
    draw: Recipe


CATALOGUE: Final = (
    Entry("walk", "walk", 48, walk),
    Entry("stand-idle", "stand", 6, idle),
    Entry("sit-chair", "sit", 24, sit("chair")),
    Entry("sit-stool", "sit", 12, sit("stool")),
    Entry("sit-couch", "sit", 28, sit("couch")),
    Entry("sit-couch-table", "sit", 12, sit_at_low_table),
    Entry("sit-chair-table", "sit", 16, sit_at_table),
    Entry("sit-down-chair", "sit-down", 8, sit_down_on("chair", backwards=False)),
    Entry("sit-down-couch", "sit-down", 8, sit_down_on("couch", backwards=False)),
    Entry("stand-up-chair", "stand-up", 6, sit_down_on("chair", backwards=True)),
    Entry("stand-up-couch", "stand-up", 6, sit_down_on("couch", backwards=True)),
    Entry("stand-table", "stand", 18, stand_at_table),
    Entry("reach-shelf", "reach", 24, reach_shelf),
)
"""216 scenelets, about as many of each kind as people spend time on it in a living room."""


def build_library(seed: int = 0) -> Library:
    """The built-in library; the same seed gives the same library, bit for bit.

    Each scenelet has its own stream of random numbers, named by catalogue line and index,
    so lengthening one line changes nothing in the others.
    """
    scenelets: list[Scenelet] = []
    for line, entry in enumerate(CATALOGUE):
        for index in range(0, entry.count, 2):
            rng = np.random.default_rng([seed, line, index])
            person = draw_person(rng)
            drawn = entry.draw(rng, person)
            furniture = [person.returns(piece) for piece in drawn.objects]
            name = f"{entry.name}-{index:03d}"
            original = localised(name, entry.action, drawn.joints, furniture, fps=FRAMES_PER_SECOND)
            scenelets += [original, mirrored(original, f"{entry.name}-{index + 1:03d}")]
    return Library("built-in" if seed == 0 else f"built-in-{seed}", tuple(scenelets))
