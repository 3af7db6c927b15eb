"""A reader of glTF that shares nothing with the writer finds furniture, motion and camera."""

from __future__ import annotations

import json
import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation, Slerp
from trimesh.exchange.gltf import validate

from imapper_prob.models.colours import category_colour
from imapper_prob.models.scene import Clip, Scene
from imapper_prob.models.skeleton import BONES, JOINTS, PELV
from imapper_prob.results.glb import write_glb
from tests.results.test_export_formats import corners, in_order
from tests.runs import posterior
from tests.uncertainty.rooms import CAMERA, FRAME_IDS, clip_of_scene, couch_and_table

UPRIGHT = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""From glTF (y up) to the world (z up): (x, y, z) is (x, -z, y)."""
BESIDE = np.array([0.5, 0.2, 0.0])
PARTS = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}


class Reader:
    """The specification's words: chunks, accessors, nodes and samplers."""

    def __init__(self, path: Path) -> None:
        content = path.read_bytes()
        magic, version, length = struct.unpack_from("<4sII", content)
        assert (magic, version, length) == (b"glTF", 2, len(content))
        size, kind = struct.unpack_from("<I4s", content, 12)
        assert kind == b"JSON"
        self.tree: dict[str, Any] = json.loads(content[20 : 20 + size])
        following, kind = struct.unpack_from("<I4s", content, 20 + size)
        assert kind == b"BIN\0"
        self.binary = content[28 + size :]
        assert following == len(self.binary) == self.tree["buffers"][0]["byteLength"]

    def values(self, number: int) -> np.ndarray:
        """Numbers of an accessor, which are within what it says of them."""
        accessor = self.tree["accessors"][number]
        view = self.tree["bufferViews"][accessor["bufferView"]]
        assert accessor["componentType"] == 5126
        assert view["byteOffset"] % 4 == 0
        parts = PARTS[accessor["type"]]
        assert view["byteLength"] == 4 * parts * accessor["count"]
        found = np.frombuffer(self.binary, "<f4", view["byteLength"] // 4, view["byteOffset"])
        found = found.reshape(accessor["count"], parts)
        assert_allclose(accessor["min"], found.min(0))
        assert_allclose(accessor["max"], found.max(0))
        return found.astype(float)

    def number(self, name: str) -> int:
        (found,) = [n for n, node in enumerate(self.tree["nodes"]) if node.get("name") == name]
        return found

    def placed(self, name: str) -> np.ndarray:
        """(4, 4) matrix of a root node; glTF stores columns."""
        number = self.number(name)
        assert number in self.tree["scenes"][0]["nodes"]
        return np.reshape(self.tree["nodes"][number]["matrix"], (4, 4)).T

    def moved(self, name: str, points: np.ndarray, at: float) -> np.ndarray:
        """Points (n, 3) of a node moved by the animation to a time in seconds."""
        (animation,) = self.tree["animations"]
        mine = {
            channel["target"]["path"]: animation["samplers"][channel["sampler"]]
            for channel in animation["channels"]
            if channel["target"]["node"] == self.number(name)
        }
        times = self.values(mine["scale"]["input"])[:, 0]
        (scale, shift), turns = (
            [
                [np.interp(at, times, own) for own in self.values(mine[path]["output"]).T]
                for path in ("scale", "translation")
            ],
            self.values(mine["rotation"]["output"]),
        )
        assert_allclose(np.linalg.norm(turns, axis=1), 1, atol=1e-6)
        # A viewer may blend quaternions as they are, without looking for the shorter way.
        assert ((turns[1:] * turns[:-1]).sum(1) >= 0).all()
        at = min(at, times[-1])  # which is of single precision
        return Slerp(times, Rotation.from_quat(turns))(at).apply(points * scale) + shift


ENDS = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def written(folder: Path, scene: Any, clip: Clip) -> Reader:
    write_glb(folder / "scene.glb", scene, clip)
    found = Reader(folder / "scene.glb")
    validate(found.tree)
    return found


def dancing() -> Scene:
    """Somebody whose arms turn by 0.9 rad a frame, through every direction."""
    scene = couch_and_table()
    joints = scene.joints.copy()
    for far, near in BONES[9:]:
        angle = 0.9 * np.arange(len(joints)) + near
        along = np.stack([0.2 * np.cos(angle), 0.1 * np.cos(3 * angle), np.sin(angle)], -1)
        joints[:, far] = joints[:, near] + 0.3 * along
    return replace(scene, joints=joints)


@pytest.mark.parametrize("scene", [couch_and_table(), dancing()], ids=["walking", "dancing"])
def test_the_person_moves_as_in_the_scene(tmp_path: Path, scene: Scene) -> None:
    film = written(tmp_path, scene, clip_of_scene(scene))
    world = UPRIGHT @ film.placed("person")[:3, :3]
    bones = [
        film.tree["nodes"][n]["name"] for n in film.tree["nodes"][film.number("person")]["children"]
    ]
    assert bones == [f"person {JOINTS[far]}-{JOINTS[near]}" for far, near in BONES]
    for (far, near), name in zip(BONES, bones, strict=True):
        for t in range(len(FRAME_IDS)):
            found = film.moved(name, ENDS, t / 10.0) @ world.T
            assert_allclose(found, scene.joints[t, [near, far]], atol=2e-6)
        rest = film.tree["nodes"][film.number(name)]
        assert_allclose(rest["translation"], scene.joints[0, near])


def test_the_mesh_of_a_bone_is_a_rod_of_a_metre(tmp_path: Path) -> None:
    scene = couch_and_table()
    film = written(tmp_path, scene, clip_of_scene(scene))
    used = {node["mesh"] for node in film.tree["nodes"] if node["name"].startswith("person ")}
    (mesh,) = used
    (primitive,) = film.tree["meshes"][mesh]["primitives"]
    rod = film.values(primitive["attributes"]["POSITION"])
    assert_allclose([rod.min(0), rod.max(0)], [[-0.02, -0.02, 0], [0.02, 0.02, 1]], atol=1e-6)


def test_in_frames_without_a_motion_it_goes_on_from_the_last_to_the_next(tmp_path: Path) -> None:
    scene = couch_and_table()
    joints = scene.joints.copy()
    joints[[0, 5, 6]] = np.nan
    film = written(tmp_path, replace(scene, joints=joints), clip_of_scene(scene))
    for t, expected in ((4, joints[4]), (7, joints[7]), (5.5, 0.5 * (joints[4] + joints[7]))):
        found = film.moved("person HEAD-NECK", ENDS, t / 10.0)
        assert_allclose(found, expected[[JOINTS.index("NECK"), JOINTS.index("HEAD")]], atol=1e-5)


def test_the_camera_sees_what_the_clip_sees(tmp_path: Path) -> None:
    scene = couch_and_table()
    film = written(tmp_path, scene, clip_of_scene(scene))
    (camera,), matrix = film.tree["cameras"], film.placed("camera")
    lens, points = camera["perspective"], scene.joints[:, PELV]
    local = (points @ UPRIGHT - matrix[:3, 3]) @ matrix[:3, :3]
    up = np.tan(0.5 * lens["yfov"])
    seen = local[:, :2] / -local[:, 2:] / (up * lens["aspectRatio"], up)
    pixels = (1 + seen * (1, -1)) * (CAMERA.width / 2, CAMERA.height / 2)
    # The principal point of this camera is the centre of the picture.
    assert_allclose(pixels, CAMERA.project(points), atol=1e-6)
    assert film.tree["nodes"][film.number("camera")]["extras"]["fx"] == CAMERA.fx


def test_what_is_said_of_a_scene_of_the_posterior(tmp_path: Path) -> None:
    run = posterior()
    best = run.scene(1)
    said = written(tmp_path, best, run.clip).tree["scenes"][0]["extras"]
    assert said["probability"] == best.probability
    assert said["probability_error"] == best.error
    assert said["units"].startswith("metres")
    assert (said["clip"], said["fps"]) == (run.clip.name, run.clip.fps)
    assert "probability" not in written(tmp_path, best.scene, run.clip).tree["scenes"][0]["extras"]


def test_everybody_moves_in_one_animation(tmp_path: Path) -> None:
    scene = couch_and_table()
    clip = clip_of_scene(scene)
    (track,) = clip.tracks
    clip = replace(clip, tracks=(replace(track, name="A"), replace(track, name="B")))
    both = replace(scene, joints=np.concatenate([scene.joints, scene.joints + BESIDE]))
    film = written(tmp_path, both, clip)
    for name, beyond in (("A", 0.0 * BESIDE), ("B", BESIDE)):
        assert film.number(f"motion {name}")
        found = film.moved(f"person {name} NECK-THRX", ENDS[:1], 0.3)
        assert_allclose(found[0], scene.joints[3, JOINTS.index("THRX")] + beyond, atol=1e-6)


def test_boxes_of_a_glb_are_those_of_the_scene(tmp_path: Path) -> None:
    scene = couch_and_table()
    write_glb(tmp_path / "scene.glb", scene, clip_of_scene(scene))
    back = trimesh.load(tmp_path / "scene.glb")
    # glTF has y up: (x, y, z) of ours is (x, z, -y) of theirs.
    names = {
        "couch 1": ["seat", "back", "arm 1", "arm 2"],
        "table 1": ["top", "left leg"],
    }
    for o, (name, parts) in zip(scene.objects, names.items(), strict=True):
        assert name in back.graph.nodes
        for c, part in zip(o.cuboids, parts, strict=True):
            matrix, geometry = back.graph[f"{name} {part}"]
            found = trimesh.transform_points(back.geometry[geometry].vertices, matrix)
            mine = corners(o, c) @ np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])
            unique = np.unique(np.round(found, 5), axis=0)
            assert len(unique) == 8
            assert_allclose(in_order(unique), in_order(mine), atol=1e-3)
    matrix, geometry = back.graph["motion"]
    way = trimesh.transform_points(back.geometry[geometry].vertices, matrix)
    assert_allclose(way[0][[0, 2]], scene.joints[0, PELV, :2] * (1, -1), atol=1e-3)


