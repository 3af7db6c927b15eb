"""Would the truth win? Log-posterior of true, moved and mistaken layouts on the i3DB scenes.

    python -m lab.preference I3DB_FOLDER

prints a table for each scene, one row a wish, with reasons.

A *wish* is a seat or shelf that somebody uses for a while, from the annotated actions: the seat
nearest to the true pelvis in each sitting interval, the nearest shelf in each reaching interval. A
wish is granted by scenelets of its category whose own object is placed exactly at the wished centre
and orientation, with the middle frame inside the interval. For every third start and every choice
of objects the best single scenelet is searched in the frames around the interval. Of these the best
for the whole clip is taken, even at a loss, and further ones as long as the log-posterior
increases. All layouts are granted in the same way and differ only in their wishes, and each is
evaluated at its optimal camera and body. The published energy (preset ``paper``) is evaluated for
the same states.
"""

from __future__ import annotations

import argparse
import json
import re
from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from scipy.optimize import minimize

from imapper_prob.clips.i3db import read_i3db, read_i3db_truth
from imapper_prob.evaluate.score import scenes_with_truth
from imapper_prob.models.camera import Camera
from imapper_prob.models.log_posterior import State, empty_state, log_posterior, terms
from imapper_prob.models.problem import TERMS, Problem
from imapper_prob.models.scene import Cuboid, Placement, SceneObject, Truth
from imapper_prob.models.scenelet import Library
from imapper_prob.models.settings import ModelSettings, PaperWeights
from imapper_prob.models.skeleton import PELV
from imapper_prob.scenelets.library import load_library
from imapper_prob.solver.candidates import refine
from imapper_prob.solver.solver import Solution, solve

__all__ = []


Array = NDArray[np.float64]

SEATS = frozenset({"chair", "couch", "stool", "bench", "armchair"})
USED = {"sitting": SEATS, "reaching": frozenset({"shelf"})}
"""Labels of the objects that each action uses."""
SHIFT = 0.5
"""Displacement in metres of wrong places; the truth is accurate to about half of that."""
MARGIN = 15
"""Frames around an interval in which scenelets are tried: the correlation time of the path."""
STEP = 3
"""Frames between the starts that are tried."""
PAPER_NATS = ModelSettings().paper_nats * np.array(astuple(PaperWeights()))
"""Nats for each unit of the terms of the published energy."""
REACH = 1.5
"""Greatest distance in metres of an object of the authors from the wish it corresponds to."""


@dataclass(frozen=True)
class Wish:
    """An object that should exist because somebody uses it in frames first to last."""

    label: str
    place: Placement
    """Placement of its centre on the floor."""
    first: int
    last: int


@dataclass(frozen=True)
class Fit:
    """A single scenelet placed so that its object grants a wish."""

    value: float
    scenelet: int
    start: int
    placement: Array


@dataclass(frozen=True)
class Layout:
    """A named state and its terms in nats, for the default posterior and the preset ``paper``."""

    name: str
    state: State
    terms: dict[str, float]
    paper: dict[str, float]

    @property
    def total(self) -> float:
        return sum(self.terms.values())


def centre_of(o: SceneObject) -> Placement:
    """Placement of an object's centre on the floor, with its orientation."""
    return Placement(float(o.centre[0]), float(o.centre[1]), o.placement.yaw)


def wishes_of(truth: Truth) -> list[Wish]:
    """Seats that are sat on and shelves that are reached into, by interval."""
    wishes = []
    first = 0
    for t in range(1, len(truth.actions) + 1):
        if t < len(truth.actions) and truth.actions[t] == truth.actions[first]:
            continue
        found = [o for o in truth.objects if o.label in USED.get(truth.actions[first], ())]
        pelvis = truth.joints[first:t, PELV, :2]
        pelvis = pelvis[np.isfinite(pelvis).all(1)]
        if found and len(pelvis):
            gap = [np.linalg.norm(o.centre[:2] - np.median(pelvis, axis=0)) for o in found]
            nearest = found[int(np.argmin(gap))]
            wishes.append(Wish(nearest.label, centre_of(nearest), first, t - 1))
        first = t
    return wishes


