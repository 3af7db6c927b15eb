"""Left and right taken for each other: a hidden state a frame, summed out, compiled.

A detector that sees somebody from behind, or in poor light, can swap all joints of the left
side with those of the right, for a run of frames and at full confidence. Whether frame t is
swapped is a chain s_t of two states with persistent values; what it costs to know nothing of
it is the forward recursion of a hidden Markov model (Rabiner 1989), exact and linear in T:

    log p(u, c | q) = log sum over s of p(s) prod_t p(u_t, c_t | q_t, s_t)^w

with the frame weight w that stands for the correlation of neighbouring frames. The sum itself is
part of every evaluation (:func:`imapper_prob.models.kernels.votes.sum_votes`); here is what each
frame adds to it, and which frames are swapped.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.jit import compiled

__all__ = ["draw_swaps", "filtered", "swap_probabilities"]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


@compiled
def filtered(
    by_frame: Array, starts: Flags, weight: float, begins: float, ends: float
) -> tuple[Array, Array]:
    """What each frame adds to the log-likelihood, and whether it is swapped, given earlier frames.

    Parameters
    ----------
    by_frame : (T, 2) float
        Log-likelihood of each frame as it is, and with sides swapped, nats.
    starts : (T,) bool
        Frames that follow upon nothing: the chain begins anew there.
    weight : float
        Factor on every frame's log-likelihood.
    begins, ends : float
        Probability a frame that a swap begins, and that one ends. The first frame, as any
        start, is swapped as often as any, ``begins / (begins + ends)``.

    Returns
    -------
    shares : (T,) float
        log p(u_t, c_t | all earlier frames), nats; their sum is that of all frames.
    swapped : (T,) float
        Probability that a frame is swapped, given the frames up to it.
    """
    n, usual = len(by_frame), begins / (begins + ends)
    shares, swapped = np.empty(n), np.empty(n)
    predicted = usual
    for t in range(n):
        if starts[t]:
            predicted = usual
        right, wrong = weight * by_frame[t, 0], weight * by_frame[t, 1]
        top = max(right, wrong)
        stays = (1.0 - predicted) * math.exp(right - top)
        turned = predicted * math.exp(wrong - top)
        both = stays + turned
        shares[t] = top + math.log(both)
        swapped[t] = turned / both
        predicted = (stays * begins + turned * (1.0 - ends)) / both
    return shares, swapped


@compiled
def swap_probabilities(
    by_frame: Array, starts: Flags, weight: float, begins: float, ends: float
) -> Array:
    """(T,) probability that each frame is swapped, given all frames (forward-backward).

    Parameters as for :func:`filtered`.
    """
    n, forward = len(by_frame), filtered(by_frame, starts, weight, begins, ends)[1]
    result = forward.copy()
    for t in range(n - 2, -1, -1):
        if starts[t + 1]:
            continue
        # p(s_t | all) = sum over s_{t+1} of p(s_{t+1} | all) p(s_t | s_{t+1}, past).
        now = forward[t]
        to_swapped = (1.0 - now) * begins + now * (1.0 - ends)
        to_right = (1.0 - now) * (1.0 - begins) + now * ends
        result[t] = (
            result[t + 1] * now * (1.0 - ends) / to_swapped
            + (1.0 - result[t + 1]) * now * ends / to_right
        )
    return result


def draw_swaps(
    rng: np.random.Generator,
    n_frames: int,
    *,
    begins: float,
    ends: float,
    starts: Flags | None = None,
) -> Flags:
    """(T,) frames in which left is taken for right: a chain of two states in equilibrium.

    ``begins`` and ``ends`` are probabilities a frame; besides the first frame the chain begins
    anew in ``starts`` (T,).
    """
    uniform = rng.random(n_frames)
    swapped = np.zeros(n_frames, bool)
    for t in range(n_frames):
        anew = t == 0 or (starts is not None and starts[t])
        probability = 1 - ends if swapped[t - 1] else begins
        swapped[t] = uniform[t] < (begins / (begins + ends) if anew else probability)
    return swapped
