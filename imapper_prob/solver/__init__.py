"""The deterministic solver, stage by stage: from detections to the best scene."""
