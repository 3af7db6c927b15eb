"""What is it worth to be told something about a scene?

    python -m lab.told I3DB_FOLDER FOLDER [--steps 26000] [--workers 2]

samples each scene briefly, then conditions the posterior on one true statement at a time, with
continued chains as long as the first ones: the height of the camera; walls; the label of one seat;
the place of one object; boxes of furniture as from an object detector, alone and with the height of
the camera; depths of the pelvis. It prints a table of scores over all scenes before and after, and
one for each scene, stores results in FOLDER, and continues from there. It takes some ten minutes a
scene. Two more tables show what limits the scores: the error of joints whose pelvis has its true
depth in some frames, and the overlap of furniture that differs from the true furniture in place and
size alone. Figures are written to `lab/results.json`.

The statements come from the ground truth, with simulated errors of boxes (10 px, one object in ten
missed) and depths (5 %). Constants are estimated without the scene.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from shapely import MultiPoint, Polygon, box, unary_union

import imapper_prob as im
from imapper_prob.clips.i3db import read_i3db_truth
from imapper_prob.evaluate.prediction import prediction_of_scene
from imapper_prob.evaluate.score import known_scene, scenes_with_truth, score, summarise
from imapper_prob.evaluate.truth import TruthInView
from imapper_prob.models.problem import labels_of
from imapper_prob.models.scene import SEATS, Clip, SceneObject, Truth
from imapper_prob.models.scenelet import Library
from imapper_prob.models.skeleton import PELV, SCORED
from imapper_prob.models.statements import Statement
from lab.mixing import note
from lab.stored import SHORT_STEPS, digest, with_steps

Array = NDArray[np.float64]
_NAMES: Final = (
    "nothing", "camera height", "walls", "a label", "a place", "boxes", "boxes, then height",
    "boxes as seen", "depths",
)  # fmt: skip
_MISSED, _PIXELS, _DEPTH_ERROR, _FRAMES = 0.1, 10.0, 0.05, 10
_REPEATS: Final = 100
"""Random draws of sizes, places and depths."""
_DEPTHS: Final = {
    "10 frames, 5 % error": (_FRAMES, _DEPTH_ERROR),
    "10 frames": (_FRAMES, 0.0),
    "30 frames": (30, 0.0),
    "all frames": (0, 0.0),
}
"""Number of frames with the true depth, 0 for all that are annotated, and its relative error."""
_WALL: Final = 0.3
"""Distance in metres of the walls from everything inside."""


def statements_of(
    clip: Clip, truth: Truth, used: Sequence[str], labels: Sequence[str], rng: np.random.Generator
) -> dict[str, list[Statement]]:
    """The statements, by name."""
    known = [o for o in truth.objects if o.label in labels]
    ours = [o for o in known if o.label in used]
    seats = [o for o in ours if o.label in SEATS] or ours
    found = detected(clip, truth, known, rng)
    measured_depths = depths(clip, truth, rng)
    seen = [one for one in found if rng.uniform() >= share_hidden(clip, truth, one[0])]
    return {
        "camera height": [im.Measured("height", truth.camera.elevation, 0.02)],
        "walls": [walls(truth)],
        "a label": [im.Presence(seats[0].label, region=about(seats[0]))],
        "a place": [im.ObjectAt(ours[-1].label, place=tuple(ours[-1].centre[:2]), place_std=0.05)],
        "boxes": [boxes(clip, found)],
        "boxes as seen": [boxes(clip, seen)],
        "depths": [measured_depths],
    }


def walls(truth: Truth) -> im.Room:
    """A rectangle around all furniture and the person's path."""
    points = [o.footprint for o in truth.objects]
    pelvis = truth.joints[:, PELV, :2]
    inside = np.concatenate([*points, pelvis[np.isfinite(pelvis).all(1)]])
    (x0, y0), (x1, y1) = inside.min(0) - _WALL, inside.max(0) + _WALL
    return im.Room(((x0, y0), (x1, y0), (x1, y1), (x0, y1)))


def about(o: SceneObject, radius: float = 0.8) -> tuple[tuple[float, float], ...]:
    """A circle about an object, as a polygon."""
    angles = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    circle = o.centre[:2] + radius * np.stack([np.cos(angles), np.sin(angles)], -1)
    return tuple((float(x), float(y)) for x, y in circle)


