"""Which of both samplers is right about the most probable scenes? Their evidences, alone.

    python -m lab.eryn.evidence FOLDER

after ``python -m lab.eryn`` with the same FOLDER prints the ratio of the evidences of the most
probable scene and of each of the next, and of the visits of both samplers. With scenelets and
starts fixed, camera, placements and sizes are nearly normal, and bridge sampling estimates the
evidence from draws of these alone, without jumps. Chains should visit scenes in the ratio of their
evidences.

References
----------
Meng & Wong 1996, Stat. Sinica 6, 831 (bridge sampling).
Overstall & Forster 2010, Comput. Stat. Data Anal. 54, 3269 (fit and use different draws).
Frühwirth-Schnatter 2004, Econom. J. 7, 143 (error for correlated draws).
"""

from __future__ import annotations

import argparse
import math
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq
from scipy.special import expit, logsumexp

from imapper_prob.models.log_posterior import State, log_posterior
from imapper_prob.models.problem import Problem
from imapper_prob.samplers.diagnostics import mean_error
from lab.eryn.__main__ import LONG
from lab.eryn.exchange import load_problem, load_runs

__all__ = ["Evidence", "bridge_sampling"]


Array = NDArray[np.float64]
Items = tuple[tuple[int, int], ...]

DRAWS = 4000
"""Draws of each run, evenly spaced."""
SCENES = 3
"""Scenes that are compared: all that have a probability of more than a twentieth."""


def assignments(runs: dict[str, NDArray[Any]]) -> NDArray[np.object_]:
    """(R, N, W) the scenelets of each draw and their starts, in order of time."""
    found = np.empty(runs["alive"].shape[:-1], dtype=object)
    whole = np.floor(runs["leaves"][..., -2:]).astype(int)
    for at in np.ndindex(found.shape):
        items = whole[at][runs["alive"][at]].tolist()
        found[at] = tuple(sorted(map(tuple, items), key=lambda item: item[1]))
    return found


def vectors(runs: dict[str, NDArray[Any]], visited: NDArray[np.object_], items: Items) -> Array:
    """(R, n, 5 + 4 k) camera, placements and sizes of draws with an assignment, yaws unwrapped."""
    result = []
    for run in range(len(visited)):
        here = [at for at in np.ndindex(visited.shape[1:]) if visited[run][at] == items]
        rows: list[Array] = []
        for at in here:
            leaves = runs["leaves"][run][at][runs["alive"][run][at]]
            leaves = leaves[np.argsort(leaves[:, 5])]
            # Yaws are taken modulo a turn as near as possible to that of the first draw.
            about = rows[0][7::4] if rows else leaves[:, 2]
            leaves[:, 2] = about + (leaves[:, 2] - about + math.pi) % (2 * math.pi) - math.pi
            rows.append(np.append(runs["cameras"][run][at], leaves[:, :4]))
        result.append(np.array(rows))
    fewest = min(DRAWS, *map(len, result))
    spaced = [np.linspace(0, len(rows) - 1, fewest).astype(int) for rows in result]
    return np.array([rows[every] for rows, every in zip(result, spaced, strict=True)])


def evidence(problem: Problem, draws: Array, items: Items) -> Evidence:
    """Evidence of an assignment with the latent variables of the path at zero."""
    latent = np.zeros((problem.n_frames, 2))

    def density(x: Array) -> Array:
        own = x[:, 5:].reshape(len(x), len(items), 4)
        states = (
            State(camera.copy(), np.array(items), leaf[:, :3].copy(), leaf[:, 3].copy(), latent)
            for camera, leaf in zip(x[:, :5], own, strict=True)
        )
        return np.array([log_posterior(problem, state) for state in states])

    return bridge_sampling(draws, density, rng=np.random.default_rng(0))


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the ratios of evidences, and of the visits of both samplers."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args(arguments).folder
    problem, _ = load_problem(folder / "problem.npz")
    names = ("layout", "eryn_with_candidates_layout")
    runs = {name: load_runs(folder / f"{name}-{LONG[1]:.0f}.npz") for name in names}
    visited = {name: assignments(runs[name]) for name in names}
    counted: Counter[Items] = Counter(visited["layout"].ravel().tolist())
    most = [items for items, _ in counted.most_common(SCENES)]
    found = [
        evidence(problem, vectors(runs["layout"], visited["layout"], items), items)
        for items in most
    ]
    for items, own in zip(most[1:], found[1:], strict=True):
        ratio = found[0].log_evidence - own.log_evidence
        error = math.hypot(found[0].standard_error, own.standard_error)
        print(f"{most[0]} over {items}: log ratio of evidences {ratio:.3f} ± {error:.3f}")
        for name in names:
            shares = [
                np.array([np.mean([own == one for own in run.flat]) for run in visited[name]])
                for one in (most[0], items)
            ]
            by_run = np.round(np.log(shares[0] / shares[1]), 2)
            visits = math.log(shares[0].mean() / shares[1].mean())
            print(f"  of visits, {name}: {visits:.3f}, run by run {by_run}")


