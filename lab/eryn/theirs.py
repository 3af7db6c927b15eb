"""Eryn on both targets; runs in Eryn's own environment.

``python -m lab.eryn.theirs TARGET PROBLEM OUT RUNS BURN_IN SECONDS FIRST_SEED``
with TARGET one of ``gaussian``, ``prior`` and ``candidates``. The last two are the scene posterior,
with births from a broad prior or from the project's own candidates.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from eryn.ensemble import EnsembleSampler
from eryn.moves import DistributionGenerateRJ, GaussianMove, GroupStretchMove
from eryn.prior import ProbDistContainer
from eryn.state import State
from eryn.utils import PeriodicContainer
from numpy.typing import NDArray

from imapper_prob.models.problem import Problem
from lab.eryn import gaussian
from lab.eryn.exchange import during, load_problem, save_runs
from lab.eryn.leaves import AllLeaves, CameraDensity, LeafDensity, SceneLikelihood

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

GAUSSIAN_WALKERS, GAUSSIAN_STEP = 200, 0.5
WALKERS = 32
LADDERS = {"prior": (4, 30.0), "candidates": (8, 300.0)}
"""Number of temperatures and the highest one, the best of those tried; see
docs/research/eryn.md."""
STEPS = {"start": 2.0, "scenelet": 3.0, "placement": (0.03, 0.1, 0.1, 0.03)}
"""Standard deviations of normal steps: frames, scenelets, (metres, metres, radians, log size)."""
UPDATE = 20
"""Steps between updates of the stationary group that leaves are stretched towards."""


class Drawn(ProbDistContainer):  # type: ignore[misc]
    """A density of whole leaves with the interface of Eryn's births."""

    def __init__(self, density: Any) -> None:
        self.density = density

    def logpdf(self, x: Array, keys: None = None) -> Array:
        """Log density of (n, D) leaves."""
        return np.asarray(self.density.logpdf(x))

    def rvs(self, size: int | tuple[int, ...] = 1, keys: None = None) -> Array:
        """Draw leaves."""
        return np.asarray(self.density.rvs(size))


class Stretch(GroupStretchMove):  # type: ignore[misc]
    """Stretch each leaf towards one of the stationary group at the same temperature.

    Only leaves with the same ``key``, which the stretch must not change, are used; a leaf without
    one stays. Other branches move with those of the chosen leaf.
    """

    def __init__(self, branch: str, key: Any, **options: object) -> None:
        self.branch, self.key = branch, key
        super().__init__(**options)

    def setup_friends(self, branches: dict[str, Any]) -> None:
        """Store the ensemble, with its leaves sorted by temperature and key."""
        self.stored = {name: branch.coords.copy() for name, branch in branches.items()}
        places = np.nonzero(branches[self.branch].inds)
        codes = self._codes(places[0], self.stored[self.branch][places])
        order = np.argsort(codes, kind="stable")
        self.codes, self.places = codes[order], np.stack(places)[:, order]

    def _codes(self, rungs: NDArray[np.int64], leaves: Array) -> NDArray[np.int64]:
        return np.asarray(1000 * rungs + self.key(leaves), dtype=np.int64)

    def find_friends(
        self, name: str, s: Array, s_inds: Bools | None = None, branch_supps: object = None
    ) -> Array:
        """Leaves of the stationary group for those marked in ``s_inds``; others are unchanged."""
        friends = s.copy()
        if name == self.branch:
            own = np.nonzero(np.asarray(s_inds))
            codes = self._codes(own[0], s[own])
            low, high = (np.searchsorted(self.codes, codes, side) for side in ("left", "right"))
            some = high > low
            pick = low + np.floor(np.random.rand(len(low)) * (high - low)).astype(int)  # noqa: NPY002
            self.own = tuple(at[some] for at in own)
            self.friend = self.places[:, pick[some]]
            friends[self.own] = self.stored[name][tuple(self.friend)]
        else:
            (ladder, walker), (other, further) = self.own[:2], self.friend[:2]
            friends[ladder, walker, 0] = self.stored[name][other, further, 0]
        return friends


def alone(name: str, leaf: int, shape: tuple[int, int], columns: list[int]) -> dict[str, Bools]:
    """Mask of columns of one leaf, since Eryn's stretch counts dimensions of absent leaves too."""
    mask = np.zeros(shape, dtype=bool)
    mask[leaf, columns] = True
    return {name: mask}


class StandardNormal:
    """Prior density of the signals of the Gaussian target."""

    def logpdf(self, x: Array) -> Array:
        """Log density of (n, D) signals."""
        return gaussian.log_prior(x)

    def rvs(self, size: int | tuple[int, ...] = 1) -> Array:
        """Draw signals from numpy's global generator, which Eryn's moves use."""
        return np.random.standard_normal((*np.atleast_1d(size), gaussian.DIMENSION))  # noqa: NPY002


