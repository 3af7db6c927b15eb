"""Where the constants of the model come from: estimated from clips whose truth is known."""

from imapper_prob.calibrate.procedure import calibrate, in_use, without
from imapper_prob.calibrate.recovery import recover
from imapper_prob.calibrate.report import as_markdown, as_toml

__all__ = ["as_markdown", "as_toml", "calibrate", "in_use", "recover", "without"]
