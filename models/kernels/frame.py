"""The log-likelihood of a frame, its sixteen joints side by side, compiled.

What is computed is equation (11) of ``docs/model.md``, in two steps. The chances of a frame,
how likely its detections are if a joint is hidden and if it is seen, follow from the pose and
the camera; weighing them needs how visible the joints are. Furniture that moves changes but
the second.

Exponentials and logarithms are written out (Cody and Waite 1980: reduce, then a polynomial),
for a call of the library's would keep the compiler from working on many joints in one
instruction; they are as exact as their precision.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.jit import compiled, inlined
from imapper_prob.models.kernels.sight import Singles
from imapper_prob.models.limits import NEAREST
from imapper_prob.models.problem import Problem
from imapper_prob.models.skeleton import MIRROR

__all__ = [
    "CHANCES", "DESK", "Lens", "find_seen", "lens_of", "set_chances", "set_own_chances", "weigh",
]  # fmt: skip

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Lens = tuple[float, float, float, float, float, float, float, float, float, float]
"""Both focal lengths, the principal point and the pose's doubt of one metre's depth, in
pixels; cosine and sine of the camera's pitch, its elevation, cosine and sine of its roll."""

CHANCES = 64
"""Of a frame: densities of the detections of hidden joints, and by how much those of seen
joints are greater; both for sides as they are and then swapped. A joint is in its own place,
whichever side's detection it answers for: only their product counts."""

# Where the rows of the desk start: pixels, and square pixels of the pose's doubt, of the
# joints and then of those of the other side;
_U, _V, _LOOSE = 0, 16, 32
_CROSSED = 48
# sides as they are, hidden and seen; sides swapped, hidden and seen:
_DENSITY = 96  # 1 + r^2 / (dof scale^2), then the density
_POWER = _DENSITY + 64
_SCALE2 = _POWER + 64  # square pixels
DESK = _SCALE2 + 64
"""Numbers on the desk, the workspace."""

_SMALLEST = float(np.finfo(np.float64).tiny)
"""No density counts less."""
_OTHER = np.array(MIRROR)
_PER_TURN = 1.0 / (2.0 * math.pi)
_LOG2E = 1.0 / math.log(2.0)
_LN2_HIGH = 6.93147180369123816490e-01
_LN2_LOW = 1.90821492927058770002e-10
"""ln 2 in two parts, of which multiples of the first are exact."""
_LN2 = math.log(2.0)
_ROUND = 6755399441055744.0
"""1.5 * 2^52: adding it leaves a number's nearest integer in the lowest bits."""
_E2, _E3, _E4, _E5, _E6, _E7, _E8, _E9, _E10, _E11, _E12 = (
    1.0 / math.factorial(n) for n in range(2, 13)
)
_HALF_BITS = 0x3FE6A09E667F3BCD
"""The bits of sqrt(1/2), from where mantissas are counted."""
_MANTISSA, _UNIT = 0x000FFFFFFFFFFFFF, 0x3FF0000000000000
"""The bits of a mantissa, and those of the exponent of numbers from 1 to 2."""
_BIAS = 1023

# The same in single precision, in which lines of sight are.
_F1, _F2, _F3, _F4, _F5, _F6 = (np.float32(1.0 / math.factorial(n)) for n in range(1, 7))
_SINGLE_LOG2E, _SINGLE_ROUND = np.float32(_LOG2E), np.float32(12582912.0)
_SINGLE_LN2_HIGH, _SINGLE_LN2_LOW = np.float32(0.693359375), np.float32(-2.12194440e-4)
_FAR = np.float32(30.0)
"""Widths of the step of visibility; farther from it the probability is what it is there."""


@compiled
def lens_of(problem: Problem, camera: Array) -> Lens:
    """What projection needs of a camera (5,)."""
    focal = math.exp(camera[2])
    fx, fy = focal * problem.fx, focal * problem.fy
    return (
        fx, fy, problem.cx, problem.cy, fx * problem.pose_tolerance,
        math.cos(camera[0]), math.sin(camera[0]), camera[1],
        math.cos(camera[4]), math.sin(camera[4]),
    )  # fmt: skip


