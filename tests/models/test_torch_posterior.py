"""The torch executor says what the compiled one says, and its gradients are right."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cache, reduce

import hypothesis.strategies as st
import numpy as np
import pytest
import torch
from hypothesis import example, given, settings

from imapper_prob.models.batched.posterior import log_posterior_batch, terms_batch
from imapper_prob.models.batched.scan import log_product, second_order_scan
from imapper_prob.models.batched.tensors import to_tensors
from imapper_prob.models.compiled import TERMS
from imapper_prob.models.posterior import State, terms
from imapper_prob.models.problem import Problem
from tests.models import worlds

N_FRAMES, N_ITEMS = 24, 4
DEVICES = [
    "cpu",
    pytest.param(
        "cuda", marks=pytest.mark.skipif(not torch.cuda.is_available(), reason="no GPU here")
    ),
]
Batch = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""Camera (S, 5), items (S, k, 2), placements (S, k, 3), sizes (S, k) and latent (S, T, 2)."""
REALS = (0, 2, 3, 4)
"""Which of these have derivatives."""


@pytest.fixture(autouse=True, scope="module")
def one_thread() -> Iterator[None]:
    """The operations are too small for two."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@cache
def problem(n_frames: int = N_FRAMES) -> Problem:
    """A walk, some joints and one whole frame of it undetected, free poses at a price.

    One scenelet of the library has two objects, which stand in each other.
    """
    rng = np.random.default_rng(3)
    first, *others = worlds.library(min(5, n_frames))
    first = replace(first, objects=(*first.objects, worlds.couch(0.5, -0.7, 1.0, "table")))
    scenelets = worlds.Library("test", (first, *others))
    whole = worlds.facing_about(worlds.problem(n_frames, scenelets=scenelets))
    used = whole.used & (rng.random(whole.used.shape) < 0.9)
    used[n_frames // 2] = False
    lowered = np.zeros_like(whole.lowered)
    lowered[::2] = 1, 4
    stays = np.array([[0, 3, 1.5], [5, 9, 0.7], [13, 16, 2.5]])
    return whole._replace(used=used, free_cost=rng.random(n_frames), lowered=lowered, stays=stays)


def states(seed: int, n: int, whole: Problem, *, wild: bool) -> Batch:
    """Random states: 0 to 4 scenelets about the walk, or ``wild``, anywhere and overlapping.

    Wild states have boxes and joints behind the camera, cameras and assignments outside the
    support, and scenelets that share one placement.
    """
    rng = np.random.default_rng(seed)
    camera = whole.camera_mean + rng.normal(size=(n, 5)) * [0.03, 0.05, 0.05, 0.05, 0.03]
    latent = rng.normal(size=(n, N_FRAMES, 2))
    items = np.full((n, N_ITEMS, 2), -1)
    held = rng.random((n, N_ITEMS)) < 0.7
    items[..., 0] = np.where(held, rng.integers(0, 3, (n, N_ITEMS)), -1)
    items[..., 1] = 6 * np.arange(N_ITEMS) + rng.integers(0, 2, (n, N_ITEMS))
    middle = worlds.walk(N_FRAMES)[np.minimum(items[..., 1] + 2, N_FRAMES - 1), 6]
    placements = middle + rng.normal(size=middle.shape) * [0.4, 0.4, 3.0]
    sizes = 0.1 * rng.normal(size=(n, N_ITEMS))
    if wild:
        camera += rng.normal(size=(n, 5)) * [0.3, 0.6, 0.1, 0.1, 0.3]
        items[..., 1] += rng.integers(-2, 3, (n, 1)) * (rng.random((n, N_ITEMS)) < 0.1)
        placements[..., 1] += rng.choice([-5.0, -3.0, 0.0], (n, N_ITEMS))
        placements[:, 2] = np.where(rng.random((n, 1)) < 0.5, placements[:, 1], placements[:, 2])
    return camera, items, placements, sizes, latent


def compiled(whole: Problem, batch: Batch) -> np.ndarray:
    """(S, 10) terms by the compiled executor."""
    rows = []
    for camera, items, placements, sizes, latent in zip(*batch, strict=True):
        held = items[:, 0] >= 0
        state = State(camera, items[held], placements[held], sizes[held], latent)
        rows.append(list(terms(whole, state).values()))
    return np.array(rows)


def tensors_of(
    batch: Batch, *, dtype: torch.dtype = torch.float64, device: str = "cpu"
) -> list[torch.Tensor]:
    """The batch on a device, derivatives wanted."""
    return [
        torch.tensor(a, dtype=dtype, device=device, requires_grad=True)
        if i in REALS
        else torch.tensor(a, device=device)
        for i, a in enumerate(batch)
    ]


def batched(
    whole: Problem, batch: Batch, *, dtype: torch.dtype = torch.float64, device: str = "cpu"
) -> np.ndarray:
    tensors = to_tensors(whole, dtype=dtype, device=device)
    values = terms_batch(tensors, *tensors_of(batch, dtype=dtype, device=device))
    return values.detach().cpu().double().numpy()


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize(("dtype", "near"), [(torch.float64, 1e-6), (torch.float32, 1e-4)])
@settings(max_examples=40)
@given(
    seed=st.integers(0, 10**6),
    wild=st.booleans(),
    library=st.sampled_from([True, False]),
    people=st.sampled_from([(0,), (0, 6, 13)]),
)
def test_both_executors_agree(
    device: str, dtype: torch.dtype, near: float, seed: int, wild: bool, library: bool,
    people: tuple[int, ...],
) -> None:  # fmt: skip
    whole = problem()
    whole = whole._replace(path_starts=np.isin(np.arange(N_FRAMES), people))
    if not library:
        bare = np.zeros_like(whole.box_first)
        whole = whole._replace(box_first=bare)
    batch = states(seed, 8, whole, wild=wild)
    found = batched(whole, batch, dtype=dtype, device=device)
    np.testing.assert_allclose(found, compiled(whole, batch), rtol=near, atol=near)


def test_the_random_states_go_everywhere() -> None:
    """Otherwise agreement would say little."""
    whole = problem()
    values = compiled(whole, states(0, 400, whole, wild=True))
    outside = np.isinf(values[:, 0])
    assert 0.1 < outside.mean() < 0.7
    assert ((values[~outside] != 0).mean(0) > 0.3).all(), dict(zip(TERMS, values.T, strict=True))
    tame = compiled(whole, states(0, 100, whole, wild=False))
    assert np.isfinite(tame).all()


def test_the_log_posterior_is_the_sum_of_its_terms() -> None:
    whole = problem()
    batch = tensors_of(states(1, 5, whole, wild=False))
    tensors = to_tensors(whole)
    expected = terms_batch(tensors, *batch).sum(1)
    torch.testing.assert_close(log_posterior_batch(tensors, *batch), expected)


def test_states_order_of_items_and_padding_do_not_matter() -> None:
    whole = problem()
    camera, items, placements, sizes, latent = batch = states(2, 6, whole, wild=False)
    together = batched(whole, batch)
    for i in range(6):
        order = np.random.default_rng(i).permutation(N_ITEMS)
        order = np.concatenate([order, order[:1]])
        filled = items[i, order]
        filled[-1] = -1, 77  # a fifth item that is none
        placed = placements[[i]][:, order], sizes[[i]][:, order]
        one = (camera[[i]], filled[None], *placed, latent[[i]])
        np.testing.assert_allclose(batched(whole, one)[0], together[i], rtol=1e-12, atol=1e-12)


def test_gradients_are_those_of_the_terms() -> None:
    """Against central differences, for each term alone.

    Of this executor, for the other's lines of sight in single precision move in small jumps;
    that both are the same function is tested above.

    The terms have kinks (least clearance, deepest overlap, the cap). A coordinate whose
    differences to the left and to the right disagree has one within the step, and is left out;
    these are few.
    """
    whole = problem()
    step = 1e-6
    reached = np.zeros(len(TERMS), bool)
    for seed in range(6):
        batch = states(seed, 1, whole, wild=False)
        state = tensors_of(batch)
        values = terms_batch(to_tensors(whole), *state)[0]
        middle = np.concatenate([batch[i].reshape(-1) for i in REALS])
        shifts = step * np.eye(len(middle))
        ends = np.cumsum([batch[i].size for i in REALS])[:-1]
        around = np.concatenate([middle[None], middle + shifts, middle - shifts])
        parts = iter(np.split(around, ends, axis=1))
        moved = tuple(
            next(parts).reshape(-1, *a.shape[1:]) if i in REALS else np.repeat(a, len(around), 0)
            for i, a in enumerate(batch)
        )
        here, right, left = np.split(batched(whole, moved).T, [1, 1 + len(middle)], axis=1)
        right, left = (right - here) / step, (here - left) / step
        for i, name in enumerate(TERMS):
            numeric = (left[i] + right[i]) / 2
            if not values[i].requires_grad:
                assert not numeric.any(), name
                continue
            slopes = torch.autograd.grad(
                values[i], [state[r] for r in REALS], retain_graph=True, allow_unused=True,
                materialize_grads=True,
            )  # fmt: skip
            found = np.concatenate([p.numpy().reshape(-1) for p in slopes])
            size = 1 + np.abs(numeric)
            smooth = np.abs(right[i] - left[i]) < 1e-2 * size
            assert smooth.mean() > 0.95, name
            assert (np.abs(found - numeric)[smooth] < 1e-4 * size[smooth]).all(), name
            reached[i] |= bool(found.any())
    constant = {"layout", "free_pose", "support"}
    assert {name for name, hit in zip(TERMS, reached, strict=True) if not hit} == constant


def odd_cases() -> dict[str, tuple[Problem, Batch]]:
    """Where a division, a root or a logarithm could go wrong."""
    whole = problem()
    camera, latent = np.array(whole.camera_mean)[None], np.zeros((1, N_FRAMES, 2))
    items = np.array([[[0, 2], [0, 9], [2, 16]]])
    ahead = np.array([[[0.0, 4.0, 0.0], [0.5, 4.0, 0.0], [1.0, 4.0, 0.0]]])
    same, even = np.repeat(ahead[:, :1], 3, 1), np.zeros((1, 3))
    blind = whole._replace(used=np.zeros_like(whole.used))
    per_frame = (
        "keypoints", "used", "confidence_density", "error_scale", "error_dof",
        "path_centre", "path_scale", "path_starts", "lift", "poses", "free_cost",
    )  # fmt: skip
    one = whole._replace(
        static_density=whole.static_density[:, :1].copy(),
        **{name: getattr(whole, name)[:1] for name in per_frame},
    )
    return {
        "behind the camera": (whole, (camera, items, ahead * [1, -1, 1], even, latent)),
        "at the camera": (whole, (camera, items, 0 * ahead, even, latent)),
        "very far": (whole, (camera, items, ahead * [1, 100, 1], even, latent)),
        "coincident": (whole, (camera, items, same, even, latent)),
        "no detection": (blind, (camera, items, ahead, even, latent)),
        "no item": (whole, (camera, items[:, :0], ahead[:, :0], even[:, :0], latent)),
        "one frame": (one, (camera, items[:, :0], ahead[:, :0], even[:, :0], latent[:, :1])),
        "covered from end to end": (
            problem(2),
            (camera, 0 * items[:, :1], ahead[:, :1], even[:, :1], latent[:, :2]),
        ),
        "likelihood off": (whole._replace(likelihood=0.0), (camera, items, ahead, even, latent)),
        "overlap in time": (whole, (camera, 0 * items, ahead, even, latent)),
        "not a number": (whole, (camera * [np.nan, 1, 1, 1, 1], items, ahead, even, latent)),
        "below the floor": (whole, (camera * [1, -1, 1, 1, 1], items, ahead, even, latent)),
    }


@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
@pytest.mark.parametrize("name", odd_cases())
def test_odd_states_have_finite_values_and_gradients(name: str, dtype: torch.dtype) -> None:
    whole, batch = odd_cases()[name]
    state = tensors_of(batch, dtype=dtype)
    values = terms_batch(to_tensors(whole, dtype=dtype), *state)
    expected = compiled(whole, batch)
    near = 1e-6 if dtype == torch.float64 else 1e-4
    np.testing.assert_allclose(values.detach().numpy(), expected, rtol=near, atol=near)
    values.sum().backward()
    supported = bool(np.isfinite(expected).all())
    for part in (state[i] for i in REALS):
        assert part.grad is None or torch.isfinite(part.grad).all()
        assert supported or part.grad is None or not part.grad.any()


@example(seed=0, n=1200)  # long enough to overflow
@given(seed=st.integers(0, 10**6), n=st.integers(1, 40))
@settings(max_examples=25)
def test_scans_are_their_recursions(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    first, second, offset = rng.normal(size=(3, 2, n, 3))
    first *= 0.5
    second *= 0.3
    first[rng.random(first.shape) < 0.2] = 0.0
    second[first == 0.0] = 0.0  # a frame that forgets what was before it
    line = np.zeros((2, n, 3))
    before, h = np.zeros((2, 3)), np.zeros((2, 3))
    for t in range(n):
        before, h = h, first[:, t] * h + second[:, t] * before + offset[:, t]
        line[:, t] = h
    found = second_order_scan(*(torch.tensor(x) for x in (first, second, offset)))
    np.testing.assert_allclose(found, line, rtol=1e-8, atol=1e-8)

    matrices = rng.uniform(0, 1, (2, n, 2, 2))
    product, log_scale = log_product(torch.tensor(matrices))
    for i in range(2):
        whole = reduce(np.matmul, matrices[i])
        np.testing.assert_allclose(product[i] * log_scale[i].exp(), whole, rtol=1e-10)
