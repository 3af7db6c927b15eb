"""Damaged and hostile inputs for every reader, made from sound ones.

A source writes a sound input into a folder; a kind of damage changes one of its files. All random
numbers come from one generator, so that a failure is reproducible from reader, kind and seed.
"""

from __future__ import annotations

import io
import json
import math
import re
import shutil
import tempfile
import warnings
import zipfile
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

import h5py
import numpy as np
from PIL import Image

from imapper_prob.clips.clip_file import read_clip
from imapper_prob.clips.detect import detect
from imapper_prob.clips.i3db import read_i3db
from imapper_prob.clips.load import ClipOptions, read_camera, read_whatever, write_clip
from imapper_prob.clips.options import CameraFile
from imapper_prob.evaluate.i3db import read_authors, read_input_path, read_truth_in_view
from imapper_prob.evaluate.published import read_depths, read_regions
from imapper_prob.models.scene import Clip
from imapper_prob.models.skeleton import JOINTS, N_JOINTS
from imapper_prob.recording.video import read_video
from imapper_prob.scenelets.captures import (
    Capture,
    read_capture,
    read_i3db_capture,
    write_capture,
)
from imapper_prob.scenelets.pigraphs import read_pigraphs
from tests.clips import bodies, test_proposals
from tests.clips.films import dark_figure, film, write_film
from tests.clips.i3db_folder import I3dbFolder
from tests.clips.pigraphs_folder import PigraphsFolder

__all__ = ["KINDS", "READERS", "Reader", "kinds_of"]

Generator = np.random.Generator
Damage = Callable[[bytes, Generator], bytes]

_OPTIONS: Final = ClipOptions(size=bodies.SIZE, focal=1000.0, fps=25.0)
_CAMERA: Final = CameraFile(
    (640, 480), np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]]), np.zeros(0)
)
_TOML: Final = """
size = [1280, 720]
matrix = [[900, 0, 630], [0, 905, 365], [0, 0, 1]]
distortion = [-0.28, 0.07, 0.001, -0.0005, 0.0]
pitch_degrees = -12
"""


@dataclass(frozen=True)
class Reader:
    """Parameters
    ----------
    write : callable
        Writes a sound input into a folder and returns what to read.
    read : callable
        Reads it.
    """

    write: Callable[[Path], Path]
    read: Callable[[Path], Any]


def _joints() -> np.ndarray:
    return np.random.default_rng(1).normal(size=(12, N_JOINTS, 3)) * 0.4 + (0.2, 0.1, 4)


def _joints_file(folder: Path) -> Path:
    path = folder / "joints.npz"
    np.savez(
        path, joints=_joints(), joint_names=JOINTS, fps=30.0, matrix=_CAMERA.matrix, size=[640, 480]
    )
    return path


def _clip_file(folder: Path) -> Path:
    clip = read_i3db(I3dbFolder().write(folder.parent / "scene"))
    write_clip(folder / "clip.npz", clip)
    return folder / "clip.npz"


def _capture(folder: Path) -> Path:
    write_capture(folder / "capture.npz", Capture("walk", "hall", _joints(), (), 10.0))
    return folder / "capture.npz"


def _camera_json(folder: Path) -> Path:
    data = {"size": [1280, 720], "matrix": [[900, 0, 630], [0, 905, 365], [0, 0, 1]]}
    return bodies.write_json(folder / "camera.json", data | {"distortion": [0.1, 0, 0, 0]})


def _camera_toml(folder: Path) -> Path:
    (folder / "camera.toml").write_text(_TOML)
    return folder / "camera.toml"


def _proposals(folder: Path) -> Path:
    return bodies.write_json(folder / "lcr.json", test_proposals.content())


