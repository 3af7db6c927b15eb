"""The demo's clip tells the story it promises."""

from __future__ import annotations

import numpy as np

from imapper_prob.api import demo_clip
from imapper_prob.models.skeleton import DETECTED, LANK, RANK


def test_the_demo_can_be_recovered() -> None:
    clip = demo_clip()
    assert clip.truth is not None
    assert [o.label for o in clip.truth.objects] == ["couch", "table", "shelf"]
    actions = np.array(clip.truth.actions)
    assert (actions == "sitting").sum() >= 20
    assert (actions == "reaching").sum() >= 20
    # Sitting, the feet are hidden and little else.
    sitting = clip.truth.hidden[actions == "sitting"]
    assert sitting[:, [RANK, LANK]].mean() > 0.9
    assert sitting[:, DETECTED].mean() < 0.3
    assert (clip.tracks[0].confidences[:, DETECTED] > 0).mean() > 0.8


def test_the_demo_is_always_the_same() -> None:
    one, other = demo_clip(), demo_clip()
    np.testing.assert_array_equal(one.tracks[0].keypoints, other.tracks[0].keypoints)
