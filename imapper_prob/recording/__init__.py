"""A run to look at: one rerun recording, and a picture of it.

A recording is a view of the durable results, never their only copy. rerun is imported by the
modules in here, so import them only where a recording is wanted.
"""
