"""The exception that reports unusable input to the user, and checks of single values."""

from __future__ import annotations

import math
from numbers import Integral, Real
from types import UnionType
from typing import Any

__all__ = ["InputError", "require_kind", "require_number", "require_whole"]


class InputError(ValueError):
    """An input that cannot be used.

    The message is one sentence for a person. It names the file, frame and joint if they are known,
    and says what is wrong and what to do about it. The command line prints it without a traceback
    and exits with code 2.

    Examples
    --------
    >>> import imapper_prob as im
    >>> try:
    ...     im.load_clip("nowhere.npz")
    ... except im.InputError as error:
    ...     print(error)
    nowhere.npz: no such file or folder
    """


def require_kind(
    what: str, value: Any, kind: type | tuple[type, ...] | UnionType, wanted: str
) -> None:
    """Refuse a value of another type.

    Parameters
    ----------
    what : str
        Names the value in the message.
    value : object
    kind : type, tuple of type, or union
    wanted : str
        What is needed, with an article: ``"a Clip, see load_clip"``.

    Raises
    ------
    InputError
        The value is of another type.
    """
    if not isinstance(value, kind):
        raise InputError(f"{what} = {value!r:.60} must be {wanted}")


def require_whole(
    what: str, value: Any, *, least: float = -math.inf, most: float = math.inf
) -> int:
    """Refuse a value that is no whole number in a range; ``True`` and ``2.0`` are none.

    Parameters
    ----------
    what : str
        Names the value in the message.
    value : object
    least, most : number
        Both allowed.

    Returns
    -------
    int
        The value.

    Raises
    ------
    InputError
        The value is of another type, or outside the range.
    """
    if isinstance(value, bool):
        raise InputError(f"{what} = {value} must be a whole number")
    require_kind(what, value, Integral, "a whole number")
    if value < least:
        raise InputError(f"{what} = {value} must be at least {least}")
    if value > most:
        raise InputError(f"{what} = {value!r:.60} must be at most {most}")
    return int(value)


def require_number(
    what: str,
    value: Any,
    *,
    above: float = -math.inf,
    below: float = math.inf,
    least: float = -math.inf,
    most: float = math.inf,
) -> float:
    """Refuse a value that is no finite number in a range.

    Parameters
    ----------
    what : str
        Names the value in the message.
    value : object
    above, below : float
        Neither is allowed itself.
    least, most : float
        Both allowed.

    Returns
    -------
    float
        The value.

    Raises
    ------
    InputError
        The value is of another type, not finite, or outside the range.
    """
    try:
        number = math.nan if isinstance(value, bool) else float(value)
        finite = isinstance(value, Real) and math.isfinite(number)
    except (OverflowError, TypeError, ValueError):
        finite = False
    if not finite:
        raise InputError(f"{what} = {value!r:.60} must be a finite number")
    if not above < number < below:
        bounds = "positive" if (above, below) == (0, math.inf) else f"in ({above:g}, {below:g})"
        raise InputError(f"{what} = {value} must be {bounds}")
    if number < least:
        raise InputError(f"{what} = {value} must be at least {least:g}")
    if number > most:
        raise InputError(f"{what} = {value} must be at most {most:g}")
    return number
