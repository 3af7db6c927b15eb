"""Scenelets made by recipes: a body, furniture, and what the one does with the other."""
