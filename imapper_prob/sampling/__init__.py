"""The posterior of a clip, sampled."""
