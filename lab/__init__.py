"""Measurements and tests of the program: one question, one file, one command. See ``README.md``."""
