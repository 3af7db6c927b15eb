"""The staged, deterministic solver: from detections to the most probable scene."""