def detected(
    clip: Clip, truth: Truth, objects: Sequence[SceneObject], rng: np.random.Generator
) -> list[tuple[SceneObject, tuple[float, ...]]]:
    """Objects and noisy projected bounding boxes of them in the image, with some missed."""
    found = []
    size = np.array([clip.camera.width, clip.camera.height])
    for o in objects:
        pixels = truth.camera.project(o.placement.apply(_corners(*o.bounds)))
        if not np.isfinite(pixels).all() or rng.uniform() < _MISSED:
            continue
        near, far = np.clip(pixels.min(0), 0, size), np.clip(pixels.max(0), 0, size)
        if (far - near > 4 * _PIXELS).all():
            edges = np.concatenate([near, far]) + _PIXELS * rng.standard_normal(4)
            found.append((o, tuple(edges.tolist())))
    return found


def boxes(clip: Clip, found: Sequence[tuple[SceneObject, tuple[float, ...]]]) -> im.Seen:
    """The statement of a detector that found these objects in the middle frame."""
    named = tuple({o.label: 1.0} for o, _ in found)
    return im.Seen(_middle(clip), tuple(edges for _, edges in found), named, std=_PIXELS)


def share_hidden(clip: Clip, truth: Truth, own: SceneObject) -> float:
    """Share of an object's outline that the person and other true furniture hide.

    An outline is that of the boxes of all parts, or of the person's joints; what has the nearer
    middle hides.
    """
    frame = int(np.flatnonzero(clip.frame_ids == _middle(clip))[0])
    picture = box(0, 0, clip.camera.width, clip.camera.height)
    joints = truth.joints[frame]
    known = joints[np.isfinite(joints).all(1)]
    outlines, depths = [_outline(truth, known)], [truth.camera.to_camera(joints[PELV])[1]]
    for o in truth.objects:
        parts = [
            _outline(truth, o.placement.apply(_corners(c.centre - half, c.centre + half)))
            for c, half in ((c, c.size / 2) for c in o.cuboids)
        ]
        outlines.append(unary_union(parts))
        depths.append(truth.camera.to_camera(o.centre)[1])
    k = 1 + truth.objects.index(own)
    outline = outlines[k].intersection(picture)
    before = unary_union([a for a, d in zip(outlines, depths, strict=True) if d < depths[k]])
    return float(outline.intersection(before).area / outline.area) if outline.area else 1.0


def _outline(truth: Truth, points: Array) -> Polygon:
    """Convex outline of points in the image."""
    pixels = truth.camera.project(points)
    seen = pixels[np.isfinite(pixels).all(1)]
    return MultiPoint(seen).convex_hull if len(seen) else Polygon()


def _corners(low: Array, high: Array) -> Array:
    """(8, 3) corners of a box."""
    return np.array(list(product(*np.stack([low, high], -1))))


