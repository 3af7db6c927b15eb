"""Statements: each term against plain numpy, and normalised over answers."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import permutations, product

import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm
from shapely import Point, Polygon

import imapper_prob as im
from imapper_prob.layouts import placed_objects
from imapper_prob.models.kernels.measured import ERRORS, measure_box
from imapper_prob.models.log_posterior import (
    Incremental,
    State,
    camera_at,
    empty_state,
    label_probabilities,
    log_posterior,
    motion,
    terms,
)
from imapper_prob.models.problem import Problem, label_kinds, labels_of, seat_chances
from imapper_prob.models.scene import Cuboid, SceneObject
from imapper_prob.models.scenelet import Library
from imapper_prob.models.settings import SIDE_SPREAD, ModelSettings
from imapper_prob.models.skeleton import LKNE, LWRI, NECK, PELV, RKNE, RWRI
from imapper_prob.models.statement_rows import tell
from imapper_prob.models.statements import Statement
from imapper_prob.models.valid import check_problem
from tests.models import worlds
from tests.models.said import ALL, BOX, LIBRARY, REGION, clip, problem

AHEAD, ASIDE = ModelSettings().furniture_ahead, ModelSettings().furniture_aside
YAW = ModelSettings().furniture_yaw
CONFUSION = ModelSettings().seat_confusion


def state() -> State:
    """A couch twice, which is one, and a chair; the camera is not the mean one."""
    nothing = empty_state(problem())
    camera = nothing.camera + np.array([0.02, 0.05, 0.03, -0.04, 0.01])
    nothing = State(camera, nothing.items, nothing.placements, nothing.sizes, nothing.latent)
    return (
        nothing.with_item(0, 0, np.array([-0.4, 3.6, 0.1]), 0.02)
        .with_item(1, 6, np.array([-0.35, 3.7, 0.15]), -0.03)
        .with_item(2, 13, np.array([0.7, 5.6, -0.5]), 0.01)
    )


def given(statement: Statement, at: State | None = None, of: Problem | None = None) -> float:
    told = tell(problem(0.0) if of is None else of, [statement], clip(), labels_of(LIBRARY))
    check_problem(told)
    return terms(told, state() if at is None else at)["given"]


def pieces(at: State) -> list[SceneObject]:
    """The couch of the first scenelet, and the chair: the second couch is the first again."""
    placed = [o for _, o in placed_objects(at, LIBRARY)]
    assert [o.label for o in placed] == ["couch", "couch", "chair"]
    return [placed[0], placed[2]]


def edges(piece: SceneObject, at: State) -> np.ndarray:
    """Box of a piece in the image and beyond, px."""
    camera = camera_at(clip().camera, at.camera)
    low, high = piece.bounds
    corners = np.array(list(product(*zip(low, high, strict=True))))
    pixels = camera.project(piece.placement.apply(corners))
    return np.concatenate([pixels.min(0), pixels.max(0)])


def measured(piece: SceneObject, at: State, said: im.ObjectAt) -> tuple[np.ndarray, np.ndarray]:
    """What errors of 0 predict of all that was measured, and its covariance."""

    def seen(errors: np.ndarray) -> np.ndarray:
        there = worlds.with_errors(piece, errors)
        size = np.diff(piece.bounds, axis=0)[0] * (1 + errors[2:5])
        parts = [
            (said.place, there.centre[:2]),
            (said.size, size),
            (said.box, edges(there, at)),
        ]
        return np.concatenate([value for value_said, value in parts if value_said is not None])

    step = 1e-5 * np.eye(6)
    slopes = np.array([(seen(e) - seen(-e)) / 2e-5 for e in step]).T
    width = np.diff(piece.bounds, axis=0)[0, 0]
    errors = np.diag(np.square([ASIDE * width, AHEAD, *[SIDE_SPREAD] * 3, YAW]))
    noise = [said.place_std] * 2 * (said.place is not None)
    noise += [said.size_std] * 3 * (said.size is not None)
    noise += [said.box_std] * 4 * (said.box is not None)
    return seen(np.zeros(6)), slopes @ errors @ slopes.T + np.diag(np.square(noise))


def cut_off(values: np.ndarray, mean: np.ndarray, covariance: np.ndarray, std: float) -> float:
    """Density of numbers of which the last is a lower edge that is cut off at 1080 px.

    By quadrature over the true edge. The other edges are measured far from the border, so they are
    not cut off, and normal.
    """
    left, top, right = values[-4:-1]
    assert min(left, top, 1920 - right) > 8 * std
    known = covariance[:-1, :-1]
    gain = np.linalg.solve(known, covariance[:-1, -1])
    middle = mean[-1] + gain @ (values[:-1] - mean[:-1])
    spread = math.sqrt(covariance[-1, -1] - std**2 - gain @ covariance[:-1, -1])
    lower = middle + spread * np.linspace(-9, 9, 40_001)
    seen = norm.pdf(values[-1], np.minimum(lower, 1080), std) * norm.pdf(lower, middle, spread)
    others = multivariate_normal.pdf(values[:-1], mean[:-1], known)
    return float(others * np.trapezoid(seen, lower))


def answered(probability: float, doubt: float) -> float:
    return math.log((1 - doubt) * probability + doubt / 2)


def share(label: str, said: tuple[str, ...]) -> float:
    """Probability that an object whose scenelet has a label is truly of one of those said."""
    of_seats = {"couch": 0.0, "chair": 0.0, "stool": 0.0, "table": 0.0}
    for scenelet in LIBRARY:
        for kind in scenelet.labels:
            of_seats[kind] += scenelet.weight * (kind != "table")
    if not of_seats[label]:
        return float(label in said)
    any_seat = sum(of_seats[kind] for kind in said) / sum(of_seats.values())
    return (1 - CONFUSION) * (label in said) + CONFUSION * any_seat


def cases(piece: SceneObject, said: dict[str, float]) -> list[tuple[float, SceneObject]]:
    """What a seat may be: that of its scenelet, or one of the mean sides of any kind."""
    found = [((1 - CONFUSION) * said.get(piece.label, 0.0), piece)]
    for kind in ("couch", "chair"):
        chance = share(kind, (kind,)) - (1 - CONFUSION)
        logs = [
            np.log(np.diff(o.bounds, axis=0)[0])
            for s in LIBRARY
            for o in s.objects
            if o.label == kind
        ]
        sides, low = np.exp(np.mean(logs, axis=0)), piece.bounds[0, 2]
        middle = np.array([*piece.bounds.mean(0)[:2], low + sides[2] / 2])
        other = SceneObject(kind, piece.placement, (Cuboid("all", middle, sides),))
        found.append((chance * said.get(kind, 0.0), other))
    return [(share, o) for share, o in found if share]


def reference_object(said: im.ObjectAt) -> float:
    density, area = 0.0, 1.0
    values = [v for part in (said.place, said.size, said.box) if part for v in part]
    shares = np.array([share(p.label, said.labels) for p in pieces(state())])
    for piece in pieces(state()):
        for own, o in cases(piece, dict.fromkeys(said.labels, 1.0)):
            density += own * multivariate_normal.pdf(values, *measured(o, state(), said))
    density *= (1 - np.prod(1 - shares)) / shares.sum()
    area *= 100.0 if said.place else 1.0
    area *= 27.0 if said.size else 1.0
    area *= (1920 * 1080 / 2) ** 2 if said.box else 1.0
    return math.log((1 - said.doubt) * density + said.doubt / 2 / area)


def signed(point: np.ndarray) -> float:
    polygon, at = Polygon(REGION), Point(point)
    return polygon.exterior.distance(at) * (1 if polygon.contains(at) else -1)


def softened(piece: SceneObject, std: float) -> float:
    width = np.diff(piece.bounds, axis=0)[0, 0]
    return math.sqrt(std**2 + ((ASIDE * width) ** 2 + AHEAD**2) / 2)


@pytest.mark.parametrize(
    "said",
    [
        im.ObjectAt("couch", place=(-0.2, 3.2), place_std=0.3),
        im.ObjectAt(("couch", "chair"), place=(1.0, 4.0), place_std=0.4, doubt=0.05),
        im.ObjectAt("chair", size=(1.5, 0.9, 0.9)),
        im.ObjectAt("couch", box=BOX, box_std=20.0),
        im.ObjectAt(("chair", "couch"), place=(0, 3), size=(1.6, 0.8, 0.9), box=BOX),
    ],
)
def test_a_measured_object_is_one_of_its_labels(said: im.ObjectAt) -> None:
    assert given(said) == pytest.approx(reference_object(said), rel=1e-7)


def test_an_object_that_is_not_there_was_measured_by_chance() -> None:
    said = im.ObjectAt("chair", place=(0.0, 3.0), doubt=0.01)
    assert given(said, empty_state(problem())) == pytest.approx(math.log(0.01 / 2 / 100))


@pytest.mark.parametrize("labels", ["couch", "chair", ("couch", "chair")])
@pytest.mark.parametrize("there", [True, False])
def test_an_object_is_in_a_region_as_far_as_it_is_inside(labels: str, there: bool) -> None:
    said = im.Presence(labels, there=there, region=REGION, doubt=0.02)
    none = np.prod(
        [
            1 - share(p.label, said.labels) * norm.cdf(signed(p.centre[:2]) / softened(p, said.std))
            for p in pieces(state())
        ]
    )
    assert given(said) == pytest.approx(answered(1 - none if there else none, 0.02), rel=1e-9)


def test_an_object_is_anywhere_or_nowhere() -> None:
    none = (1 - share("couch", ("chair",))) * (1 - share("chair", ("chair",)))
    for there, true in ((True, 1 - none), (False, none)):
        said = im.Presence("chair", there=there, doubt=0.1)
        assert given(said) == pytest.approx(answered(true, 0.1))


def test_furniture_and_person_are_inside_the_walls() -> None:
    said = im.Room(REGION, std=0.5, doubt=0.01)
    path = motion(problem(0.0), state())[:, PELV, :2]
    probability = norm.cdf(min(signed(p) for p in path) / 0.5)
    for piece in pieces(state()):
        deepest = min(signed(corner) for corner in piece.footprint)
        probability *= norm.cdf(deepest / softened(piece, 0.5))
    assert given(said) == pytest.approx(answered(probability, 0.01), rel=1e-6)


@pytest.mark.parametrize(
    ("quantity", "value", "std", "there"),
    [
        ("pitch", -3.0, 0.5, lambda phi: math.degrees(phi[0])),
        ("height", 1.6, 0.1, lambda phi: phi[1]),
        ("focal", 2000.0, 30.0, lambda phi: 1955 * math.exp(phi[2])),
        ("stature", 1.8, 0.04, lambda phi: 1.7 * math.exp(phi[3])),
    ],
)
def test_camera_and_body_are_measured(quantity, value, std, there) -> None:
    expected = norm.logpdf(value, there(state().camera), std)
    assert given(im.Measured(quantity, value, std)) == pytest.approx(expected)


def test_a_joint_is_at_a_point() -> None:
    said = im.JointAt("RKNE", 7, (0.1, 3.5, 0.5), 0.1)
    off = motion(problem(0.0), state())[7, RKNE] - said.point
    spread = math.hypot(0.1, problem().pose_tolerance[RKNE] * math.exp(state().camera[3]))
    assert given(said) == pytest.approx(norm.logpdf(off, 0, spread).sum())


@pytest.mark.parametrize("scale_error", [0.0, 0.2])
def test_depths_share_the_error_of_their_scale(scale_error: float) -> None:
    said = im.DepthOf((2, 9, 15), (3.2, 3.9, 4.4), 0.05, scale_error, "NECK")
    camera = camera_at(clip().camera, state().camera)
    joints = motion(problem(0.0), state())[list(said.frames), NECK]
    depth = camera.to_camera(joints)[:, 1]
    pose = problem().pose_tolerance[NECK] * math.exp(state().camera[3]) / depth
    covariance = np.diag(0.05**2 + pose**2) + scale_error**2
    expected = multivariate_normal.logpdf(np.log(said.depths), np.log(depth), covariance)
    assert given(said) == pytest.approx(expected - np.log(said.depths).sum())


def touched(label: str, t: int, sits: bool) -> float:
    """Probability that an object, by the label of its scenelet, is within reach in a frame."""
    best = -math.inf
    for j in (PELV,) if sits else (PELV, RKNE, LKNE, RWRI, LWRI):
        point = motion(problem(0.0), state())[t, j]
        for piece in (o for _, o in placed_objects(state(), LIBRARY) if o.label == label):
            x, y = piece.placement.rotation.T @ (point[:2] - [piece.placement.x, piece.placement.y])
            for part in piece.cuboids:
                outside = np.abs([x, y, point[2]] - part.centre) - part.size / 2
                aside = np.linalg.norm(np.maximum(outside[:2], 0))
                top = part.centre[2] + part.size[2] / 2
                on = min(0.25 - abs(point[2] - top), 0.125 - aside)
                near = 0.25 - np.linalg.norm(np.maximum(outside, 0))
                best = max(best, on if sits else near)
    return float(norm.cdf(best / 0.05))


@pytest.mark.parametrize("sits", [True, False])
@pytest.mark.parametrize("span", [(1, 4), (14, 17), (5, 14)])
def test_somebody_touches_an_object_all_through(sits: bool, span: tuple[int, int]) -> None:
    said = im.Contact("couch", *span, sits=sits, doubt=0.01)
    probability = min(
        1 - np.prod([1 - share(o, said.labels) * touched(o, t, sits) for o in ("couch", "chair")])
        for t in range(span[0], span[1] + 1)
    )
    assert given(said) == pytest.approx(answered(probability, 0.01), rel=1e-6)


@pytest.mark.parametrize("sits", [True, False])
@pytest.mark.parametrize("labels", ["couch", "chair", ("chair", "couch")])
@pytest.mark.parametrize(
    "spans", [((1, 4), (7, 9)), ((2, 3), (14, 16)), ((1, 1), (8, 8), (15, 17))]
)
def test_one_object_is_touched_in_all_spans(sits, labels, spans) -> None:
    """The couch that stands twice is one; a couch and then a chair are not."""
    said = im.SameObject(labels, spans, sits=sits, doubt=0.01)
    frames = [t for first, last in spans for t in range(first, last + 1)]
    none = np.prod(
        [
            1 - share(o, said.labels) * min(touched(o, t, sits) for t in frames)
            for o in ("couch", "chair")
        ]
    )
    assert given(said) == pytest.approx(answered(1 - none, 0.01), rel=1e-6)


@pytest.mark.parametrize("yaw", [-0.5, 1.2])
@pytest.mark.parametrize("aside", [-1.5, 0.0, 0.7])
@pytest.mark.parametrize("labels", [("chair", "couch"), ("couch", "chair")])
def test_one_object_is_behind_another_as_the_camera_sees_them(labels, aside, yaw) -> None:
    moved = state().with_placement(2, np.array([aside, 5.6, yaw]), 0.01)
    none = 1.0
    for back, front in permutations(pieces(moved)):
        far, near = (np.hypot(*piece.centre[:2]) for piece in (back, front))
        angles = [np.arctan2(*piece.footprint.T) for piece in (back, front)]
        overlap = min(a.max() for a in angles) - max(a.min() for a in angles)
        one, two = softened(back, 0.0), softened(front, 0.0)
        probability = norm.cdf((far - near) / math.hypot(one, two))
        probability *= norm.cdf(overlap / math.hypot(one / far, two / near))
        none *= 1 - share(back.label, labels[:1]) * share(front.label, labels[1:]) * probability
    said = im.Behind(*labels, doubt=0.02)
    assert given(said, moved) == pytest.approx(answered(1 - none, 0.02), rel=1e-9)


def test_nothing_is_behind_what_is_not_there() -> None:
    said = im.Behind("chair", "couch", doubt=0.02)
    assert given(said, empty_state(problem())) == pytest.approx(math.log(0.01))
    same = im.SameObject("couch", [(1, 2), (5, 6)], doubt=0.02)
    assert given(same, empty_state(problem())) == pytest.approx(math.log(0.01))


@pytest.mark.parametrize("named", [None, {"couch": 0.9, "chair": 0.6}, {"chair": 1.0}])
def test_what_is_seen_is_a_poisson_process_of_boxes(named: dict[str, float] | None) -> None:
    near = np.minimum(edges(pieces(state())[0], state()) + 12.0, (1920, 1080, 1920, 1100))
    known = ({"couch": 0.8, "chair": 0.3}, {"chair": 0.5})
    heard = tuple({k: p for k, p in row.items() if named is None or k in named} for row in known)
    said = im.Seen(16, (tuple(near), BOX), heard, std=10.0, named=named)
    camera = camera_at(clip().camera, state().camera)
    joints = motion(problem(0.0), state())[16]
    pixels = camera.project(joints)
    person = (*pixels.min(0), *pixels.max(0), camera.to_camera(joints[PELV])[1])
    size = (1920, 1080) * 2
    outlines = [
        (*np.clip(edges(p, state()), 0, size), camera.to_camera(p.centre)[1])
        for p in pieces(state())
    ]
    rates = []
    for k, (u0, v0, u1, v1, depth) in enumerate(outlines):
        free = 0
        for a, b in product(range(4), range(4)):
            u, v = u0 + (a + 0.5) / 4 * (u1 - u0), v0 + (b + 0.5) / 4 * (v1 - v0)
            before = [person, *(o for j, o in enumerate(outlines) if j != k)]
            free += not any(o[0] < u < o[2] and o[1] < v < o[3] and o[4] < depth for o in before)
        rates.append(-math.log(1 - 0.9 * (free + 0.5) / 17))
    assert min(rates) < max(rates)  # something is in the way
    anywhere = (2 / (1920 * 1080)) ** 2 / 80
    everything = dict.fromkeys(("couch", "chair"), 1.0) if named is None else named
    for k, piece in enumerate(pieces(state())):
        rates[k] = (rates[k], sum(own for own, _ in cases(piece, everything)))
    expected = -0.5 - sum(rate * heeded for rate, heeded in rates)
    rates = [rate for rate, _ in rates]
    # The lower edge of the first box is below the picture, where pieces are cut off.
    assert said.boxes[0][3] > 1080
    for whole, confusion in zip(said.boxes, said.confusion, strict=True):
        box = np.clip(whole, 0, size)
        density = 0.5 * anywhere
        for piece, rate in zip(pieces(state()), rates, strict=True):
            for own, o in cases(piece, confusion):
                near = measured(o, state(), im.ObjectAt(o.label, box=box, box_std=10.0))
                density += rate * own * cut_off(box, *near, 10.0)
        expected += math.log(density)
    assert given(said) == pytest.approx(expected, rel=1e-6)


# ------------------------------------------------------------------------------------------------
# True labels.


def test_a_seat_may_be_another_one_and_a_table_may_not() -> None:
    table = replace(LIBRARY[0], name="table", objects=(worlds.couch(label="table"),))
    mixed = Library("more", (*LIBRARY, table))
    names, chances = labels_of(mixed), seat_chances(mixed, CONFUSION)
    assert names == ["chair", "couch", "table"]
    kinds = label_kinds(problem()._replace(label_chance=chances))
    expected = [[share(label, (kind,)) for kind in names] for label in names]
    np.testing.assert_allclose(kinds, expected)
    assert chances.sum() == pytest.approx(CONFUSION)
    assert not seat_chances(mixed, 0.0).any()
    assert seat_chances(Library("table", (table,)), CONFUSION).tolist() == [0.0]
    bare = Library("bare", tuple(s for s in LIBRARY if not s.objects))
    assert seat_chances(bare, CONFUSION).shape == (0,)


def as_labelled(said: Statement, couch: str, chair: str) -> float:
    """The term of a statement if the two seats certainly have these labels."""
    names, of = labels_of(LIBRARY), problem(0.0)
    numbers = [names.index({"chair": chair, "couch": couch}[names[k]]) for k in of.box_label]
    nothing_by_chance = np.zeros(len(names))
    return given(said, of=of._replace(box_label=np.array(numbers), label_chance=nothing_by_chance))


ON_LABELS = (
    im.Presence("chair", region=REGION, doubt=0.02),
    im.Presence(("couch", "chair"), there=False, doubt=0.02),
    im.Presence("chair", there=False, doubt=0.3),
    im.SameObject("couch", [(1, 4), (7, 9)], sits=False, doubt=0.01),
)


def by_labels(said: Statement) -> dict[tuple[str, str], float]:
    """Probability of a statement and of the labels of couch and chair, which are independent."""
    return {
        (couch, chair): share("couch", (couch,))
        * share("chair", (chair,))
        * math.exp(as_labelled(said, couch, chair))
        for couch, chair in product(labels_of(LIBRARY), repeat=2)
    }


@pytest.mark.parametrize("said", ON_LABELS)
def test_labels_are_summed_out(said: Statement) -> None:
    assert given(said) == pytest.approx(math.log(sum(by_labels(said).values())))


@pytest.mark.parametrize("said", ON_LABELS)
def test_a_statement_says_which_label_an_object_has(said: Statement) -> None:
    names, joint = labels_of(LIBRARY), by_labels(said)
    told = tell(problem(), [im.Measured("height", 1.6, 0.1), said], clip(), names)
    centres, labels, found = label_probabilities(told, state())
    assert [names[k] for k in labels] == ["couch", "chair"]
    np.testing.assert_allclose(centres, [p.centre for p in pieces(state())])
    for k, row in enumerate(found):
        expected = [sum(p for kinds, p in joint.items() if kinds[k] == kind) for kind in names]
        np.testing.assert_allclose(row, np.array(expected) / sum(expected), rtol=1e-7)


def test_without_statements_on_labels_these_are_as_in_a_table() -> None:
    names = labels_of(LIBRARY)
    found = label_probabilities(problem(), state())[2]
    expected = [[share(own, (kind,)) for kind in names] for own in ("couch", "chair")]
    np.testing.assert_allclose(found, expected)


def test_a_measured_size_is_evidence_of_the_kind() -> None:
    """The mean chair of the library has the sides of a couch, so a size of its own is given."""
    names, narrow = labels_of(LIBRARY), np.log([0.5, 0.5, 0.9])
    sides = problem(0.0).label_sides.copy()
    sides[names.index("chair")] = narrow
    place = tuple(pieces(state())[0].centre[:2].tolist())
    for said in (
        im.ObjectAt(("couch", "chair"), place=place, place_std=0.1, size=(0.5, 0.5, 0.9)),
        im.Seen(2, (tuple(edges(pieces(state())[1], state())),), ({"couch": 0.5, "chair": 0.5},)),
    ):
        told = tell(problem(0.0)._replace(label_sides=sides), [said], clip(), names)
        found = label_probabilities(told, state())[2]
        if isinstance(said, im.ObjectAt):
            assert found[0, names.index("chair")] > 0.95
        else:  # an outline as broad as a couch
            assert found[1, names.index("couch")] > share("chair", ("couch",)) + 0.1


def test_an_empty_scene_has_no_labels() -> None:
    told = tell(problem(), [im.Presence("couch")], clip(), labels_of(LIBRARY))
    centres, labels, found = label_probabilities(told, empty_state(problem()))
    assert centres.shape == (0, 3)
    assert labels.shape == (0,)
    assert found.shape == (0, len(labels_of(LIBRARY)))


# ------------------------------------------------------------------------------------------------
# Normalised over all answers that there might have been.


def total(density, *axes: np.ndarray) -> float:
    """The sum of a density over a grid, times its cells."""
    cell = np.prod([axis[1] - axis[0] for axis in axes])
    return float(cell * sum(math.exp(density(*point)) for point in product(*axes)))


def test_places_of_an_object_integrate_to_one() -> None:
    def density(x: float, y: float) -> float:
        said = im.ObjectAt(("couch", "chair"), place=(x, y), place_std=0.3, doubt=0.2)
        return given(said)

    # Ten metres by ten, over which places that are named by chance are; half of those say that
    # there is nothing.
    grid = np.arange(-5, 5, 0.2) + 0.1
    assert total(density, grid, grid + 5.2) == pytest.approx(0.8 + 0.1, abs=2e-3)


def test_answers_to_a_question_add_up_to_one() -> None:
    for labels, region in product(("couch", "chair"), (None, REGION)):
        both = [
            math.exp(given(im.Presence(labels, there=there, region=region, doubt=0.1)))
            for there in (True, False)
        ]
        assert sum(both) == pytest.approx(1.0)


@pytest.mark.slow
def test_depths_and_points_integrate_to_one() -> None:
    near, far = np.linspace(2.0, 7.0, 60), np.linspace(2.0, 8.5, 60)

    def depths(first: float, second: float) -> float:
        return given(im.DepthOf((3, 16), (first, second), 0.08, 0.1))

    assert total(depths, near, far) == pytest.approx(1.0, abs=1e-3)
    middle = motion(problem(0.0), state())[3, PELV]
    grid = [np.arange(-8, 9) * 0.08 + x for x in middle]
    one = total(lambda *p: given(im.JointAt("PELV", 3, p, 0.1)), *grid)
    assert one == pytest.approx(1.0, abs=1e-3)


def test_as_many_boxes_are_seen_as_are_expected() -> None:
    # So far away that no box within three deviations is cut off.
    far = state()
    for k, at in enumerate([(-1.4, 9.6, 0.1), (-1.35, 9.7, 0.15), (2.7, 11.6, -0.5)]):
        far = far.with_placement(k, np.array(at), float(far.sizes[k]))
    nothing, density = given(im.Seen(2, (), (), clutter=0.001), far), 0.0
    for piece in pieces(far):
        own = im.ObjectAt(piece.label, box=BOX, box_std=40.0)
        outline, covariance = measured(piece, far, own)
        root = np.linalg.cholesky(covariance)
        said = im.Seen(2, (BOX,), ({piece.label: 1.0},), std=40.0, clutter=0.001)
        as_in_scenelets = problem(0.0)._replace(label_chance=np.zeros(len(labels_of(LIBRARY))))
        told = tell(as_in_scenelets, [said], clip(), labels_of(LIBRARY))
        # Sums over a grid of a step of one deviation are all but exact; beyond three is .1 %.
        for steps in product(np.arange(-3.0, 4.0), repeat=4):
            box = outline + root @ np.array(steps)
            seen = terms(told._replace(given_rows=box[None]), far)["given"]
            density += np.linalg.det(root) * math.exp(seen - nothing)
    assert density == pytest.approx(0.999 * (-nothing - 0.001), rel=1e-3)


@pytest.mark.parametrize("lower", [500.0, 1000.0, 1070.0, 1080.0, 1150.0, 1400.0])
def test_an_edge_is_measured_inside_the_picture_or_at_its_border(lower: float) -> None:
    """Only the lower edge changes with the errors, so the integral is over it alone."""
    lens = np.array([960.0, 540.0, 1500.0, 1500.0, 1920.0, 1080.0])
    edges, slopes = np.array([600.0, 300.0, 900.0, lower, 5.0]), np.zeros((4, ERRORS))
    slopes[3, 1], covariance = -250.0, np.diag([0.1, 0.2, 0.2, 0.2, 0.2, 0.3]) ** 2
    at = np.arange(lower - 500.0, lower + 500.0)
    density = []
    for said in at:
        box = np.array([600.0, 300.0, 900.0, said])
        mean, after = np.zeros(ERRORS), covariance.copy()
        density.append(math.exp(measure_box(box, 10.0, lens, edges, slopes, mean, after)))
        if said < 1000.0:  # not at the border, wherever the edge was expected
            assert mean[1] == pytest.approx(-(50**2) / 250 * (said - lower) / (50**2 + 10**2))
            assert after[1, 1] < 0.003
        if 1075.0 < said <= 1080.0 and lower > 1100.0:  # anywhere beyond it
            assert mean[1] == 0.0
    others = norm.pdf(0.0, scale=10.0) ** 3
    assert np.sum(density) == pytest.approx(others, rel=1e-6)


# ------------------------------------------------------------------------------------------------
# In every evaluator.


def test_chains_and_whole_states_agree_on_what_is_given(rng: np.random.Generator) -> None:
    told = tell(problem(), ALL, clip(), labels_of(LIBRARY))
    at, bare = state(), problem()
    chain = Incremental(told, at)
    for _ in range(60):
        new = at
        kind = rng.integers(4)
        if kind == 0 and at.n_scenelets:
            k = int(rng.integers(at.n_scenelets))
            moved = at.placements[k] + 0.05 * rng.standard_normal(3)
            new = at.with_placement(k, moved, float(0.02 * rng.standard_normal()))
        elif kind == 1 and at.n_scenelets > 1:
            new = at.without_item(int(rng.integers(at.n_scenelets)))
        elif kind == 2:
            camera = at.camera + 0.01 * rng.standard_normal(5)
            new = State(camera, at.items, at.placements, at.sizes, at.latent)
        else:
            new = replace(at, latent=at.latent + 0.1 * rng.standard_normal(at.latent.shape))
        value = sum(chain.propose(new))
        assert value == pytest.approx(log_posterior(told, new), abs=1e-5)
        own = terms(told, new)
        assert value - own["given"] == pytest.approx(log_posterior(bare, new), abs=1e-5)
        chain.accept()
        at = new


def test_the_published_energy_has_the_same_term() -> None:
    paper = tell(problem(energy="paper"), ALL, clip(), labels_of(LIBRARY))
    ours = tell(problem(), ALL, clip(), labels_of(LIBRARY))
    assert terms(paper, state())["given"] == pytest.approx(terms(ours, state())["given"])
    assert terms(paper, state())["given"] != 0.0


def test_statements_add_up_and_have_a_power() -> None:
    told = tell(problem(), ALL, clip(), labels_of(LIBRARY))
    each = [given(statement) for statement in ALL]
    assert terms(told, state())["given"] == pytest.approx(sum(each))
    half = told._replace(given_power=0.5 * told.given_power)
    assert terms(half, state())["given"] == pytest.approx(sum(each) / 2)
    assert terms(problem(), state())["given"] == 0.0
