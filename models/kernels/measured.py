"""What measurements say of the place, size and yaw of a piece of furniture (model.md 27 and 34).

A true piece differs from that of its scenelet by six normal errors: its place along its width and
along its depth (m), the logs of its width, depth and height, and its yaw. A seat of another kind
than in its scenelet has the mean sides of that kind in place of the scenelet's, with the same
errors. Places, sizes and edges of image boxes are linear in the errors, to first order. So these
are summed out exactly: measured numbers condition them one after the other, and the product of the
predictive densities is the density of all. An edge that may be outside the picture, where boxes are
cut off, is a mixture; the errors are then conditioned on its most probable case.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.jit import compiled, inner
from imapper_prob.models.kernels.axes import (
    camera_pose,
    point_of_box,
    point_to_camera,
    vector_to_camera,
)
from imapper_prob.models.settings import NEAREST, SIDE_SPREAD

__all__ = [
    "ERRORS",
    "LOG_2PI",
    "detection_rate",
    "log_normal",
    "measure_box",
    "measure_object",
    "normal_cdf",
    "project_outline",
    "resize",
    "set_errors",
    "settle_errors",
    "try_errors",
]

Array = NDArray[np.float64]
ERRORS: Final = 6
"""Number of errors of a piece."""
LOG_2PI: Final = math.log(2.0 * math.pi)
_LEAST: Final = 1e-300
"""Least probability of a case; its log is finite."""
_PASSES: Final = 5
"""Gauss-Newton steps; a test compares draws about their result with the exact distribution."""
_FARTHEST: Final = 4.0
"""Greatest error that a step may reach, in standard deviations of the prior: one in 16,000 is
greater. Without it, steps diverge where precise measurements contradict each other."""
_GRID: Final = 4
"""Points along each side of an object's image box at which occlusion is tested."""


@inner
def log_normal(x: float, variance: float) -> float:
    """Log density of a normal error.

    Parameters
    ----------
    x : float
    variance : float

    Returns
    -------
    float
    """
    return -0.5 * (LOG_2PI + math.log(variance) + x * x / variance)


@inner
def normal_cdf(x: float) -> float:
    """Standard normal distribution function.

    Parameters
    ----------
    x : float

    Returns
    -------
    float
    """
    return 0.5 * math.erfc(-x / math.sqrt(2.0))


@compiled
def set_errors(piece: Array, spread: Array, mean: Array, covariance: Array) -> None:
    """Set the errors of a piece to their prior.

    Parameters
    ----------
    piece : (7,) float
        Centre (m), half sides (m) and yaw of its bounding box.
    spread : (3,) float
        Standard deviations of its place along its width, as a share of it, and along its depth, m;
        and of its yaw, radians.
    mean, covariance : (6,), (6, 6) float
        Output.
    """
    mean[:] = 0.0
    covariance[:] = 0.0
    covariance[0, 0] = (2.0 * spread[0] * piece[3]) ** 2
    covariance[1, 1] = spread[1] ** 2
    for a in range(3):
        covariance[2 + a, 2 + a] = SIDE_SPREAD**2
    covariance[5, 5] = spread[2] ** 2


@compiled
def resize(piece: Array, sides: Array, resized: Array) -> None:
    """Give a piece other sides, about its middle on the floor.

    Parameters
    ----------
    piece : (7,) float
        Centre (m), half sides (m) and yaw of its bounding box.
    sides : (3,) float
        Logs of width, depth and height.
    resized : (7,) float
        Output.
    """
    resized[:] = piece
    for a in range(3):
        resized[3 + a] = 0.5 * math.exp(sides[a])
    resized[2] += resized[5] - piece[5]


@inner
def _measure(mean: Array, covariance: Array, slope: Array, off: float, variance: float) -> float:
    """Condition the errors on one number, and return its log density given the earlier ones.

    The number is ``off`` plus what errors of 0 predict; it changes by ``slope`` with the errors.
    """
    gain = np.empty(ERRORS)
    off, total = _predict(mean, covariance, slope, off, gain)
    total += variance
    _condition(mean, covariance, gain, off, total)
    return log_normal(off, total)


@inner
def _predict(
    mean: Array, covariance: Array, slope: Array, off: float, gain: Array
) -> tuple[float, float]:
    """What is left of ``off`` after the mean errors, and the variance that they give the number."""
    total = 0.0
    for i in range(ERRORS):
        gain[i] = 0.0
        for j in range(ERRORS):
            gain[i] += covariance[i, j] * slope[j]
        total += slope[i] * gain[i]
        off -= slope[i] * mean[i]
    return off, total


