"""The energy of the published method, on the states of this model.

    E = w_r L_r + w_o L_o + w_s L_s + w_c L_c + w_m L_m         (Monszpart et al. 2019)

    L_r = sum over t, j of c_tj |Pi q_tj - u_tj|^2              reprojection
    L_o = sum over t, j of F(v_tj, c_tj)                        occlusion
    L_s = sum over t of |p_t - p_(t-1)|^2                       smoothness of the pelvis
    L_c = sum over pairs of objects of max(0, -d)               collision of objects
    L_m = sum over t, objects not in use of max(0, -d_t)        motion through objects

with joints q and pelvis p in metres, detections u in normalised image coordinates (pixels
from the principal point over the focal length) of confidence c, clearance v of a line of
sight and signed distance d on the floor, in metres.

Misprints, mended:

* eta_t, which says whether a scenelet covers frame t, is printed with the upper limit
  max(t, n_l) of its sum over starts; it is min(t, n_l). With the maximum a scenelet would
  cover every frame after its start.
* L_m is printed with the signed distance itself and would reward walking through things; it
  takes the negative part, as L_c does.
* L_o is undefined where there is no object; the distance to an empty volume is the cap V,
  and so is every larger one.

Ours, where our notes of the paper give no formula: F, whose properties alone are known; the
pelvis as what is smooth; which columns of the body meet an object and which objects are one
seen twice, both as in the default posterior, so that the two differ in their weights alone.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Final

import numpy as np

from imapper_prob.models.energy.detections import DetectionModel
from imapper_prob.models.errors import InputError
from imapper_prob.models.geometry import NOTHING_IN_SIGHT
from imapper_prob.models.jit import compiled

__all__ = ["SURE_BUT_HIDDEN", "PaperWeights", "occlusion_cost"]


def _sure_but_hidden(tables: DetectionModel) -> float:
    hidden, seen = tables.confidence[:, tables.edges[:-1] < 0.5].sum(1)
    return float(np.log((1 - seen) / (1 - hidden)) / np.log(hidden / seen))


SURE_BUT_HIDDEN: Final = _sure_but_hidden(DetectionModel())
"""What a confident joint costs in the hidden volume, in parts of what an unsure one costs in
the open: by how many nats a confidence above .5 speaks for seen, over those by which one below
speaks for hidden."""


@dataclass(frozen=True)
class PaperWeights:
    """The factors of the five terms.

    The paper gives none. These are the ones of the authors' released program, used in
    normalised image coordinates on clips of 10 frames a second. It smooths with 0.5 at first
    and with 0.05, the value here, later on.

    Raises
    ------
    InputError
        If a weight is negative or not finite.
    """

    reprojection: float = 1.0
    occlusion: float = 1.0
    smoothness: float = 0.05
    collision: float = 20.0
    motion: float = 10.0

    def __post_init__(self) -> None:
        for name in (f.name for f in fields(self)):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0):
                raise InputError(f"weight {name} = {value} must be finite and at least 0")


@compiled
def occlusion_cost(clearance: float, confidence: float) -> float:
    """F(v, c), what it costs a joint to be as hidden and as confidently detected as it is.

        F(v, c) = (1 - c) min(max(v, 0), V) + k c min(max(-v, 0), V)

    with V = ``NOTHING_IN_SIGHT`` and k = ``SURE_BUT_HIDDEN``. In the open, v > 0, an unsure
    joint costs its way to the hidden volume, up to V where nothing hides it. In the volume,
    v < 0, a sure joint costs its way out, but less: detectors are often sure of what they
    cannot see. The form is ours; these properties are the paper's.

    Parameters
    ----------
    clearance : float
        Metres, negative where furniture hides the joint.
    confidence : float
        In [0, 1].

    Returns
    -------
    float
        Metres, in [0, V].
    """
    open_by = min(max(clearance, 0.0), NOTHING_IN_SIGHT)
    hidden_by = min(max(-clearance, 0.0), NOTHING_IN_SIGHT)
    return (1.0 - confidence) * open_by + SURE_BUT_HIDDEN * confidence * hidden_by
