"""Where a result is from: enough to tell two runs apart and to repeat one."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from importlib.metadata import version
from typing import Any, Final

from imapper_prob.config import Config, to_toml
from imapper_prob.inputs.clip_file import pack_clip
from imapper_prob.models.scene import Clip
from imapper_prob.results.stored_input import Source

__all__ = ["SECONDS", "clip_digest", "provenance", "seconds_of"]

SECONDS: Final = "seconds_"
"""Begins the attributes that say how long a part of the run took."""


def provenance(source: Source, config: Config, seconds: Mapping[str, float]) -> dict[str, Any]:
    """What is said of a run's origin, as attributes of its file.

    Parameters
    ----------
    source : Source
    config : Config
    seconds : mapping of str to float
        How long each part took by the clock on the wall.
    """
    settings = to_toml(config)
    return {
        "program": f"imapper-prob {version('imapper-prob')}",
        "clip": source.clip.name,
        "clip_digest": clip_digest(source.clip),
        "library": source.library.name,
        "library_digest": source.library.digest,
        "config": settings,
        "config_digest": hashlib.sha256(settings.encode()).hexdigest(),
        "seed": config.seed,
        **{f"{SECONDS}{name}": float(value) for name, value in seconds.items()},
    }


def seconds_of(attributes: Mapping[Any, Any]) -> dict[str, float]:
    """How long each part of a run took, from its attributes."""
    return {
        str(name).removeprefix(SECONDS): float(value)
        for name, value in attributes.items()
        if str(name).startswith(SECONDS)
    }


def clip_digest(clip: Clip) -> str:
    """SHA-256 of all that a clip holds, its truth left out: inference never reads that."""
    state = hashlib.sha256()
    for name, values in pack_clip(clip).items():
        if not name.startswith(("truth", "object", "cuboid")):
            state.update(f"{name} {values.shape}".encode())
            text = values.dtype.kind == "U"
            state.update(repr(values.tolist()).encode() if text else values.tobytes())
    return state.hexdigest()