def test_colours_are_linear(tmp_path: Path) -> None:
    """A viewer encodes linear colours in sRGB, and so shows the colours of the figures."""
    scene = couch_and_table()
    film = written(tmp_path, scene, clip_of_scene(scene))

    def shown(linear: np.ndarray) -> np.ndarray:
        curved = 1.055 * np.maximum(linear, 0.0031308) ** (1 / 2.4) - 0.055
        return 255 * np.where(linear <= 0.0031308, 12.92 * linear, curved)

    found = {}
    for node in film.tree["nodes"]:
        if "mesh" in node:
            found[node["name"]] = film.tree["meshes"][node["mesh"]]["primitives"][0]
    for name, colour in (
        ("couch 1 seat", category_colour("couch")),
        ("table 1 top", category_colour("table")),
        ("person NECK-THRX", (235, 200, 70)),
    ):
        material = film.tree["materials"][found[name]["material"]]
        factor = np.array(material["pbrMetallicRoughness"]["baseColorFactor"])
        assert_allclose(shown(factor[:3]), colour, atol=3)  # linear colours are bytes
        assert factor[3] == 1
    accessor = film.tree["accessors"][found["motion"]["attributes"]["COLOR_0"]]
    start = film.tree["bufferViews"][accessor["bufferView"]]["byteOffset"]
    colours = np.frombuffer(film.binary, np.uint8, 4 * accessor["count"], start).reshape(-1, 4)
    assert_allclose(shown(colours[:, :3] / 255), np.tile((60, 60, 70), (len(colours), 1)), atol=3)
    assert (colours[:, 3] == 255).all()


def test_a_glb_of_an_empty_room_and_an_unknown_motion(tmp_path: Path) -> None:
    scene = couch_and_table()
    nobody = replace(scene, objects=scene.objects[1:], joints=np.full_like(scene.joints, np.nan))
    write_glb(tmp_path / "scene.glb", nobody, clip_of_scene(scene))
    assert set(trimesh.load(tmp_path / "scene.glb").geometry) == {"table 1 top", "table 1 left leg"}
