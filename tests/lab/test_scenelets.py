"""What motion says about furniture."""

from __future__ import annotations

import pytest

from imapper_prob.models.scenelet import Scenelet
from imapper_prob.scenelets.library import load_library
from lab.scenelets import kinds_agree


def test_kinds_agree_as_often_as_by_chance_or_always() -> None:
    first: dict[str, Scenelet] = {}
    for scenelet in load_library():
        if scenelet.action == "sit" and len(scenelet.objects) == 1:
            first.setdefault(scenelet.objects[0].label, scenelet)
    chair, couch = first["chair"], first["couch"]
    assert kinds_agree([(chair, chair), (couch, couch)]) == (1.0, 0.5)
    both = [(one, other) for one in (chair, couch) for other in (chair, chair, couch)]
    assert kinds_agree(both) == pytest.approx((0.5, 0.5))
    standing = next(s for s in load_library() if not s.objects)
    assert kinds_agree([(chair, chair), (standing, couch)]) == (1.0, 1.0)
