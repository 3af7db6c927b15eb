"""Families of the built-in library: kinds of motion that a library can be without.

Who asks how the program does on motions that its library lacks leaves out one
family at a time.
"""

from __future__ import annotations

import re
from typing import Final

from imapper_prob.models.errors import InputError
from imapper_prob.models.scenelet import Library
from imapper_prob.scenelets.procedural.catalogue import CATALOGUE

__all__ = ["FAMILIES", "family_of", "only_family", "without_family"]

_OF_LINE: Final = {entry.name: entry.family for entry in CATALOGUE}

FAMILIES: Final = tuple(dict.fromkeys(_OF_LINE.values()))
"""Names of all families, in the order of the catalogue."""


def family_of(name: str) -> str | None:
    """The family of a scenelet of the built-in library, by its name; None of any other.

    Parameters
    ----------
    name : str
        As ``"sit-on-leg-bed-004"``, or with the name of its library before it, as
        :func:`~imapper_prob.scenelets.library.joined` may put it.
    """
    return _OF_LINE.get(re.sub(r"-\d+$", "", name.rpartition("/")[2]))


def only_family(library: Library, family: str) -> Library:
    """The scenelets of one family, in order; ``InputError`` if there is no such family or none."""
    _check(family)
    chosen = tuple(s for s in library if family_of(s.name) == family)
    return Library(f"{family} of {library.name}", chosen)


def without_family(library: Library, family: str) -> Library:
    """All other scenelets, those of other libraries too; ``InputError`` if there is no such family.

    What is left does not say that somebody did the like: plain sitting has legs crossed now and
    then.
    """
    _check(family)
    chosen = tuple(s for s in library if family_of(s.name) != family)
    return Library(f"{library.name} without {family}", chosen)


def _check(family: str) -> None:
    if family not in FAMILIES:
        raise InputError(f"there is no family {family!r}; there are {', '.join(FAMILIES)}")