def _hall(folder: Path) -> Path:
    """A scene with ground truth, corrected detections, and a result in the same format."""
    made = I3dbFolder()
    hall = made.write(folder / "Hall")
    corrected = {frame: joints for frame, joints in made.detections["3d"].items()}
    bodies.write_json(hall / "gt" / "skel_GT_2d.json", {"3d": corrected})
    shutil.copytree(hall / "gt", hall / "iMapper")
    (hall / "iMapper" / "skel_hall_GT.json").rename(hall / "iMapper" / "skel_output.json")
    return hall


def _lifted(folder: Path) -> Path:
    """A folder with only the files that the reader of lifted paths needs."""
    hall = _hall(folder)
    for path in [path for path in hall.rglob("*") if path.is_file()]:
        if not path.name.endswith("_unannot.json"):
            path.unlink()
    return hall


@cache
def _hall_clip() -> Clip:
    with tempfile.TemporaryDirectory() as folder:
        return read_i3db(_hall(Path(folder)))


def _regions(folder: Path) -> Path:
    box = {"category_id": 62, "bbox": [100.0, 200, 300, 400], "score": 0.9}
    found = [{"image_id": f"frame_{frame:05d}.jpg", **box} for frame in range(1, 13)]
    categories = [{"id": 62, "name": "chair"}]
    document = {"detections": found, "categories": categories, "size": [1920, 1080]}
    return bodies.write_json(folder / "mask.json", document)


def _depths(folder: Path) -> Path:
    np.savez(folder / "mono.npz", depth=np.full((12, 54, 96), 3.0))
    return folder / "mono.npz"


def _pictures(folder: Path) -> Path:
    for frame in range(1, 4):
        Image.new("RGB", (192, 108), "teal").save(folder / f"color_{frame:05d}.png")
        Image.new("RGB", (192, 108), "teal").save(folder / f"color_{frame + 3:05d}.jpg")
    return folder


def _keypoints(path: Path) -> Any:
    return read_whatever(path, _OPTIONS)


def _openpose(order: str) -> Callable[[Path], Path]:
    return lambda folder: bodies.write_openpose(folder, order, people=2)


READERS: Final[dict[str, Reader]] = {
    "OpenPose BODY_25": Reader(_openpose("body_25"), _keypoints),
    "OpenPose BODY_25B": Reader(_openpose("body_25b"), _keypoints),
    "OpenPose COCO-18": Reader(_openpose("coco_18"), _keypoints),
    "results COCO-17": Reader(
        lambda f: bodies.write_json(f / "r.json", bodies.results("coco_17")), _keypoints
    ),
    "results Halpe-26": Reader(
        lambda f: bodies.write_json(f / "r.json", bodies.results("halpe_26")), _keypoints
    ),
    "MMPose instances": Reader(
        lambda f: bodies.write_json(f / "r.json", bodies.instances("coco_17")), _keypoints
    ),
    "MediaPipe dump": Reader(
        lambda f: bodies.write_json(f / "m.json", bodies.landmarks()),
        lambda path: read_whatever(path, ClipOptions(focal=1000.0)),
    ),
    "TRC": Reader(
        lambda f: bodies.write_trc(f / "walk.trc", _joints(), JOINTS),
        lambda path: read_whatever(path, ClipOptions(camera=_CAMERA)),
    ),
    "3D joints (.npz)": Reader(_joints_file, lambda path: read_whatever(path, ClipOptions())),
    "clip (.npz)": Reader(_clip_file, read_clip),
    "capture (.npz)": Reader(_capture, read_capture),
    "i3DB scene": Reader(lambda f: I3dbFolder().write(f / "Hall"), read_i3db),
    "PiGraphs recording": Reader(
        lambda f: PigraphsFolder().write(f),
        lambda path: read_pigraphs(path, folder=path.parents[1]),
    ),
    "i3DB truth": Reader(_hall, read_truth_in_view),
    "i3DB truth, a capture": Reader(_hall, read_i3db_capture),
    "i3DB result": Reader(_hall, lambda path: read_authors(path, _hall_clip())),
    "i3DB lifted path": Reader(_lifted, lambda path: read_input_path(path, _hall_clip())),
    "LCR-Net++ proposals": Reader(_proposals, lambda path: read_whatever(path, ClipOptions())),
    "regions": Reader(_regions, lambda path: read_regions(path, _hall_clip())),
    "depth maps (.npz)": Reader(_depths, lambda path: read_depths(path, _hall_clip())),
    "pictures": Reader(_pictures, lambda path: read_video(path, _hall_clip())),
    "camera (TOML)": Reader(_camera_toml, read_camera),
    "camera (JSON)": Reader(_camera_json, read_camera),
}
"""Every reader of the program; the reader of videos only if PyAV is installed."""

