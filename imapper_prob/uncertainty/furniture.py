"""Furniture as labelled arrays: presence, position and size of every object, by draw and over all.

Draws have different objects in arbitrary order.
:func:`imapper_prob.uncertainty.clusters.object_clusters` matches them, and each match is one entry
of the dimension ``object``. ``presence`` is defined in every draw. In a draw without the object,
position and size are NaN.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from imapper_prob.models.scene import FRONTLESS, SceneObject
from imapper_prob.uncertainty.clusters import ObjectCluster, names_of

__all__ = ["FurnitureOfDraws", "object_draws", "object_summary"]

Array = NDArray[np.float64]
_MEASURES: Final = {
    "x": ("m", "centre of the bounding box, to the right of the camera"),
    "y": ("m", "centre of the bounding box, away from the camera"),
    "yaw": ("rad", "counter-clockwise about z, within half a turn of the circular mean"),
    "width": ("m", "side of the bounding box, across the object's front"),
    "depth": ("m", "side of the bounding box, from its back to its front"),
    "height": ("m", "side of the bounding box, upward"),
}
"""Unit and description of each quantity."""


class FurnitureOfDraws(tuple[tuple[SceneObject, ...], ...]):
    """The objects of each draw, chain by chain: a tuple with a short text.

    Parameters
    ----------
    iterable : iterable of tuple of SceneObject
        Objects of each draw.
    """

    def __repr__(self) -> str:
        counts = [len(own) for own in self]
        return f"{len(self)} draws of {min(counts)} to {max(counts)} objects"


def object_draws(
    clusters: Sequence[ObjectCluster],
    furniture: Sequence[Sequence[SceneObject]],
    shape: tuple[int, int],
) -> xr.Dataset:
    """Presence, position and size of every object in every draw.

    Parameters
    ----------
    clusters : sequence of K ObjectCluster
        Matched objects, the most probable first.
    furniture : sequence of C N sequences of SceneObject
        Displaced objects of each draw, chain by chain.
    shape : (int, int)
        Number of chains C, and of draws N per chain.

    Returns
    -------
    Dataset
        ``presence`` (0 or 1), ``x``, ``y``, ``yaw``, ``width``, ``depth`` and ``height``, each
        (C, N, K) along ``chain``, ``draw`` and ``object``. The coordinate ``object`` has names such
        as ``"couch"`` and ``"table 2"``.
    """
    count = len(clusters)
    presence = np.zeros((shape[0] * shape[1], count))
    values = np.full((len(_MEASURES), *presence.shape), np.nan)
    for k, cluster in enumerate(clusters):
        drawn = cluster.members[:, 0]
        presence[drawn, k] = 1
        values[:, drawn, k] = np.transpose(
            [_measures(furniture[n][i], cluster) for n, i in cluster.members.tolist()]
        )
    dims = ("chain", "draw", "object")
    measures = {
        name: (dims, own.reshape(*shape, count), {"units": unit, "long_name": said})
        for (name, (unit, said)), own in zip(_MEASURES.items(), values, strict=True)
    }
    there = {"units": "1", "long_name": "1 where the draw has the object, else 0"}
    return xr.Dataset(
        {"presence": (dims, presence.reshape(*shape, count), there), **measures},
        {
            "chain": np.arange(shape[0]),
            "draw": np.arange(shape[1]),
            "object": np.array(names_of(clusters), dtype=np.str_),
        },
    )


def _measures(o: SceneObject, cluster: ObjectCluster) -> Array:
    """Position, yaw and size of a drawn object, in the order of `_MEASURES`."""
    turn = np.pi if cluster.label in FRONTLESS else 2 * np.pi
    away = o.placement.yaw - cluster.yaw
    yaw = cluster.yaw + away - turn * np.round(away / turn)
    low, high = o.bounds
    return np.array([*o.centre[:2], yaw, *(high - low)])


def object_summary(clusters: Sequence[ObjectCluster]) -> xr.Dataset:
    """Clusters as a table: labels, presence, position and orientation over all draws.

    Parameters
    ----------
    clusters : sequence of K ObjectCluster
        Matched objects, the most probable first.

    Returns
    -------
    Dataset
        See :meth:`imapper_prob.uncertainty.draws.Draws.summary`.
    """
    spread = np.array([np.sqrt(np.diag(c.covariance)) for c in clusters]).reshape(-1, 2)
    mean = np.array([c.mean for c in clusters]).reshape(-1, 2)
    columns = {
        "label": ([c.label for c in clusters], ""),
        "label_probability": ([c.labels[c.label] for c in clusters], "1"),
        "presence": ([c.presence for c in clusters], "1"),
        "presence_error": ([c.presence_error for c in clusters], "1"),
        "x": (mean[:, 0], "m"),
        "x_sd": (spread[:, 0], "m"),
        "y": (mean[:, 1], "m"),
        "y_sd": (spread[:, 1], "m"),
        "yaw": ([c.yaw for c in clusters], "rad"),
        "yaw_sd": ([c.yaw_spread for c in clusters], "rad"),
    }
    return xr.Dataset(
        {
            name: ("object", np.asarray(values), {"units": unit} if unit else {})
            for name, (values, unit) in columns.items()
        },
        coords={"object": np.array(names_of(clusters), dtype=np.str_)},
    )
