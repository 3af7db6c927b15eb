"""Walking and standing about with nothing near."""

from __future__ import annotations

import numpy as np

from imapper_prob.scenelets.procedural.body import pose_body
from imapper_prob.scenelets.procedural.gait import arc, walk_along
from imapper_prob.scenelets.procedural.person import Person
from imapper_prob.scenelets.procedural.recipes.drawn import Drawn, moments
from imapper_prob.scenelets.procedural.standing import stand_idle

__all__ = ["idle", "walk"]


def walk(rng: np.random.Generator, person: Person) -> Drawn:
    """About a metre or two of walking, straight or in a curve."""
    speed = rng.uniform(0.55, 1.25)
    curvature = rng.choice([0.0, rng.uniform(0.2, 1.3)])
    # Steps quicken as walking does: 85 a minute at .55 m/s, 115 at 1.25 m/s.
    step_time = 60 / (62 + 42 * speed)
    times = moments(rng, 15, 20)
    moving = walk_along(
        arc(speed, curvature),
        times,
        step_time=step_time,
        phase=rng.uniform(0, 2 * step_time),
        lean=rng.uniform(0.02, 0.08),
        half_width=rng.uniform(0.06, 0.10),
        vigour=rng.uniform(0.5, 1.3),
    )
    return Drawn(pose_body(moving.trunk, ankles=moving.ankles, wrists=moving.wrists), ())


def idle(rng: np.random.Generator, person: Person) -> Drawn:
    """Standing with nothing near."""
    return Drawn(stand_idle(rng, moments(rng, 15, 18)), ())
