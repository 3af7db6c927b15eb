"""What several seeds say of the same scenes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from lab.seeds import Seeds, compared, picture, tables
from tests.runs import posterior


def seeds_of(probability: list[list[float]], stated: float) -> Seeds:
    shares = np.array(probability)
    ones = np.ones(len(shares))
    return Seeds(shares, np.full(shares.shape, stated), ones, ones, ones, ones > 0, ones)


def test_a_seed_is_held_against_all_others() -> None:
    found = seeds_of([[0.6, 0.4, 0.0], [0.8, 0.2, 0.0], [0.4, 0.3, 0.3]], stated=0.1)
    np.testing.assert_allclose(found.scatter, [0.2, 0.1, 0.3 / np.sqrt(3)])
    # The first: .6, .4, 0 beside .6, .25, .15.
    np.testing.assert_allclose(found.distance, [0.15, 0.3, 0.3])
    table = tables({"clip": found})
    assert "| clip | 1 | 0.60 | 0.200 | 0.100 | 2.0 |" in table
    counted = replace(found, scenelets=(np.array([[2, 3], [3, 3]]), np.full((2, 2), 2)))
    assert "| clip | 3 | 0.75, 0.00 | 0.00 to 1.00 |" in tables({"clip": counted})


def test_the_same_scenes_are_the_same_layouts_in_all_seeds() -> None:
    """Two runs with the same draws agree; one whose draws say something else does not."""
    one = posterior()
    shares = compared([one, one]).probability
    np.testing.assert_array_equal(shares[0], shares[1])
    assert shares.sum() == pytest.approx(2.0)
    own = one.samples.probabilities.probability
    np.testing.assert_allclose(np.sort(shares[0])[::-1], np.sort(own)[::-1])
    np.testing.assert_allclose(compared([one, one]).chains[0].mean(0), shares[0])
    empty = replace(one.samples, objects=tuple(() for _ in one.samples.objects))
    other = compared([one, replace(one, samples=empty)])
    nothing = sum(not objects for objects in one.samples.objects) / len(one.samples.objects)
    np.testing.assert_allclose(other.distance, 1.0 - nothing)


def test_seeds_and_chains_are_drawn(tmp_path: Path) -> None:
    both = compared([posterior(), posterior()])
    picture({"one": both, "another": both}, tmp_path / "seeds.png")
    with Image.open(tmp_path / "seeds.png") as drawn:
        assert drawn.size == (1104, 408)
