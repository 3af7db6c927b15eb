"""How a detector reports a joint that is seen, and one that is hidden.

A joint at pixel ``q`` with probability ``m`` of being in view is detected at ``u`` with
confidence ``c`` with density

    p(u, c | q, m) = m p1(c) t(u; q, s1(c)) + (1 - m) p0(c) t(u; q, s0(c)),

``p1`` and ``p0`` being histograms of confidence and ``t`` a bivariate Student-t. It takes
the place of the paper's reprojection term L_r and occlusion term L_o (Monszpart et al.
2019) in one normalised density: robust to gross jumps, and asymmetric as the paper's F is,
for a detector may be sure of a joint it cannot see.

The tables are calibrated (``docs/research/calibration.md``): detections of i3DB against projected
ground truth, hidden as the benchmark's own ray casts say.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imapper_prob.models.calibrated import from_data
from imapper_prob.models.errors import InputError

__all__ = [
    "CONFIDENCE_EDGES", "ERROR_EDGES", "LOST_ERROR", "DetectionModel", "DetectorSettings",
    "student_t", "student_t_loss",
]  # fmt: skip

Array = NDArray[np.float64]

CONFIDENCE_EDGES: Final = (0, 0.02, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.85, 0.9, 1)
"""Bins of confidence: finer where i3DB's detector is mostly found."""
ERROR_EDGES: Final = (0.02, 0.5)
"""Confidences that part lost, doubtful and sure detections, whose pixel errors differ."""
LOST_ERROR: Final = (2000.0, 4.0)
"""Scale, in pixels at 1080 lines, and degrees of freedom of the pixel error of a lost joint: about
the width of a picture. A detector that believes in none of its places says that the joint may be
hidden, not where it is: what it reports is the best of nothing, often on something else."""
_REFERENCE_HEIGHT = 1080.0


@dataclass(frozen=True)
class DetectorSettings:
    """How a detector errs, estimated from data (``docs/research/calibration.md``).

    Parameters
    ----------
    hidden_confidence, seen_confidence : tuple of B float
        Probability of each bin of confidence.
    hidden_error_scale, seen_error_scale : tuple of 2 float
        Pixels at 1080 lines; scale of the error of doubtful and of sure joints.
    hidden_error_dof, seen_error_dof : tuple of 2 float
        Degrees of freedom of the same.
    """

    hidden_confidence: tuple[float, ...] = from_data("detections.hidden_confidence")
    seen_confidence: tuple[float, ...] = from_data("detections.seen_confidence")
    hidden_error_scale: tuple[float, ...] = from_data("detections.hidden_error_scale")
    seen_error_scale: tuple[float, ...] = from_data("detections.seen_error_scale")
    hidden_error_dof: tuple[float, ...] = from_data("detections.hidden_error_dof")
    seen_error_dof: tuple[float, ...] = from_data("detections.seen_error_dof")

    def __post_init__(self) -> None:
        lengths = {"confidence": len(CONFIDENCE_EDGES) - 1, "error_scale": 2, "error_dof": 2}
        for what, length in lengths.items():
            for state in ("hidden", "seen"):
                row = getattr(self, f"{state}_{what}")
                if len(row) != length or not all(0 < value < np.inf for value in row):
                    raise InputError(
                        f"detector setting {state}_{what} = {row} must be {length} positive numbers"
                    )


