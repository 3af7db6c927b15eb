"""Sampling the posterior of a clip: moves, chains, ensembles and checkpoints."""
