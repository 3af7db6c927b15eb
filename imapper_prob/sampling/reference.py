"""The reference: a distribution of scenes, learnt from visits, that can be sampled directly.

It takes the place of the prior in tempering (Surjanovic, Syed, Bouchard-Côté & Campbell 2022,
NeurIPS): at inverse temperature beta chains sample reference^(1 - beta) posterior^beta. At beta = 0
scenes are drawn independently, so each replica that travels from there to the posterior brings an
independent scene. The quality of the reference affects only the speed of mixing, not the result.

A scene is drawn as follows.

1. Camera and body come from a multivariate t distribution with mean and covariance of the visits.
2. Scenelets are drawn one after another in time, as a semi-Markov chain. The next scenelet comes
   from a mixture: what followed furniture of the same kind that ended at about this frame
   (*followed*), whatever came next after this frame (*later*), a scenelet of similar motion instead
   of that (*similar*), one that explains the detections well (*fitting*,
   :mod:`imapper_prob.sampling.gains`), one of these that begins in this frame, often with furniture
   of the same kind (*flush*), and any scenelet at any start (*anywhere*). Each component but
   *flush* may end the scene. The weights of the components are those that best predict one half
   of the visits from the other.
3. The placement of a scenelet is given by the position of the pelvis in its first frame, in camera
   coordinates (:mod:`imapper_prob.models.view`). The visits of all scenelets determine the mean
   position in each frame; a displacement from it is drawn. A scenelet that is flush with the one
   before it continues from its last pelvis. After a gap it has a part of the displacement of
   the one before, because the error of the path persists. Yaw and size are about those of visits
   of this scenelet, above all of those that begin in nearly the same frame, and of similar ones.
   Means are transformed to the drawn camera (:mod:`imapper_prob.sampling.image_pelvis`) and depend
   on it linearly beyond that. With a small probability the placement comes from the prior.
4. The latent variables of the path have their normal distribution, which the densities here do not
   include.

All densities are normalised over the scenes in which scenelets begin ahead of the camera.
:mod:`imapper_prob.sampling.reference_density` computes them, with the placements of step 3 in
:mod:`imapper_prob.sampling.reference_placement`; :mod:`imapper_prob.sampling.redraws` draws, and
:mod:`imapper_prob.sampling.learning` learns.
"""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from imapper_prob.sampling.jit import inner, inner_inlined

__all__ = [
    "ANYWHERE",
    "COMPONENTS",
    "DOF",
    "END_PROBABILITY",
    "FIRST",
    "FITTING",
    "FLUSH",
    "FLUSH_NEXT",
    "FOLLOWED",
    "GAP",
    "LATER",
    "NONE_BEFORE",
    "PRIOR_PLACEMENT_WEIGHT",
    "SAME_KIND",
    "SIMILAR",
    "START",
    "Reference",
    "draw_summed",
    "log_t",
]  # fmt: skip

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

START: Final[Any] = np.int64(0)
"""Index of the first scenelet and of the first frame, and the kind before it. It is an int64,
because numba compiles callees anew for a literal."""
NONE_BEFORE: Final[Any] = np.int64(-1)
"""End of the scenelet before the first one; an int64 like ``START``."""
END_PROBABILITY: Final = 0.2
"""Probability that the components fitting and anywhere end the scene; chosen."""
SAME_KIND: Final = 0.75
"""Probability that a scenelet of the component flush has furniture of the kind of the one before;
chosen."""
PRIOR_PLACEMENT_WEIGHT: Final = 0.05
"""Probability that a placement comes from the prior; chosen."""
DOF: Final = 5.0
"""Degrees of freedom for camera and placements: heavy tails for unvisited values; chosen."""
COMPONENTS: Final = 6
FOLLOWED, LATER, SIMILAR, FITTING, ANYWHERE, FLUSH_NEXT = range(COMPONENTS)
"""Components of the mixture."""
FIRST, FLUSH, GAP = range(3)
"""Rows of the displacement factors: the first scenelet, one that is flush with the one before it,
and one that begins later."""


