"""The catalogue: the interactions of the built-in library, and the number of each.

Actions are ``walk``, ``stand``, ``sit``, ``sit-down``, ``stand-up``, ``lie``, ``reach``,
``pick-up``, ``put-down``, ``squat``, ``kneel`` and ``bend``. A family is an action, or one way of
performing it. Every recipe draws one motion with its furniture; every second scenelet is the mirror
image of the one before, so that the library has no handedness.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final
from zlib import crc32

import numpy as np

from imapper_prob.models.scenelet import Library, Scenelet
from imapper_prob.scenelets.frames import localised, mirrored
from imapper_prob.scenelets.plausibility import faults
from imapper_prob.scenelets.procedural import (
    folded,
    low,
    lying,
    on_foot,
    reaching,
    resting,
    sitting,
)
from imapper_prob.scenelets.procedural.body import (
    FRAMES_PER_SECOND,
    Recipe,
    as_tracked,
    backwards,
    draw_person,
)

__all__ = ["CATALOGUE", "VERSION", "Entry", "build_library"]

VERSION: Final = 4
"""Version, raised whenever the generated scenelets change; part of the library's name."""

_ATTEMPTS: Final = 50
"""Largest number of draws for one scenelet; most need one or two."""


@dataclass(frozen=True)
class Entry:
    """One entry of the catalogue.

    Parameters
    ----------
    name : str
        Name of its scenelets, which are numbered. It also seeds them, so it must never change.
    action : str
        Action of the scenelets.
    count : int
        Number of scenelets; even.
    draw : Recipe
        Draws a scenelet.
    family : str
        Family of these motions; the action, if not given.
    """

    name: str
    action: str
    count: int
    draw: Recipe
    family: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "family", self.family or self.action)


