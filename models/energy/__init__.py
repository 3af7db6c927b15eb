"""The terms of the log-posterior, a file each."""
