"""What a recording says about how sure everything is, read back."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from imapper_prob.models.skeleton import PELV
from imapper_prob.models.text import as_probability, in_markdown
from imapper_prob.plotting import category_colour
from imapper_prob.recording.blueprint import certainty_text, moves_text
from imapper_prob.recording.log import write_recording
from imapper_prob.recording.palette import FLOOR, UNCLAIMED
from imapper_prob.recording.posterior import HIDDEN, Certainty, hidden_colours
from imapper_prob.uncertainty.clusters import cells_of_object, names_of
from imapper_prob.uncertainty.parameters import cells_of_parameter
from imapper_prob.uncertainty.scenes import WeightedScene
from tests.recording.reading import Columns, read
from tests.recording.room import make_certainty, make_chains, make_room

N_FRAMES, N_DRAWS = 30, 20


@pytest.fixture(scope="module")
def scenes() -> list[WeightedScene]:
    return make_room(N_FRAMES)[1]


@pytest.fixture(scope="module")
def certainty(scenes: list[WeightedScene]) -> Certainty:
    return make_certainty(N_DRAWS, scenes)


@pytest.fixture(scope="module")
def columns(
    tmp_path_factory: pytest.TempPathFactory, scenes: list[WeightedScene], certainty: Certainty
) -> Columns:
    path = tmp_path_factory.mktemp("certainty") / "room.rrd"
    write_recording(
        path,
        clip=make_room(N_FRAMES)[0],
        scenes=scenes,
        traces={},
        description="",
        certainty=certainty,
        draws=make_chains(N_DRAWS, N_FRAMES, scenes),
        acceptance={"birth": 0.02, "path": 0.9},
    )
    return read(path)


def test_the_floor_is_coloured_by_what_probably_stands_there(
    columns: Columns, certainty: Certainty
) -> None:
    found = certainty.occupancy
    corners = np.array(columns["/world/occupancy", "Mesh3D:vertex_positions"][None])
    colours = np.array(columns["/world/occupancy", "Mesh3D:vertex_colors"][None])
    tiles = corners.reshape(-1, 4, 3)
    assert len(tiles) == (found.anything >= 0.03).sum()
    np.testing.assert_allclose(np.ptp(tiles, axis=1)[:, :2], found.cell, atol=1e-5)
    for tile, packed in list(zip(tiles, colours[::4], strict=True))[::37]:
        x, y = tile[:, :2].mean(0)
        row, column = np.abs(found.y - y).argmin(), np.abs(found.x - x).argmin()
        kind = found.categories[found.by_category[:, row, column].argmax()]
        share = found.anything[row, column]
        expected = (1 - share) * np.array(FLOOR) + share * np.array(category_colour(kind))
        rgb = [(int(packed) >> shift) & 255 for shift in (24, 16, 8)]
        np.testing.assert_allclose(rgb, expected, atol=0.51)


def test_every_object_has_its_two_regions(columns: Columns, certainty: Certainty) -> None:
    centres = np.array(columns["/world/all_draws/positions", "Ellipsoids3D:centers"][None])
    sizes = np.array(columns["/world/all_draws/positions", "Ellipsoids3D:half_sizes"][None])
    regions = [c.region(share) for c in certainty.clusters for share in (0.5, 0.9)]
    np.testing.assert_allclose(centres[:, :2], [r.centre for r in regions], atol=1e-5)
    np.testing.assert_allclose(sizes[:, :2], [r.half_axes for r in regions], atol=1e-5)
    turns = np.array(columns["/world/all_draws/positions", "Ellipsoids3D:quaternions"][None])
    angles = 2 * np.arctan2(turns[:, 2], turns[:, 3])
    off = angles - np.array([r.angle for r in regions])
    np.testing.assert_allclose(np.sin(off), 0.0, atol=1e-5)
    labels = columns["/world/all_draws/names", "Points3D:labels"][None]
    likely = [c for c in certainty.clusters if c.presence >= 0.2]
    assert labels == [f"{c.label} {as_probability(c.presence)}" for c in likely]


def test_hidden_joints_are_marked_in_the_colour_of_what_hides_them(
    columns: Columns, certainty: Certainty, scenes: list[WeightedScene]
) -> None:
    hidden = certainty.hidden.probability >= HIDDEN
    assert hidden.any()
    assert not hidden.all()
    best = scenes[0].scene
    pixels = best.camera.project(best.joints)
    for t, (in_room, in_image) in enumerate(
        zip(
            columns["/world/scene_1/hidden", "Points3D:positions"].values(),
            columns["/world/camera/image/hidden", "Boxes2D:centers"].values(),
            strict=True,
        )
    ):
        np.testing.assert_allclose(
            np.reshape(in_room, (-1, 3)), best.joints[t, hidden[t]], atol=1e-5
        )
        np.testing.assert_allclose(np.reshape(in_image, (-1, 2)), pixels[t, hidden[t]], atol=1e-2)
    t, j = np.argwhere(hidden)[0]
    by = certainty.hidden.by_object[:, t, j].argmax()
    expected = category_colour(certainty.clusters[by].label)
    assert hidden_colours(certainty.hidden)[t, j].tolist() == list(expected)


def test_what_no_object_claims_is_grey(certainty: Certainty) -> None:
    nobody = replace(certainty.hidden, clusters=(), by_object=np.zeros((0, N_FRAMES, 16)))
    assert (hidden_colours(nobody) == UNCLAIMED).all()
    unclaimed = replace(certainty.hidden, by_object=np.zeros_like(certainty.hidden.by_object))
    assert (hidden_colours(unclaimed) == UNCLAIMED).all()


def test_curves_say_how_much_is_hidden_and_how_far_off_it_may_be(
    columns: Columns, certainty: Certainty
) -> None:
    def values(entity: str) -> np.ndarray:
        return np.ravel(list(columns[entity, "Scalars:scalars"].values()))

    for k in range(len(certainty.clusters)):
        expected = certainty.hidden.by_object[k].sum(-1)
        np.testing.assert_allclose(values(f"/sure/hidden/object_{k + 1}"), expected)
    spread = 100 * certainty.joints.standard_deviation[:, PELV]
    for axis, name in enumerate(("across_the_view", "depth", "height")):
        np.testing.assert_allclose(values(f"/sure/pelvis/{name}"), spread[:, axis])


def test_the_texts_have_a_row_for_everything(columns: Columns, certainty: Certainty) -> None:
    (text,) = columns["/certainty", "TextDocument:text"][None]
    assert text == certainty_text(certainty)
    for name, c in zip(names_of(certainty.clusters), certainty.clusters, strict=True):
        assert f"| {name} | {' | '.join(map(in_markdown, cells_of_object(c)))} |" in text
    for one in certainty.nuisances.values():
        assert f"| {' | '.join(cells_of_parameter(one))} |" in text
    assert "learned" not in text.lower()
    for title in ("camera pitch", "camera height", "log focal length", "log stature"):
        assert f"| {title} |" in text
    (moves,) = columns["/moves", "TextDocument:text"][None]
    assert moves.index("| path | 90.0 % |") < moves.index("| birth | 2.0 % |")
    assert moves_text({}) == ""


def test_an_empty_room_has_no_map(tmp_path: Path, scenes: list[WeightedScene]) -> None:
    clip = make_room(N_FRAMES)[0]
    bare = [replace(s, scene=replace(s.scene, objects=()), covariances=np.zeros((0, 2, 2)))
            for s in scenes]  # fmt: skip
    path = tmp_path / "room.rrd"
    write_recording(
        path, clip=clip, scenes=bare, traces={}, description="",
        certainty=make_certainty(4, bare), draws=make_chains(4, N_FRAMES, bare),
    )  # fmt: skip
    columns = read(path)
    assert ("/world/occupancy", "Mesh3D:vertex_positions") not in columns
    assert columns["/world/all_draws/names", "Points3D:labels"][None] == []
