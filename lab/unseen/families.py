"""Families of the built-in library: kinds of motion that can be left out of a library.

To test the program on motions that its library lacks, one family at a time is left
out.
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
    """The family of a scenelet of the built-in library by its name, or None for other names.

    Parameters
    ----------
    name : str
        Such as ``"sit-on-leg-bed-004"``, or with the name of its library before it, as
        :func:`~imapper_prob.scenelets.library.joined` may put it.
    """
    return _OF_LINE.get(re.sub(r"-\d+$", "", name.rpartition("/")[2]))


def only_family(library: Library, family: str) -> Library:
    """The scenelets of one family, in order; ``InputError`` if there is no such family or none."""
    _check(family)
    chosen = tuple(s for s in library if family_of(s.name) == family)
    return Library(f"{family} of {library.name}", chosen)


def without_family(library: Library, family: str) -> Library:
    """All other scenelets, also those of other libraries; ``InputError`` for an unknown family.

    Similar motions may remain: in plain sitting, for example, legs are sometimes crossed.
    """
    _check(family)
    chosen = tuple(s for s in library if family_of(s.name) != family)
    return Library(f"{library.name} without {family}", chosen)


def _check(family: str) -> None:
    if family not in FAMILIES:
        raise InputError(f"there is no family {family!r}; there are {', '.join(FAMILIES)}")