if find_spec("av") is not None:
    READERS["video"] = Reader(
        lambda folder: write_film(folder / "room.mp4", film(20)),
        lambda path: detect(path, detector=dark_figure, step=1),
    )

_STRANGE: Final[tuple[Any, ...]] = (
    None,
    "x",
    "",
    [],
    {},
    True,
    -1,
    0,
    [[]],
    {"x": 1},
    "NaN",
    [1, 2, 3],
)
_NOT_FINITE: Final = ("NaN", "Infinity", "-Infinity", "1e999")
_LARGEST: Final = 50_000_000
"""Numbers in an array of a million frames, limited so that the damaged input fits into memory."""
_HUGE: Final = ("1e308", "-1e300", "9" * 400, "9" * 5000, "123456789012345678901234567890")


def _cut(content: bytes, rng: Generator) -> bytes:
    return content[: rng.integers(0, len(content))]


def _bytes(content: bytes, rng: Generator) -> bytes:
    changed = bytearray(content)
    for _ in range(rng.integers(1, 20)):
        changed[rng.integers(len(changed))] = rng.integers(256)
    return bytes(changed)


def _types(content: bytes, rng: Generator) -> bytes:
    data = json.loads(content)
    return json.dumps(
        _replaced(data, rng, lambda old: _STRANGE[rng.integers(len(_STRANGE))])
    ).encode()


def _missing(content: bytes, rng: Generator) -> bytes:
    data = json.loads(content)
    return json.dumps(_replaced(data, rng, lambda old: _DROPPED)).encode()


def _number(choices: tuple[str, ...]) -> Callable[[bytes, Generator], bytes]:
    def spoil(content: bytes, rng: Generator) -> bytes:
        found = list(re.finditer(rb"-?\d+(\.\d+)?(e-?\d+)?", content))
        match = found[rng.integers(len(found))]
        new = choices[rng.integers(len(choices))].encode()
        return content[: match.start()] + new + content[match.end() :]

    return spoil


def _deep(content: bytes, rng: Generator) -> bytes:
    depth = int(rng.choice([200, 5_000, 200_000]))
    nested = b"[" * depth + b"]" * depth
    found = list(re.finditer(rb"-?\d+(\.\d+)?", content))
    match = found[rng.integers(len(found))]
    return (
        nested if rng.random() < 0.3 else content[: match.start()] + nested + content[match.end() :]
    )


def _nobody(content: bytes, rng: Generator) -> bytes:
    """Empty lists of people, null landmarks, or zero scores."""
    text = content.decode()
    text = re.sub(r'("people": )\[.*\]', r"\1[]", text)
    text = re.sub(r'("instances": )\[.*?\]\}\]', r"\1[]", text)
    text = re.sub(r'("landmarks": )\[.*?\]', r"\1null", text)
    return (text if text != content.decode() else str(rng.choice(["[]", "{}", "null"]))).encode()


