"""Recipes: each draws one motion with its furniture."""