def around(problem: Problem, first: int, last: int) -> tuple[Problem, int]:
    """The problem restricted to some frames, and the number of its first frame."""
    begin, end = max(0, first - MARGIN), min(problem.n_frames, last + MARGIN + 1)
    by_frame = (
        "keypoints", "used", "confidences", "confidence_density", "error_scale", "error_dof",
        "path_centre", "path_scale", "path_stay", "lift", "poses", "path_facing", "free_cost",
    )  # fmt: skip
    cut = {name: getattr(problem, name)[begin:end] for name in by_frame}
    rows = end - begin + 1
    return problem._replace(
        **cut,
        stays=np.zeros((0, 3)),
        static_density=np.ascontiguousarray(problem.static_density[:, begin:end]),
        path_starts=np.arange(end - begin) == 0,
        path_mean=np.ascontiguousarray(problem.path_mean[:, :rows]),
        path_draw=np.ascontiguousarray(problem.path_draw[:, :rows]),
    ), begin


def fits_of(
    problem: Problem, library: Library, wish: Wish, allowed: Callable[[str], bool]
) -> list[Fit]:
    """The best scenelet for each start and choice of objects, with one object as wished.

    An object of another category than the wished one may also be reversed, because fronts of
    different categories are not comparable.
    """
    cut, begin = around(problem, wish.first, wish.last)
    empty = empty_state(cut)
    best: dict[tuple[int, tuple[str, ...]], Fit] = {}
    for index, scenelet in enumerate(library):
        length = int(problem.lengths[index])
        for o in scenelet.objects:
            if not allowed(o.label):
                continue
            for turn in (0.0,) if o.label == wish.label else (0.0, np.pi):
                own = centre_of(o)
                yaw = wish.place.yaw + turn - own.yaw
                offset = Placement(0, 0, yaw).rotation @ (own.x, own.y)
                placement = np.array([wish.place.x - offset[0], wish.place.y - offset[1], yaw])
                for middle in range(wish.first, wish.last + 1, STEP):
                    start = middle - length // 2 - begin
                    if start < 0 or start + length > cut.n_frames:
                        continue
                    value = log_posterior(cut, empty.with_item(index, start, placement))
                    key = (start, scenelet.labels)
                    if key not in best or value > best[key].value:
                        best[key] = Fit(value, index, start + begin, placement)
    return list(best.values())


def granted(
    problem: Problem,
    library: Library,
    wishes: Sequence[Wish],
    allowed: Callable[[Wish, str], bool],
) -> State:
    """The state that grants all wishes in turn: each at least once, then while it increases."""
    state = empty_state(problem)
    for wish in wishes:
        found = fits_of(problem, library, wish, partial(allowed, wish))
        value = -np.inf
        while found:
            grown = [state.with_item(f.scenelet, f.start, f.placement) for f in found]
            gained = [log_posterior(problem, more) for more in grown]
            best = int(np.argmax(gained))
            if gained[best] <= value:
                break
            state, value = grown[best], gained[best]
    return state


def suited(problem: Problem, name: str, state: State) -> Layout:
    """The state at its optimal camera and body, by the Nelder-Mead method."""
    spread = 1 / np.sqrt(np.diag(problem.camera_precision))

    def cost(theta: Array) -> float:
        return -log_posterior(problem, replace(state, camera=state.camera + spread * theta))

    simplex = np.vstack([np.zeros(5), 0.5 * np.eye(5)])
    options = {"maxfev": 150, "initial_simplex": simplex}
    found = minimize(cost, np.zeros(5), method="Nelder-Mead", options=options)
    state = replace(state, camera=state.camera + spread * found.x)
    paper = problem._replace(paper_nats=PAPER_NATS)
    return Layout(name, state, terms(problem, state), terms(paper, state))


