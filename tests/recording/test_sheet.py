"""The sheet of a library as rerun reads it back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import rerun as rr
from rerun.chunk import RrdReader

from imapper_prob.models.errors import InputError
from imapper_prob.models.geometry import pack_boxes
from imapper_prob.models.scenelet import Library, Scenelet
from imapper_prob.recording import sheet
from imapper_prob.recording.sheet import kinds, write_sheet
from lab.picture import PictureUnavailable, render_recording
from tests.recording.reading import Columns, read
from tests.scenelets.motions import box, standing


def library(n_kinds: int = 5, each: int = 20) -> Library:
    """Kinds of people who glide faster the higher their number, each by a piece of furniture."""
    scenelets = []
    for k in range(n_kinds):
        for i in range(each):
            joints = standing(10 + k)
            joints[..., 1] += np.linspace(0, 0.1 * i, len(joints))[:, None]
            scenelets.append(Scenelet(f"glide-{k}-{i:03d}", "glide", joints, (box(f"piece {k}"),)))
    return Library("gliders", tuple(scenelets))


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("sheet") / "sheet.rrd"
    gliders = library()
    write_sheet(path, gliders, np.linspace(0, 1, len(gliders)))
    return path


@pytest.fixture(scope="module")
def columns(written: Path) -> Columns:
    return read(written)


def entities(columns: Columns) -> list[str]:
    return sorted({e for e, name in columns if name == "Transform3D:translation"})


def labels(columns: Columns, name: str, action: str = "1 glide") -> list[str]:
    entity = rr.escape_entity_path_part(action)
    (words,) = columns[f"/sheet/{entity}/{name}", "Points3D:labels"].values()
    return list(words)


def ground(columns: Columns, action: str) -> tuple[np.ndarray, np.ndarray]:
    """Centres (n, 2) and half sides (2,) of the tiles of an action."""
    entity = rr.escape_entity_path_part(action)
    (centres,) = columns[f"/sheet/{entity}/tiles", "Boxes3D:centers"].values()
    (halves,) = columns[f"/sheet/{entity}/tiles", "Boxes3D:half_sizes"].values()
    return np.array(centres)[:, :2], np.array(halves)[0, :2]


def test_a_kind_is_a_name_without_its_number() -> None:
    names = {"sit-couch-table-011": "sit", "room-3": "sit", "room-4": "walk", "walk": "walk"}
    few = Library("few", tuple(Scenelet(n, a, standing(), ()) for n, a in names.items()))
    assert kinds(few) == ["sit-couch-table", "room sit", "room walk", "walk"]


def test_every_kind_has_its_row_from_least_to_most_characteristic(columns: Columns) -> None:
    numbers = labels(columns, "numbers")
    gliders = library()
    values = np.linspace(0, 1, len(gliders))
    assert len(numbers) == 5 * 7
    for k in range(5):
        row = numbers[7 * k : 7 * k + 7]
        assert row[0] == f"000 · {values[20 * k]:.2f}"
        assert row[-1] == f"019 · {values[20 * k + 19]:.2f}"
        assert row == sorted(row)
    assert labels(columns, "kinds") == [f"glide-{k}" for k in range(5)]


def test_scenelets_do_not_share_a_tile(columns: Columns) -> None:
    centres, halves = ground(columns, "1 glide")
    gap = np.abs(centres[:, None] - centres)
    clear = (gap > 2 * halves).any(-1)
    assert clear[~np.eye(len(centres), dtype=bool)].all()
    stands = [columns[e, "Transform3D:translation"][None][0][:2] for e in entities(columns)]
    assert sorted(map(tuple, stands)) == sorted(map(tuple, centres.tolist()))


def test_tiles_grow_with_the_furniture(tmp_path: Path) -> None:
    halls = Library(
        "halls",
        tuple(Scenelet(f"a-{i}", "a", standing(), (box("table", y=4.0),)) for i in range(4)),
    )
    write_sheet(tmp_path / "halls.rrd", halls, np.zeros(4))
    _, halves = ground(read(tmp_path / "halls.rrd"), "1 a")
    assert (halves > 0.95 * 4.25).all()


def test_each_action_has_its_own_tiles(tmp_path: Path) -> None:
    both = Library(
        "both",
        tuple(
            Scenelet(f"room-{i}", action, standing(), ())
            for i, action in enumerate(["sit", "walk", "sit", "walk", "walk"])
        ),
    )
    write_sheet(tmp_path / "both.rrd", both, np.zeros(5))
    columns = read(tmp_path / "both.rrd")
    assert [len(ground(columns, action)[0]) for action in ("1 sit", "2 walk")] == [2, 3]
    assert labels(columns, "kinds", "1 sit") == ["room sit"]
    assert labels(columns, "kinds", "2 walk") == ["room walk"]


def test_motion_and_furniture_are_those_of_the_scenelet(columns: Columns) -> None:
    of_name = {s.name: s for s in library()}
    shown = [e.split("/")[-1].replace("\\", "").split(" ")[1] for e in entities(columns)]
    assert len(shown) == 35
    for entity, name in zip(entities(columns), shown, strict=True):
        scenelet = of_name[name]
        positions = columns[f"{entity}/person", "Points3D:positions"]
        assert list(positions) == list(range(14))
        for t in range(14):
            expected = scenelet.joints[min(t, scenelet.n_frames - 1)].astype(np.float32)
            assert np.array_equal(positions[t], expected)
        centres = columns[f"{entity}/furniture", "Boxes3D:centers"][None]
        assert np.array_equal(centres, pack_boxes(scenelet.objects)[:, :3].astype(np.float32))
        (poses,) = columns[f"{entity}/poses", "LineStrips3D:strips"].values()
        assert len(poses) == 5 * 3


def test_names_that_the_viewer_cannot_draw_are_told_apart(tmp_path: Path) -> None:
    """The viewer ends at a character that its font lacks, and shows paths of entities."""
    named = [("座-1", "座る"), ("椅-1", "座る"), ("a-1", "歩く")]
    few = Library("few", tuple(Scenelet(n, a, standing(), ()) for n, a in named))
    write_sheet(tmp_path / "few.rrd", few, np.zeros(3))
    columns = read(tmp_path / "few.rrd")
    assert [e.replace("\\", "") for e in entities(columns)] == [
        "/sheet/1 ??/1 ?-1", "/sheet/1 ??/2 ?-1", "/sheet/2 ??/1 a-1",
    ]  # fmt: skip


def test_motions_of_all_frame_rates_play_at_one_rate(tmp_path: Path) -> None:
    slow, quick = standing(11), standing(31)
    slow[..., 1] += np.linspace(0, 1, 11)[:, None]
    quick[..., 1] += np.linspace(0, 1, 31)[:, None]
    both = Library(
        "both",
        (
            Scenelet("slow-1", "walk", slow, (), fps=10.0),
            Scenelet("quick-1", "walk", quick, (), fps=30.0),
        ),
    )
    write_sheet(tmp_path / "both.rrd", both, np.zeros(2))
    columns = read(tmp_path / "both.rrd")
    one, other = (columns[f"{e}/person", "Points3D:positions"] for e in entities(columns))
    assert list(one) == list(range(31))
    for t in one:
        np.testing.assert_allclose(one[t], other[t], atol=1e-6)


def test_the_same_library_makes_the_same_sheet(
    written: Path, columns: Columns, tmp_path: Path
) -> None:
    gliders = library()
    write_sheet(tmp_path / "again.rrd", gliders, np.linspace(0, 1, len(gliders)))
    assert read(tmp_path / "again.rrd") == columns
    ids = [
        [r.recording_id for r in RrdReader(p).recordings()]
        for p in (written, tmp_path / "again.rrd")
    ]
    assert ids[0] == ids[1]
    assert len(RrdReader(written).blueprints()) == 1


def test_many_kinds_are_laid_out_wide(tmp_path: Path) -> None:
    many = library(n_kinds=30, each=3)
    write_sheet(tmp_path / "many.rrd", many, np.zeros(len(many)))
    centres, _ = ground(read(tmp_path / "many.rrd"), "1 glide")
    assert len(centres) == 90
    width, depth = np.ptp(centres, axis=0)
    assert 1.0 < width / depth < 3.5


def test_a_failed_write_leaves_the_old_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError("no space left")

    path = tmp_path / "sheet.rrd"
    path.write_bytes(b"old")
    monkeypatch.setattr(sheet, "_log", full)
    with pytest.raises(OSError, match="no space"):
        write_sheet(path, library(1, 2), np.zeros(2))
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_missing_folder_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="does not exist; make it first"):
        write_sheet(tmp_path / "nowhere" / "sheet.rrd", library(1, 2), np.zeros(2))


def test_the_viewer_draws_it_without_complaint(written: Path, tmp_path: Path) -> None:
    try:
        reports = render_recording(written, tmp_path / "sheet.png", width=800, height=500, frame=5)
    except PictureUnavailable as error:
        pytest.skip(str(error))
    assert reports == []
