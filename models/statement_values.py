"""Checks of the values of statements, which return them in the type of their field.

A statement takes lists and numbers of numpy, too. It holds tuples and numbers of Python, which can
be hashed and written as JSON.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon

from imapper_prob.models.errors import InputError, require_kind, require_number

__all__ = [
    "DOUBT",
    "LEAST_METRES",
    "Points",
    "as_numbers",
    "as_polygon",
    "require_doubt",
    "require_flag",
    "store",
]

Points = tuple[tuple[float, float], ...]
DOUBT: Final = 0.001
"""Default probability that an answer is given by chance; chosen."""
_LEAST_DOUBT: Final = 1e-12
"""Least doubt; chosen, so that its log is finite."""
LEAST_METRES: Final = 1e-4
"""Least standard deviation of measured lengths, m; chosen. Nobody measures furniture better, and
much smaller ones are lost in rounding."""
MOST_METRES: Final = 1e3
"""Largest length of a statement, m; chosen, more than any room. Millimetres are beyond it."""


def store(statement: Any, **values: Any) -> None:
    """Set fields of a frozen statement while it is made.

    Parameters
    ----------
    statement : Statement
    **values
        By name of the field.
    """
    for name, value in values.items():
        object.__setattr__(statement, name, value)


def require_doubt(what: str, value: Any) -> float:
    """Refuse a doubt that is no probability from 1e-12 to 1.

    Parameters
    ----------
    what : str
        Names the statement in the message.
    value : object

    Returns
    -------
    float

    Raises
    ------
    InputError
        The value is no number, or outside the range.
    """
    doubt = require_number(f"{what}: doubt", value)
    if not _LEAST_DOUBT <= doubt < 1:
        raise InputError(
            f"{what}: doubt = {value!r:.60} must be a probability, {_LEAST_DOUBT:g} or more"
        )
    return doubt


def require_flag(what: str, value: Any) -> bool:
    """Refuse a value other than True and False.

    Parameters
    ----------
    what : str
        Names the value in the message.
    value : object

    Returns
    -------
    bool

    Raises
    ------
    InputError
        The value is of another type.
    """
    require_kind(what, value, bool | np.bool_, "True or False")
    return bool(value)


def as_numbers(what: str, values: Any, count: int, *, most: float) -> tuple[float, ...]:
    """Convert values to finite numbers.

    Parameters
    ----------
    what : str
        Names the values in the message.
    values : array_like
    count : int
        How many there have to be.
    most : float
        Largest magnitude.

    Returns
    -------
    tuple of float

    Raises
    ------
    InputError
        They are no finite numbers, too large, or of another number.
    """
    array = _finite(values)
    if array.shape != (count,):
        raise InputError(f"{what} must be {count} finite numbers, not {values!r:.80}")
    if (np.abs(array) > most).any():
        raise InputError(f"{what}: {values!r:.80}; {most:g} at most")
    return tuple(array.tolist())


def as_polygon(what: str, corners: Any) -> Points:
    """Convert values to the corners of a polygon.

    Parameters
    ----------
    what : str
        Names the polygon in the message.
    corners : array_like
        Corners (x, y), m.

    Returns
    -------
    tuple of (float, float)

    Raises
    ------
    InputError
        They are no corners, fewer than three, or the polygon's sides cross.
    """
    array = _finite(corners)
    if array.shape[1:] != (2,) or len(array) < 3:
        raise InputError(f"{what} must be three or more corners (x, y) in metres")
    if (np.abs(array) > MOST_METRES).any():
        raise InputError(f"{what}: a corner is more than {MOST_METRES:g} m away")
    polygon = Polygon(array)
    if not polygon.is_valid or polygon.area <= 0:
        raise InputError(f"{what} must be a polygon whose sides do not cross")
    return tuple((x, y) for x, y in array.tolist())


def _finite(values: Any) -> NDArray[np.float64]:
    """The values as an array; an empty one if they are no finite numbers."""
    try:
        array = np.asarray(values)
    except ValueError:  # rows of several lengths
        return np.empty(0)
    good = array.dtype.kind in "iuf" and np.isfinite(array).all()
    return array.astype(np.float64) if good else np.empty(0)