def _middle(clip: Clip) -> int:
    """Number of the middle frame."""
    return int(clip.frame_ids[clip.n_frames // 2])


def depths(clip: Clip, truth: Truth, rng: np.random.Generator) -> im.DepthOf:
    """Pelvis depths in ten frames, evenly spaced over those that are annotated."""
    known = np.flatnonzero(np.isfinite(truth.joints).all((1, 2)))
    frames = known[np.linspace(0, len(known) - 1, _FRAMES).round().astype(int)]
    depth = truth.camera.to_camera(truth.joints[frames, PELV])[:, 1]
    said = depth * np.exp(_DEPTH_ERROR * rng.standard_normal(_FRAMES))
    return im.DepthOf(clip.frame_ids[frames].tolist(), said.tolist(), error=_DEPTH_ERROR)


def sampled(
    folder: Path, steps: int, workers: int
) -> tuple[im.Posterior, TruthInView, Truth, dict[str, list[Statement]]]:
    """The posterior of a scene, its truth in camera axes and in the world, and true statements."""
    known, library = known_scene(folder), im.load_library()
    truth = read_i3db_truth(folder, known.clip)
    used = [o.label for o in known.truth.used_objects]
    config = replace(with_steps(steps), seed=0).without(folder.name)
    posterior = im.sample(known.clip, library, config=config, workers=workers)
    rng = np.random.default_rng(0)
    told = statements_of(known.clip, truth, used, labels_of(library), rng)
    return posterior, known.truth, truth, told


def measured(folder: Path, steps: int, workers: int) -> dict[str, Any]:
    """All rows of one scene."""
    before, seen, _, told = sampled(folder, steps, workers)
    rows: dict[str, Any] = {"nothing": row(before, seen, 0.0)}
    rows["nothing"]["with true depth"] = with_true_depth(before, seen)
    for name, statements in told.items():
        begun = time.perf_counter()
        after = before.given(statements, steps=steps, workers=workers)
        rows[name] = row(after, seen, time.perf_counter() - begun)
        if name == "boxes":
            begun = time.perf_counter()
            both = after.given(told["camera height"], steps=steps, workers=workers)
            rows["boxes, then height"] = row(both, seen, time.perf_counter() - begun)
        sys.stderr.write(f"{folder.name} {name}: {rows[name]['evidence']}\n")
    return rows


def with_true_depth(posterior: im.Posterior, truth: TruthInView) -> dict[str, float]:
    """Error of joints in cm if the pelvis had its true depth in some frames, by :data:`_DEPTHS`.

    The body is moved along the ray through its pelvis. Between the frames, evenly spaced over those
    that are annotated, the log of the true over the estimated depth is interpolated.
    """
    joints = prediction_of_scene(posterior.estimate, name="estimate").joints
    known = np.flatnonzero(truth.known)
    pelvis = joints[known, PELV]
    missing = np.log(truth.joints[known, PELV, 1] / pelvis[:, 1])
    rng = np.random.default_rng(0)
    found = {}
    for name, (count, error) in _DEPTHS.items():
        frames = np.linspace(0, len(known) - 1, count or len(known)).round().astype(int)
        squares = []
        for _ in range(_REPEATS if error else 1):
            said = missing[frames] + error * rng.standard_normal(len(frames))
            factor = np.exp(np.interp(np.arange(len(known)), frames, said))
            moved = joints[known] + ((factor[:, None] - 1) * pelvis)[:, None]
            off = (moved - truth.joints[known])[:, list(SCORED)]
            squares.append(np.square(off).sum(-1).mean())
        found[name] = float(100 * np.sqrt(np.mean(squares)))
    return found


def row(posterior: im.Posterior, truth: TruthInView, seconds: float) -> dict[str, Any]:
    """Scores of the estimate, and what was said of the evidence."""
    people = len(posterior.clip.tracks)
    answer = prediction_of_scene(posterior.estimate, name="estimate", people=people)
    found = score(answer, truth)
    evidence = None if posterior.told is None else posterior.told.evidence
    summary = summarise([found])
    return {
        "found": summary.found,
        "true": summary.true,
        "spurious": summary.spurious,
        "error": summary.error,
        "loss": summary.loss,
        "shared": found.objects.shared,
        "covered": found.objects.covered,
        "joints": next(iter(summary.pose.values()))[0],
        "evidence": "" if evidence is None else evidence.text,
        "method": "" if evidence is None else evidence.method,
        "log_ratio": None if evidence is None else evidence.log_ratio,
        "seconds": seconds,
    }


def table(scenes: dict[str, dict[str, Any]]) -> str:
    """Markdown table over all scenes, one row for each statement."""
    lines = [
        "| statement | found | spurious | loss, cm | IoU | joints, cm | reweighted / resampled "
        "| seconds |",
        "|---|---:|---:|---:|---:|---:|---:|---:|",
    ]
    for name in _NAMES:
        rows = [rows[name] for rows in scenes.values()]
        true = sum(r["true"] for r in rows)
        loss = sum(r["true"] * r["loss"] for r in rows) / true
        overlap = sum(r["shared"] for r in rows) / sum(r["covered"] for r in rows)
        weighed = sum(r["method"] == "reweighted" for r in rows)
        led = sum(r["method"] == "resampled" for r in rows)
        lines.append(
            f"| {name} | {sum(r['found'] for r in rows)} of {true} | "
            f"{sum(r['spurious'] for r in rows)} | {loss:.0f} | {overlap:.2f} | "
            f"{np.mean([r['joints'] for r in rows]):.1f} | {weighed} / {led} | "
            f"{np.mean([r['seconds'] for r in rows]):.0f} |"
        )
    return "\n".join(lines) + "\n"


def by_scene(scenes: dict[str, dict[str, Any]]) -> str:
    """Markdown table with one row for each scene and statement."""
    lines = [
        "| scene | statement | found | loss, cm | joints, cm | log evidence ratio, nats | method |",
        "|---|---|---:|---:|---:|---:|---|",
    ]
    lines += [
        f"| {scene} | {name} | {row['found']} of {row['true']} | {row['loss']:.0f} "
        f"| {row['joints']:.1f} | {_ratio(row['evidence'])} | {row['method']} |"
        for scene, rows in scenes.items()
        for name, row in rows.items()
    ]
    return "\n".join(lines) + "\n"


def depth_table(scenes: dict[str, dict[str, Any]]) -> str:
    """Markdown table of the error of joints whose pelvis has its true depth."""
    lines = ["| true depth in | joints, cm | by scene |", "|---|---:|---|"]
    for name in _DEPTHS:
        each = [rows["nothing"]["with true depth"][name] for rows in scenes.values()]
        by_scene = ", ".join(f"{error:.1f}" for error in each)
        lines.append(f"| {name} | {np.mean(each):.1f} | {by_scene} |")
    return "\n".join(lines) + "\n"


def overlap_table(scenes: Sequence[Path], library: Library) -> str:
    """Markdown table of IoU if furniture differs from the true one in place and size alone.

    Places have normal errors along each axis. Sizes are those of random pieces of the library with
    the same label. Each number is a mean over random draws.
    """
    sizes: dict[str, list[Array]] = {}
    for o in (o for scenelet in library for o in scenelet.objects):
        sizes.setdefault(o.label, []).append(_size(o))
    used = []
    for folder in scenes:
        known = known_scene(folder)
        objects = read_i3db_truth(folder, known.clip).objects
        used.append([objects[k] for k in known.truth.used])
    rng = np.random.default_rng(0)
    lines = ["| error of place, cm | true sizes | sizes of the library |", "|---:|---:|---:|"]
    for error in (0.0, 0.1, 0.2, 0.3):
        right = [_overlap(used, {}, error, rng) for _ in range(_REPEATS)]
        other = [_overlap(used, sizes, error, rng) for _ in range(_REPEATS)]
        lines.append(f"| {100 * error:.0f} | {np.mean(right):.2f} | {np.mean(other):.2f} |")
    return "\n".join(lines) + "\n"


def _overlap(
    used: Sequence[Sequence[SceneObject]],
    sizes: dict[str, list[Array]],
    error: float,
    rng: np.random.Generator,
) -> float:
    """IoU over all scenes of true furniture and furniture of other sizes beside it."""
    shared, covered = 0.0, 0.0
    for objects in used:
        true, other = [], []
        for o in objects:
            label = sizes.get(o.label, [_size(o)])
            true.append(_footprint(o, _size(o), np.zeros(2)))
            size = label[rng.integers(len(label))]
            other.append(_footprint(o, size, error * rng.standard_normal(2)))
        one, two = unary_union(true), unary_union(other)
        shared, covered = shared + one.intersection(two).area, covered + one.union(two).area
    return shared / covered


def _size(o: SceneObject) -> Array:
    """Width and depth, metres."""
    sides: Array = np.diff(o.bounds, axis=0)[0, :2]
    return sides


def _footprint(o: SceneObject, size: Array, off: Array) -> Polygon:
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * size / 2
    return Polygon(corners @ o.placement.rotation.T + o.centre[:2] + off)


def _ratio(text: str) -> str:
    """The number in the text on an evidence ratio."""
    return text.removeprefix("Log evidence ratio ").partition(" nats")[0]


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, store, print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("scenes", type=Path, help="folder of i3DB scenes with their truth")
    parser.add_argument("folder", type=Path, help="what is done is kept here")
    parser.add_argument("--steps", type=int, default=SHORT_STEPS, help="of chains")
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args(arguments)
    options.folder.mkdir(parents=True, exist_ok=True)
    found = {}
    for scene in scenes_with_truth(options.scenes):
        path = options.folder / f"{scene.name}-{options.steps}-{digest(Path(__file__))}.json"
        if not path.is_file():
            rows = measured(scene, options.steps, options.workers)
            path.write_text(json.dumps(rows, indent=1))
        found[scene.name] = json.loads(path.read_text())
    tables = [table(found), by_scene(found), depth_table(found)]
    tables.append(overlap_table(scenes_with_truth(options.scenes), im.load_library()))
    sys.stdout.write("\n".join(tables))
    note(
        {
            f"told_{name}_{scene}_{what}": float(rows[name][what])
            for scene, rows in found.items()
            for name in _NAMES
            for what in ("found", "loss", "joints", "seconds")
        }
    )


if __name__ == "__main__":
    main()
