"""A clip and a problem for tests of statements, and one statement of each type."""

from __future__ import annotations

from functools import cache

import numpy as np

import imapper_prob as im
from imapper_prob.models.problem import Problem
from imapper_prob.models.scene import Clip
from imapper_prob.models.settings import ModelSettings
from imapper_prob.models.statements import Statement
from tests.models import worlds

LIBRARY = worlds.mixed_library()
REGION = ((-1.5, 2.0), (1.0, 2.2), (1.2, 4.5), (-0.2, 3.4), (-1.4, 4.4))
"""A room that is not convex."""
BOX = (600.0, 500.0, 1100.0, 900.0)
ALL: tuple[Statement, ...] = (
    im.Measured("height", 1.6, 0.1),
    im.ObjectAt(("couch", "chair"), place=(0.3, 3.4), size=(1.6, 0.8, 0.9), box=BOX),
    im.Presence("chair", region=REGION),
    im.Presence("couch", there=False, region=REGION),
    im.Room(REGION, std=0.4),
    im.JointAt("RWRI", 4, (0.1, 3.5, 1.0), 0.2),
    im.DepthOf((2, 9), (3.2, 3.9), 0.05, 0.1),
    im.Contact("couch", 3, 8, sits=False),
    im.SameObject(("chair", "couch"), [(2, 4), (8, 9)], sits=False),
    im.Behind("chair", ("couch", "chair")),
    im.Seen(3, (BOX,), ({"couch": 0.8},)),
)


@cache
def clip() -> Clip:
    return worlds.clip_of(worlds.walk(20), np.random.default_rng(0))


@cache
def problem(likelihood: float = 1.0, energy: str = "default") -> Problem:
    settings = ModelSettings(likelihood=likelihood, energy=energy)
    return worlds.problem(scenelets=LIBRARY, settings=settings)
