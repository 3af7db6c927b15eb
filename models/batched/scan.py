"""Recursions over frames in log2 T steps, all frames at once.

A recursion whose steps compose is solved by doubling: after step k every frame holds the
composition of the 2^k steps that end in it (Hillis and Steele 1986). A loop over frames does
less arithmetic but starts thousands of small operations, and as many more for the gradient.
"""

from __future__ import annotations

import torch
from torch import Tensor

__all__ = ["log_product", "second_order_scan"]


def _strides(n: int) -> list[int]:
    return [2**k for k in range((n - 1).bit_length())]


def _after(stride: int, update: Tensor, before: Tensor) -> Tensor:
    """``update`` for frames from ``stride`` on; earlier frames are composed already."""
    return torch.cat([before[:, :stride], update], 1)


def second_order_scan(first: Tensor, second: Tensor, offset: Tensor) -> Tensor:
    """h_t = first_t h_{t-1} + second_t h_{t-2} + offset_t for all t: (S, T, ...), from zero."""
    one, none = torch.ones_like(first), torch.zeros_like(first)
    # (h_t, h_{t-1}) from the pair before: a matrix of rows ``upper``, ``lower``, and an offset.
    upper, lower = torch.stack([first, second], -1), torch.stack([one, none], -1)
    now, before = offset, torch.zeros_like(offset)
    for stride in _strides(first.shape[1]):
        a, b = upper[:, stride:, ..., 0], upper[:, stride:, ..., 1]
        c, d = lower[:, stride:, ..., 0], lower[:, stride:, ..., 1]
        h, g = now[:, :-stride], before[:, :-stride]
        now = _after(stride, now[:, stride:] + a * h + b * g, now)
        before = _after(stride, before[:, stride:] + c * h + d * g, before)
        top, bottom = upper[:, :-stride], lower[:, :-stride]
        upper, lower = (
            _after(stride, a[..., None] * top + b[..., None] * bottom, upper),
            _after(stride, c[..., None] * top + d[..., None] * bottom, lower),
        )
    return now


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
