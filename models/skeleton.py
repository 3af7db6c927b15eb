"""The sixteen joints, by name, and how they are connected.

Left and right are the person's own. The order is that of the i3DB benchmark
(Monszpart et al. 2019), so that its files and scores can be compared directly; code
should still go through the names.
"""

from __future__ import annotations

from typing import Final

__all__ = [
    "BONES",
    "BONE_LENGTHS",
    "DETECTED",
    "HEAD",
    "JOINTS",
    "LANK",
    "LELB",
    "LHIP",
    "LKNE",
    "LSHO",
    "LWRI",
    "MIRROR",
    "NECK",
    "N_JOINTS",
    "PELV",
    "RANK",
    "REFERENCE_STATURE",
    "RELB",
    "RHIP",
    "RKNE",
    "RSHO",
    "RWRI",
    "SCORED",
    "THRX",
]

JOINTS: Final = (
    "RANK", "RKNE", "RHIP", "LHIP", "LKNE", "LANK", "PELV", "THRX",
    "NECK", "HEAD", "RWRI", "RELB", "RSHO", "LSHO", "LELB", "LWRI",
)  # fmt: skip
N_JOINTS: Final = len(JOINTS)
(
    RANK, RKNE, RHIP, LHIP, LKNE, LANK, PELV, THRX,
    NECK, HEAD, RWRI, RELB, RSHO, LSHO, LELB, LWRI,
) = range(N_JOINTS)  # fmt: skip

MIRROR: Final = (
    LANK, LKNE, LHIP, RHIP, RKNE, RANK, PELV, THRX,
    NECK, HEAD, LWRI, LELB, LSHO, RSHO, RELB, RWRI,
)  # fmt: skip
"""``MIRROR[j]`` is the joint on the other side of the body."""

BONES: Final = (
    (RANK, RKNE), (RKNE, RHIP), (RHIP, PELV), (LANK, LKNE), (LKNE, LHIP), (LHIP, PELV),
    (THRX, PELV), (NECK, THRX), (HEAD, NECK),
    (RWRI, RELB), (RELB, RSHO), (RSHO, THRX), (LWRI, LELB), (LELB, LSHO), (LSHO, THRX),
)  # fmt: skip
"""Pairs of joints that a line connects: the one further from the pelvis, then the nearer."""

SCORED: Final = tuple(j for j in range(N_JOINTS) if j not in (PELV, NECK))
"""The fourteen joints of the benchmark's pose score."""

DETECTED: Final = SCORED
"""Joints that a detector reports itself; PELV and NECK are synthesised from others."""

REFERENCE_STATURE: Final = 1.70
"""Stature in metres of the body that ``BONE_LENGTHS`` and the built-in library describe."""

BONE_LENGTHS: Final[dict[tuple[int, int], float]] = {
    (RANK, RKNE): 0.40, (LANK, LKNE): 0.40,
    (RKNE, RHIP): 0.42, (LKNE, LHIP): 0.42,
    (RHIP, LHIP): 0.24,
    (RSHO, LSHO): 0.31,
    (RSHO, RELB): 0.29, (LSHO, LELB): 0.29,
    (RELB, RWRI): 0.25, (LELB, LWRI): 0.25,
    (PELV, THRX): 0.49,
    (THRX, HEAD): 0.25,
}  # fmt: skip
"""Segment lengths in metres of a 1.70 m adult: Drillis and Contini (1966), as tabulated by
Winter, *Biomechanics and Motor Control of Human Movement*, fig. 4.1 (shin .246 H, thigh
.245 H, upper arm .186 H, forearm .146 H); trunk and girdle widths between joint centres,
which lie inside the body's outline."""
