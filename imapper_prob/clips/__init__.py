"""Clips: what detectors, lifters and benchmarks leave in files, read into one type."""
