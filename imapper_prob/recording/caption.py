"""What a recording says in words."""

from __future__ import annotations

from collections.abc import Sequence

from imapper_prob.models.scene import Scene
from imapper_prob.results.scenes import WeightedScene

__all__ = ["caption", "contents", "layout_name"]

_LEGEND = """\
**Boxes** are furniture, in a colour for each category. **Ellipses** on the floor hold 50 and
90 % of an object's position. The **yellow person** moves as in the most probable layout; **thin
doubles** are other draws of the same motion, blue people those of other layouts. **Grey
outlines** are the truth, where it is known.

In the image, **dots** are detections, from red (unsure) to green (sure); the yellow skeleton is
the person projected back.

Play `frame` to see the motion. Choose the timeline `layout` for one layout after the other, and
`draw` for the traces of the chains.
"""


def layout_name(number: int, weighted: WeightedScene) -> str:
    """Number of a layout (from 1) and its probability with the Monte-Carlo error."""
    return f"Layout {number}: p = {weighted.probability:.2f} ± {weighted.error:.2f}"


def contents(scene: Scene) -> str:
    """The furniture of a scene, as in ``"2 chair, table"``."""
    labels = sorted(o.label for o in scene.objects)
    counts = {label: labels.count(label) for label in labels}
    return ", ".join(f"{n} {label}" if n > 1 else label for label, n in counts.items()) or "nothing"


def caption(description: str, scenes: Sequence[WeightedScene]) -> str:
    """The text panel in Markdown: ``description``, the layouts in a table, and a legend."""
    rows = [
        f"| {i} | {s.probability:.2f} ± {s.error:.2f} | {contents(s.scene)} |"
        for i, s in enumerate(scenes, 1)
    ]
    table = ["| layout | probability | furniture |", "|---|---|---|", *rows]
    return "\n\n".join([description.strip(), "\n".join(table), _LEGEND])
