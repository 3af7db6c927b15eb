"""The draw that stands for a layout, and how its objects spread about it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.scene import SceneObject
from imapper_prob.sampling.layouts import match_objects
from imapper_prob.sampling.sample import Samples

__all__ = ["Representative", "representative"]


@dataclass(frozen=True)
class Representative:
    """One draw in place of many.

    Parameters
    ----------
    draw : int
        Its number, chain by chain.
    objects : tuple of SceneObject
        Its furniture, in the order of the layout's founder.
    covariances : (n_objects, 2, 2) float
        Of each object's position over the draws of the layout, square metres.
    """

    draw: int
    objects: tuple[SceneObject, ...]
    covariances: NDArray[np.float64]


def representative(
    samples: Samples, layout: int, *, seen: Sequence[Sequence[SceneObject]], radius: float
) -> Representative:
    """The draw of a layout whose objects are nearest to their mean positions.

    ``seen`` are the objects of all draws and ``radius`` the metres that the layouts were made
    with.
    """
    leader = samples.layouts.leaders[layout]
    founder = seen[leader]
    members = np.flatnonzero(samples.layouts.indicator == layout).tolist()
    partners = {m: match_objects(founder, seen[m], radius=radius) for m in members}
    matched = [(m, partner) for m, partner in partners.items() if partner is not None]
    centres = np.array(
        [[samples.objects[m][k].centre[:2] for k in partner] for m, partner in matched]
    ).reshape(len(matched), len(founder), 2)
    offset = centres - centres.mean(0)
    draw, partner = matched[int((offset**2).sum((1, 2)).argmin())]
    covariances = np.einsum("nki,nkj->kij", offset, offset) / max(len(matched) - 1, 1)
    return Representative(draw, tuple(samples.objects[draw][k] for k in partner), covariances)
