"""Clips spoiled as lifters, detectors and cameras spoil them, and what that costs."""
