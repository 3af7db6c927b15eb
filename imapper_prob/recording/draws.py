"""Draws one after the other, chain beside chain: what the sampler really did."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from imapper_prob.models.scene import SceneObject
from imapper_prob.recording import palette, shapes
from imapper_prob.recording.entities import PATH_RADIUS, log_moving

__all__ = ["MOST", "DrawnChain", "chain_entity", "log_draws"]

Array = NDArray[np.float64]

MOST = 400
"""Most draws of all chains together that are kept, evenly spread: a recording stays small."""


@dataclass(frozen=True)
class DrawnChain:
    """Some draws of one chain.

    Parameters
    ----------
    numbers : (n,) int
        Which draws of the chain these are, counted from 0.
    objects : sequence of n sequences of SceneObject
        Furniture in the world.
    paths : (n, K, T, 3) float
        Pelvis of each of K people in the world, metres.
    """

    numbers: NDArray[np.int64]
    objects: Sequence[Sequence[SceneObject]]
    paths: Array


def chain_entity(number: int) -> str:
    """Where the draws of a chain, counted from 1, are logged."""
    return f"world/draws/chain_{number}"


def log_draws(
    recording: rr.RecordingStream, chains: Sequence[DrawnChain], categories: Mapping[str, int]
) -> None:
    """Log furniture, names and path of each draw on the timeline `draw`."""
    for number, chain in enumerate(chains, 1):
        entity = chain_entity(number)
        index = rr.TimeColumn("draw", sequence=chain.numbers)
        log_moving(
            recording,
            f"{entity}/furniture",
            index,
            shapes.box_columns(chain.objects, dict(categories)),
            style=rr.Boxes3D.from_fields(
                radii=0.006,
                fill_mode=rr.components.FillMode.TransparentFillMajorWireframe,
                show_labels=False,
            ),
        )
        log_moving(
            recording,
            f"{entity}/names",
            index,
            shapes.name_columns(chain.objects, dict(categories)),
            style=rr.Points3D.from_fields(radii=0.004, show_labels=True),
        )
        log_moving(
            recording,
            f"{entity}/path",
            index,
            rr.LineStrips3D.columns(
                strips=[path for people in chain.paths for path in people]
            ).partition([len(people) for people in chain.paths]),
            style=rr.LineStrips3D.from_fields(
                class_ids=palette.ESTIMATE, radii=PATH_RADIUS, show_labels=False
            ),
        )
