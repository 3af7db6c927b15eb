"""Simulated clips: a furnished room, a person in it, and what is seen of both."""
