"""Candidates: fits at maxima of charness, evaluated and refined under the log-posterior.

Reprojection alone cannot distinguish a chair from a couch. So in every window the best fits of each
kind of furniture are kept separately, evaluated with occlusion and intersections, and the best of
each kind is refined if its gain is sufficient. The paper takes 200 fits per maximum, removes those
that walk through furniture, then those whose furniture hides the wrong joints, and keeps three
(Monszpart et al. 2019, section 5).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from scipy.optimize import minimize

from imapper_prob.layouts import furniture_kinds
from imapper_prob.models.kernels.stays import unsupported
from imapper_prob.models.log_posterior import (
    State,
    empty_state,
    log_posterior,
    log_posterior_near,
    terms,
)
from imapper_prob.models.problem import Problem
from imapper_prob.models.text import Listed, brief
from imapper_prob.models.view import to_floor, to_view
from imapper_prob.progress import Progress
from imapper_prob.solver.fits import Fits

__all__ = [
    "Candidate",
    "CharnessCurve",
    "Fate",
    "MaximaSettings",
    "MaximumTable",
    "Shortlisted",
    "along_the_ray",
    "apart_from_stays",
    "assigned",
    "charness_curve",
    "refine",
    "screen",
    "shortlist",
]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class MaximaSettings:
    """How maxima of charness are found.

    Parameters
    ----------
    temperature : float
        Nats per joint; a fit that is worse than the window's best by this has 1/e of its weight.
    smoothing : float
        Standard deviation in windows (2.5 in the paper).
    minimum : float
        Smallest charness of a maximum: between the medians of walking windows (.09) and of
        reaching ones (.29) on i3DB. (.3 in the authors' code, with categories of their own.)
    apart : float
        Seconds between maxima, about the length of a scenelet.
    most : int
        Largest number of maxima (1 to 5 in the paper).
    """

    temperature: float = 0.1
    smoothing: float = 2.5
    minimum: float = 0.2
    apart: float = 1.6
    most: int = 12


@dataclass(frozen=True)
class Peak:
    """A local maximum of charness, and whether it was selected.

    Parameters
    ----------
    window : int
    charness : float
    dropped : str
        Reason why it was not selected; empty if it was.
    """

    window: int
    charness: float
    dropped: str


@dataclass(frozen=True)
class CharnessCurve:
    """Charness by window, and its maxima.

    Parameters
    ----------
    centres : (W,) int
        Middle frame of each window.
    raw : (W,) float
        Charness of each window's best fits in [0, 1]; NaN in windows without detections.
    values : (W,) float
        The same, interpolated where unknown, and smoothed.
    maxima : (M,) int
        Indices of the selected windows, in descending order of charness.
    peaks : tuple of Peak
        All maxima, and the local maxima that were not selected, in order of time.
    """

    centres: Ints
    raw: Array
    values: Array
    maxima: Ints
    peaks: tuple[Peak, ...]

    @property
    def step(self) -> int:
        """Frames from one window to the next; 1 if there is only one."""
        return int(np.diff(self.centres[:2]).sum()) or 1


def charness_curve(
    fits: Fits,
    charness: Array,
    *,
    fps: float,
    settings: MaximaSettings | None = None,
    bare: NDArray[np.bool_] | None = None,
) -> CharnessCurve:
    """Charness of the best fits, weighted by fit quality and smoothed; find separated maxima.

    Parameters
    ----------
    fits : Fits
    charness : (L,) float
        Of the library's scenelets.
    fps : float
    settings : MaximaSettings, optional
    bare : (T,) bool, optional
        Frames without a static skeleton. A window about such a frame is also a maximum, whatever
        its charness, unless another maximum is near: the set T' of the paper.

    Returns
    -------
    CharnessCurve
    """
    settings = settings or MaximaSettings()
    known: NDArray[np.bool_] = np.any(np.isfinite(fits.cost), axis=1)
    raw = np.full(len(fits.centres), np.nan)
    for w in np.flatnonzero(known):
        cost = fits.cost[w]
        weight = np.exp(-(cost - cost.min()) / settings.temperature)
        raw[w] = float(weight @ charness / weight.sum())
    bridged = np.zeros(len(raw))
    if known.any():
        # A window without detections takes the interpolated charness of its neighbours.
        bridged = np.interp(np.arange(len(raw)), np.flatnonzero(known), raw[known])
    values = gaussian_filter1d(bridged, settings.smoothing, mode="nearest")
    chosen: list[int] = []
    dropped: dict[int, str] = {}
    for w in np.argsort(-values, kind="stable").tolist():
        if not known[w]:
            dropped[w] = "no scenelet could be fitted"
            continue
        if values[w] < settings.minimum:
            dropped[w] = f"charness below {settings.minimum:g}"
            continue
        near = np.abs(fits.centres[w] - fits.centres[chosen]) < settings.apart * fps
        if near.any():
            stronger = fits.centres[chosen[int(near.argmax())]]
            dropped[w] = f"within {settings.apart:g} s of the maximum at frame {stronger}"
        elif len(chosen) == settings.most:
            dropped[w] = f"{settings.most} maxima are higher"
        else:
            chosen.append(w)
    if bare is not None:
        # Windows into which some scenelet fits, with or without detections.
        forced = bare[fits.centres] & (fits.placements[..., 1] > 0).any(1)
        for w in np.argsort(-values, kind="stable").tolist():
            near = np.abs(fits.centres[w] - fits.centres[chosen]) < settings.apart * fps
            if forced[w] and not near.any() and len(chosen) < settings.most:
                chosen.append(w)
                dropped.pop(w, None)
    peaks = tuple(
        Peak(w, float(values[w]), dropped.get(w, ""))
        for w in range(len(values))
        if w in chosen or _stands_out(values, w)
    )
    return CharnessCurve(fits.centres, raw, values, np.array(chosen, dtype=np.int64), peaks)


def _stands_out(values: Array, window: int) -> bool:
    """Whether a window is a local maximum: above the one before, not below the one after."""
    before = values[window - 1] if window > 0 else -np.inf
    after = values[window + 1] if window + 1 < len(values) else -np.inf
    return bool(before < values[window] >= after)


# ------------------------------------------------------------------------------------------------
# Evaluation and refinement.

_EACH_KIND: Final = 3
"""Fits of each kind of furniture that are evaluated per window; chosen."""
_WORTH: Final = 20.0
"""Nats by which a kind may be worse than the window's best and still be refined; chosen."""


@dataclass(frozen=True)
class Candidate:
    """A scenelet fitted to a window.

    Parameters
    ----------
    scenelet, start : int
        Index in the library, and start frame.
    placement : (3,) float
        x, y in metres, yaw in radians.
    size : float
        Log size of the person.
    gain : float
        Nats by which this scenelet alone improves on the empty scene.
    kind : tuple of int
        Categories of its objects; scenelets of one kind imply the same furniture.
    window : int
        Index of the window it was fitted to.
    """

    scenelet: int
    start: int
    placement: Array
    size: float
    gain: float
    kind: tuple[int, ...]
    window: int


def screen(
    problem: Problem,
    fits: Fits,
    *,
    progress: Progress | None = None,
) -> tuple[Candidate, ...]:
    """Evaluate the best fits of every window and kind; candidates are in order of time.

    Parameters
    ----------
    problem : Problem
    fits : Fits
    progress : callable, optional
        Called with the name of a stage and its completed share.

    Returns
    -------
    tuple of Candidate
    """
    empty = empty_state(problem)
    value = log_posterior_near(problem, empty)
    base = value(empty)
    kinds = furniture_kinds(problem)
    found: list[Candidate] = []
    for w, centre in enumerate(fits.centres.tolist()):
        judged: dict[tuple[int, ...], list[Candidate]] = {}
        for scenelet in np.argsort(fits.cost[w], kind="stable").tolist():
            own = judged.setdefault(kinds[scenelet], [])
            if len(own) == _EACH_KIND or not np.isfinite(fits.cost[w, scenelet]):
                continue
            start = centre - int(problem.lengths[scenelet]) // 2
            placed = along_the_ray(problem, centre, fits.placements[w, scenelet])
            gain = value(empty.with_item(scenelet, start, *placed)) - base
            if np.isfinite(gain):
                own.append(Candidate(scenelet, start, *placed, gain, kinds[scenelet], w))
        found += _refined(problem, empty, base, judged)
        if progress is not None:
            progress("judging candidates", (w + 1) / len(fits.centres))
    return tuple(found)


def _refined(
    problem: Problem,
    empty: State,
    base: float,
    judged: dict[tuple[int, ...], list[Candidate]],
) -> list[Candidate]:
    """Candidates of one window; the best of each kind with furniture is refined if good enough."""
    everything = [c for own in judged.values() for c in own]
    if not everything:
        return []
    enough = max(0.0, max(c.gain for c in everything)) - _WORTH
    result = []
    for kind, own in judged.items():
        for rank, candidate in enumerate(sorted(own, key=lambda c: -c.gain)):
            if rank == 0 and kind and candidate.gain > enough:
                state = refine(problem, assigned(empty, [candidate]))
                candidate = replace(
                    candidate,
                    placement=state.placements[0],
                    size=float(state.sizes[0]),
                    gain=log_posterior(problem, state) - base,
                )
            result.append(candidate)
    return result


def assigned(state: State, members: Iterable[Candidate]) -> State:
    """Add candidates to a state.

    Parameters
    ----------
    state : State
    members : iterable of Candidate

    Returns
    -------
    State
    """
    for c in members:
        state = state.with_item(c.scenelet, c.start, c.placement, c.size)
    return state


def apart_from_stays(problem: Problem, context: State) -> Callable[[Sequence[Candidate]], float]:
    """A gain function of candidates that divides the value of a stay among its candidates.

    A single scenelet supports a whole stay, and a second one gains nothing from it, so gains of
    single candidates would not add up. Here each candidate gets the share of the stay's frames in
    which its person is off their feet. Sums over the candidates of a stay do not exceed the stay's
    value.

    Parameters
    ----------
    problem : Problem
    context : State
        Scene without the candidates; no candidates gain 0. Stays that it supports have no value.

    Returns
    -------
    callable
        Maps candidates to their gain in nats.
    """
    bare = problem._replace(stays=problem.stays[:0])
    held = [unsupported(stay[None], problem.lowered, context.items) == 0 for stay in problem.stays]
    stays = problem.stays[~np.array(held, dtype=bool)]
    value = log_posterior_near(bare, context)
    base = value(context)

    def share(candidate: Candidate) -> float:
        first, end = (candidate.start + problem.lowered[candidate.scenelet]).tolist()
        covered = np.minimum(stays[:, 1], end) - np.maximum(stays[:, 0], first)
        lasts = stays[:, 1] - stays[:, 0]
        return float((stays[:, 2] * np.maximum(covered, 0.0) / lasts).sum())

    def gain(members: Sequence[Candidate]) -> float:
        worth = problem.likelihood * sum(share(c) for c in members)
        return value(assigned(context, members)) - base + worth

    return gain


def along_the_ray(problem: Problem, frame: int, placement: Array) -> tuple[Array, float]:
    """The most probable placement along the viewing ray, and its log size.

    A fit determines the apparent size of the person. The distance then depends on the actual size
    and on the depth of the static path in that frame; both have normal priors.

    Parameters
    ----------
    problem : Problem
    frame : int
        Frame of the static path whose depth is used.
    placement : (3,) float
        Of a person with the body's size: x, y in metres, yaw in radians.

    Returns
    -------
    placement : (3,) float
    size : float
        Log size.
    """
    pitch, _, log_focal, log_body, roll = problem.camera_mean
    bearing, log_depth = problem.path_centre[frame]
    # Distance on the floor, in units of the depth along the optical axis.
    aside, up = np.exp(-log_focal) * np.array([bearing, problem.lift[frame]])
    ahead = np.cos(pitch) - np.sin(pitch) * (np.sin(roll) * aside + np.cos(roll) * up)
    apart = log_depth + log_focal + log_body + np.log(ahead) - np.log(placement[1])
    doubt, spread = problem.path_scale[frame, 1] ** 2, problem.size_spread**2
    size = float(apart * spread / (spread + doubt))
    return placement * [np.exp(size), np.exp(size), 1.0], size


_SPREAD: Final = np.array([0.02, 0.05, 0.15, 0.05])
"""First steps of a refinement in bearing, log depth, yaw (rad), and log size at constant apparent
size; chosen, about the error of a fit."""
_EVALUATIONS: Final = 90
"""Evaluations of the log-posterior to refine one scenelet; chosen."""


def refine(problem: Problem, state: State, *, only: Iterable[int] | None = None) -> State:
    """Optimise placements and sizes under the full posterior, one scenelet at a time (Nelder-Mead).

    Parameters
    ----------
    problem : Problem
    state : State
    only : iterable of int, optional
        Indices of the scenelets to move; all if not given.

    Returns
    -------
    State
    """
    for index in range(state.n_scenelets) if only is None else only:
        value = log_posterior_near(problem, state)
        start = to_view(state.placements[index], state.sizes[index])
        start[3] -= start[1]

        def placed(theta: Array, index: int = index, state: State = state) -> State:
            placement, size = to_floor(theta + np.array([0.0, 0.0, 0.0, theta[1]]))
            return state.with_placement(index, placement, float(size))

        simplex = start + np.vstack([np.zeros(4), np.diag(_SPREAD)])
        result = minimize(
            lambda theta, placed=placed, value=value: -value(placed(theta)),
            start,
            method="Nelder-Mead",
            options={"maxfev": _EVALUATIONS, "initial_simplex": simplex},
        )
        state = placed(result.x)
    return state


# ------------------------------------------------------------------------------------------------
# Tables of maxima: which candidates were kept, and why others were not, in the order of the paper's
# criteria, although one log-posterior evaluates all of them at once.

_SOLID = ("motion", "collision", "ground")
"""Terms of penetrations."""


class Fate(StrEnum):
    """Whether a candidate was kept, or which criterion it failed."""

    FIT = "fit"
    MOTION = "motion"
    OCCLUSION = "occlusion"
    KIND = "same furniture"
    KEPT = "kept"


@dataclass(frozen=True)
class Shortlisted:
    """A candidate at a maximum, with its gain over the empty scene in three parts, nats.

    Parameters
    ----------
    candidate : Candidate
    fit : float
        All but the other two: detections without occlusion, facing, path, prior.
    motion : float
        Penetrations of people and furniture, at most 0.
    occlusion : float
        Effect of occlusion by the furniture.
    fate : Fate
        ``KIND``: another candidate with the same furniture is better. ``MOTION`` and ``OCCLUSION``:
        it would have been kept without that part. ``FIT``: not even then.
    """

    candidate: Candidate
    fit: float
    motion: float
    occlusion: float
    fate: Fate


@dataclass(frozen=True)
class MaximumTable:
    """The candidates at one maximum of charness.

    Parameters
    ----------
    window : int
    fitted : int
        Number of scenelets fitted in this window and its neighbours.
    rows : tuple of Shortlisted
        Evaluated candidates with furniture, the best first.
    """

    window: int
    fitted: int
    rows: tuple[Shortlisted, ...]

    __repr__ = brief

    def __post_init__(self) -> None:
        object.__setattr__(self, "rows", Listed(self.rows))

    def counts(self) -> dict[str, int]:
        """Number of candidates left after each criterion, from all fitted to those kept.

        Returns
        -------
        dict of str to int
        """
        left = {"fitted": self.fitted, "judged": len(self.rows)}
        remaining = len(self.rows)
        for fate in (Fate.FIT, Fate.MOTION, Fate.OCCLUSION, Fate.KIND):
            remaining -= sum(row.fate is fate for row in self.rows)
            left[f"after {fate}"] = remaining
        return left


def shortlist(
    problem: Problem,
    fits: Fits,
    candidates: Sequence[Candidate],
    curve: CharnessCurve,
    kept: Sequence[Candidate],
) -> tuple[MaximumTable, ...]:
    """Make the table of every maximum, in order of time.

    Parameters
    ----------
    problem, fits, candidates, curve
        Results of the earlier stages.
    kept : sequence of Candidate
        Candidates that are used in combinations.

    Returns
    -------
    tuple of MaximumTable
    """
    empty = empty_state(problem)
    bare = _without_furniture(problem)
    nothing = log_posterior(problem, empty)
    chosen = {(c.window, c.scenelet) for c in kept}
    tables = []
    for window in sorted(curve.maxima.tolist()):
        near = slice(max(0, window - 1), window + 2)
        here = [c for c in candidates if abs(c.window - window) <= 1 and c.kind]
        here.sort(key=lambda c: -c.gain)
        own = [c for c in here if (c.window, c.scenelet) in chosen]
        rows = []
        for c in here:
            state = assigned(empty, [c])
            fit = log_posterior(bare, state) - nothing
            values = terms(problem, state)
            motion = sum(values.get(name, 0.0) for name in _SOLID)
            occlusion = c.gain - fit - motion
            fate = Fate.KEPT if any(c is k for k in own) else _fate(c, own, motion, occlusion)
            rows.append(Shortlisted(c, fit, motion, occlusion, fate))
        fitted = int(np.isfinite(fits.cost[near]).sum())
        tables.append(MaximumTable(window, fitted, tuple(rows)))
    return tuple(tables)


def _fate(candidate: Candidate, kept: Sequence[Candidate], motion: float, occlusion: float) -> Fate:
    """The criterion that a candidate which was not kept failed."""
    if any(candidate.kind == k.kind for k in kept):
        return Fate.KIND
    missing = min(k.gain for k in kept) - candidate.gain
    if -motion >= missing:
        return Fate.MOTION
    return Fate.OCCLUSION if -occlusion >= missing else Fate.FIT


def _without_furniture(problem: Problem) -> Problem:
    """The problem with the same scenelets without furniture."""
    return problem._replace(
        boxes=problem.boxes[:0],
        box_first=np.zeros_like(problem.box_first),
        box_object=problem.box_object[:0],
        box_label=problem.box_label[:0],
        box_yaw=problem.box_yaw[:0],
    )
