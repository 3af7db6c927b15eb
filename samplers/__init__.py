"""Generic MCMC samplers and diagnostics; nothing here depends on scenes or on the model."""
