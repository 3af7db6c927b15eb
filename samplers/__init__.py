"""How a distribution is explored: knows nothing of scenes."""
