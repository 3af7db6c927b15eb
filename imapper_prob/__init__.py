"""Posterior over furniture and human motion, occluded joints included, from one camera.

>>> import imapper_prob as im  # doctest: +SKIP
>>> clip = im.load_clip("Scene04")  # doctest: +SKIP
>>> posterior = im.sample(clip, rng=0)  # doctest: +SKIP
>>> posterior.scenes(5)  # doctest: +SKIP
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

__version__ = "0.2.0"

_HOMES = {
    "Behind": "imapper_prob.models.furniture_statements",
    "Clip": "imapper_prob.models.scene",
    "ClipOptions": "imapper_prob.clips.load",
    "Config": "imapper_prob.config",
    "Contact": "imapper_prob.models.furniture_statements",
    "DepthOf": "imapper_prob.models.statements",
    "InputError": "imapper_prob.models.errors",
    "JointAt": "imapper_prob.models.statements",
    "Library": "imapper_prob.models.scenelet",
    "Measured": "imapper_prob.models.statements",
    "ObjectAt": "imapper_prob.models.furniture_statements",
    "Posterior": "imapper_prob.results.posterior",
    "Presence": "imapper_prob.models.furniture_statements",
    "Room": "imapper_prob.models.statements",
    "SameObject": "imapper_prob.models.furniture_statements",
    "Seen": "imapper_prob.models.furniture_statements",
    "Solution": "imapper_prob.solver.solver",
    "Solved": "imapper_prob.solver.actors",
    "demo_clip": "imapper_prob.api",
    "load_clip": "imapper_prob.api",
    "load_library": "imapper_prob.scenelets.library",
    "load_posterior": "imapper_prob.results.load",
    "read_camera": "imapper_prob.clips.load",
    "read_config": "imapper_prob.config",
    "read_statements": "imapper_prob.clips.statements_file",
    "same_room": "imapper_prob.clips.takes",
    "sample": "imapper_prob.api",
    "solve": "imapper_prob.api",
    "write_clip": "imapper_prob.clips.load",
}
"""Modules of the public names; each is imported, with torch if needed, on first access."""

__all__ = sorted(_HOMES)


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
