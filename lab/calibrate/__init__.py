"""Where the constants of the model come from: estimated from clips whose truth is known."""

from lab.calibrate.procedure import as_markdown, as_toml, calibrate, in_use, recover, without

__all__ = ["as_markdown", "as_toml", "calibrate", "in_use", "recover", "without"]
