"""How one scene differs from another, in words."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from imapper_prob.models.scene import SceneObject
from imapper_prob.results.scene_distance import pair_objects, turn

__all__ = ["describe_difference", "where"]

_MOVED: Final = 0.3
"""Metres worth a word: about the standard deviation of an object's position."""
_TURNED: Final = np.radians(30)
"""Radians worth a word."""


def describe_difference(best: Sequence[SceneObject], other: Sequence[SceneObject]) -> str:
    """What of ``other`` is not as in ``best``, as the camera sees it.

    Where two objects share a label, how far away they are says which one is meant.

    Examples
    --------
    ``"a stool instead of the couch, 0.4 m nearer; no table; also a shelf 1.2 m to the right
    and 4.0 m away"``
    """
    found = pair_objects(best, other)
    labels = [o.label for o in best]
    names = [
        o.label if labels.count(o.label) == 1 else f"{o.label} (at {o.centre[1]:.1f} m)"
        for o in best
    ]
    parts = [_change(names[i], best[i], other[j]) for i, j in found.pairs]
    parts += [f"no {names[i]}" for i in found.only_first]
    parts += [f"also a {other[j].label} {where(other[j])}" for j in found.only_second]
    return "; ".join(part for part in parts if part) or "the same furniture, nearly as it stands"


def where(o: SceneObject) -> str:
    """Where an object stands, seen from the camera."""
    x, y = o.centre[:2]
    side = "right" if x >= 0 else "left"
    return f"{abs(x):.1f} m to the {side} and {y:.1f} m away"


def _change(name: str, first: SceneObject, second: SceneObject) -> str:
    """Half a sentence on a pair; empty where nothing is worth a word."""
    right, away = (second.centre - first.centre)[:2]
    moves = []
    if abs(right) > _MOVED:
        moves.append(f"{abs(right):.1f} m to the {'right' if right > 0 else 'left'}")
    if abs(away) > _MOVED:
        moves.append(f"{abs(away):.1f} m {'further away' if away > 0 else 'nearer'}")
    if not moves and np.hypot(right, away) > _MOVED:
        moves.append(f"{np.hypot(right, away):.1f} m off")
    turned = turn(first, second)
    if turned > _TURNED:
        moves.append(f"turned by {np.degrees(turned):.0f}°")
    if first.label != second.label:
        return ", ".join([f"a {second.label} instead of the {name}", *moves])
    return f"the {name} {', '.join(moves)}" if moves else ""
