"""The one exception that a user is meant to see."""

from __future__ import annotations

__all__ = ["InputError"]


class InputError(ValueError):
    """Something that was handed in cannot be used.

    The message is one sentence for a person: it names the file, frame and joint where
    that is known, says what is wrong and what to do about it. The command line prints it
    without a traceback and exits with code 2.

    Examples
    --------
    >>> import imapper_prob as im
    >>> try:
    ...     im.load_clip("nowhere.npz")
    ... except im.InputError as error:
    ...     print(error)
    nowhere.npz: no such file or folder
    """