def _order(content: bytes, rng: Generator) -> bytes:
    """Lines, or entries of the longest list, in another order, with one repeated."""
    try:
        data = json.loads(content)
    except ValueError:
        lines = content.splitlines()
        shuffled = [lines[i] for i in rng.permutation(len(lines))]
        return b"\n".join([*shuffled, lines[-1]])
    rows = (
        data
        if isinstance(data, list)
        else max((v for v in data.values() if isinstance(v, list)), key=len, default=[])
    )
    rng.shuffle(rows)
    rows += rows[:1]
    return json.dumps(data).encode()


def _million(content: bytes, rng: Generator) -> bytes:
    """A distant frame number, or very many rows."""
    far = str(rng.choice([10**6, 10**9, 10**15]))
    text, times = re.subn(
        r'("image_id": |"frame_id": |"frame": )"?\d+(\.jpg)?"?',
        rf"\g<1>{far}",
        content.decode(),
        count=1,
    )
    if times:
        return text.encode()
    lines = content.splitlines()
    if len(lines) > 6:
        return b"\n".join([*lines, *[lines[-1]] * 1_000_000])
    return json.dumps({"3d": {far: {}}, "people": [{}] * 1_000_000}).encode()


_DROPPED: Final = object()


def _replaced(data: Any, rng: Generator, new: Callable[[Any], Any]) -> Any:
    """The tree with a random element replaced or removed."""
    if not isinstance(data, dict | list) or not data or rng.random() < 0.1:
        value = new(data)
        return None if value is _DROPPED else value
    key = (
        list(data)[rng.integers(len(data))]
        if isinstance(data, dict)
        else int(rng.integers(len(data)))
    )
    child = data[key]
    if isinstance(child, dict | list) and child and rng.random() < 0.8:
        data[key] = _replaced(child, rng, new)
        return data
    value = new(child)
    if value is _DROPPED:
        del data[key]
    else:
        data[key] = value
    return data


def _entries(content: bytes) -> dict[str, np.ndarray]:
    with np.load(io.BytesIO(content), allow_pickle=False) as archive:
        return {key: archive[key] for key in archive.files}


def _saved(arrays: dict[str, Any], *, allow_pickle: bool = False) -> bytes:
    file = io.BytesIO()
    np.savez(file, allow_pickle=allow_pickle, **arrays)
    return file.getvalue()


def _array_types(content: bytes, rng: Generator) -> bytes:
    arrays = _entries(content)
    key = str(rng.choice(list(arrays)))
    old = arrays[key]
    if key == "values.json":  # in a checkpoint
        arrays[key] = np.frombuffer(_types(old.tobytes(), rng), np.uint8)
        return _saved(arrays)
    choices: list[Any] = [
        old.astype(np.str_), np.zeros(0), np.zeros((3, 3)), old[None], np.array("x"),
        old.ravel()[:1],
        old.astype(np.complex128) if old.dtype.kind in "fiu" else np.zeros(2, np.complex64),
        np.zeros(4, "datetime64[s]"), np.zeros(3, [("a", "i4")]),
    ]  # fmt: skip
    arrays[key] = choices[rng.integers(len(choices))]
    return _saved(arrays)


def _in_netcdf(change: Callable[[Any, list[str], Generator], None]) -> Damage:
    """Apply a change to a random variable of a netCDF file."""

    def spoil(content: bytes, rng: Generator) -> bytes:
        file = io.BytesIO(content)
        with h5py.File(file, "r+") as tree:
            names: list[str] = []
            tree.visititems(
                lambda name, item: names.append(name) if isinstance(item, h5py.Dataset) else None
            )
            change(tree, names, rng)
        return file.getvalue()

    return spoil


def _put(tree: Any, name: str, values: Any) -> None:
    """Replace a variable by another one, keeping its dimensions if they fit."""
    attributes = dict(tree[name].attrs)
    del tree[name]
    made = tree.create_dataset(name, data=values)
    for key, value in attributes.items():
        if key not in ("DIMENSION_LIST", "REFERENCE_LIST"):
            made.attrs[key] = value


