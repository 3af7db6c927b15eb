"""Colours of text can be read on any ground."""

from __future__ import annotations

import pytest

from imapper_prob.models.colours import category_colour, text_colour


def luminance(colour: tuple[int, int, int]) -> float:
    """Relative luminance of an sRGB colour (IEC 61966-2-1)."""
    light = [
        v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4
        for v in (value / 255 for value in colour)
    ]
    return 0.2126 * light[0] + 0.7152 * light[1] + 0.0722 * light[2]


@pytest.mark.parametrize("label", ["couch", "chair", "desk", "shelf", "bench", "unheard of", ""])
def test_text_is_as_readable_on_black_as_on_white(label: str) -> None:
    level = luminance(text_colour(label))
    assert 1.05 / (level + 0.05) == pytest.approx(4.58, rel=0.03)
    assert (level + 0.05) / 0.05 == pytest.approx(4.58, rel=0.03)


def test_text_keeps_the_hue_of_its_object() -> None:
    for label in ("couch", "chair", "shelf"):
        of_object, of_text = category_colour(label), text_colour(label)
        ranks = [sorted(range(3), key=colour.__getitem__) for colour in (of_object, of_text)]
        assert ranks[0] == ranks[1]