@dataclass(frozen=True)
class DetectionModel:
    """The tables of the detector; indices 0 and 1 of the first axis are hidden and seen.

    By default those of :class:`DetectorSettings`; see :meth:`of`.

    Parameters
    ----------
    edges : (B + 1,) float
        Bin edges of confidence.
    confidence : (2, B) float
        Probability of each bin.
    error_edges : (2,) float
        Confidences at which the pixel error changes class.
    error_scale, error_dof : (2, 3) float
        Scale in pixels of an image of 1080 lines, and degrees of freedom, of the pixel
        error's Student-t, by class.
    """

    edges: Array = field(default_factory=lambda: np.asarray(CONFIDENCE_EDGES, float))
    confidence: Array = field(default_factory=lambda: _shares(DetectorSettings()))
    error_edges: Array = field(default_factory=lambda: np.asarray(ERROR_EDGES))
    error_scale: Array = field(default_factory=lambda: _errors(DetectorSettings())[0])
    error_dof: Array = field(default_factory=lambda: _errors(DetectorSettings())[1])

    @classmethod
    def of(cls, settings: DetectorSettings) -> DetectionModel:
        """The tables by some settings.

        Parameters
        ----------
        settings : DetectorSettings

        Returns
        -------
        DetectionModel
        """
        scale, dof = _errors(settings)
        return cls(confidence=_shares(settings), error_scale=scale, error_dof=dof)

    def confidence_density(self, confidence: ArrayLike) -> Array:
        """Densities p0(c) and p1(c) of a confidence.

        Parameters
        ----------
        confidence : (...) float
            In [0, 1].

        Returns
        -------
        (..., 2) float
            Per unit of confidence, of a hidden joint and of a seen one.
        """
        c = np.asarray(confidence, float)
        bins = np.clip(np.searchsorted(self.edges, c, side="right") - 1, 0, len(self.edges) - 2)
        return np.moveaxis((self.confidence / np.diff(self.edges))[:, bins], 0, -1)

    def error_class(self, confidence: ArrayLike) -> NDArray[np.intp]:
        """Which row of the pixel-error table a confidence belongs to.

        Parameters
        ----------
        confidence : (...) float
            In [0, 1].

        Returns
        -------
        (...) int
            0 lost, 1 doubtful, 2 sure.
        """
        return np.searchsorted(self.error_edges, np.asarray(confidence, float), side="right")

    def error_tables(self, confidence: ArrayLike, *, image_height: int) -> tuple[Array, Array]:
        """Scale and degrees of freedom of the pixel error of detections.

        Parameters
        ----------
        confidence : (...) float
            In [0, 1].
        image_height : int
            Pixels.

        Returns
        -------
        scale : (..., 2) float
            Pixels, of a hidden joint and of a seen one.
        dof : (..., 2) float
            Degrees of freedom of the same.
        """
        index = self.error_class(confidence)
        scale = self.error_scale[:, index] * (image_height / _REFERENCE_HEIGHT)
        return np.moveaxis(scale, 0, -1), np.moveaxis(self.error_dof[:, index], 0, -1)

    def draw(
        self,
        rng: np.random.Generator,
        pixels: ArrayLike,
        hidden: ArrayLike,
        *,
        image_height: int,
        looseness: ArrayLike = 0.0,
    ) -> tuple[Array, Array]:
        """Draw detections of joints.

        Parameters
        ----------
        rng : numpy.random.Generator
        pixels : (..., 2) float
            Where the joints are in the image.
        hidden : (...) bool
        image_height : int
            Pixels.
        looseness : (...) float
            Pixels by which a pose may be off where it is a scenelet's; their square adds to that of
            the detector's scale.

        Returns
        -------
        detected : (..., 2) float
            Pixels.
        confidence : (...) float
            In [0, 1].
        """
        pixels = np.asarray(pixels, float)
        state = np.where(np.asarray(hidden, bool), 0, 1)
        cumulative = np.cumsum(self.confidence, axis=1)
        u = rng.random(state.shape)
        bins = np.minimum((u[..., None] > cumulative[state]).sum(-1), len(self.edges) - 2)
        confidence = rng.uniform(self.edges[bins], self.edges[bins + 1])
        index = self.error_class(confidence)
        scale = self.error_scale[state, index] * (image_height / _REFERENCE_HEIGHT)
        scale = np.hypot(scale, looseness)
        dof = self.error_dof[state, index]
        normal = rng.standard_normal((*state.shape, 2))
        mixing = rng.chisquare(dof) / dof
        return pixels + scale[..., None] * normal / np.sqrt(mixing)[..., None], confidence


def _shares(settings: DetectorSettings) -> Array:
    """Normalised again, for what is stored is rounded."""
    counted = np.array([settings.hidden_confidence, settings.seen_confidence])
    result: Array = counted / counted.sum(1, keepdims=True)
    return result


def _errors(settings: DetectorSettings) -> tuple[Array, Array]:
    """Pixel errors of lost joints before those of doubtful and sure ones: (2, 3) each."""
    lost, tails = (np.full((2, 1), value) for value in LOST_ERROR)
    scale = np.array([settings.hidden_error_scale, settings.seen_error_scale])
    dof = np.array([settings.hidden_error_dof, settings.seen_error_dof])
    return np.hstack([lost, scale]), np.hstack([tails, dof])


def student_t(squared_error: ArrayLike, scale: ArrayLike, dof: ArrayLike) -> Array:
    """Log density per square pixel of a bivariate Student-t.

    ``log t = -log(2 pi s^2) - loss``: the constant of the bivariate t,
    Gamma((nu+2)/2) / (Gamma(nu/2) nu pi s^2), is 1 / (2 pi s^2).

    Parameters
    ----------
    squared_error, scale, dof : (...) float
        See :func:`student_t_loss`; pixels.

    Returns
    -------
    (...) float
        Nats.
    """
    result: Array = -np.log(2 * np.pi * np.asarray(scale, float) ** 2)
    return result - student_t_loss(squared_error, scale, dof)


def student_t_loss(
    squared_error: ArrayLike, scale: ArrayLike, dof: ArrayLike, *, dimensions: int = 2
) -> Array:
    """Minus the log density of a Student-t, without its constant.

    ``(nu + d) / 2 log(1 + r^2 / (nu s^2))``

    Parameters
    ----------
    squared_error : (...) float
        r^2, squared length of the error.
    scale : (...) float
        s, the unit of errors.
    dof : (...) float
        nu, degrees of freedom.
    dimensions : int
        d, of the error.

    Returns
    -------
    (...) float
        Nats.
    """
    scale, dof = np.asarray(scale, float), np.asarray(dof, float)
    tails = np.log1p(np.asarray(squared_error, float) / (dof * scale**2))
    result: Array = (dof + dimensions) / 2 * tails
    return result