@inlined
def _project(lens: Lens, body: float, joints: Array, row: int, desk: Array) -> None:
    """Pixels of the joints ``joints[row]``, and how loosely a scenelet's pose holds there."""
    fx, fy, cx, cy, doubt, cp, sp, elevation, cr, sr = lens
    # A larger body differs by more: else distance alone would seem to fit better.
    doubt *= body
    for j in range(16):
        x, y, z = joints[row, 0, j], joints[row, 1, j], joints[row, 2, j] - elevation
        nearness = 1.0 / max(cp * y + sp * z, NEAREST)
        up = -sp * y + cp * z
        desk[_U + j] = cx + fx * (cr * x + sr * up) * nearness
        desk[_V + j] = cy - fy * (cr * up - sr * x) * nearness
        desk[_LOOSE + j] = (doubt * nearness) * (doubt * nearness)


@inlined
def _cross(desk: Array, of: int, to: int) -> None:
    """A row of the desk with the joints of the other side."""
    for j in range(16):
        desk[to + j] = desk[of + _OTHER[j]]


@inlined
def _measure(problem: Problem, t: int, desk: Array) -> None:
    """Misfit of frame t's detections, by the errors of hidden and of seen joints."""
    keypoints, scales, dofs = problem.keypoints, problem.error_scale, problem.error_dof
    for j in range(16):
        for side in range(2):
            of = _CROSSED * side + j
            du, dv = desk[_U + of] - keypoints[t, j, 0], desk[_V + of] - keypoints[t, j, 1]
            for visible in range(2):
                to = 32 * side + 16 * visible + j
                scale, dof = scales[t, j, visible], dofs[t, j, visible]
                scale2 = scale * scale + desk[_LOOSE + of]
                desk[_DENSITY + to] = 1.0 + (du * du + dv * dv) / (dof * scale2)
                desk[_POWER + to] = -0.5 * dof - 1.0
                desk[_SCALE2 + to] = scale2


@inlined
def _raise(desk: Array) -> None:
    """Student's density: every ratio to its power, over its square scale."""
    for j in range(64):
        # ln x = e ln 2 + 2 artanh((f - 1) / (f + 1)) with f in [sqrt(1/2), sqrt 2).
        bits = np.float64(desk[_DENSITY + j]).view(np.int64)
        e = (bits - _HALF_BITS) >> 52
        f = np.int64(bits - (e << 52)).view(np.float64)
        s = (f - 1.0) / (f + 1.0)
        z = s * s
        zz = z * z
        q = (1.0 + 1 / 3 * z) + zz * ((1 / 5 + 1 / 7 * z) + zz * (1 / 9 + 1 / 11 * z))
        q += zz * zz * zz * ((1 / 13 + 1 / 15 * z) + zz * ((1 / 17 + 1 / 19 * z) + 1 / 21 * zz))
        x = desk[_POWER + j] * (2.0 * s * q + np.float64(e) * _LN2)
        # e^x = 2^n e^r with |r| below ln 2 / 2.
        shifted = max(x, -700.0) * _LOG2E + _ROUND
        n = shifted - _ROUND
        r = (max(x, -700.0) - n * _LN2_HIGH) - n * _LN2_LOW
        rr = r * r
        p = ((_E8 + _E9 * r) + rr * (_E10 + _E11 * r)) + rr * rr * _E12
        p = ((1.0 + r) + rr * (_E2 + _E3 * r)) + rr * rr * (
            ((_E4 + _E5 * r) + rr * (_E6 + _E7 * r)) + rr * rr * p
        )
        scale = np.int64((np.float64(shifted).view(np.int64) + _BIAS) << 52).view(np.float64)
        desk[_DENSITY + j] = p * scale / desk[_SCALE2 + j]


@inlined
def set_chances(
    problem: Problem,
    lens: Lens,
    body: float,
    joints: Array,
    row: int,
    t: int,
    desk: Array,
    chances: Array,
    to: int,
) -> None:
    """Chances of frame t in which a scenelet poses the body, into ``chances[to]`` (64,).

    ``joints[row]`` (3, 16) in the world, metres; ``body`` is how large the person is.
    """
    _project(lens, body, joints, row, desk)
    _cross(desk, _U, _CROSSED + _U)
    _cross(desk, _V, _CROSSED + _V)
    _cross(desk, _LOOSE, _CROSSED + _LOOSE)
    _measure(problem, t, desk)
    _raise(desk)
    confidence = problem.confidence_density
    for j in range(16):
        hidden, seen = confidence[t, j, 0] * _PER_TURN, confidence[t, j, 1] * _PER_TURN
        desk[_DENSITY + j] *= hidden
        desk[_DENSITY + 16 + j] *= seen
        desk[_DENSITY + 32 + j] *= hidden
        desk[_DENSITY + 48 + j] *= seen
    _give_chances(problem, t, desk, chances, to)


