from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import pytest

from imapper_prob.api import demo_clip
from imapper_prob.models.path_prior import CameraPrior
from imapper_prob.models.text import brief
from imapper_prob.scenelets.library import load_library


@dataclass(frozen=True)
class Inner:
    value: float

    __repr__ = brief


@dataclass(frozen=True)
class Outer:
    what: Any
    secret: int = field(default=1, repr=False)

    __repr__ = brief


class Pair(NamedTuple):
    first: Any
    second: Any

    def __repr__(self) -> str:
        return brief(self)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (np.zeros((130, 16, 2)), "float64 (130, 16, 2)"),
        (np.array([1.0, 2.5]), "[1.0, 2.5]"),
        (np.array(["a", "b"]), "str32 (2,)"),
        ("demo", "'demo'"),
        ("x" * 100, repr("x" * 60) + "..."),
        ((1, 2, None), "(1, 2, None)"),
        ((), "()"),
        (tuple(range(7)), "7 x int"),
        ((Inner(1.0), Inner(2.0)), "2 x Inner"),
        ((Inner(1.0), 2), "2 x values"),
        ({"a": 1}, "{'a': 1}"),
        ({str(k): 1.0 for k in range(9)}, "9 x float"),
        (Inner(1.0), "Inner"),
        (0.25, "0.25"),
    ],
)
def test_values_are_said_in_a_word(value: object, text: str) -> None:
    assert repr(Outer(value)) == f"Outer(what={text})"


def test_named_tuples_as_well() -> None:
    assert repr(Pair(np.zeros(9), 1)) == "Pair(first=float64 (9,), second=1)"


def test_what_people_type_first_is_short() -> None:
    clip, library = demo_clip(), load_library()
    prior = CameraPrior(np.zeros(5), np.eye(5))
    table = library._repr_html_()
    assert table.count("<tr>") == 1 + len({s.action for s in library})
    assert len(table) < 4000
    for shown in (clip, clip.tracks[0], clip.truth, library, library[0], library[0].objects, prior):
        assert len(repr(shown)) < 2000
