"""Observation model of a 2D joint detector, for visible and for hidden joints.

A joint at pixel ``q`` with probability ``m`` of being in view is detected at ``u`` with
confidence ``c`` with density

    p(u, c | q, m) = m p1(c) t(u; q, s1(c)) + (1 - m) p0(c) t(u; q, s0(c)),

where ``p1`` and ``p0`` are histograms of confidence and ``t`` is a bivariate Student-t density.
This one normalised density replaces the paper's reprojection term L_r and occlusion term L_o
(Monszpart et al. 2019). It is robust to gross errors. Like the paper's F it is asymmetric: a
detector may be confident about a joint that it cannot see.

The tables are calibrated (``docs/research/calibration.md``) on detections of i3DB compared with
projected ground truth; ray casts of the benchmark's scenes tell which joints are hidden.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imapper_prob.models.calibrated import from_data
from imapper_prob.models.errors import InputError

__all__ = [
    "CONFIDENCE_EDGES", "ERROR_EDGES", "LOST_ERROR", "REFERENCE_SIDE", "DetectionModel",
    "DetectorSettings", "student_t", "student_t_loss",
]  # fmt: skip

Array = NDArray[np.float64]

CONFIDENCE_EDGES: Final = (0, 0.02, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.85, 0.9, 1)
"""Bin edges of confidence, finer where most detections of i3DB lie."""
ERROR_EDGES: Final = (0.02, 0.5)
"""Confidences that separate lost, doubtful and sure detections; each class has its pixel error."""
LOST_ERROR: Final = (2000.0, 4.0)
"""Scale (pixels in an image whose shorter side has 1080) and degrees of freedom of the pixel error
of a lost joint. The scale is about the image width: a detection of very low confidence tells that
the joint may be hidden but not where it is, because it often lies on something else."""
REFERENCE_SIDE: Final = 1080.0
"""Shorter side in pixels of the images whose pixel errors were measured; errors are in proportion
to it."""


@dataclass(frozen=True)
class DetectorSettings:
    """Error model of the detector, estimated from data (``docs/research/calibration.md``).

    Parameters
    ----------
    hidden_confidence, seen_confidence : tuple of B float
        Probability of each confidence bin.
    hidden_error_scale, seen_error_scale : tuple of 2 float
        Scale of the pixel error of doubtful and of sure joints, in pixels of an image of 1080
        lines.
    hidden_error_dof, seen_error_dof : tuple of 2 float
        Degrees of freedom of these errors.
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
    """Tables of the detector; along the first axis, index 0 is hidden and 1 is seen.

    The defaults come from :class:`DetectorSettings`; see :meth:`of`.

    Parameters
    ----------
    edges : (B + 1,) float
        Bin edges of confidence.
    confidence : (2, B) float
        Probability of each bin.
    error_edges : (2,) float
        Confidences that separate the classes lost, doubtful and sure.
    error_scale, error_dof : (2, 3) float
        Scale (pixels of an image of 1080 lines) and degrees of freedom of the Student-t pixel
        error, by class.
    """

    edges: Array = field(default_factory=lambda: np.asarray(CONFIDENCE_EDGES, float))
    confidence: Array = field(default_factory=lambda: _shares(DetectorSettings()))
    error_edges: Array = field(default_factory=lambda: np.asarray(ERROR_EDGES))
    error_scale: Array = field(default_factory=lambda: _errors(DetectorSettings())[0])
    error_dof: Array = field(default_factory=lambda: _errors(DetectorSettings())[1])

    @classmethod
    def of(cls, settings: DetectorSettings) -> DetectionModel:
        """Make the tables from settings.

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
        """Probability densities p0(c) and p1(c) of a confidence.

        Parameters
        ----------
        confidence : (...) float
            In [0, 1].

        Returns
        -------
        (..., 2) float
            Density per unit of confidence, for a hidden joint and for a seen one.
        """
        c = np.asarray(confidence, float)
        bins = np.clip(np.searchsorted(self.edges, c, side="right") - 1, 0, len(self.edges) - 2)
        return np.moveaxis((self.confidence / np.diff(self.edges))[:, bins], 0, -1)

    def error_class(self, confidence: ArrayLike) -> NDArray[np.intp]:
        """Class of the pixel error that a confidence belongs to.

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

    def error_tables(self, confidence: ArrayLike, *, short_side: int) -> tuple[Array, Array]:
        """Scale and degrees of freedom of the pixel errors of detections.

        Parameters
        ----------
        confidence : (...) float
            In [0, 1].
        short_side : int
            Shorter side of the image, pixels.

        Returns
        -------
        scale : (..., 2) float
            Pixels, for a hidden joint and for a seen one.
        dof : (..., 2) float
            Degrees of freedom, likewise.
        """
        index = self.error_class(confidence)
        scale = self.error_scale[:, index] * (short_side / REFERENCE_SIDE)
        return np.moveaxis(scale, 0, -1), np.moveaxis(self.error_dof[:, index], 0, -1)

    def draw(
        self,
        rng: np.random.Generator,
        pixels: ArrayLike,
        hidden: ArrayLike,
        *,
        short_side: int,
        looseness: ArrayLike = 0.0,
    ) -> tuple[Array, Array]:
        """Draw detections of joints from the observation model.

        Parameters
        ----------
        rng : numpy.random.Generator
        pixels : (..., 2) float
            Projections of the joints.
        hidden : (...) bool
        short_side : int
            Shorter side of the image, pixels.
        looseness : (...) float
            Uncertainty of the pose in pixels, where a scenelet gives it; added in quadrature to the
            detector's scale.

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
        scale = self.error_scale[state, index] * (short_side / REFERENCE_SIDE)
        scale = np.hypot(scale, looseness)
        dof = self.error_dof[state, index]
        normal = rng.standard_normal((*state.shape, 2))
        mixing = rng.chisquare(dof) / dof
        return pixels + scale[..., None] * normal / np.sqrt(mixing)[..., None], confidence


def _shares(settings: DetectorSettings) -> Array:
    """(2, B) probabilities of the bins, normalised again because stored values are rounded."""
    counted = np.array([settings.hidden_confidence, settings.seen_confidence])
    result: Array = counted / counted.sum(1, keepdims=True)
    return result


def _errors(settings: DetectorSettings) -> tuple[Array, Array]:
    """(2, 3) scale and (2, 3) degrees of freedom of pixel errors: lost, doubtful and sure."""
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
    """Negative log density of a Student-t, without the normalising constant.

    ``(nu + d) / 2 log(1 + r^2 / (nu s^2))``

    Parameters
    ----------
    squared_error : (...) float
        r^2, squared length of the error.
    scale : (...) float
        s, the scale, in units of the error.
    dof : (...) float
        nu, degrees of freedom.
    dimensions : int
        d, the dimension of the error.

    Returns
    -------
    (...) float
        Nats.
    """
    scale, dof = np.asarray(scale, float), np.asarray(dof, float)
    tails = np.log1p(np.asarray(squared_error, float) / (dof * scale**2))
    result: Array = (dof + dimensions) / 2 * tails
    return result
