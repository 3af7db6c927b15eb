"""Estimation of the constants of the model from clips with ground truth."""

from lab.calibrate.procedure import as_markdown, as_toml, calibrate, in_use, recover, without

__all__ = ["as_markdown", "as_toml", "calibrate", "in_use", "recover", "without"]