CATALOGUE: Final = (
    # On foot without furniture: 18 of 100.
    Entry("walk", "walk", 160, on_foot.walk),
    Entry("walk-shuffle", "walk", 24, on_foot.shuffle),
    Entry("walk-start", "walk", 32, on_foot.start_walking),
    Entry("walk-stop", "walk", 32, on_foot.stop_walking),
    Entry("walk-turn", "walk", 32, on_foot.turn_on_spot),
    Entry("walk-side-step", "walk", 20, on_foot.side_step),
    Entry("walk-carry", "walk", 36, on_foot.carry),
    Entry("stand-idle", "stand", 60, on_foot.idle),
    # Seats: 41 of 100, and another 11 below. On chairs (and some benches, at tables),
    Entry("sit-chair", "sit", 84, sitting.sit("chair")),
    Entry("sit-office-chair", "sit", 40, sitting.sit("office-chair")),
    Entry("sit-chair-turned", "sit", 20, sitting.sit_turned("chair")),
    Entry("sit-table", "sit", 80, sitting.sit_at_table),
    Entry("sit-desk", "sit", 60, sitting.sit_at_desk),
    Entry("sit-chair-shelf", "sit", 12, sitting.sit_beside_shelf("chair")),
    Entry("sit-down-chair", "sit-down", 28, sitting.sit_down_on("chair")),
    Entry("stand-up-chair", "stand-up", 26, backwards(sitting.sit_down_on("chair"))),
    Entry("sit-down-table", "sit-down", 12, sitting.sit_down_at_table),
    Entry("stand-up-table", "stand-up", 10, backwards(sitting.sit_down_at_table)),
    # on couches and armchairs,
    Entry("sit-couch", "sit", 120, sitting.sit("couch")),
    Entry("sit-armchair", "sit", 60, sitting.sit("armchair")),
    Entry("sit-couch-turned", "sit", 24, sitting.sit_turned("couch")),
    Entry("sit-couch-table", "sit", 72, sitting.sit_at_low_table),
    Entry("sit-couch-shelf", "sit", 12, sitting.sit_beside_shelf("couch")),
    Entry("sit-down-couch", "sit-down", 32, sitting.sit_down_on("couch")),
    Entry("stand-up-couch", "stand-up", 30, backwards(sitting.sit_down_on("couch"))),
    # and on what else there is.
    Entry("sit-stool", "sit", 98, sitting.sit("stool")),
    Entry("sit-down-stool", "sit-down", 18, sitting.sit_down_on("stool")),
    Entry("stand-up-stool", "stand-up", 16, backwards(sitting.sit_down_on("stool"))),
    Entry("sit-bench", "sit", 32, sitting.sit("bench")),
    Entry("sit-down-bench", "sit-down", 8, sitting.sit_down_on("bench")),
    Entry("stand-up-bench", "stand-up", 8, backwards(sitting.sit_down_on("bench"))),
    Entry("sit-bed", "sit", 12, sitting.sit("bed")),
    # At tables and counters: 10 of 100.
    Entry("stand-table", "stand", 40, on_foot.stand_at("table")),
    Entry("stand-counter", "stand", 36, on_foot.stand_at("counter")),
    Entry("lean-on-table", "stand", 16, on_foot.lean_on_top("table")),
    Entry("lean-on-counter", "stand", 16, on_foot.lean_on_top("counter")),
    Entry("lean-against-table", "stand", 12, on_foot.lean_back_against("table")),
    Entry("lean-against-counter", "stand", 16, on_foot.lean_back_against("counter")),
    Entry("pick-up-table", "pick-up", 20, on_foot.pick_up("table")),
    Entry("put-down-table", "put-down", 16, backwards(on_foot.pick_up("table"))),
    Entry("pick-up-low-table", "pick-up", 14, on_foot.pick_up("low table")),
    Entry("put-down-low-table", "put-down", 10, backwards(on_foot.pick_up("low table"))),
    Entry("pick-up-counter", "pick-up", 12, on_foot.pick_up("counter")),
    Entry("put-down-counter", "put-down", 8, backwards(on_foot.pick_up("counter"))),
    # At shelves: 11 of 100.
    Entry("reach-shelf", "reach", 140, reaching.reach_shelf),
    Entry("reach-shelf-coming", "reach", 40, reaching.step_to_shelf),
    Entry("reach-shelf-leaving", "reach", 28, backwards(reaching.step_to_shelf)),
    Entry("reach-shelf-browsing", "reach", 44, reaching.browse_shelf),
    # Lying: 2 of 100, including on the floor.
    Entry("lie-bed", "lie", 24, lying.lie_on_bed),
    Entry("lie-couch", "lie", 12, lying.lie_on_couch),
    # Other ways of sitting: legs crossed,
    Entry("sit-crossed-chair", "sit", 20, folded.sit_crossed("chair"), "legs-crossed"),
    Entry("sit-crossed-couch", "sit", 12, folded.sit_crossed("couch"), "legs-crossed"),
    Entry("sit-crossed-stool", "sit", 10, folded.sit_crossed("stool"), "legs-crossed"),
    Entry("sit-crossed-bench", "sit", 4, folded.sit_crossed("bench"), "legs-crossed"),
    # a leg folded on the seat, or both of them,
    Entry("sit-on-leg-bed", "sit", 18, folded.sit_on_leg("bed"), "leg-folded"),
    Entry("sit-on-leg-couch", "sit", 10, folded.sit_on_leg("couch"), "leg-folded"),
    Entry("sit-on-leg-chair", "sit", 8, folded.sit_on_leg("chair"), "leg-folded"),
    Entry("sit-on-leg-bench", "sit", 2, folded.sit_on_leg("bench"), "leg-folded"),
    Entry("sit-tailor-bed", "sit", 14, folded.sit_tailor_fashion("bed"), "cross-legged"),
    Entry("sit-tailor-couch", "sit", 12, folded.sit_tailor_fashion("couch"), "cross-legged"),
    # on an edge,
    Entry("perch-chair", "sit", 12, resting.perch_on("chair"), "perch"),
    Entry("perch-stool", "sit", 18, resting.perch_on("stool"), "perch"),
    Entry("perch-bench", "sit", 6, resting.perch_on("bench"), "perch"),
    Entry("perch-couch", "sit", 4, resting.perch_on("couch"), "perch"),
    Entry("perch-bed", "sit", 4, resting.perch_on("bed"), "perch"),
    Entry("perch-table", "stand", 12, resting.perch_on_table, "perch"),
    # on an arm,
    Entry("sit-leaning-chair", "sit", 12, resting.lean_on_armrest("chair"), "lean-on-arm"),
    Entry("sit-leaning-couch", "sit", 10, resting.lean_on_armrest("couch"), "lean-on-arm"),
    Entry("sit-leaning-armchair", "sit", 8, resting.lean_on_armrest("armchair"), "lean-on-arm"),
    Entry("sit-leaning-table", "sit", 14, resting.lean_on_table, "lean-on-arm"),
    Entry("sit-leaning-bed", "sit", 8, resting.lean_on_bed, "lean-on-arm"),
    # and lying back.
    Entry("slouch-chair", "sit", 12, resting.slouch_on("chair"), "slouch"),
    Entry("slouch-couch", "sit", 10, resting.slouch_on("couch"), "slouch"),
    Entry("slouch-armchair", "sit", 6, resting.slouch_on("armchair"), "slouch"),
    Entry("sit-back-bed", "sit", 8, resting.lean_back_on_bed, "slouch"),
    # Low postures without furniture: 6 of 100.
    Entry("sit-floor-cross-legged", "sit", 12, low.low_down("cross-legged"), "floor-sit"),
    Entry("sit-floor-legs-out", "sit", 10, low.low_down("legs out"), "floor-sit"),
    Entry("sit-floor-knees-up", "sit", 10, low.low_down("knees up"), "floor-sit"),
    Entry("lie-floor", "lie", 8, low.lie_on_floor, "floor-lie"),
    Entry("squat", "squat", 16, low.low_down("squat")),
    Entry("squat-down", "squat", 8, low.go_into_squat),
    Entry("squat-up", "squat", 8, backwards(low.go_into_squat)),
    Entry("kneel-both", "kneel", 16, low.low_down("both knees")),
    Entry("kneel-one", "kneel", 16, low.low_down("one knee")),
    Entry("pick-up-floor", "pick-up", 16, low.pick_up_from_floor, "bend"),
    Entry("put-down-floor", "put-down", 8, backwards(low.pick_up_from_floor), "bend"),
    Entry("bend-over", "bend", 10, low.bend_over),
)
"""2206 scenelets, about in proportion to the time that people spend on each in living rooms and
offices. Chairs, couches, stools and benches are as 4 : 4 : 1.5 : .7, so that none is preferred only
because another one is rare."""


