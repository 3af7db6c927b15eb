"""Recursions over frames in log2 T steps, all frames at once.

A recursion whose steps compose is solved by doubling: after step k every frame holds the
composition of the 2^k steps that end in it (Hillis and Steele 1986). A loop over frames does
less arithmetic but starts thousands of small operations, and as many more for the gradient.
"""

from __future__ import annotations

import torch
from torch import Tensor

__all__ = ["affine_scan", "log_product"]


def _strides(n: int) -> list[int]:
    return [2**k for k in range((n - 1).bit_length())]


def _after(stride: int, update: Tensor, before: Tensor) -> Tensor:
    """``update`` for frames from ``stride`` on; earlier frames are composed already."""
    return torch.cat([before[:, :stride], update], 1)


def affine_scan(slope: Tensor, offset: Tensor, start: Tensor) -> Tensor:
    """h_t = slope_t h_{t-1} + offset_t for all t: (S, T, ...), from h_{-1} = ``start``."""
    for stride in _strides(slope.shape[1]):
        later = slope[:, stride:]
        offset = _after(stride, offset[:, stride:] + later * offset[:, :-stride], offset)
        slope = _after(stride, later * slope[:, :-stride], slope)
    return slope * start + offset


def log_product(matrices: Tensor) -> tuple[Tensor, Tensor]:
    """M_1 M_2 ... M_T of matrices (S, T, n, n) with entries of at least 0.

    Returns
    -------
    product : (S, n, n)
        Scaled to a largest entry of 1.
    log_scale : (S,)
        Logarithm of the scale taken out.
    """
    log_scale = matrices.new_zeros(len(matrices))
    while True:
        size = matrices.detach().amax((-2, -1))
        matrices = matrices / size[..., None, None]
        log_scale = log_scale + size.log().sum(1)
        n = matrices.shape[1]
        if n == 1:
            return matrices[:, 0], log_scale
        pairs = matrices[:, 0 : n - 1 : 2] @ matrices[:, 1::2]
        matrices = torch.cat([pairs, matrices[:, n - n % 2 :]], 1)
