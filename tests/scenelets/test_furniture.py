"""Furniture: sizes people live with, standing on the floor, facing +y."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from imapper_prob.models.scene import Cuboid, Placement, SceneObject
from imapper_prob.scenelets.procedural import furniture
from imapper_prob.scenelets.procedural.body import Person

Draw = Callable[[np.random.Generator], SceneObject]
Range = tuple[float, float]

PIECES: dict[str, tuple[Draw, str]] = {
    "chair": (lambda rng: furniture.chair(rng, arms=False), "chair"),
    "chair with arms": (lambda rng: furniture.chair(rng, arms=True), "chair"),
    "office chair": (furniture.office_chair, "chair"),
    "stool": (furniture.stool, "stool"),
    "bench": (furniture.bench, "bench"),
    "armchair": (lambda rng: furniture.couch(rng, seats=1), "couch"),
    "couch": (lambda rng: furniture.couch(rng, seats=3), "couch"),
    "bed": (furniture.bed, "bed"),
    "table": (furniture.table, "table"),
    "low table": (furniture.low_table, "table"),
    "desk": (furniture.desk, "table"),
    "counter": (furniture.counter, "counter"),
    "shelf": (furniture.shelf, "shelf"),
}

# Height of the part, and width and depth of the whole, metres.
SIZES: dict[str, tuple[str, Range, Range, Range]] = {
    "chair": ("seat", (0.42, 0.48), (0.42, 0.48), (0.44, 0.52)),
    "chair with arms": ("seat", (0.42, 0.48), (0.52, 0.60), (0.44, 0.52)),
    "office chair": ("seat", (0.42, 0.51), (0.46, 0.62), (0.44, 0.48)),
    "stool": ("seat", (0.43, 0.50), (0.34, 0.42), (0.34, 0.42)),
    "bench": ("seat", (0.42, 0.47), (0.90, 1.50), (0.36, 0.44)),
    "armchair": ("seat", (0.40, 0.45), (0.86, 1.08), (0.80, 0.92)),
    "couch": ("seat", (0.40, 0.45), (2.10, 2.52), (0.80, 0.92)),
    "bed": ("seat", (0.40, 0.55), (0.90, 1.80), (1.93, 2.05)),
    "table": ("top", (0.72, 0.75), (1.00, 1.60), (0.60, 0.80)),
    "low table": ("top", (0.40, 0.45), (0.90, 1.20), (0.50, 0.60)),
    "desk": ("top", (0.72, 0.76), (1.20, 1.80), (0.60, 0.80)),
    "counter": ("top", (0.85, 0.95), (1.20, 2.40), (0.60, 0.60)),
    "shelf": ("side", (1.40, 2.25), (0.80, 1.20), (0.28, 0.38)),
}


def many(name: str, count: int = 60) -> list[SceneObject]:
    draw, _ = PIECES[name]
    return [draw(np.random.default_rng([7, i])) for i in range(count)]


def faces(cuboid: Cuboid) -> tuple[np.ndarray, np.ndarray]:
    return cuboid.centre - cuboid.size / 2, cuboid.centre + cuboid.size / 2


def part(piece: SceneObject, name: str) -> Cuboid:
    return next(c for c in piece.cuboids if c.part == name)


@pytest.mark.parametrize("name", PIECES)
def test_pieces_stand_on_the_floor_about_their_origin(name: str) -> None:
    for piece in many(name):
        assert piece.label == PIECES[name][1]
        assert piece.placement == furniture.ORIGIN
        low, high = piece.bounds
        assert low[2] == pytest.approx(0.0, abs=1e-9)
        np.testing.assert_allclose((low + high)[:2], 0.0, atol=1e-9)


@pytest.mark.parametrize("name", SIZES)
def test_sizes_are_in_their_ranges_and_fill_them(name: str) -> None:
    what, *ranges = SIZES[name]
    pieces = many(name)
    heights = [faces(part(p, what))[1][2] for p in pieces]
    widths, depths, _ = np.array([np.diff(p.bounds, axis=0)[0] for p in pieces]).T
    for values, (low, high) in zip((heights, widths, depths), ranges, strict=True):
        assert low - 1e-9 <= np.min(values)
        assert np.max(values) <= high + 1e-9
        # Sixty draws leave less than a fifth of the range out, but for one in 10 000.
        assert np.ptp(values) >= 0.5 * (high - low)


@pytest.mark.parametrize("name", PIECES)
def test_no_part_floats(name: str) -> None:
    """Every cuboid touches the floor, or another one that is held up."""
    for piece in many(name, 20):
        boxes = [faces(c) for c in piece.cuboids]
        held = [low[2] < 1e-9 for low, _ in boxes]
        for _ in boxes:
            held = [
                h
                or any(
                    g and bool(np.all(low <= up + 1e-6) and np.all(down <= high + 1e-6))
                    for g, (down, up) in zip(held, boxes, strict=True)
                )
                for h, (low, high) in zip(held, boxes, strict=True)
            ]
        assert all(held)


@pytest.mark.parametrize("name", ["chair", "chair with arms", "office chair", "couch", "bed"])
def test_backs_are_behind_the_seat_and_higher(name: str) -> None:
    for piece in many(name, 20):
        seat = part(piece, "seat")
        back = part(piece, "headboard" if name == "bed" else "back")
        assert back.centre[1] < seat.centre[1]
        assert faces(back)[1][2] > faces(seat)[1][2] + 0.25


@pytest.mark.parametrize("name", ["chair with arms", "office chair", "armchair", "couch"])
def test_armrests_are_at_the_sides_above_the_seat(name: str) -> None:
    armed = [p for p in many(name) if any(c.part == "arm" for c in p.cuboids)]
    assert len(armed) > 20
    for piece in armed:
        left, right = (c for c in piece.cuboids if c.part == "arm")
        assert left.centre[0] == pytest.approx(-right.centre[0])
        above = faces(left)[1][2] - faces(part(piece, "seat"))[1][2]
        assert 0.10 < above < 0.26
        # Hips are .36 to .40 m wide (Pheasant and Haslegrave 2005).
        assert faces(right)[0][0] - faces(left)[1][0] > 0.40


@pytest.mark.parametrize("name", ["table", "desk"])
def test_knees_have_room_below_a_table(name: str) -> None:
    for piece in many(name):
        low, high = furniture.knee_room(piece)
        assert high - low > 0.6
        for cuboid in piece.cuboids:
            (x0, _, _), (x1, y1, z1) = faces(cuboid)
            if cuboid.part != "top" and y1 > 0.1 and z1 > 0.1:
                assert x1 <= low + 1e-9 or x0 >= high - 1e-9


def test_desks_come_open_and_closed() -> None:
    parts = [{c.part for c in p.cuboids} for p in many("desk")]
    assert {"leg" in p for p in parts} == {True, False}
    assert any("drawers" in p for p in parts)


def test_furniture_grows_as_its_beholder_shrinks() -> None:
    chair = furniture.chair(np.random.default_rng(0), arms=True)
    chair = chair.moved(Placement(0.3, -0.2, 0.5))
    small, tall = Person(1.55), Person(1.85)
    assert small.sees(chair).bounds[1, 2] > chair.bounds[1, 2] > tall.sees(chair).bounds[1, 2]
