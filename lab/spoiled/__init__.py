"""Clips with typical faults of lifters, detectors and cameras, and the resulting errors."""
