"""Compiled kernels that the full and the incremental evaluation share."""
