"""Recordings for the rerun viewer: runs, stages of the solver, libraries.

A recording is a view of stored results, never their only copy. These modules import rerun; import
them only where a recording is made.
"""
