"""Simulated clips, whose truth is known."""
