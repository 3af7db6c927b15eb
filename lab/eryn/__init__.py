"""Eryn beside the project's sampler, on the same targets."""
