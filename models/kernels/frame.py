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
# sides as they are, hidden and seen; sides swapped, hidden and seen; and the same as chances.
_DENSITY, _CHANCE = 96, 160
DESK = 224
"""Numbers on the desk, the workspace."""
# On the bench, in the order of densities: 1 + r^2 / (dof scale^2), the power it is raised to,
# and the square scale, pixels.
_RATIO, _POWER, _SCALE2 = 0, 64, 128

_SMALLEST = float(np.finfo(np.float64).tiny)
"""No density counts less."""
_OTHER = np.array(MIRROR)
_PER_TURN = 1.0 / (2.0 * math.pi)
_LN2 = math.log(2.0)
_MANTISSA, _UNIT = 0x000FFFFFFFFFFFFF, 0x3FF0000000000000
"""The bits of a mantissa, and those of the exponent of numbers from 1 to 2."""
_BIAS = 1023

# Of single precision, for one number in double makes double of all it meets.
_LOG2E = np.float32(1.0 / math.log(2.0))
_LN2_HIGH, _LN2_LOW = np.float32(0.693359375), np.float32(-2.12194440e-4)
"""ln 2 in two parts, of which multiples of the first are exact."""
_ROUND, _ROUND_BITS = np.float32(12582912.0), 0x4B400000
"""1.5 * 2^23: adding it leaves a number's nearest integer in the lowest bits."""
_HALF_BITS = 0x3F3504F3
"""The bits of sqrt(1/2), from where mantissas are counted."""
_E1, _E2, _E3, _E4, _E5, _E6 = (np.float32(1.0 / math.factorial(n)) for n in range(1, 7))
_L1, _L3, _L5, _L7, _L9 = (np.float32(2.0 / n) for n in (1, 3, 5, 7, 9))
_SINGLE_LN2, _LEAST_POWER = np.float32(_LN2), np.float32(-700.0)
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
def _measure(problem: Problem, t: int, desk: Array, bench: Singles) -> None:
    """Misfit of frame t's detections, by the errors of hidden and of seen joints."""
    keypoints, scales, dofs = problem.keypoints, problem.error_scale, problem.error_dof
    for j in range(16):
        for side in range(2):
            of = _CROSSED * side + j
            du, dv = desk[_U + of] - keypoints[t, j, 0], desk[_V + of] - keypoints[t, j, 1]
            misfit, loose = np.float32(du * du + dv * dv), np.float32(desk[_LOOSE + of])
            for visible in range(2):
                to = 32 * side + 16 * visible + j
                scale, dof = np.float32(scales[t, j, visible]), np.float32(dofs[t, j, visible])
                scale2 = scale * scale + loose
                bench[_RATIO + to] = _E1 + misfit / (dof * scale2)
                bench[_POWER + to] = -_E2 * dof - _E1
                bench[_SCALE2 + to] = scale2


@inlined
def _raise(bench: Singles, desk: Array) -> None:
    """Student's density: every ratio to its power, over its square scale."""
    for j in range(64):
        # ln x = e ln 2 + 2 artanh((f - 1) / (f + 1)) with f in [sqrt(1/2), sqrt 2).
        bits = np.float32(bench[_RATIO + j]).view(np.int32)
        e = np.int32((bits - _HALF_BITS) >> 23)
        f = np.int32(bits - (e << 23)).view(np.float32)
        s = (f - _E1) / (f + _E1)
        z = s * s
        q = (_L1 + _L3 * z) + z * z * ((_L5 + _L7 * z) + z * z * _L9)
        x = max(bench[_POWER + j] * (s * q + np.float32(e) * _SINGLE_LN2), _LEAST_POWER)
        # e^x = 2^n e^r with |r| below ln 2 / 2.
        shifted = x * _LOG2E + _ROUND
        n = shifted - _ROUND
        r = (x - n * _LN2_HIGH) - n * _LN2_LOW
        rr = r * r
        p = ((_E1 + r) + rr * (_E2 + _E3 * r)) + rr * rr * ((_E4 + _E5 * r) + rr * _E6)
        bench[_RATIO + j] = p / bench[_SCALE2 + j]
        bench[_POWER + j] = shifted
    # Single precision ends where detections far off have not yet: so much for its exponent.
    for j in range(64):
        n = np.int64(np.float32(bench[_POWER + j]).view(np.int32)) - _ROUND_BITS
        desk[_DENSITY + j] = bench[_RATIO + j] * np.int64((n + _BIAS) << 52).view(np.float64)


@inlined
def set_chances(
    problem: Problem,
    lens: Lens,
    body: float,
    joints: Array,
    row: int,
    t: int,
    desk: Array,
    bench: Singles,
    chances: Array,
    to: int,
) -> None:
    """Chances of frame t in which a scenelet poses the body, into ``chances[to]`` (64,).

    ``joints[row]`` (3, 16) in the world, metres; ``body`` is how large the person is. Desk and
    bench are workspaces.
    """
    _project(lens, body, joints, row, desk)
    _cross(desk, _U, _CROSSED + _U)
    _cross(desk, _V, _CROSSED + _V)
    _cross(desk, _LOOSE, _CROSSED + _LOOSE)
    _measure(problem, t, desk, bench)
    _raise(bench, desk)
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
            desk[_CHANCE + 32 * side + j] = hidden if used[t, j] else 1.0
            desk[_CHANCE + 32 * side + 16 + j] = seen - hidden if used[t, j] else 0.0
    _cross(desk, _CHANCE + 32, _DENSITY + 32)
    _cross(desk, _CHANCE + 48, _DENSITY + 48)
    for j in range(32):
        chances[to, j] = desk[_CHANCE + j]
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
            shifted = x * _LOG2E + _ROUND
            whole = shifted - _ROUND
            r = (x - whole * _LN2_HIGH) - whole * _LN2_LOW
            rr = r * r
            p = ((_E1 + r) + rr * (_E2 + _E3 * r)) + rr * rr * ((_E4 + _E5 * r) + rr * _E6)
            scale = np.int32((np.float32(shifted).view(np.int32) + 127) << 23).view(np.float32)
            seen[i, j] = least + span / (_E1 + p * scale)


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
