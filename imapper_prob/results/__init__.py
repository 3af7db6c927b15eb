"""The results of a run: the posterior, figures, files and the report."""