def _netcdf_types(tree: Any, names: list[str], rng: Generator) -> None:
    name = names[rng.integers(len(names))]
    old = tree[name][()]
    numeric = isinstance(old, np.ndarray) and old.dtype.kind in "fiu"
    choices: list[Any] = [
        np.zeros(0), np.zeros((3, 3)), b"x", 7,
        old.astype(np.complex128) if numeric else np.zeros(2),
        old[:-1] if isinstance(old, np.ndarray) and old.ndim else 3.0,
        old[None] if isinstance(old, np.ndarray) else -1,
    ]  # fmt: skip
    if rng.random() < 0.2:
        key = list(tree.attrs)[rng.integers(len(tree.attrs))]
        tree.attrs[key] = ("x", "", 7, -1.5, "[{}]", [1, 2, 3], "[" * 5000)[rng.integers(7)]
    else:
        _put(tree, name, choices[rng.integers(len(choices))])


def _netcdf_missing(tree: Any, names: list[str], rng: Generator) -> None:
    if rng.random() < 0.2:
        del tree.attrs[list(tree.attrs)[rng.integers(len(tree.attrs))]]
    else:
        del tree[names[rng.integers(len(names))]]


def _netcdf_values(values: tuple[float, ...]) -> Callable[[Any, list[str], Generator], None]:
    def change(tree: Any, names: list[str], rng: Generator) -> None:
        while True:
            name = names[rng.integers(len(names))]
            old = tree[name]
            if old.size and old.dtype.kind in "fiu" and "CLASS" not in old.attrs:
                break
        array = old[()] if old.ndim else np.array(old[()])
        new = np.array(rng.choice(values))
        if array.dtype.kind in "iu":
            new = np.clip(np.nan_to_num(new), -(2.0**62), 2.0**62)
        whole = rng.random() < 0.3
        with np.errstate(all="ignore"):
            if whole or array.ndim == 0:
                array[...] = new.astype(array.dtype)
            else:
                array.reshape(-1)[rng.integers(array.size)] = new.astype(array.dtype)
        old[...] = array

    return change


def _netcdf_order(tree: Any, names: list[str], rng: Generator) -> None:
    while True:
        name = names[rng.integers(len(names))]
        old = tree[name]
        if old.ndim and len(old) > 1 and "CLASS" not in old.attrs:
            break
    old[...] = old[()][rng.permutation(len(old))]


def _array_missing(content: bytes, rng: Generator) -> bytes:
    arrays = _entries(content)
    del arrays[str(rng.choice(list(arrays)))]
    return _saved(arrays)


def _array_values(values: tuple[float, ...]) -> Callable[[bytes, Generator], bytes]:
    def spoil(content: bytes, rng: Generator) -> bytes:
        arrays = _entries(content)
        key = str(rng.choice([k for k, v in arrays.items() if v.dtype.kind in "fiu" and v.size]))
        if key == "values.json":  # in a checkpoint
            spoiled = _number(_HUGE)(arrays[key].tobytes(), rng)
            arrays[key] = np.frombuffer(spoiled, np.uint8)
            return _saved(arrays)
        array, new = arrays[key].astype(np.float64), rng.choice(values)
        if arrays[key].dtype.kind in "iu" and np.isfinite(new):
            array, new = arrays[key].astype(np.int64), np.clip(new, -(2**40), 2**40)
        array.reshape(-1)[rng.integers(array.size)] = new
        arrays[key] = array
        return _saved(arrays)

    return spoil


