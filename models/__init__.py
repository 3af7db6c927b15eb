"""The probabilistic model: scenes, problems, the log-posterior and its compiled kernels."""
