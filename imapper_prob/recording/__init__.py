"""Recordings for the rerun viewer: runs, stages of the solver, libraries.

A recording is a view of the durable results, never their only copy. Modules in here import rerun;
import them only where a recording is wanted.
"""
