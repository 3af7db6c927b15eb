"""What a run found: the posterior, figures, files and the report."""
