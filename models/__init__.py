"""What a scene is and what it costs."""