def moved(wish: Wish, along: float, across: float) -> Wish:
    """The wish moved along the viewing ray (away) and across it (to the right), in metres."""
    ray = np.array([wish.place.x, wish.place.y])
    ray /= np.linalg.norm(ray)
    x, y = (wish.place.x, wish.place.y) + along * ray + across * np.array([ray[1], -ray[0]])
    return replace(wish, place=Placement(float(x), float(y), wish.place.yaw))


def authors_wishes(wishes: Sequence[Wish], objects: Sequence[SceneObject]) -> list[Wish]:
    """Wishes moved to the nearest object of the same group in the authors' result, if any."""
    result = []
    for wish in wishes:
        group = SEATS if wish.label in SEATS else {wish.label}
        near = [centre_of(o) for o in objects if o.label in group]
        labels = [o.label for o in objects if o.label in group]
        gap = [np.hypot(p.x - wish.place.x, p.y - wish.place.y) for p in near]
        if gap and min(gap) < REACH:
            k = int(np.argmin(gap))
            result.append(replace(wish, label=labels[k], place=near[k]))
    return result


def same(wish: Wish, label: str) -> bool:
    return label == wish.label


def another_seat(wish: Wish, label: str) -> bool:
    return label != wish.label and label in SEATS if wish.label in SEATS else label == wish.label


def another_group(wish: Wish, label: str) -> bool:
    return label not in SEATS if wish.label in SEATS else label in SEATS


def layouts(solution: Solution, wishes: Sequence[Wish], authors: Sequence[Wish]) -> list[Layout]:
    """The true layout, and those it is compared with."""
    problem, library = solution.problem, solution.library
    truth = granted(problem, library, wishes, same)
    result = [
        suited(problem, "truth", truth),
        suited(problem, "truth, placements refined", refine(problem, refine(problem, truth))),
        suited(problem, "no objects", empty_state(problem)),
    ]
    for name, along, across in (
        ("0.5 m nearer", -SHIFT, 0.0),
        ("0.5 m farther", SHIFT, 0.0),
        ("0.5 m to the left", 0.0, -SHIFT),
        ("0.5 m to the right", 0.0, SHIFT),
    ):
        elsewhere = [moved(wish, along, across) for wish in wishes]
        result.append(suited(problem, name, granted(problem, library, elsewhere, same)))
    for name, allowed in (("another seat", another_seat), ("another group", another_group)):
        result.append(suited(problem, name, granted(problem, library, wishes, allowed)))
    result.append(suited(problem, "the authors' places", granted(problem, library, authors, same)))
    result.append(suited(problem, "staged solver's best", solution.states[0]))
    return result


def deciding(gap: dict[str, float], sign: float) -> str:
    """The term that contributes most to the difference.

    Detections and free pose count as one term, since covering a frame exchanges one for the other.
    """
    joint = {name: value for name, value in gap.items() if name not in ("detections", "free_pose")}
    if "detections" in gap:
        joint["fit"] = gap["detections"] + gap["free_pose"]
    return max(joint, key=lambda name: sign * joint[name])


def comparison(scene: str, found: Sequence[Layout]) -> Table:
    """Table of each layout against the truth: the difference in nats, and what decides it."""
    table = Table(
        title=f"{scene}: truth minus other, nats", title_justify="left", box=SIMPLE_HEAD,
        padding=0, pad_edge=False,
    )  # fmt: skip
    table.add_column("layout", no_wrap=True)
    table.add_column("scenelets", justify="right")
    for name in TERMS:
        table.add_column(name.replace("_", " "), justify="right")
    table.add_column("all", justify="right")
    table.add_column("decided by")
    table.add_column("paper", justify="right")
    table.add_column("decided by")
    truth = found[0]
    for layout in found:
        gap = {name: truth.terms[name] - layout.terms[name] for name in TERMS}
        total = sum(gap.values())
        decisive = deciding(gap, np.sign(total)) if total else ""
        cells = [f"{gap[name]:+.1f}" for name in TERMS]
        count = str(layout.state.n_scenelets)
        other = {name: truth.paper[name] - layout.paper[name] for name in truth.paper}
        published = sum(other.values())
        why = deciding(other, np.sign(published)) if published else ""
        table.add_row(
            layout.name, count, *cells, f"{total:+.1f}", decisive, f"{published:+.0f}", why
        )
    return table