# Nats beyond which one of the two sums of a bridge is negligible: e^-50 is smaller than one over
# any number of draws.
_BEYOND = 50.0


class Evidence(NamedTuple):
    """Estimate of a log evidence.

    Parameters
    ----------
    log_evidence : float
    standard_error : float
        Monte-Carlo standard error of ``log_evidence``, to first order: reliable below one.
    """

    log_evidence: float
    standard_error: float


def bridge_sampling(
    draws: ArrayLike, log_density_fn: Callable[[Array], Array], *, rng: np.random.Generator
) -> Evidence:
    """Evidence of a posterior of fixed dimension, from draws and a normal proposal.

    The proposal has the mean and covariance of the first half of each chain; the second half
    enters the estimate with an equal number of draws of the proposal (Meng & Wong 1996).

    Parameters
    ----------
    draws : (C, N, D) float
        Draws of the posterior in unbounded coordinates, in which it is roughly normal.
    log_density_fn : callable
        ``(n, D) -> (n,)``, log prior + log likelihood, normalised; -inf where it is zero.
    rng : numpy.random.Generator
        For draws of the proposal.

    Raises
    ------
    ValueError
        Not (C, N, D), fewer than 2 (D + 1) draws to fit, draws in a subspace, or draws where
        the density is not finite, or zero at all draws of the proposal.
    """
    draws = np.asarray(draws, float)
    if draws.ndim != 3:
        raise ValueError(f"draws must be (chains, draws, dimensions), not {draws.shape}")
    n_dimensions, half = draws.shape[2], draws.shape[1] // 2
    fitted = draws[:, :half].reshape(-1, n_dimensions)
    if len(fitted) < 2 * (n_dimensions + 1):
        raise ValueError(f"{len(fitted)} draws cannot fit a proposal in {n_dimensions} dimensions")
    used = draws[:, half:]
    mean = fitted.mean(0)
    try:
        root = np.linalg.cholesky(np.atleast_2d(np.cov(fitted, rowvar=False)))
    except np.linalg.LinAlgError as error:
        raise ValueError("the draws lie in a subspace: a coordinate says nothing new") from error

    def log_proposal(x: Array) -> Array:
        z = np.linalg.solve(root, (x - mean).T)
        constant = 0.5 * n_dimensions * math.log(2 * math.pi) + np.log(np.diag(root)).sum()
        density: Array = -0.5 * (z**2).sum(0) - constant
        return density

    posterior = used.reshape(-1, n_dimensions)
    proposed = mean + rng.standard_normal(posterior.shape) @ root.T
    # Log ratios of target to proposal, at draws of the posterior and at draws of the proposal.
    at_posterior = log_density_fn(posterior) - log_proposal(posterior)
    at_proposal = log_density_fn(proposed) - log_proposal(proposed)
    if not np.isfinite(at_posterior).all():
        raise ValueError("the density is not finite at a draw that is said to be of it")
    if not np.isfinite(at_proposal).any():
        raise ValueError("no draw of the normal proposal has a finite density")
    log_evidence = _bridged(at_posterior, at_proposal)
    series = expit(log_evidence - at_posterior)
    others = expit(at_proposal - log_evidence)
    variance = (mean_error(series.reshape(used.shape[:2])) / series.mean()) ** 2
    variance += others.var(ddof=1) / len(others) / others.mean() ** 2
    return Evidence(log_evidence, float(np.sqrt(variance)))


def _bridged(at_posterior: Array, at_proposal: Array) -> float:
    """Fixed point log Z of the estimate of Meng & Wong, from log ratios p / g.

    With equal numbers of draws of posterior and proposal it is the only root of
    ``mean_g(p / (p + Z g)) = mean_p(Z g / (p + Z g))``, whose left side decreases with Z.
    """

    def difference(log_evidence: float) -> float:
        left = logsumexp(-np.logaddexp(0, log_evidence - at_proposal))
        right = logsumexp(-np.logaddexp(0, at_posterior - log_evidence))
        return float(left - right)

    ratios = np.concatenate([at_posterior, at_proposal[np.isfinite(at_proposal)]])
    return float(brentq(difference, ratios.min() - _BEYOND, ratios.max() + _BEYOND))


if __name__ == "__main__":
    main()
