"""Scenelets made by code: a body, furniture, and what the one does with the other."""
