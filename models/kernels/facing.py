"""Where a scenelet's person faces, given where the lifted poses face, compiled.

Detections alone can hardly tell somebody who sits turned half away from somebody who does not: a
scenelet that fits them may face 60 degrees off. A lifter sees that. So the yaw of a scenelet is a
priori wrapped Cauchy about the one at which it faces, on average over its frames, as the static
path does: a density in closed form, with tails for frames in which the lifter is wrong.
"""

from __future__ import annotations

import math

from imapper_prob.models.jit import compiled
from imapper_prob.models.problem import Problem

__all__ = ["expected_facing", "log_yaw_density"]

_UNKNOWN = 1e-9
"""A mean of directions that is shorter has none."""


@compiled
def expected_facing(problem: Problem, scenelet: int, start: int) -> tuple[float, float]:
    """Cosine and sine of the yaw at which a scenelet faces as the static path; 0, 0 if unknown."""
    first, last = problem.joint_first[scenelet], problem.joint_first[scenelet + 1]
    along, aside = 0.0, 0.0
    for n in range(first, last):
        seen = problem.path_facing[start + n - first]
        own = problem.joint_facing[n]
        along += seen[0] * own[0] + seen[1] * own[1]
        aside += seen[1] * own[0] - seen[0] * own[1]
    length = math.hypot(along, aside)
    if length < _UNKNOWN:
        return 0.0, 0.0
    return along / length, aside / length


@compiled
def log_yaw_density(problem: Problem, scenelet: int, start: int, yaw: float) -> float:
    """Log density of a scenelet's yaw, per radian: wrapped Cauchy, or uniform if nobody looked."""
    along, aside = expected_facing(problem, scenelet, start)
    if along == 0.0 and aside == 0.0:
        return -math.log(2 * math.pi)
    near = math.exp(-problem.facing_spread)
    cosine = along * math.cos(yaw) + aside * math.sin(yaw)
    density = (1.0 - near * near) / (2 * math.pi * (1.0 + near * near - 2.0 * near * cosine))
    return math.log(density)
