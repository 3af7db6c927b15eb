"""The energy of the published method, on the states of this model.

    L = w_r L_r + w_o L_o + w_s L_s + w_c L_c + w_m L_m         (Monszpart et al. 2019, section 5)

    L_r = sum_t sum_k c_tk |Pi q_tk - u_tk|^2                    reprojection
    L_o = sum_t sum_k F(v(q_tk, O), c_tk)                        occlusion
    L_s = sum_t |p_t - p_(t-1)|^2                                smoothness of the pelvis
    L_c = -sum_(i, j) ( int_Li d-_j + int_Lj d-_i )              objects in each other
    L_m = -sum_t min(0, max_q min_i d_i(q))                      motion through objects

with joints q and pelvis p in metres and detections u of confidence c in normalised image
coordinates (pixels from the principal point over the focal length). F and v are in
:mod:`imapper_prob.models.energy.paper_occlusion`, L_c and L_m in
:mod:`imapper_prob.models.energy.paper_intersection`, L_r and L_s in
:mod:`imapper_prob.models.compiled_paper`.

Misprints, mended:

* eta_t, which says whether a scenelet covers frame t, is printed with the upper limit
  max(t, n_l) of its sum over starts; it is min(t, n_l). With the maximum a scenelet would
  cover every frame after its start.
* L_m is printed with the signed distance itself and would reward walking far from things; it
  takes the negative part, as L_c does.
* L_c is printed over pairs with "b_i != b_j and theta_i != theta_j"; the text spares only pairs
  of the same label and the same orientation.
* v is undefined where there is no object; the distance to an empty volume is the cap V of
  ``paper_occlusion``, and so is every larger one.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from imapper_prob.models.errors import InputError

__all__ = ["PaperWeights"]


@dataclass(frozen=True)
class PaperWeights:
    """The factors of the five terms.

    The paper prints none. These are those of the command files that the authors released with
    i3DB, for terms in normalised image coordinates and metres on clips of 10 frames a second. One
    scene (Scene10) has ``occlusion`` 10, the others 1. The files have one weight for
    intersections, which the released program halves where joints meet objects.

    Parameters
    ----------
    reprojection : float
        A unit of squared normalised image coordinates.
    occlusion : float
        A square metre.
    smoothness : float
        A square metre.
    collision : float
        A cubic metre: depth in the other object, over the floor.
    motion : float
        A metre.

    Raises
    ------
    InputError
        If a weight is negative or not finite.
    """

    reprojection: float = 1.0
    occlusion: float = 1.0
    smoothness: float = 0.05
    collision: float = 1.0
    motion: float = 0.5

    def __post_init__(self) -> None:
        for name in (f.name for f in fields(self)):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0):
                raise InputError(f"weight {name} = {value} must be finite and at least 0")
