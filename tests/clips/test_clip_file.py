"""The clip format: what is written comes back, what is spoiled is named."""

from __future__ import annotations

import contextlib
import os
import zipfile
from collections.abc import Callable
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import imapper_prob as im
from imapper_prob.clips.clip_file import clip_of, pack_clip, read_clip, write_clip
from imapper_prob.clips.i3db import read_i3db, read_i3db_truth
from imapper_prob.clips.load import window
from imapper_prob.models.camera import Camera
from imapper_prob.models.errors import InputError
from imapper_prob.models.scene import Clip, Cuboid, Placement, SceneObject, Track, Truth
from imapper_prob.models.text import readable
from tests.clips.i3db_folder import I3dbFolder

Arrays = dict[str, Any]
number = st.floats(-1e6, 1e6)
positive = st.floats(1e-3, 1e6)
word = st.text(
    st.characters(exclude_categories=["Cs", "Cc", "Zl", "Zp"]), min_size=1, max_size=12
).filter(lambda text: readable(text) == text)


def same(a: Any, b: Any) -> bool:
    """Equal in every field, NaN being equal to NaN."""
    if is_dataclass(a):
        return type(a) is type(b) and all(
            same(getattr(a, f.name), getattr(b, f.name)) for f in fields(a)
        )
    if isinstance(a, tuple):
        return len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, np.ndarray):
        return bool(np.array_equal(a, b, equal_nan=a.dtype.kind == "f"))
    return type(a) is type(b) and a == b


@st.composite
def cameras(draw: st.DrawFn) -> Camera:
    return Camera(
        draw(st.integers(1, 10_000)),
        draw(st.integers(1, 10_000)),
        *(draw(positive) for _ in range(2)),
        *(draw(number) for _ in range(5)),
    )


@st.composite
def clip_cameras(draw: st.DrawFn) -> Camera:
    """Such as people are filmed with."""
    width, height = draw(st.integers(600, 10_000)), draw(st.integers(1, 10_000))
    longer, near, tilt = max(width, height), st.floats(-1.0, 2.0), st.floats(-1.0, 1.0)
    focal = [longer * draw(st.floats(0.01, 50.0)) for _ in range(2)]
    centre = [longer * draw(near) for _ in range(2)]
    return Camera(
        width, height, *focal, *centre, draw(tilt), draw(tilt), draw(st.floats(0.2, 100.0))
    )


@st.composite
def objects(draw: st.DrawFn) -> SceneObject:
    boxes = draw(st.lists(st.tuples(word, *[number] * 3, *[positive] * 3), min_size=1, max_size=3))
    return SceneObject(
        draw(word),
        Placement(*(draw(number) for _ in range(3))),
        tuple(Cuboid(part, np.array(b[:3]), np.array(b[3:])) for part, *b in boxes),
    )


@st.composite
def clips(draw: st.DrawFn) -> Clip:
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    n_frames = draw(st.integers(1, 9))

    def track(name: str) -> Track:
        keypoints = rng.normal(500, 400, (n_frames, 16, 2))
        confidences = rng.random((n_frames, 16))
        poses = rng.normal(size=(n_frames, 16, 3))
        lost = rng.random((n_frames, 16)) < 0.3
        keypoints[lost], confidences[lost] = np.nan, 0
        poses[rng.random(n_frames) < 0.3] = np.nan
        return Track(name, keypoints, confidences, poses, rng.random(n_frames) < 0.5)

    tracks = tuple(track(n) for n in draw(st.lists(word, min_size=1, max_size=3, unique=True)))
    truth = None
    if draw(st.booleans()):
        spoken = draw(st.booleans())
        rows = n_frames * draw(st.sampled_from((1, len(tracks))))
        truth = Truth(
            camera=draw(cameras()),
            objects=tuple(draw(st.lists(objects(), max_size=3))),
            joints=np.where(rng.random((rows, 1, 1)) < 0.5, np.nan, 1.5) * np.ones((16, 3)),
            hidden=rng.random((rows, 16)) < 0.5,
            actions=tuple(draw(word) for _ in range(rows)) if spoken else (),
        )
    return Clip(
        name=draw(word),
        camera=draw(clip_cameras()),
        fps=draw(st.floats(0.1, 1000.0)),
        frame_ids=np.arange(n_frames) + draw(st.integers(-5, 10**9)),
        tracks=tracks,
        focal_spread=draw(st.floats(0.001, 0.9)),
        truth=truth,
    )


