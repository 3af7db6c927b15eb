"""Clips: output files of detectors, lifters and benchmarks, read into one type."""
