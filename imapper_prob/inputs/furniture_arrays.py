"""Furniture as flat arrays, the same in every file that holds some.

====================  =============  ========================================================
``object_label``      (O,) text      category
``object_placement``  (O, 3) number  x, y in metres, yaw in radians (+y is the front)
``cuboid_object``     (K,) index     which object a cuboid belongs to, ascending
``cuboid_part``       (K,) text      what it is of the object
``cuboid_centre``     (K, 3) number  metres, frame of the object
``cuboid_size``       (K, 3) number  full side lengths, metres
====================  =============  ========================================================
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from imapper_prob.inputs.archives import Arrays, Shapes
from imapper_prob.models.errors import InputError
from imapper_prob.models.scene import Cuboid, Placement, SceneObject

__all__ = ["FURNITURE_SHAPES", "check_owners", "pack_furniture", "unpack_furniture"]

FURNITURE_SHAPES: Final[Shapes] = {
    "object_label": ("text", None),
    "object_placement": ("number", "object_label", 3),
    "cuboid_object": ("index", None),
    "cuboid_part": ("text", "cuboid_object"),
    "cuboid_centre": ("number", "cuboid_object", 3),
    "cuboid_size": ("number", "cuboid_object", 3),
}
"""For :func:`~imapper_prob.inputs.archives.check_shapes`."""


def pack_furniture(objects: Sequence[SceneObject]) -> Arrays:
    """Objects as the arrays of the module's description."""
    cuboids = [(i, c) for i, o in enumerate(objects) for c in o.cuboids]
    places = [(o.placement.x, o.placement.y, o.placement.yaw) for o in objects]
    return {
        "object_label": np.array([o.label for o in objects], dtype=np.str_),
        "object_placement": np.array(places, dtype=np.float64).reshape(-1, 3),
        "cuboid_object": np.array([i for i, _ in cuboids], dtype=np.int64),
        "cuboid_part": np.array([c.part for _, c in cuboids], dtype=np.str_),
        "cuboid_centre": np.array([c.centre for _, c in cuboids]).reshape(-1, 3),
        "cuboid_size": np.array([c.size for _, c in cuboids]).reshape(-1, 3),
    }


def unpack_furniture(arrays: Arrays) -> list[SceneObject]:
    """Objects again, from arrays whose shapes were checked.

    Raises
    ------
    InputError
        A cuboid belongs to no object, or an object is none.
    """
    labels, owners = arrays["object_label"], arrays["cuboid_object"]
    check_owners(arrays, "cuboid_object", "object_label")
    first = np.searchsorted(owners, np.arange(len(labels) + 1))
    cuboids = [
        Cuboid(str(part), centre, size)
        for part, centre, size in zip(
            arrays["cuboid_part"], arrays["cuboid_centre"], arrays["cuboid_size"], strict=True
        )
    ]
    return [
        SceneObject(
            str(label),
            Placement(*map(float, place)),
            tuple(cuboids[first[index] : first[index + 1]]),
        )
        for index, (label, place) in enumerate(zip(labels, arrays["object_placement"], strict=True))
    ]


def check_owners(arrays: Arrays, key: str, owners: str) -> None:
    """Whether the indices ``key`` point at entries of ``owners``, in ascending order."""
    index = arrays[key]
    if ((index < 0) | (index >= len(arrays[owners]))).any():
        raise InputError(f"{key} names one that does not exist")
    if (np.diff(index) < 0).any():
        raise InputError(f"{key} must be in ascending order")
