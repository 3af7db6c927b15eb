"""Shapes and colours, each against an independent account of what it should be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imapper_prob.recording.palette import category_ids, confidence_colours
from imapper_prob.recording.shapes import limbs, own_entity, paths, position_ellipses
from tests.recording.room import STANDING, furniture, make_room


@pytest.mark.parametrize("angle", [0.0, 0.7, 2.5])
def test_ellipses_hold_half_and_nine_tenths_of_the_draws(
    rng: np.random.Generator, angle: float
) -> None:
    n = 20_000
    c, s = np.cos(angle), np.sin(angle)
    axes = np.array([[c, -s], [s, c]])
    covariance = axes @ np.diag([0.09, 0.01]) @ axes.T
    item = furniture("chair", 1.0, 3.0, 0.4)
    ellipses = position_ellipses([item], covariance[None])
    draws = item.centre[:2] + rng.multivariate_normal((0, 0), covariance, n)

    shapes = zip(
        ellipses.centers.as_arrow_array().to_pylist(),
        ellipses.half_sizes.as_arrow_array().to_pylist(),
        ellipses.quaternions.as_arrow_array().to_pylist(),
        (0.5, 0.9),
        strict=True,
    )
    for centre, half_size, (_, _, z, w), probability in shapes:
        turn = 2 * np.arctan2(z, w)
        local = (draws - centre[:2]) @ [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
        inside = ((local / half_size[:2]) ** 2).sum(1) < 1
        # Four standard errors of a binomial proportion.
        tolerance = 4 * np.sqrt(probability * (1 - probability) / n)
        assert inside.mean() == pytest.approx(probability, abs=tolerance)


def test_an_unknown_position_has_no_ellipse() -> None:
    objects = [furniture("chair", 0, 3, 0), furniture("table", 1, 3, 0)]
    covariances = np.array([np.full((2, 2), np.nan), np.eye(2) * 0.01])
    ellipses = position_ellipses(objects, covariances)
    assert len(ellipses.half_sizes) == 2


@given(known=st.lists(st.booleans(), max_size=30))
def test_paths_are_the_known_stretches(known: list[bool]) -> None:
    pelvis = np.where(np.array(known, bool)[:, None], np.arange(len(known))[:, None], np.nan)
    pelvis = np.repeat(pelvis.reshape(-1, 1), 3, axis=1)
    stretches = [s[:, 0].astype(int).tolist() for s in paths(pelvis)]
    words = "".join("x" if k else " " for k in known).split()
    assert [len(s) for s in stretches] == [len(w) for w in words if len(w) > 1]
    assert all(known[t] for s in stretches for t in s)
    assert all(np.diff(s).tolist() == [1] * (len(s) - 1) for s in stretches)


def test_a_body_is_three_lines_or_none() -> None:
    assert [len(chain) for chain in limbs(STANDING)] == [7, 4, 7]
    broken = STANDING.copy()
    broken[3] = np.nan
    assert limbs(broken) == []


def test_confidence_goes_from_red_over_amber_to_green() -> None:
    red, amber, green = confidence_colours([0.0, 0.5, 1.0]).astype(int)
    assert red[0] > 2 * red[1]
    assert amber[0] > amber[1] > amber[2]
    assert green[1] > 2 * green[0]
    assert confidence_colours(np.zeros((3, 16))).shape == (3, 16, 3)


def test_category_numbers_do_not_depend_on_order() -> None:
    assert category_ids(["table", "chair", "table"]) == category_ids(["chair", "table"])
    assert len(set(category_ids(["a", "b", "c"]).values())) == 3


def test_people_whose_names_cannot_be_drawn_have_entities_of_their_own() -> None:
    """The viewer ends at a character that its font lacks, and shows paths of entities."""
    clip, _, _ = make_room(4)
    (track,) = clip.tracks
    two = replace(clip, tracks=tuple(replace(track, name=name) for name in ("部", "屋")))
    entities = [own_entity(two, "truth", person).replace("\\", "") for person in (0, 1)]
    assert entities == ["truth/1 ?", "truth/2 ?"]
    assert own_entity(clip, "truth", 0) == "truth"