class Reference(NamedTuple):
    """A distribution of scenes of L scenelets in T frames.

    The *code* of a next scenelet is start L + scenelet; the code of the end of the scene is T L.
    Rows hold codes in ascending order with their probabilities.

    Parameters
    ----------
    camera_mean, camera_factor : (5,), (5, 5) float
        Mean, and lower Cholesky factor of the scale matrix.
    camera_constant : float
        Log density at the mean, nats.
    library_camera : (5,) float
        Camera for which ``path`` holds.
    kinds, lengths : (L,) int
        Kind of furniture, from 1 (0 is the beginning of the scene), and number of frames.
    pelvis : (L, 2, 3) float
        Pelvis in the first and last frame, local frame, metres of the reference body.
    frames_left : (T + 1,) int
        Number of frames from each frame to the end of its person's frames.
    path : (T, 2) float
        Mean bearing and log depth of the pelvis in each frame.
    yaw : (T, L) float
        Mean yaw of each scenelet by its start, radians.
    size : float
        Mean log size.
    scenelet_deviations : (L, 2, 4) float
        Mean deviation of each scenelet from these means in its first and in its last frame:
        bearing, log depth, yaw, log size.
    start_deviations : (T, L, 4) single
        Further mean deviation of each scenelet by its start.
    rarely_visited : (L,) int
        1 for scenelets with too few visits of their own.
    weights : (6,) float
        Weights of the mixture's components: followed, later, similar, fitting, anywhere, flush.
    followed_first, followed, followed_probability : (K (T + 1) + 1,), (E,), (E,)
        Rows by kind, then by the frame at which the scenelet before ended.
    later_first, later, later_probability : (T + 2,), (F,), (F,)
        Rows by that frame only.
    later_similar : (F,) float
        ``later_probability`` divided by the sum of the similarity weights of all scenelets that fit
        at the same start; 0 for the end of the scene.
    similar_to : (L, L) float
        Weight by which each scenelet replaces each other one or itself; its columns are not
        normalised.
    similar_sums : (L, L) float
        Running sums of the weights for replacing each scenelet, over others in order of length.
    hazard, survival, fitting : (T + 1,), (T + 1,), (T + 1, L) float
        Sequences by gains, see :class:`imapper_prob.sampling.gains.Sequences`.
    fitting_sums : (T + 1, L) float
        Running sums of the rows of ``fitting``.
    fitting_kinds : (T + 1, K) float
        Sums of these over the scenelets of each kind, and over all in the first column; 0 where
        nothing fits.
    n_fitting_starts : (T + 2,) int
        Number of pairs of scenelet and start, from each frame on, that fit.
    by_length : (L,) int
        Scenelets in order of length.
    anywhere_mean, anywhere_deviation : (2,) float
        Mean and standard deviation of bearing and log depth in the prior.
    size_spread : float
        Prior standard deviation of the log size.
    displacement_regression : (2, 4, 4) float
        Regression of a displacement on that of the scenelet before, flush or after a gap.
    camera_regression : (3, 4, 5) float
        Regression of a displacement on the deviation of camera and body from their means.
    factors, constants : (3, 2, 4, 4), (3, 2) float
        Lower Cholesky factors of displacements, and log densities at their centres; the second
        column is for scenelets with too few visits.
    """

    camera_mean: Array
    camera_factor: Array
    camera_constant: float
    library_camera: Array
    kinds: Ints
    lengths: Ints
    pelvis: Array
    frames_left: Ints
    path: Array
    yaw: Array
    size: float
    scenelet_deviations: Array
    start_deviations: NDArray[np.float32]
    rarely_visited: Ints
    weights: Array
    followed_first: Ints
    followed: Ints
    followed_probability: Array
    later_first: Ints
    later: Ints
    later_probability: Array
    later_similar: Array
    similar_to: Array
    similar_sums: Array
    hazard: Array
    survival: Array
    fitting: Array
    fitting_sums: Array
    fitting_kinds: Array
    n_fitting_starts: Ints
    by_length: Ints
    anywhere_mean: Array
    anywhere_deviation: Array
    size_spread: float
    displacement_regression: Array
    camera_regression: Array
    factors: Array
    constants: Array


@inner
def draw_summed(sums: Array, row: int, n: int, rng: np.random.Generator) -> int:
    """Draw an index below ``n`` with given weights, never one of weight 0.

    Parameters
    ----------
    sums : (R, n or more) float
        Running sums of the weights.
    row : int
    n : int
    rng : numpy.random.Generator

    Returns
    -------
    int
    """
    level = rng.random() * sums[row, n - 1]
    low, high = 0, n - 1
    while low < high:
        middle = (low + high) // 2
        if sums[row, middle] > level:
            high = middle
        else:
            low = middle + 1
    return low


@inner_inlined
def log_t(offset: Array, factor: Array, constant: float) -> float:
    """Log density of a multivariate t distribution of :data:`DOF` degrees of freedom.

    Parameters
    ----------
    offset : (n,) float
        Offset from the centre; it is overwritten.
    factor : (n, n) float
        Lower Cholesky factor of the scale matrix.
    constant : float
        Log density at the centre.

    Returns
    -------
    float
    """
    n, square = len(offset), 0.0
    for i in range(n):
        for j in range(i):
            offset[i] -= factor[i, j] * offset[j]
        offset[i] /= factor[i, i]
        square += offset[i] * offset[i]
    return constant - 0.5 * (DOF + n) * math.log1p(square / DOF)