def _array_million(content: bytes, rng: Generator) -> bytes:
    arrays = _entries(content)
    rows = [k for k, v in arrays.items() if v.ndim]
    key = next((k for k in ("joints", "frame_ids") if k in arrays), rows[0])
    of_each = arrays[key].shape[1:]
    count = min(1_000_000, _LARGEST // max(1, math.prod(of_each)))
    arrays[key] = np.zeros((count, *of_each), np.float32)
    return _saved(arrays)


def _archive(content: bytes, rng: Generator) -> bytes:
    """Members outside the folder, with pickles, or with huge declared or unpacked sizes."""
    which = rng.integers(5)
    arrays: dict[str, Any] = dict(_entries(content))
    key = str(rng.choice(list(arrays)))
    if which == 0:
        arrays[key] = np.array([{"a": print}], dtype=object)
        return _saved(arrays, allow_pickle=True)
    file = io.BytesIO(content)
    with zipfile.ZipFile(file, "a", zipfile.ZIP_DEFLATED) as archive, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about repeated members
        header = io.BytesIO()
        claimed = {"descr": "<f8", "fortran_order": False, "shape": (1 << 40, 3)}
        np.lib.format.write_array_header_1_0(header, claimed)
        if which == 1:
            archive.writestr("../../../escaped.npy", b"x" * 100)
        elif which == 2:
            archive.writestr(f"{key}.npy", header.getvalue() + b"\0" * 64)
        elif which == 3:
            with archive.open("bomb.npy", "w") as entry:
                for _ in range(1 << 10):
                    entry.write(bytes(1 << 20))
        else:
            archive.writestr(f"{key}.npy", b"\x93NUMPY\x09\x00" + rng.bytes(40))
    return file.getvalue()


def _claims(content: bytes, rng: Generator) -> bytes:
    """A PNG whose header, with a correct checksum, declares a huge size."""
    side = int(rng.choice([0, 20_000, 60_000, 2**31 - 1])).to_bytes(4, "big")
    head = b"IHDR" + side + side + content[24:29]
    return content[:12] + head + zlib.crc32(head).to_bytes(4, "big") + content[33:]


KINDS: Final[dict[str, dict[str, Damage]]] = {
    "cut off": {"": _cut},
    "bytes changed": {"": _bytes},
    "wrong types": {".json": _types, ".npz": _array_types, ".nc": _in_netcdf(_netcdf_types)},
    "something missing": {
        ".json": _missing, ".npz": _array_missing, ".nc": _in_netcdf(_netcdf_missing),
    },
    "not finite": {
        ".json": _number(_NOT_FINITE), ".trc": _number(("nan", "inf", "-inf")),
        ".toml": _number(("nan", "inf")), ".npz": _array_values((np.nan, np.inf, -np.inf)),
        ".txt": _number(("nan", "inf")),
        ".nc": _in_netcdf(_netcdf_values((np.nan, np.inf, -np.inf))),
    },
    "huge": {
        ".json": _number(_HUGE), ".trc": _number(_HUGE), ".toml": _number(_HUGE),
        ".npz": _array_values((1e308, -1e300, 1e30)), ".txt": _number(_HUGE), ".png": _claims,
        ".nc": _in_netcdf(_netcdf_values((1e9, 1e30, -1e9, -1e300, -1.0, 1e5))),
    },
    "nested deeply": {".json": _deep, ".toml": _deep},
    "nobody": {".json": _nobody},
    "out of order": {
        ".json": _order, ".trc": _order, ".toml": _order, ".txt": _order,
        ".nc": _in_netcdf(_netcdf_order),
    },
    "a million frames": {".json": _million, ".trc": _million, ".npz": _array_million},
    "hostile archive": {".npz": _archive},
}  # fmt: skip
"""Kinds of damage, by the suffix of the damaged file; ``""`` is any suffix."""


def kinds_of(folder: Path) -> dict[str, list[tuple[Path, Damage]]]:
    """Kinds of damage that apply to an input, with its files."""
    files = sorted(p for p in folder.rglob("*") if p.is_file())
    found: dict[str, list[tuple[Path, Damage]]] = {}
    for kind, by_ending in KINDS.items():
        pairs = [
            (file, damage)
            for file in files
            for ending, damage in by_ending.items()
            if file.name.endswith(ending)
        ]
        if pairs:
            found[kind] = pairs
    return found