def rival(solution: Solution, wish: Wish) -> tuple[str, float, float]:
    """The best candidate of the interval with furniture of the wished group: name, gain, distance.

    The gain in nats is relative to no scenelet; the distance from the wished place is in metres.
    """
    group = SEATS if wish.label in SEATS else {wish.label}
    lengths = solution.problem.lengths
    best = ("none", -np.inf, np.nan)
    for c in solution.candidates:
        middle = c.start + lengths[c.scenelet] // 2
        if not wish.first <= middle <= wish.last or c.gain <= best[1]:
            continue
        for o in solution.library[c.scenelet].objects:
            if o.label in group:
                at = o.moved(Placement(*c.placement)).centre[:2]
                off = float(np.hypot(at[0] - wish.place.x, at[1] - wish.place.y))
                best = (o.label, c.gain, off)
    return best


def reasons(solution: Solution, wishes: Sequence[Wish], truth: Truth, found: Layout) -> Table:
    """Table for each wish: the gain of granting it, the error of the static path, and the rival.

    The path's error is that of the pelvis, away from the camera and to the right, median over the
    interval; a true seat is evaluated at the wrong distance where the path is wrong.
    """
    table = Table(
        title="wish by wish: gained by granting it, nats", title_justify="left",
        box=SIMPLE_HEAD, padding=0, pad_edge=False,
    )  # fmt: skip
    for name in ("wish", "frames", "seen"):
        table.add_column(name)
    for name in (*TERMS[1:], "all", "path off along, across, cm", "rival", "gains", "off, cm"):
        table.add_column(name.replace("_", " "), justify="right")
    camera = solution.clip.camera.posed(
        pitch=float(found.state.camera[0]),
        roll=float(found.state.camera[4]),
        elevation=float(found.state.camera[1]),
    )
    static = camera.to_world(solution.path.joints)[:, PELV, :2]
    for wish in wishes:
        frames = slice(wish.first, wish.last + 1)
        lengths = solution.problem.lengths[found.state.items[:, 0]]
        middles = found.state.items[:, 1] + lengths // 2
        own = (middles >= wish.first) & (middles <= wish.last)
        rest = replace(
            found.state,
            items=found.state.items[~own],
            placements=found.state.placements[~own],
            sizes=found.state.sizes[~own],
        )
        less = terms(solution.problem, rest)
        gained = [found.terms[name] - less[name] for name in TERMS[1:]]
        pelvis = truth.joints[frames, PELV, :2]
        gap = np.nanmedian(static[frames] - pelvis, axis=0)
        ray = np.nanmedian(pelvis, axis=0)
        ray = ray / np.linalg.norm(ray)
        off = 100 * np.array([gap @ ray, gap @ (ray[1], -ray[0])])
        label, gain, distance = rival(solution, wish)
        seen = solution.problem.used[frames].any(1).mean()
        ids = solution.clip.frame_ids
        table.add_row(
            wish.label, f"{ids[wish.first]}-{ids[wish.last]}", f"{seen:.0%}",
            *(f"{g:+.1f}" for g in gained), f"{sum(gained):+.1f}", f"{off[0]:+.0f}, {off[1]:+.0f}",
            label, f"{gain:+.1f}", f"{100 * distance:.0f}",
        )  # fmt: skip
    return table


