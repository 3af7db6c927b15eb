"""Runs that are disturbed: by the disk, by kills, by whoever stops them."""
