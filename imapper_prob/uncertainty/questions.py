"""Questions to the user, ranked by the information their answers would give about the layout.

A question is a statement with an open answer. The mutual information between the layout x and the
answer y, I = E log2 p(y | x) / p(y), is the expected reduction of the entropy of layouts in bits
(Lindley 1956). Both densities are means over draws: for each draw an answer is drawn from its
scene, and compared with the answers of the other draws, those of its layout and all of them. A draw
is left out of its own means, and each layout gets one pseudo-draw that answers like all draws, so
that rare layouts, of which little is known, add nothing.

This estimate is biased: the logarithm of a noisy mean is too low, and neighbours in a chain are
like the draw that is left out. So what it finds after the layouts are moved along the chains
against the answers, where the true information is 0, is subtracted. If no chain ever leaves the
layout in which it is, one cannot tell whether answers differ by layout or by chain: the error is
then unknown.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.errors import InputError
from imapper_prob.models.furniture_statements import Presence
from imapper_prob.models.log_posterior import motion
from imapper_prob.models.settings import NEAREST
from imapper_prob.models.skeleton import PELV, REFERENCE_STATURE
from imapper_prob.models.statement_rows import tell
from imapper_prob.models.statements import DepthOf, JointAt, Measured, Statement
from imapper_prob.models.text import with_error
from imapper_prob.samplers.diagnostics import ShortChainWarning, mean_error
from imapper_prob.sampling.conditioning import statement_values
from imapper_prob.sampling.sample import Samples
from imapper_prob.uncertainty.clusters import ObjectCluster
from imapper_prob.uncertainty.stored import Source, categories_of

__all__ = ["Question", "information", "questions_of", "shifted"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
_CORNERS: Final = 12
"""Number of corners of the polygon about an object."""
_OPEN: Final = 0.03
"""Probability, from 0 or from 1, within which presence or label count as certain."""
_MEASURED: Final[tuple[tuple[str, Literal["height", "stature"], float], ...]] = (
    ("How high is the camera, to 2 cm?", "height", 0.02),
    ("How tall is the person, to 2 cm?", "stature", 0.02),
)
"""Questions that are always included, that of the stature if there is one person, with the standard
deviation of the answer in metres."""
_DEPTH_ERROR: Final = 0.05
"""Relative error of a depth by another system; chosen, as in ``docs/research/told.md``."""
_VIEW_ERROR: Final = 0.05
"""Error along each axis, metres, of a pelvis located by a second camera; chosen."""
_COMPARED: Final = 200
"""Number of draws whose whole motion is computed to choose the frame of the question."""
_FEWEST: Final = 5
"""Least number of draws of a layout whose mean motion is used to choose the frame."""

_SHIFTS: Final = 4
"""Number of times that layouts are moved against answers; their mean is as noisy as one estimate
over two."""

Open = Presence | Measured | DepthOf | JointAt
"""A statement with an open answer."""


@dataclass(frozen=True)
class Question:
    """A question with the expected information of its answer.

    Parameters
    ----------
    text : str
    bits : float
        Expected reduction of the entropy of layouts.
    error : float
        Standard error of ``bits``.
    open : Presence, Measured, DepthOf or JointAt
        The statement with an open answer; see :meth:`answered`.
    """

    text: str
    bits: float
    error: float
    open: Open

    def __repr__(self) -> str:
        return f"Question({self.text!r}, bits={self.bits:.2f}, error={self.error:.2f})"

    def __str__(self) -> str:
        return f"{self.text} {with_error(self.bits, self.error)} bit"

    def answered(self, answer: bool | float | Sequence[float]) -> Statement:
        """The statement that results from an answer.

        Parameters
        ----------
        answer : bool, float or (3,) sequence of float
            Yes or no, a length or depth in metres, or a place: x, y and z in metres.

        Returns
        -------
        Statement

        Raises
        ------
        InputError
            The answer is not yes or no where the question asks for it, or does not have as many
            numbers as it asks for.

        Examples
        --------
        >>> question = posterior.questions()[0]
        >>> question.bits > -1
        True
        """
        if isinstance(self.open, Presence) != isinstance(answer, bool | np.bool_):
            wanted = "True or False" if isinstance(self.open, Presence) else "metres"
            raise InputError(f"{self.text} is answered by {wanted}, not by {answer!r:.60}")
        match self.open:
            case Presence():
                return replace(self.open, there=bool(answer))
            case JointAt():
                x, y, z = _numbers(answer, 3, "x, y and z")
                return replace(self.open, point=(x, y, z))
            case DepthOf():
                return replace(self.open, depths=tuple(_numbers(answer, 1, "a depth")))
        return replace(self.open, value=_numbers(answer, 1, "a length")[0])


def _numbers(answer: bool | float | Sequence[float], count: int, wanted: str) -> list[float]:
    numbers: list[float] = np.ravel(np.asarray(answer, float)).tolist()
    if len(numbers) != count:
        raise InputError(f"an answer of {len(numbers)} numbers; give {wanted} in metres")
    return numbers


def questions_of(
    samples: Samples,
    clusters: Sequence[ObjectCluster],
    source: Source,
    *,
    radius: float,
    rng: np.random.Generator,
) -> tuple[Question, ...]:
    """Questions about a posterior, in descending order of information.

    Parameters
    ----------
    samples : Samples
    clusters : sequence of ObjectCluster
        Objects that questions are about.
    source : Source
        Clip, problem and library of the draws.
    radius : float
        Radius in metres of the region of an object.
    rng : numpy.random.Generator
        Generator for simulated numerical answers.

    Returns
    -------
    tuple of Question
    """
    found = []
    for text, asked in _about_objects(clusters, radius):
        told = tell(source.problem, [asked], source.clip, categories_of(source))
        yes = np.exp(statement_values(told, samples.states))
        found.append(_question(text, asked, samples, np.stack([yes, 1 - yes], -1), rng))
    for text, quantity, std in _MEASURED:
        if quantity == "stature" and len(source.clip.tracks) > 1:
            continue
        number = 1 if quantity == "height" else 3
        values = np.array([state.camera[number] for state in samples.states])
        if number == 3:
            values = REFERENCE_STATURE * np.exp(values)
        open_one = Measured(quantity, float(np.mean(values)), std)
        heard = values + std * rng.standard_normal(len(values))
        densities = _normal(heard[:, None] - values, std**2)
        found.append(_question(text, open_one, samples, densities, rng))
    for text, told_of, densities in _about_people(samples, source, rng):
        found.append(_question(text, told_of, samples, densities, rng))
    return tuple(sorted(found, key=lambda question: -question.bits))


def _about_objects(clusters: Sequence[ObjectCluster], radius: float) -> list[tuple[str, Presence]]:
    """Questions about the presence and the labels of objects."""
    angles = 2 * np.pi * np.arange(_CORNERS) / _CORNERS
    circle = radius * np.stack([np.cos(angles), np.sin(angles)], -1)
    asked = []
    for cluster in clusters:
        x, y = cluster.mean
        region = tuple((float(a), float(b)) for a, b in circle + cluster.mean)
        where = f"({x:.1f}, {y:.1f}) m"
        if _OPEN < cluster.presence < 1 - _OPEN:
            # A label that is all but impossible would be answered by another object near by.
            labels = [label for label, share in cluster.labels.items() if share > _OPEN]
            asked.append((
                f"Is there a {' or '.join(labels)} at {where}?",
                Presence(tuple(labels), region=region),
            ))  # fmt: skip
        for label, share in cluster.labels.items():
            if _OPEN < share < 1 - _OPEN:
                asked.append(
                    (f"Is what stands at {where} a {label}?", Presence((label,), region=region))
                )
    return asked


def _about_people(
    samples: Samples, source: Source, rng: np.random.Generator
) -> list[tuple[str, Open, Array]]:
    """Questions about the depth and the place of each person.

    Each is about the frame in which the two most frequent layouts differ most, see
    :func:`_parted`.

    Parameters
    ----------
    samples : Samples
    source : Source
    rng : numpy.random.Generator
        For the answers.

    Returns
    -------
    list of (str, DepthOf or JointAt, (N, N) float)
        Question, statement, and the density of the answer simulated from each draw under all
        draws.
    """
    clip, problem, states = source.clip, source.problem, samples.states
    chosen = np.unique(np.linspace(0, len(states) - 1, _COMPARED).astype(np.int64))
    paths = np.stack([motion(problem, states[n])[:, PELV] for n in chosen])
    parted = _parted(paths, samples.layouts.indicator[chosen])
    cameras = np.array([state.camera for state in states])
    pose = problem.pose_tolerance[PELV] * np.exp(cameras[:, 3])
    frames = parted.reshape(len(clip.tracks), clip.n_frames).argmax(1)
    rows = np.arange(len(frames)) * clip.n_frames + frames
    pelvises = np.stack([motion(problem, state)[rows, PELV] for state in states], axis=1)
    asked: list[tuple[str, Open, Array]] = []
    for person, points in enumerate(pelvises):
        frame = int(clip.frame_ids[frames[person]])
        who = "the person" if len(clip.tracks) == 1 else clip.tracks[person].name
        along = np.cos(cameras[:, 0]) * points[:, 1]
        along = along + np.sin(cameras[:, 0]) * (points[:, 2] - cameras[:, 1])
        depths = np.maximum(along, NEAREST)
        variance = _DEPTH_ERROR**2 + (pose / depths) ** 2
        heard = np.log(depths) + np.sqrt(variance) * rng.standard_normal(len(depths))
        asked.append((
            f"How far is {who} from the camera in frame {frame}, to {_DEPTH_ERROR:.0%}?",
            DepthOf((frame,), (float(np.exp(heard.mean())),), _DEPTH_ERROR, person=person + 1),
            _normal(heard[:, None] - np.log(depths), variance),
        ))  # fmt: skip
        variance = _VIEW_ERROR**2 + pose**2
        seen = points + np.sqrt(variance)[:, None] * rng.standard_normal(points.shape)
        x, y, z = points.mean(0).tolist()
        densities = [_normal(seen[:, None, k] - points[:, k], variance) for k in range(3)]
        asked.append((
            f"Where is {who} in frame {frame}, to {100 * _VIEW_ERROR:.0f} cm (from a second view)?",
            JointAt("PELV", frame, (x, y, z), _VIEW_ERROR, person + 1),
            densities[0] * densities[1] * densities[2],
        ))  # fmt: skip
    return asked


def _parted(paths: Array, layouts: Ints) -> Array:
    """(T,) separation of the two most frequent layouts in each frame.

    The squared distance of their means over the sum of their variances; if one layout has nearly
    all draws, the variance of all draws.

    Parameters
    ----------
    paths : (N, T, 3) float
        Pelvis in each frame, metres.
    layouts : (N,) int
    """
    names, counts = np.unique(layouts, return_counts=True)
    frequent = names[np.argsort(-counts)][:2]
    if len(names) < 2 or np.sort(counts)[-2] < _FEWEST:
        return np.asarray(paths.var(0).sum(-1))
    one, other = (paths[layouts == name] for name in frequent)
    apart = ((one.mean(0) - other.mean(0)) ** 2).sum(-1)
    # A variance of (1 mm)^2 is added, because all draws of a layout may be equal.
    return np.asarray(apart / ((one.var(0) + other.var(0)).sum(-1) + 1e-6))


def _question(
    text: str, asked: Open, samples: Samples, densities: Array, rng: np.random.Generator
) -> Question:
    bits, error = information(samples.layouts.indicator.reshape(samples.shape), densities, rng=rng)
    return Question(text, bits, error, asked)


def information(
    layouts: Ints, densities: Array, *, rng: np.random.Generator
) -> tuple[float, float]:
    """Mutual information between layouts and an answer, and its standard error, in bits.

    Parameters
    ----------
    layouts : (C, N) int
        Layout of each draw of each chain.
    densities : (C N, C N) or (C N, A) float
        Density of the answer simulated from each draw under all draws; or probabilities of all A
        answers under each draw.
    rng : numpy.random.Generator
        For the shifts of the layouts.

    Returns
    -------
    bits, error : float
        The error is NaN if chains are too short, or if they differ and none changes its layout.
    """
    if densities.shape == (layouts.size, layouts.size):
        np.fill_diagonal(densities := densities.copy(), 0.0)
    gained = _gained(layouts.ravel(), densities)
    gained = gained - np.mean(
        [_gained(moved.ravel(), densities) for moved in shifted(layouts, rng)], axis=0
    )
    if np.ptp(layouts) > 0 and not np.ptp(layouts, axis=1).any():
        return float(gained.mean()), float("nan")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ShortChainWarning)
        error = float(mean_error(gained.reshape(layouts.shape))) if np.ptp(gained) > 0 else 0.0
    return float(gained.mean()), error


def shifted(layouts: Ints, rng: np.random.Generator) -> list[Ints]:
    """Copies of the layouts of chains, moved along all chains by a random number of draws.

    Draws and layouts of a copy have nothing to do with each other, but layouts last as long as they
    do in the chains. They move on into the next chain, because chains that stay in a layout of
    their own would not change otherwise, and by a fourth of a chain at least.

    Parameters
    ----------
    layouts : (C, N) int
    rng : numpy.random.Generator

    Returns
    -------
    list of (C, N) int
        No draw is left where it is, if there are two or more.
    """
    least = max(1, layouts.shape[1] // 4)
    steps = rng.integers(least, max(least + 1, layouts.size - least + 1), _SHIFTS)
    return [np.roll(layouts.ravel(), step).reshape(layouts.shape) for step in steps]


def _gained(layouts: Ints, densities: Array) -> Array:
    """(C N,) bits that the answer of each draw tells, before correction; their mean is biased.

    The diagonal of densities (C N, C N) is 0.
    """
    count = layouts.size
    _, member = np.unique(layouts, return_inverse=True)
    size = np.bincount(member)[member]
    if densities.shape == (count, count):
        # Row m: densities of the answer of draw m under the draws.
        of_all = densities.sum(1) / (count - 1)
        of_layouts = densities @ np.eye(member.max() + 1)[member]
        same = of_layouts[np.arange(count), member]
        # No draw but the one that gives the answer may agree with it: that tells nothing.
        told = of_all > 0
        gained = np.zeros(count)
        gained[told] = np.log2((same + of_all)[told] / size[told] / of_all[told])
        return gained
    of_all = (densities.sum(0) - densities) / (count - 1)
    sums = np.stack([np.bincount(member, column) for column in densities.T], -1)
    of_layout = (sums[member] - densities + of_all) / size[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        terms = densities * np.log2(of_layout / of_all)
    return np.asarray(np.where(densities > 0, terms, 0.0).sum(1))


def _normal(off: Array, variance: float | Array) -> Array:
    return np.asarray(np.exp(-0.5 * off**2 / variance) / np.sqrt(2 * math.pi * variance))
