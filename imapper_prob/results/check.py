"""One thing that must be so if a result is to be believed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

__all__ = ["RATE", "Check"]

RATE: Final = 0.01
"""How often each check is alarmed by a clip that is as the model says; six of them, 5 % in all."""


@dataclass(frozen=True)
class Check:
    """One thing that must be so.

    Parameters
    ----------
    name : str
        One word.
    value, limit : float
        What was found, and from where on it is alarming; NaN where nothing could be found. In
        degrees, metres, metres a metre, standard deviations, a probability, a part of the frames,
        and frames.
    alarmed : bool
    sentence : str
        What is wrong and what to do about it, or that nothing is.
    """

    name: str
    value: float
    limit: float
    alarmed: bool
    sentence: str