@inner
def _condition(mean: Array, covariance: Array, gain: Array, off: float, total: float) -> None:
    """Condition the errors on a number of variance ``total`` that is ``off`` its prediction."""
    for i in range(ERRORS):
        mean[i] += gain[i] * off / total
        for j in range(ERRORS):
            covariance[i, j] -= gain[i] * gain[j] / total


@inner
def _measure_edge(
    mean: Array, covariance: Array, slope: Array, edge: float, said: float, std: float, most: float
) -> float:
    """The same of an edge that is cut off at 0 and ``most``.

    The true edge is inside the picture, or beyond a border; then that border is measured.
    """
    gain = np.empty(ERRORS)
    off, spread = _predict(mean, covariance, slope, said - edge, gain)
    expected, total = said - off, spread + std * std
    root = math.sqrt(max(spread, 1e-18))
    # Where the edge is, given that it was measured and is not cut off.
    there, within = expected + off * spread / total, root / math.sqrt(total) * std
    inside = normal_cdf((most - there) / within) - normal_cdf(-there / within)
    inside_nats = log_normal(off, total) + math.log(max(inside, _LEAST))
    below_nats = log_normal(said, std * std) + math.log(max(normal_cdf(-expected / root), _LEAST))
    above = normal_cdf((expected - most) / root)
    above_nats = log_normal(said - most, std * std) + math.log(max(above, _LEAST))
    top = max(inside_nats, below_nats, above_nats)
    if inside_nats == top:
        _condition(mean, covariance, gain, off, total)
    share = math.exp(inside_nats - top) + math.exp(below_nats - top) + math.exp(above_nats - top)
    return top + math.log(share)


@compiled
def project_outline(
    lens: Array, camera: Array, piece: Array, turn: Array, edges: Array, slopes: Array
) -> None:
    """The box of a piece in the image, and how it changes with the errors of the piece.

    Parameters
    ----------
    lens : (6,) float
        Principal point, focal lengths, and width and height of the image, pixels.
    camera : (5,) float
        Camera parameters of a state.
    piece : (7,) float
        Centre (m), half sides (m) and yaw of its bounding box.
    turn : (2,) float
        Cosine and sine of its yaw.
    edges : (5,) float
        Output: left, top, right and bottom, also outside the image, pixels; depth of the centre, m.
    slopes : (4, 6) float
        Output: derivatives of the edges by the errors.
    """
    pose = camera_pose(camera)
    fx, fy = math.exp(camera[2]) * lens[2], math.exp(camera[2]) * lens[3]
    edges[0], edges[1], edges[2], edges[3] = math.inf, math.inf, -math.inf, -math.inf
    moves = np.zeros((ERRORS, 3))
    for corner in range(8):
        a = piece[3] if corner & 1 else -piece[3]
        b = piece[4] if corner & 2 else -piece[4]
        above = piece[2] + (piece[5] if corner & 4 else -piece[5])
        moves[0, 0], moves[0, 1] = turn[0], turn[1]
        moves[1, 0], moves[1, 1] = -turn[1], turn[0]
        moves[2, 0], moves[2, 1] = a * turn[0], a * turn[1]
        moves[3, 0], moves[3, 1] = -b * turn[1], b * turn[0]
        # A higher piece still stands on the floor.
        moves[4, 2] = above
        x, y = point_of_box(piece, turn[0], turn[1], a, b)
        moves[5, 0], moves[5, 1] = piece[1] - y, x - piece[0]
        right, depth, up = point_to_camera(pose, x, y, above)
        right, up = right / depth, up / depth
        u, v = lens[0] + fx * right, lens[1] - fy * up
        for edge in range(4):
            value = v if edge % 2 else u
            if value < edges[edge] if edge < 2 else value > edges[edge]:
                edges[edge] = value
                for k in range(ERRORS):
                    aside, farther, lifted = vector_to_camera(
                        pose, moves[k, 0], moves[k, 1], moves[k, 2]
                    )
                    farther = farther if depth > NEAREST else 0.0
                    if edge % 2:
                        slopes[edge, k] = -fy * (lifted - up * farther) / depth
                    else:
                        slopes[edge, k] = fx * (aside - right * farther) / depth
    edges[4] = point_to_camera(pose, piece[0], piece[1], piece[2])[1]