def main(arguments: Sequence[str] | None = None) -> None:
    """Compare the truth of each scene with its rivals."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("scenes", type=Path, help="folder of i3DB scenes with their truth")
    options = parser.parse_args(arguments)
    console = Console(width=170)
    library = load_library()
    for scene in scenes_with_truth(options.scenes):
        clip = read_i3db(scene)
        truth = read_i3db_truth(scene, clip)
        solution = solve(clip, library)
        wishes = wishes_of(truth)
        authors = authors_wishes(wishes, _authors_objects(scene, truth.camera))
        found = layouts(solution, wishes, authors)
        console.print(comparison(scene.name, found))
        console.print(reasons(solution, wishes, truth, found[0]))
        shift = found[1].state.placements[:, :2] - found[0].state.placements[:, :2]
        console.print(
            f"{len(wishes)} wishes, {len(authors)} of them granted by the authors; refining moved "
            f"the true placements by {100 * np.linalg.norm(shift, axis=1).mean():.0f} cm (mean)\n"
        )


# Objects of the authors' own result on i3DB, regrouped, since their files spread the parts of an
# object over many numbers and repeat some. Seats, table tops and shelves represent their objects.

MAIN_PARTS = frozenset({"seat", "stool", "top", "shelf"})
REPEATED = 0.3
"""Greatest distance in metres between centres of one part written twice."""
BACK_REACH = 0.6
"""Greatest distance in metres of a back from the seat it belongs to."""


def _authors_objects(scene: Path, camera: Camera) -> list[SceneObject]:
    """One object for each main part, in the world of ``camera``, with the main part's box only.

    A seat's front is opposite to its back. Without a back, and for shelves and tables, the thinner
    side faces the camera.
    """
    folder = scene / "iMapper"
    listed = json.loads((folder / "skel_output.json").read_text())["scenelets"]["obbs"]
    parts = [_part(folder / str(name), camera) for name in listed]
    objects: list[SceneObject] = []
    for part in parts:
        if part["part"] not in MAIN_PARTS:
            continue
        x, y, z = part["centre"]
        known = [o for o in objects if o.label == part["label"]]
        if any(np.hypot(*(o.centre[:2] - (x, y))) < REPEATED for o in known):
            continue
        forward, size = _front(part, parts)
        yaw = float(np.arctan2(-forward[0], forward[1]))
        box = Cuboid(part["part"], np.array([0, 0, max(z, size[2] / 2)]), size)
        objects.append(SceneObject(part["label"], Placement(x, y, yaw), (box,)))
    return objects


def _part(path: Path, camera: Camera) -> dict[str, Any]:
    """A box: label, part, centre (3,), horizontal axes (2, 2) in rows, size (3,), world frame."""
    document = json.loads(path.with_suffix(".json").read_text())
    matched = re.fullmatch(r"\d+_([a-z]+)_([a-z]+)(-\d+)?", path.stem)
    assert matched is not None, path
    axes = _camera_axes(np.array(document["axes"]).T) @ camera.rotation.T
    return {
        "label": matched[1],
        "part": matched[2],
        "centre": camera.to_world(_camera_axes(np.array(document["centroid"])[:, 0])),
        "axes": axes[:2, :2] / np.linalg.norm(axes[:2, :2], axis=1, keepdims=True),
        "size": np.array(document["scales"])[:, 0],
    }


def _camera_axes(points: Array) -> Array:
    """(..., 3) points with the files' x right, y down, z forward to x right, y forward, z up."""
    return np.stack([points[..., 0], points[..., 2], -points[..., 1]], -1)


def _front(part: dict[str, Any], parts: list[dict[str, Any]]) -> tuple[Array, Array]:
    """Direction of the front on the floor, and sizes across it, along it and upwards."""
    backs = [p["centre"] for p in parts if p["part"] == "back" and p["label"] == part["label"]]
    away = [part["centre"][:2] - b[:2] for b in backs]
    near = [a for a in away if np.linalg.norm(a) < BACK_REACH]
    if near:
        guess = min(near, key=lambda a: float(np.linalg.norm(a)))
        axis = int(np.argmax(np.abs(part["axes"] @ guess)))
    else:
        guess = -part["centre"][:2]
        axis = int(np.argmin(part["size"][:2]))
    forward = part["axes"][axis] * np.sign(part["axes"][axis] @ guess)
    return forward, part["size"][[1 - axis, axis, 2]]


if __name__ == "__main__":
    main()
