"""What the draws of a run say: scenes, objects, motion, visibility, checks."""
