"""What measurements say of the place and size of a piece of furniture (model.md 27 and 34).

A true piece differs from that of its scenelet by five normal errors: its place along its width and
along its depth (m), and the logs of its width, depth and height. A seat of another kind than in its
scenelet has the mean sides of that kind in place of the scenelet's, with the same errors. Places,
sizes and edges of image boxes are linear in the errors, to first order. So these are summed out
exactly: measured numbers condition them one after the other, and the product of the predictive
densities is the density of all.
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
    "project_outline",
    "resize",
    "set_errors",
]

Array = NDArray[np.float64]
ERRORS: Final = 5
"""Number of errors of a piece."""
LOG_2PI: Final = math.log(2.0 * math.pi)
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


@compiled
def set_errors(piece: Array, spread: Array, mean: Array, covariance: Array) -> None:
    """Set the errors of a piece to their prior.

    Parameters
    ----------
    piece : (7,) float
        Centre (m), half sides (m) and yaw of its bounding box.
    spread : (2,) float
        Standard deviations of its place: along its width, as a share of it, and along its depth, m.
    mean, covariance : (5,), (5, 5) float
        Output.
    """
    mean[:] = 0.0
    covariance[:] = 0.0
    covariance[0, 0] = (2.0 * spread[0] * piece[3]) ** 2
    covariance[1, 1] = spread[1] ** 2
    for a in range(3):
        covariance[2 + a, 2 + a] = SIDE_SPREAD**2


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
    gain, total = np.zeros(ERRORS), variance
    for i in range(ERRORS):
        for j in range(ERRORS):
            gain[i] += covariance[i, j] * slope[j]
    for i in range(ERRORS):
        total += slope[i] * gain[i]
        off -= slope[i] * mean[i]
    for i in range(ERRORS):
        mean[i] += gain[i] * off / total
        for j in range(ERRORS):
            covariance[i, j] -= gain[i] * gain[j] / total
    return log_normal(off, total)


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
        Output: left, top, right and bottom, cut off at the image, pixels; depth of the centre, m.
    slopes : (4, 5) float
        Output: derivatives of the edges by the errors; 0 where an edge is cut off.
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
    for edge in range(4):
        most = lens[4 + edge % 2]
        if not 0.0 < edges[edge] < most:
            edges[edge] = min(max(edges[edge], 0.0), most)
            slopes[edge] = 0.0
    edges[4] = point_to_camera(pose, piece[0], piece[1], piece[2])[1]


@compiled
def measure_box(
    box: Array, std: float, edges: Array, slopes: Array, mean: Array, covariance: Array
) -> float:
    """Condition the errors of a piece on its box in the image.

    Parameters
    ----------
    box : (4,) float
        Left, top, right and bottom, as measured, pixels.
    std : float
        Standard deviation of each, pixels.
    edges, slopes : (5,), (4, 5) float
        See :func:`project_outline`.
    mean, covariance : (5,), (5, 5) float
        Of the errors; changed.

    Returns
    -------
    float
        Log density of the box given what the errors were conditioned on, per px^4.
    """
    total = 0.0
    for edge in range(4):
        off = box[edge] - edges[edge]
        total += _measure(mean, covariance, slopes[edge], off, std * std)
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
    mean, covariance : (5,), (5, 5) float
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
        total += measure_box(said[7:11], said[11], edges, slopes, mean, covariance)
    return total


@compiled
def detection_rate(rate: float, outlines: Array, k: int, person: Array) -> float:
    """Poisson rate of boxes of a piece at which "no box" is as probable as a detector's miss.

    Parameters
    ----------
    rate : float
        Probability of detecting a piece in full view.
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
    return -math.log1p(-rate * _shown(outlines, k, person))


@inner
def _shown(outlines: Array, k: int, person: Array) -> float:
    """Share of a piece's image box that no nearer piece and no person occludes."""
    edges, free, count = outlines[k], 0, len(outlines)
    for i in range(_GRID * _GRID):
        u = edges[0] + (i % _GRID + 0.5) / _GRID * (edges[2] - edges[0])
        v = edges[1] + (i // _GRID + 0.5) / _GRID * (edges[3] - edges[1])
        hidden = False
        for j in range(count + 1):
            if j == k:
                continue
            other = person if j == count else outlines[j]
            over = other[0] < u < other[2] and other[1] < v < other[3]
            hidden = hidden or (over and other[4] < edges[4])
        free += not hidden
    if edges[2] - edges[0] < 1.0 or edges[3] - edges[1] < 1.0:
        return 0.0
    return free / (_GRID * _GRID)
