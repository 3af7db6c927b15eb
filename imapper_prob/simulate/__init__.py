"""Simulated clips with ground truth."""