@compiled
def measure_box(
    box: Array, std: float, lens: Array, edges: Array, slopes: Array, mean: Array, covariance: Array
) -> float:
    """Condition the errors of a piece on its box in the image.

    Parameters
    ----------
    box : (4,) float
        Left, top, right and bottom, as measured, cut off at the image, pixels.
    std : float
        Standard deviation of each, pixels.
    lens : (6,) float
        See :func:`project_outline`.
    edges, slopes : (5,), (4, 6) float
        See :func:`project_outline`.
    mean, covariance : (6,), (6, 6) float
        Of the errors; changed.

    Returns
    -------
    float
        Log density of the box given what the errors were conditioned on, per px^4.
    """
    total = 0.0
    for edge in range(4):
        total += _measure_edge(
            mean, covariance, slopes[edge], edges[edge], box[edge], std, lens[4 + edge % 2]
        )
    return total


@compiled
def measure_object(
    said: Array, lens: Array, camera: Array, piece: Array, turn: Array, mean: Array,
    covariance: Array,
) -> float:  # fmt: skip
    """Condition the errors of a piece on a measured place, size and image box.

    Parameters
    ----------
    said : (12 or more,) float
        x, y, their standard deviation (m), width, depth, height, theirs (m), left, top, right,
        bottom, and theirs (px). Parts with deviation 0 were not measured.
    lens, camera, piece, turn
        See :func:`project_outline`.
    mean, covariance : (6,), (6, 6) float
        Of the errors; changed.

    Returns
    -------
    float
        Log density of all that was measured.
    """
    total, slope = 0.0, np.zeros(ERRORS)
    if said[2] > 0.0:
        slope[0], slope[1] = turn[0], -turn[1]
        total += _measure(mean, covariance, slope, said[0] - piece[0], said[2] ** 2)
        slope[0], slope[1] = turn[1], turn[0]
        total += _measure(mean, covariance, slope, said[1] - piece[1], said[2] ** 2)
    if said[6] > 0.0:
        for a in range(3):
            slope[:] = 0.0
            slope[2 + a] = 2.0 * piece[3 + a]
            total += _measure(mean, covariance, slope, said[3 + a] - slope[2 + a], said[6] ** 2)
    if said[11] > 0.0:
        edges, slopes = np.empty(5), np.empty((4, ERRORS))
        project_outline(lens, camera, piece, turn, edges, slopes)
        total += measure_box(said[7:11], said[11], lens, edges, slopes, mean, covariance)
    return total


@inner
def _displace(box: Array, errors: Array, piece: Array, turn: Array) -> None:
    """Give a piece errors: place, sides and yaw; it still stands on the floor.

    Parameters
    ----------
    box : (7,) float
        Centre (m), half sides (m) and yaw of its bounding box.
    errors : (6,) float
        Along its own axes (m), logs of its sides, and yaw (radians).
    piece : (7,) float
        Output: the box with errors.
    turn : (2,) float
        Output: cosine and sine of its yaw.
    """
    piece[:] = box
    piece[6] += errors[5]
    turn[0], turn[1] = math.cos(piece[6]), math.sin(piece[6])
    piece[0] += turn[0] * errors[0] - turn[1] * errors[1]
    piece[1] += turn[1] * errors[0] + turn[0] * errors[1]
    for a in range(3):
        piece[3 + a] *= math.exp(errors[2 + a])
    piece[2] *= math.exp(errors[4])


@inner
def _swing(aside: float, ahead: float, mean: Array, covariance: Array) -> None:
    """Add to errors of place those that a turn adds to a piece displaced by (aside, ahead)."""
    mean[0] -= ahead * mean[5]
    mean[1] += aside * mean[5]
    for i in range(ERRORS):
        covariance[0, i] -= ahead * covariance[5, i]
        covariance[1, i] += aside * covariance[5, i]
    for i in range(ERRORS):
        covariance[i, 0] -= ahead * covariance[i, 5]
        covariance[i, 1] += aside * covariance[i, 5]


@compiled
def settle_errors(
    said: Array, lenses: Array, camera: Array, box: Array, before: Array, spread: Array,
    mean: Array, covariance: Array,
) -> float:  # fmt: skip
    """Condition the errors of a piece on all that was measured of it, about their most probable
    values, which Gauss-Newton steps find.

    Parameters
    ----------
    said, lenses : (M, 12), (M, 6) float
        What was measured, and in which picture; see :func:`measure_object`.
    camera : (5,) float
        Camera parameters of a state.
    box : (7,) float
        Centre (m), half sides (m) and yaw of the piece without errors.
    before, spread : (6,), (6, 6) float
        Mean and covariance of the errors without the measurements.
    mean, covariance : (6,), (6, 6) float
        Output: these given the measurements.

    Returns
    -------
    float
        Log density of all that was measured, linear about the mean.
    """
    about, piece, turn, total = before.copy(), np.empty(len(box)), np.empty(2), 0.0
    for _ in range(_PASSES):
        mean[:], covariance[:], total = before - about, spread, 0.0
        _displace(box, about, piece, turn)
        _swing(about[0], about[1], mean, covariance)
        for m in range(len(said)):
            total += measure_object(said[m], lenses[m], camera, piece, turn, mean, covariance)
        _swing(-about[0], -about[1], mean, covariance)
        for i in range(ERRORS):
            farthest = _FARTHEST * math.sqrt(spread[i, i])
            step = about[i] + mean[i] - before[i]
            about[i] = before[i] + min(max(step, -farthest), farthest)
    mean[:] = about
    return total


