"""Sitting motions that the library does not contain."""