def gaussian_chain() -> Iterator[State]:
    """Normal steps, births and deaths from the prior, without tempering: there is one mode."""
    name, most, dimension = "signal", gaussian.MOST, gaussian.DIMENSION

    def log_like(signals: Array, groups: NDArray[np.int64]) -> Array:
        total = np.zeros((groups.max(initial=-1) + 1, dimension))
        np.add.at(total, groups, signals)
        return gaussian.log_likelihood(total)

    density = StandardNormal()
    limits = {"nleaves_max": {name: most}, "nleaves_min": {name: 0}}
    sampler = EnsembleSampler(
        GAUSSIAN_WALKERS, {name: dimension}, log_like,
        {"all_models_together": AllLeaves({name: density})},
        provide_groups=True, vectorize=True, branch_names=[name],
        moves=[GaussianMove({name: GAUSSIAN_STEP**2})],
        rj_moves=[DistributionGenerateRJ({name: Drawn(density)}, **limits)],
        fill_zero_leaves_val=float(gaussian.log_likelihood(np.zeros(dimension))), **limits,
    )  # fmt: skip
    counts = np.arange(GAUSSIAN_WALKERS) % (most + 1)
    begin = State(
        {name: density.rvs((1, GAUSSIAN_WALKERS, most))},
        inds={name: (np.arange(most) < counts[:, None])[None]},
    )
    states: Iterator[Any] = sampler.sample(begin, iterations=None, store=False)
    return states


def scene_chain(problem: Problem, leaf: LeafDensity, rungs: int, hottest: float) -> Iterator[State]:
    """Stretch moves, normal steps, births and deaths from ``leaf``, with tempering."""
    camera = CameraDensity(problem.camera_mean, problem.camera_precision)
    likelihood = SceneLikelihood(problem, leaf, camera)
    likelihood([leaf.rvs(1), camera.rvs(1)], [np.zeros(1, int), np.zeros(1, int)])  # compiles
    most = problem.n_frames // int(problem.lengths.min())
    parameters, width = len(problem.camera_mean), leaf.rvs().shape[-1]
    placement, scenelet, start = list(range(width - 2)), width - 2, width - 1
    names = [f"leaf {i}" for i in range(width)]
    periodic = PeriodicContainer(
        {"scenelet": {names[2]: 2 * math.pi}, "camera": {}},
        key_order={"scenelet": names, "camera": []},
    )
    limits = {
        "nleaves_max": {"scenelet": most, "camera": 1},
        "nleaves_min": {"scenelet": 0, "camera": 1},
    }
    whole = {"camera": np.ones((1, parameters), dtype=bool)}

    def one_by_one(columns: list[int], extra: dict[str, Bools]) -> list[dict[str, Bools]]:
        return [alone("scenelet", k, (most, width), columns) | extra for k in range(most)]

    def step(columns: list[int], spread: Any) -> GaussianMove:
        spreads = np.full(width, 1e-6)
        spreads[columns] = spread
        return GaussianMove(
            {"scenelet": np.diag(spreads**2)},
            gibbs_sampling_setup=one_by_one(columns, {}),
            periodic=periodic,
        )

    stretch = Stretch(
        "scenelet",
        lambda leaves: np.floor(leaves[:, scenelet]),
        nfriends=WALKERS,
        n_iter_update=UPDATE,
        gibbs_sampling_setup=one_by_one(placement, whole),
        periodic=periodic,
    )
    moves = [
        stretch,
        step(placement, STEPS["placement"]),
        step([start], STEPS["start"]),
        step([scenelet], STEPS["scenelet"]),
    ]
    births = DistributionGenerateRJ(
        {"scenelet": Drawn(leaf), "camera": Drawn(camera)}, periodic=periodic, **limits
    )
    sampler = EnsembleSampler(
        WALKERS, {"scenelet": width, "camera": parameters},
        likelihood,
        {"all_models_together": AllLeaves({"scenelet": leaf, "camera": camera})},
        provide_groups=True, vectorize=True, branch_names=["scenelet", "camera"],
        moves=moves, rj_moves=[births], periodic=periodic,
        tempering_kwargs={"ntemps": rungs, "Tmax": hottest}, **limits,
    )  # fmt: skip
    shape = (rungs, WALKERS)
    coords = {"scenelet": leaf.rvs((*shape, most)), "camera": camera.rvs((*shape, 1))}
    alive = {
        "scenelet": np.broadcast_to(np.arange(most) < 1, (*shape, most)).copy(),
        "camera": np.ones((*shape, 1), dtype=bool),
    }
    states: Iterator[Any] = sampler.sample(State(coords, inds=alive), iterations=None, store=False)
    return states


def counts(run: Iterator[Any]) -> dict[str, Array]:
    """Number of signals of each walker by iteration."""
    return {"count": np.array([state.branches["signal"].inds[0].sum(-1) for state in run])}


def scenes(run: Iterator[Any]) -> dict[str, Array]:
    """Leaves and cameras of the coldest walkers by iteration."""
    kept = [
        (
            scenelet.coords[0].copy(),
            scenelet.inds[0].copy(),
            state.branches["camera"].coords[0, :, 0].copy(),
        )
        for state in run
        for scenelet in [state.branches["scenelet"]]
    ]
    leaves, alive, cameras = (np.array(part) for part in zip(*kept, strict=True))
    return {"leaves": leaves, "alive": alive, "cameras": cameras}


def main(
    target: str, source: str, path: str, runs: int, burn_in: float, seconds: float, first: int
) -> None:
    """Run a target ``runs`` times with different seeds and store the draws."""
    results = []
    for seed in range(first, first + runs):
        np.random.seed(seed)  # noqa: NPY002
        if target == "gaussian":
            results.append(counts(during(gaussian_chain(), burn_in, seconds)))
        else:
            problem, density = load_problem(Path(source))
            leaf = density if target == "candidates" else density.without_candidates()
            chain = scene_chain(problem, leaf, *LADDERS[target])
            results.append(scenes(during(chain, burn_in, seconds)))
    save_runs(Path(path), results)


if __name__ == "__main__":
    target, source, path, runs, burn_in, seconds, first = sys.argv[1:]
    main(target, source, path, int(runs), float(burn_in), float(seconds), int(first))
