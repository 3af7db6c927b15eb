"""Seats, as somebody who sits on them feels them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from imapper_prob.models.scene import SceneObject

__all__ = ["Seat", "open_seat", "seat_of"]


@dataclass(frozen=True)
class Seat:
    """What somebody who sits feels of a piece of furniture.

    Parameters
    ----------
    height : float
        Of the surface, metres.
    front, back : float
        The y of the front edge and of the face of the backrest (-inf without one), metres.
    closed : bool
        Whether feet cannot go below.
    deep : bool
        Whether one sinks into it, as into a couch.
    arms : tuple of (float, float, float)
        The x of each armrest's middle, the y of its front, and the height of its top.
    """

    height: float
    front: float
    back: float
    closed: bool
    deep: bool
    arms: tuple[tuple[float, float, float], ...]


def seat_of(piece: SceneObject, *, edge: float | None = None) -> Seat:
    """The seat of a piece that stands at the origin.

    Parameters
    ----------
    piece : SceneObject
        With a part ``seat``.
    edge : float, optional
        The y in metres of the edge to sit on, where it is not the piece's own front, as of a
        bed: one sits with one's back to the rest of it, and leans on nothing.
    """
    seat = next(c for c in piece.cuboids if c.part == "seat")
    low, high = seat.centre - seat.size / 2, seat.centre + seat.size / 2
    backs = [c.centre[1] + c.size[1] / 2 for c in piece.cuboids if c.part == "back"]
    arms = tuple(
        (
            float(c.centre[0]),
            float(c.centre[1] + c.size[1] / 2),
            float(c.centre[2] + c.size[2] / 2),
        )
        for c in piece.cuboids
        if c.part == "arm"
    )
    return Seat(
        height=float(high[2]),
        front=float(high[1]) if edge is None else edge,
        back=float(backs[0]) if backs and edge is None else -np.inf,
        closed=bool(low[2] < 0.3),
        deep=piece.label == "couch",
        arms=arms,
    )


def open_seat(height: float, *, front: float) -> Seat:
    """A surface without a back or arms, as of a floor or of the middle of a bed.

    Parameters
    ----------
    height : float
        Metres.
    front : float
        The y in metres of where whoever sits there ends.
    """
    return Seat(height=height, front=front, back=-np.inf, closed=False, deep=False, arms=())