@given(clip=clips())
def test_round_trip(clip: Clip, tmp_path_factory: pytest.TempPathFactory) -> None:
    path = tmp_path_factory.getbasetemp() / "round_trip.npz"
    write_clip(path, clip)
    assert same(read_clip(path), clip)


@pytest.mark.parametrize(("known", "spread"), [(True, 0.005), (False, 0.05)])
def test_older_files_say_only_whether_the_focal_length_is_known(
    tmp_path: Path, known: bool, spread: float
) -> None:
    arrays = pack_clip(benchmark_clip(tmp_path))
    del arrays["focal_spread"]
    older = clip_of({**arrays, "focal_known": np.array(known)}, tmp_path / "older.npz")
    assert older.focal_spread == spread


def benchmark_clip(folder: Path) -> Clip:
    files = I3dbFolder().write(folder / "Hall")
    clip = read_i3db(files)
    return replace(clip, truth=read_i3db_truth(files, clip))


def test_round_trip_of_a_benchmark_scene(tmp_path: Path) -> None:
    clip = benchmark_clip(tmp_path)
    write_clip(tmp_path / "clip.npz", clip)
    assert same(read_clip(tmp_path / "clip.npz"), clip)


def test_failed_write_leaves_the_old_file_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clip = benchmark_clip(tmp_path)
    path = tmp_path / "out" / "clip.npz"
    path.parent.mkdir()
    write_clip(path, clip)
    before = path.read_bytes()

    def full_disk(file: Any, **_: Any) -> None:
        file.write(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savez_compressed", full_disk)
    with pytest.raises(OSError, match="No space left"):
        write_clip(path, clip)
    assert path.read_bytes() == before
    assert os.listdir(path.parent) == ["clip.npz"]


def test_readable_by_others_as_the_umask_says(tmp_path: Path) -> None:
    path = tmp_path / "clip.npz"
    (tmp_path / "plain").touch()
    write_clip(path, benchmark_clip(tmp_path))
    assert path.stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_other_endings_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"clip\.json: a clip file's name ends in \.npz"):
        write_clip(tmp_path / "clip.json", benchmark_clip(tmp_path))