@inlined
def set_own_chances(problem: Problem, t: int, desk: Array, chances: Array, to: int) -> None:
    """Chances of frame t in its own pose, which no camera changes, into ``chances[to]`` (64,)."""
    static = problem.static_density
    for j in range(16):
        desk[_DENSITY + j] = static[0, t, j, 0]
        desk[_DENSITY + 16 + j] = static[0, t, j, 1]
    for j in range(16):
        desk[_DENSITY + 32 + j] = static[1, t, j, 0]
        desk[_DENSITY + 48 + j] = static[1, t, j, 1]
    _give_chances(problem, t, desk, chances, to)


@inlined
def _give_chances(problem: Problem, t: int, desk: Array, chances: Array, to: int) -> None:
    """Densities on the desk as chances: see ``CHANCES``."""
    used = problem.used
    for j in range(16):
        for side in range(2):
            hidden, seen = desk[_DENSITY + 32 * side + j], desk[_DENSITY + 32 * side + 16 + j]
            # What was not detected says nothing.
            desk[_POWER + 32 * side + j] = hidden if used[t, j] else 1.0
            desk[_POWER + 32 * side + 16 + j] = seen - hidden if used[t, j] else 0.0
    _cross(desk, _POWER + 32, _DENSITY + 32)
    _cross(desk, _POWER + 48, _DENSITY + 48)
    for j in range(32):
        chances[to, j] = desk[_POWER + j]
        chances[to, 32 + j] = desk[_DENSITY + 32 + j]


@compiled
def find_seen(
    gaps: Singles, rows: Ints, n: int, width: float, surprise: float, seen: Singles
) -> None:
    """Probability of being seen: :func:`imapper_prob.models.energy.occlusion.p_seen`.

    Parameters
    ----------
    gaps : (R, 16) single
        Clearance of every joint, metres, of which the first ``n`` of ``rows`` are asked for.
    width, surprise : float
        Of the step of visibility.
    seen : (n or more, 16) single
        Out.
    """
    sharpness, least = np.float32(1.0 / width), np.float32(surprise)
    span = np.float32(1.0 - 2.0 * surprise)
    for i in range(n):
        row = rows[i]
        for j in range(16):
            x = -min(max(gaps[row, j] * sharpness, -_FAR), _FAR)
            shifted = x * _SINGLE_LOG2E + _SINGLE_ROUND
            whole = shifted - _SINGLE_ROUND
            r = (x - whole * _SINGLE_LN2_HIGH) - whole * _SINGLE_LN2_LOW
            rr = r * r
            p = ((_F1 + r) + rr * (_F2 + _F3 * r)) + rr * rr * ((_F4 + _F5 * r) + rr * _F6)
            scale = np.int32((np.float32(shifted).view(np.int32) + 127) << 23).view(np.float32)
            seen[i, j] = least + span / (_F1 + p * scale)


@inlined
def weigh(chances: Array, row: int, seen: Singles, at: int, desk: Array) -> tuple[float, float]:
    """log p(u, c | q, m) of a frame, nats: as it is, and with sides swapped.

    Parameters
    ----------
    chances : (R, 64) float
        The frame's are in row ``row``.
    seen : (R, 16) single
        Probability of every joint's being seen; the frame's is in row ``at``.
    desk : (DESK,) float
        Workspace.
    """
    for j in range(16):
        share = np.float64(seen[at, j])
        right = chances[row, j] + share * chances[row, 16 + j]
        wrong = chances[row, 32 + j] + share * chances[row, 48 + j]
        desk[j], desk[16 + j] = max(right, _SMALLEST), max(wrong, _SMALLEST)
    # Logarithms are dear: one of the product of all mantissas, which cannot underflow.
    for j in range(32):
        bits = np.float64(desk[j]).view(np.int64)
        desk[j] = np.int64((bits & _MANTISSA) | _UNIT).view(np.float64)
        desk[32 + j] = np.float64((bits >> 52) - _BIAS)
    right, wrong, twos_right, twos_wrong = 1.0, 1.0, 0.0, 0.0
    for j in range(16):
        right *= desk[j]
        wrong *= desk[16 + j]
        twos_right += desk[32 + j]
        twos_wrong += desk[48 + j]
    return math.log(right) + twos_right * _LN2, math.log(wrong) + twos_wrong * _LN2
