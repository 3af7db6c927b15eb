"""Furniture from other programs' files: category names, measured boxes, and flat arrays.

Labels are mapped to the program's own categories, because scenelets of several libraries are used
in one posterior: one library's sofa and another's couch must have the same label there.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.clips.parsing import Arrays, Shapes
from imapper_prob.models.errors import InputError
from imapper_prob.models.scene import Cuboid, Placement, SceneObject

__all__ = [
    "FURNITURE_SHAPES",
    "MeasuredBox",
    "category",
    "check_owners",
    "left_out",
    "pack_furniture",
    "unpack_furniture",
    "upright_object",
]

_SYNONYMS: Final = {
    "sofa": "couch", "loveseat": "couch", "settee": "couch", "sofa chair": "couch",
    "armchair": "couch", "office chair": "chair", "swivel chair": "chair",
    "dining chair": "chair", "seat": "chair", "footstool": "stool", "ottoman": "stool",
    "barstool": "stool", "desk": "table", "coffee table": "table", "dining table": "table",
    "side table": "table", "end table": "table", "bookshelf": "shelf", "bookcase": "shelf",
    "shelves": "shelf", "shelving": "shelf", "countertop": "counter",
    "kitchen counter": "counter",
}  # fmt: skip
"""Categories of the built-in library by other names. An armchair is a couch with one seat there."""
_NO_FURNITURE: Final = frozenset({
    "", "unknown", "unlabeled", "unlabelled", "unannotated", "none", "other", "remove",
    "floor", "wall", "ceiling", "room", "door", "window", "pillar", "beam", "stairs", "person",
})  # fmt: skip
"""Labels in scans that carry no information or that denote the room itself."""


def category(label: str) -> str | None:
    """The program's category for a label, or ``None`` if the label is not furniture.

    Case, underscores and hyphens are ignored; unknown labels are only normalised.

    Parameters
    ----------
    label : str

    Returns
    -------
    str or None
    """
    words = " ".join(label.lower().replace("_", " ").replace("-", " ").split())
    if words in _NO_FURNITURE:
        return None
    return _SYNONYMS.get(words, words)


def left_out(labels: Iterable[str]) -> str:
    """Message that counts, by label, the objects left out.

    Parameters
    ----------
    labels : iterable of str

    Returns
    -------
    str
        Its parentheses are empty if ``labels`` is.
    """
    counts = Counter(label or "without a label" for label in labels)
    listed = ", ".join(f"{n} {label}" for label, n in counts.most_common())
    return f"left out what is no furniture ({listed})"


# ------------------------------------------------------------------------------------------------
# Measured boxes.

Array = NDArray[np.float64]


@dataclass(frozen=True)
class MeasuredBox:
    """A box with vertical sides in the world.

    Parameters
    ----------
    part : str
        Name of the part of its object.
    centre : (3,) float
        World, metres, floor at z = 0.
    size : (3,) float
        Full side lengths in metres along its own x, y and z axes.
    yaw : float
        Direction of its own x axis, radians.
    """

    part: str
    centre: Array
    size: Array
    yaw: float

    @property
    def footprint_area(self) -> float:
        """Square metres."""
        return float(self.size[0] * self.size[1])


def upright_object(label: str, boxes: Sequence[MeasuredBox], yaw: float) -> SceneObject:
    """A piece of furniture whose local +y axis, its front, points along ``yaw``.

    Boxes keep their size and place. Each is rotated by the few degrees to the nearest multiple of a
    right angle, because all boxes of an object share its axes.

    Parameters
    ----------
    label : str
    boxes : sequence of MeasuredBox
    yaw : float
        Radians.

    Returns
    -------
    SceneObject
    """
    centres = Placement(0.0, 0.0, -yaw).apply([box.centre for box in boxes])
    sizes = []
    for box in boxes:
        lengthwise = abs(np.cos(box.yaw - yaw)) >= abs(np.sin(box.yaw - yaw))
        sizes.append(box.size if lengthwise else box.size[[1, 0, 2]])
    low = np.min(centres - np.array(sizes) / 2, axis=0)
    high = np.max(centres + np.array(sizes) / 2, axis=0)
    middle = (low + high) / 2 * (1, 1, 0)
    x, y, _ = Placement(0.0, 0.0, yaw).apply(middle)
    return SceneObject(
        label=label,
        placement=Placement(float(x), float(y), yaw),
        cuboids=tuple(
            Cuboid(box.part, centre - middle, size)
            for box, centre, size in zip(boxes, centres, sizes, strict=True)
        ),
    )


# ------------------------------------------------------------------------------------------------
# Flat arrays, the same in every file that contains furniture.
#
# ====================  =============  ========================================================
# ``object_label``      (O,) text      category
# ``object_placement``  (O, 3) number  x, y in metres, yaw in radians (+y is the front)
# ``cuboid_object``     (K,) index     index of the object a cuboid belongs to, ascending
# ``cuboid_part``       (K,) text      name of the part of the object
# ``cuboid_centre``     (K, 3) number  metres, frame of the object
# ``cuboid_size``       (K, 3) number  full side lengths, metres
# ====================  =============  ========================================================

FURNITURE_SHAPES: Final[Shapes] = {
    "object_label": ("text", None),
    "object_placement": ("number", "object_label", 3),
    "cuboid_object": ("index", None),
    "cuboid_part": ("text", "cuboid_object"),
    "cuboid_centre": ("number", "cuboid_object", 3),
    "cuboid_size": ("number", "cuboid_object", 3),
}
"""Expected entries, for :func:`~imapper_prob.clips.parsing.check_shapes`."""


def pack_furniture(objects: Sequence[SceneObject]) -> Arrays:
    """Convert objects to the flat arrays described above.

    Parameters
    ----------
    objects : sequence of SceneObject

    Returns
    -------
    dict of str to array
    """
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
    """Convert arrays whose shapes were checked back to objects.

    Parameters
    ----------
    arrays : mapping of str to array

    Returns
    -------
    list of SceneObject

    Raises
    ------
    InputError
        A cuboid belongs to no object, or an object is invalid.
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
    """Check that the indices ``key`` refer to entries of ``owners``, in ascending order.

    Parameters
    ----------
    arrays : mapping of str to array
    key : str
        Name of the array of indices.
    owners : str
        Name of the array they refer to.


    Raises
    ------
    InputError
        An index is out of range or out of order.
    """
    index = arrays[key].astype(np.int64)  # differences of unsigned numbers are not negative
    if ((index < 0) | (index >= len(arrays[owners]))).any():
        raise InputError(f"{key} names one that does not exist")
    if (np.diff(index) < 0).any():
        raise InputError(f"{key} must be in ascending order")
