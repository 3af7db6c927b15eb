"""Summaries of posterior draws: scenes, objects, motion, visibility, checks."""
