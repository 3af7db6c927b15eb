"""How often a chain was where, against how often it should have been."""

from __future__ import annotations

import numpy as np
from scipy import stats

# Cells that are rarer are pooled, for the distribution of the statistic is that of large
# counts.
RARE = 2e-3


def chi_square(cells: np.ndarray, expected: np.ndarray) -> float:
    """Chi-square test of a correlated chain, by the correction of Rao & Scott (1984).

    The statistic is a sum of squares of normal numbers whose covariance is estimated from
    the means of sqrt(n) batches; its distribution is taken for a scaled chi-square one with
    the same mean and variance (Satterthwaite). The variance needs the trace of the squared
    covariance, here without the bias that few batches bring (Bai & Saranadasa 1996).

    Parameters
    ----------
    cells : (n,) int
        Where the chain was.
    expected : (K,) float
        Probability of each cell.

    Returns
    -------
    float
        Probability of a difference that large.
    """
    rare = expected < RARE
    if rare.any():
        cells = np.where(rare, len(expected) - rare.sum(), np.cumsum(~rare) - 1)[cells]
        expected = np.append(expected[~rare], expected[rare].sum())
    n, n_cells = len(cells), len(expected)
    shares = np.bincount(cells, minlength=n_cells) / n
    statistic = n * np.sum((shares - expected) ** 2 / expected)

    n_batches = int(np.sqrt(n))
    length = n // n_batches
    batches = cells[: n_batches * length].reshape(n_batches, length)
    means = np.stack([np.bincount(batch, minlength=n_cells) for batch in batches]) / length
    covariance = length * np.cov(means / np.sqrt(expected), rowvar=False)
    trace, free = np.trace(covariance), n_batches - 1
    square = np.sum(covariance**2) - trace**2 / free
    square *= free**2 / ((free - 1) * (free + 2))
    return float(stats.chi2.sf(statistic * trace / square, trace**2 / square))
