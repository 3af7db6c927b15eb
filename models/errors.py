"""The exception that reports unusable input to the user."""

from __future__ import annotations

__all__ = ["InputError"]


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
