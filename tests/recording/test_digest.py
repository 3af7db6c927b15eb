"""Names of contents, and texts that can be drawn."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from imapper_prob.recording.palette import digest, drawable
from tests.recording.room import make_room


def test_equal_contents_have_equal_names() -> None:
    assert digest(make_room(5)) == digest(make_room(5))
    assert len(digest()) == 32


def test_any_change_changes_the_name() -> None:
    clip, scenes, truth = make_room(5)
    joints = scenes[1].scene.joints.copy()
    joints[3, 2, 1] += 1e-9
    moved = replace(scenes[1], scene=replace(scenes[1].scene, joints=joints))
    names = {
        digest(clip, scenes, truth),
        digest(clip, scenes),
        digest(clip, scenes, None),
        digest(clip, [scenes[0], moved, scenes[2]], truth),
        digest(replace(clip, name="other"), scenes, truth),
        digest(["ab", "c"]),
        digest(["a", "bc"]),
        digest({"a": 1}),
        digest({"a": np.array(1)}),
        digest(np.zeros((2, 3))),
        digest(np.zeros((3, 2))),
    }
    assert len(names) == 11


def test_signs_without_a_picture_become_question_marks() -> None:
    plain = "Sofá Größe łóżko διψα стул: 0.62 ± 0.02, −4°\n\n| – | “ok” |"
    assert drawable(plain) == plain
    assert drawable("部屋 █ ŉ🙂") == "?? ? ??"