def build_library(seed: int = 0) -> Library:
    """Make the built-in library; the same seed gives the same library, bit for bit.

    Each scenelet has its own random stream, named by catalogue entry and index, so changing one
    entry does not affect the others.

    Parameters
    ----------
    seed : int
        The same seed gives the same library.

    Returns
    -------
    Library
    """
    scenelets: list[Scenelet] = []
    for entry in CATALOGUE:
        for index in range(0, entry.count, 2):
            original = _scenelet(entry, index, seed)
            scenelets += [original, mirrored(original, _name(entry, index + 1))]
    name = f"built-in {VERSION}"
    return Library(name if seed == 0 else f"{name}, seed {seed}", tuple(scenelets))


def _name(entry: Entry, index: int) -> str:
    return f"{entry.name}-{index:03d}"


def _scenelet(entry: Entry, index: int, seed: int) -> Scenelet:
    """The first plausible draw of a body of 1.70 m, in its local frame and its own scale."""
    found: list[str] = []
    for attempt in range(_ATTEMPTS):
        rng = np.random.default_rng([seed, crc32(entry.name.encode()), index, attempt])
        person = draw_person(rng)
        motion, seen = entry.draw(rng, person)
        joints = as_tracked(rng, motion, fps=FRAMES_PER_SECOND)
        found = faults(joints, seen, fps=FRAMES_PER_SECOND)
        if not found:
            name = _name(entry, index)
            return localised(name, entry.action, joints, seen, fps=FRAMES_PER_SECOND)
    raise RuntimeError(
        f"catalogue line {entry.name}, scenelet {index}: {_ATTEMPTS} draws that nobody could do, "
        f"the last one because {found[0]}"
    )
