"""Runs disturbed by disk errors, kills and interruptions."""