@compiled
def try_errors(
    said: Array, lenses: Array, camera: Array, box: Array, spread: Array, tries: Array, logs: Array
) -> None:
    """Draw errors of a piece given all that was measured of it and its yaw, with their weights.

    They are normal as :func:`settle_errors` finds. The weights correct for that.

    Parameters
    ----------
    said, lenses, camera, box
        See :func:`settle_errors`.
    spread : (6, 6) float
        Covariance of the errors without the measurements, diagonal.
    tries : (N, 6) float
        Standard normal numbers, and the errors of yaw, radians. Output: the errors.
    logs : (N,) float
        Output: logs of the weights, where yaws are drawn from their distribution without the
        measurements.
    """
    before, normal, root = np.zeros(ERRORS), np.empty(ERRORS), np.zeros((ERRORS, ERRORS))
    mean, covariance, rest = np.empty(ERRORS), np.empty((ERRORS, ERRORS)), spread.copy()
    piece, turn, exact = np.empty(len(box)), np.empty(2), np.zeros((ERRORS, ERRORS))
    rest[5, 5] = 0.0
    for i in range(len(tries)):
        before[5], normal[:], total = tries[i, 5], tries[i], 0.0
        settle_errors(said, lenses, camera, box, before, rest, mean, covariance)
        tries[i] = mean
        for a in range(ERRORS - 1):
            for b in range(a + 1):
                left = covariance[a, b]
                for c in range(b):
                    left -= root[a, c] * root[b, c]
                root[a, b] = math.sqrt(max(left, _LEAST)) if a == b else left / root[b, b]
                tries[i, a] += root[a, b] * normal[b]
            total += math.log(root[a, a]) + 0.5 * normal[a] ** 2
            total -= 0.5 * tries[i, a] ** 2 / spread[a, a]
        _displace(box, tries[i], piece, turn)
        mean[:] = 0.0
        for m in range(len(said)):
            total += measure_object(said[m], lenses[m], camera, piece, turn, mean, exact)
        logs[i] = total


@compiled
def detection_rate(rate: float, lens: Array, outlines: Array, k: int, person: Array) -> float:
    """Poisson rate of boxes of a piece at which "no box" is as probable as a detector's miss.

    Parameters
    ----------
    rate : float
        Probability of detecting a piece in full view.
    lens : (6,) float
        See :func:`project_outline`.
    outlines : (K, 5) float
        Left, top, right, bottom (px) and depth (m) of all pieces.
    k : int
        Which of them.
    person : (5,) float
        The same of the person.

    Returns
    -------
    float
    """
    return -math.log1p(-rate * _shown(lens, outlines, k, person))


@inner
def _shown(lens: Array, outlines: Array, k: int, person: Array) -> float:
    """Share of a piece's image box that no nearer piece and no person occludes.

    The share is estimated from points; its mean given their number (with Jeffreys' prior) is
    neither 0 nor 1, for a piece without a free point may be seen between them.
    """
    free, count = 0, len(outlines)
    left, right = max(outlines[k, 0], 0.0), min(outlines[k, 2], lens[4])
    top, bottom = max(outlines[k, 1], 0.0), min(outlines[k, 3], lens[5])
    if right - left < 1.0 or bottom - top < 1.0:
        return 0.0
    for i in range(_GRID * _GRID):
        u = left + (i % _GRID + 0.5) / _GRID * (right - left)
        v = top + (i // _GRID + 0.5) / _GRID * (bottom - top)
        hidden = False
        for j in range(count + 1):
            if j == k:
                continue
            other = person if j == count else outlines[j]
            over = other[0] < u < other[2] and other[1] < v < other[3]
            hidden = hidden or (over and other[4] < outlines[k, 4])
        free += not hidden
    return (free + 0.5) / (_GRID * _GRID + 1)
