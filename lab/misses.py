"""What is wrong with each piece of furniture that was found, and what was not found?

    python -m lab.misses I3DB_FOLDER SUITE_FOLDER

reads the results of the staged solver from ``imapper-prob evaluate --suite`` and prints Markdown: a
row for every true object, and the overlap of footprints if size, place or orientation are replaced
by the true ones. It takes seconds.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon, affinity, box, unary_union

from imapper_prob.evaluate.objects import Pair, pair_up
from imapper_prob.evaluate.prediction import read_prediction
from imapper_prob.evaluate.score import known_scene, scenes_with_truth
from imapper_prob.evaluate.truth import Outline

Array = NDArray[np.float64]

_COLUMNS = (
    "scene", "true, m", "found, m", "cm", "along", "across", "yaw, °", "IoU", "with true size",
    "with true place",
)  # fmt: skip
_SWAPS = {
    "as found": "",
    "true size": "size",
    "true place": "place",
    "true orientation": "yaw",
    "true size and place": "size place",
    "true place and orientation": "place yaw",
    "true size and orientation": "size yaw",
    "all of the found ones true": "size place yaw",
}


def size_of(item: Outline) -> Array:
    """(2,) metres along and across the front of the smallest rectangle around an outline."""
    turned = affinity.rotate(item.hull, -item.yaw, origin=(0, 0), use_radians=True)
    low_x, low_y, high_x, high_y = turned.bounds
    return np.array([high_x - low_x, high_y - low_y])


def footprint(centre: Array, yaw: float, size: Array) -> Polygon:
    """A rectangle in top view."""
    x, y = size / 2
    turned = affinity.rotate(box(-x, -y, x, y), yaw, origin=(0, 0), use_radians=True)
    return affinity.translate(turned, *centre)


def mended(found: Outline, truth: Outline | None, what: str) -> Polygon:
    """Footprint of a found object with the properties named in ``what`` replaced by the true
    ones."""

    def best(part: str) -> Outline:
        return truth if truth is not None and part in what else found

    return footprint(best("place").centre, best("yaw").yaw, size_of(best("size")))


def overlap(one: Polygon, other: Polygon) -> float:
    """Intersection over union."""
    return float(one.intersection(other).area / one.union(other).area)


def along_and_across(pair: Pair) -> tuple[float, float]:
    """Error of a found object in cm, along the viewing ray and to the right of it."""
    apart, ray = pair.found.centre - pair.truth.centre, pair.truth.centre
    ray = ray / np.linalg.norm(ray)
    return 100 * float(apart @ ray), 100 * float(apart @ [ray[1], -ray[0]])


def row(scene: str, truth: Outline, pair: Pair | None) -> str:
    """One line of the table."""
    width, depth = size_of(truth)
    cells = [scene, f"{truth.label} {width:.2f} x {depth:.2f}"]
    if pair is None:
        return "| " + " | ".join([*cells, "nothing", *[""] * 7]) + " |\n"
    width, depth = size_of(pair.found)
    along, across = along_and_across(pair)
    cells += [
        f"{pair.found.label} {width:.2f} x {depth:.2f}" + ("" if pair.near else " (too far)"),
        f"{100 * pair.distance:.0f}",
        f"{along:+.0f}",
        f"{across:+.0f}",
        f"{pair.yaw:.0f}",
    ]
    cells += [
        f"{overlap(truth.hull, mended(pair.found, truth, what)):.2f}"
        for what in ("", "size", "place")
    ]
    return "| " + " | ".join(cells) + " |\n"


def shared_floor(
    answers: Sequence[tuple[Sequence[Outline], Sequence[Outline], Sequence[Pair]]], what: str
) -> float:
    """Pooled overlap of all footprints; missed and spurious objects are unchanged."""
    common = either = 0.0
    for true, found, pairs in answers:
        partner = {id(p.found): p.truth for p in pairs if p.near}
        claimed = unary_union([mended(o, partner.get(id(o)), what) for o in found])
        there = unary_union([o.hull for o in true])
        common += claimed.intersection(there).area
        either += claimed.union(there).area
    return common / either


def main(arguments: Sequence[str] | None = None) -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("scenes", type=Path, help="folder of i3DB scenes with their truth")
    parser.add_argument("suite", type=Path, help="folder that ``evaluate --suite`` wrote")
    options = parser.parse_args(arguments)
    out = sys.stdout.write
    out("| " + " | ".join(_COLUMNS) + " |\n")
    out("|---" * 3 + "|---:" * (len(_COLUMNS) - 3) + "|\n")
    answers = []
    for scene in scenes_with_truth(options.scenes):
        known = known_scene(scene)
        answer = read_prediction(options.suite / scene.name / "solver.json", known.clip)
        true = known.truth.used_objects
        pairs = pair_up(true, answer.objects)
        partner = {id(p.truth): p for p in pairs}
        for item in true:
            out(row(scene.name, item, partner.get(id(item))))
        answers.append((true, answer.objects, pairs))
    out("\n| found ones with | IoU |\n|---|---:|\n")
    for name, what in _SWAPS.items():
        out(f"| {name} | {shared_floor(answers, what):.2f} |\n")


if __name__ == "__main__":
    main()
