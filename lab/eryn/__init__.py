"""Comparison of Eryn with the project's sampler on the same targets."""