FAULTS: dict[str, tuple[Callable[[Arrays], object], str]] = {
    "another version": (
        lambda a: a.update(format=np.array("imapper-prob clip 2")),
        "format 'imapper-prob clip 2', this version reads",
    ),
    "no format": (lambda a: a.pop("format"), "no entry 'format'"),
    "entry missing": (lambda a: a.pop("poses"), "no entry 'poses'"),
    "fifteen joints": (
        lambda a: a.update(keypoints=a["keypoints"][:, :, :15]),
        r"entry 'keypoints' has shape \(1, 12, 15, 2\)",
    ),
    "tracks of other lengths": (
        lambda a: a.update(poses=a["poses"][:, :4]),
        r"entry 'poses' has shape \(1, 4, 16, 3\)",
    ),
    "text for numbers": (
        lambda a: a.update(confidences=a["confidences"].astype(str)),
        "entry 'confidences' has shape .* type <U32",
    ),
    "confidence above one": (
        lambda a: a["confidences"].__setitem__((0, 3, 9), 1.5),
        "track hall, frame 4, joint HEAD: confidence 1.5",
    ),
    "detection without a place": (
        lambda a: a["keypoints"].__setitem__((0, 3, 9), np.nan),
        "track hall, frame 4, joint HEAD: a confidence but no finite position",
    ),
    "half a pose": (
        lambda a: a["poses"].__setitem__((0, 2, 0), np.nan),
        "track hall, frame 3, joint RANK: pose is not finite",
    ),
    "frames that jump": (
        lambda a: a["frame_ids"].__setitem__(-1, 99),
        "frame ids must be consecutive",
    ),
    "negative focal length": (
        lambda a: a["camera"].__setitem__(2, -1.0),
        "focal length fx = -1.0",
    ),
    "broken pixels": (lambda a: a["camera"].__setitem__(0, 0.5), "whole numbers of pixels"),
    "image of no finite size": (
        lambda a: a["camera"].__setitem__(0, np.nan),
        "whole numbers of pixels",
    ),
    "no frame rate": (lambda a: a.update(fps=np.array(0.0)), "frame rate 0.0"),
    "nobody": (
        lambda a: a.update(
            track_names=a["track_names"][:0],
            keypoints=a["keypoints"][:0],
            confidences=a["confidences"][:0],
            poses=a["poses"][:0],
            interpolated=a["interpolated"][:0],
        ),
        "no person in it",
    ),
    "part of no object": (
        lambda a: a["cuboid_owners"].__setitem__(0, 9),
        "a cuboid belongs to an object that is not there",
    ),
    "object without parts": (
        lambda a: a["cuboid_owners"].fill(0),
        "object 'table' has no cuboids",
    ),
    "actions too few": (
        lambda a: a.update(truth_actions=a["truth_actions"][:2]),
        "2 actions for 12 rows",
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_spoiled_entries_are_named(fault: str, tmp_path: Path) -> None:
    spoil, message = FAULTS[fault]
    path = tmp_path / "clip.npz"
    write_clip(path, benchmark_clip(tmp_path))
    with np.load(path, allow_pickle=False) as archive:
        arrays = {name: archive[name] for name in archive.files}
    spoil(arrays)
    np.savez(path, allow_pickle=False, **arrays)
    with pytest.raises(InputError, match=message) as caught:
        read_clip(path)
    assert str(caught.value).startswith(f"{path}: ")


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 cut", b"\x93NUMPY", b"anything"])
def test_files_that_are_no_archive(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "clip.npz"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"clip\.npz: damaged, or no \.npz"):
        read_clip(path)


def test_damaged_archives_never_give_another_error(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    path = tmp_path / "clip.npz"
    write_clip(path, benchmark_clip(tmp_path))
    content = path.read_bytes()
    messages = []
    for _ in range(200):
        damaged = bytearray(content)
        for position in rng.integers(0, len(content), 4):
            damaged[position] = rng.integers(256)
        cut = len(content) if rng.random() < 0.5 else int(rng.integers(len(content)))
        path.write_bytes(damaged[:cut])
        try:
            read_clip(path)
        except InputError as error:
            messages.append(str(error))
    assert len(messages) > 150
    assert all(f"{path}: " in m for m in messages)


@pytest.mark.parametrize("how", [zipfile.ZIP_STORED, zipfile.ZIP_LZMA, zipfile.ZIP_BZIP2])
def test_archives_damaged_in_another_packing_are_refused(
    how: int, tmp_path: Path, rng: np.random.Generator
) -> None:
    path = tmp_path / "clip.npz"
    write_clip(path, benchmark_clip(tmp_path))
    with zipfile.ZipFile(path) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    with zipfile.ZipFile(path, "w", how) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    content = path.read_bytes()
    for _ in range(30):
        damaged = bytearray(content)
        start = int(rng.integers(len(content) - 40))
        damaged[start : start + 40] = rng.bytes(40)
        path.write_bytes(damaged)
        with contextlib.suppress(InputError):
            read_clip(path)


def test_what_is_no_array_is_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "clip.npz"
    write_clip(path, benchmark_clip(tmp_path))
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("notes", "25.0")
    with pytest.raises(InputError, match="entry notes is no array"):
        read_clip(path)
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("fps.npy", b"\x93NUMPY\x01\x00\x10\x00{'descr': ('<f8'  ")
    with pytest.raises(InputError, match="damaged"):
        read_clip(path)


def test_pickled_objects_are_never_loaded(tmp_path: Path) -> None:
    path = tmp_path / "clip.npz"
    np.savez(path, format=np.array([{"a": 1}], dtype=object))
    with pytest.raises(InputError, match=r"clip\.npz: damaged"):
        read_clip(path)


def test_a_fault_is_at_the_number_of_its_frame(tmp_path: Path) -> None:
    arrays = pack_clip(read_i3db(I3dbFolder().write(tmp_path / "hall")))
    arrays["frame_ids"] = arrays["frame_ids"] - arrays["frame_ids"][0] + 100
    arrays["poses"][0, 5, 0] = 98.0
    with pytest.raises(InputError, match="frame 105, joint RANK: its pose has it 98 m from"):
        clip_of(arrays, Path("hall.npz"))


def test_a_part_of_a_clip_has_its_part_of_the_truth() -> None:
    clip = im.demo_clip()
    assert clip.truth is not None
    both = replace(clip, truth=replace(
        clip.truth,
        joints=np.concatenate([clip.truth.joints, clip.truth.joints + 1]),
        hidden=np.concatenate([clip.truth.hidden, clip.truth.hidden]),
        actions=tuple(str(row) for row in range(260)),
    ))  # fmt: skip
    for whole, rows in ((clip, [*range(20, 50)]), (both, [*range(20, 50), *range(150, 180)])):
        part = window(whole, 20, 49)
        assert part.truth is not None
        assert whole.truth is not None
        assert same(part.truth.joints, whole.truth.joints[rows])
        assert same(part.truth.hidden, whole.truth.hidden[rows])
        assert len(part.truth.actions) == len(rows)
    assert part.truth.actions[30] == "150"
