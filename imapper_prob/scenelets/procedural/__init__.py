"""Procedural scenelets: recipes that generate a body, furniture, and their interaction."""
