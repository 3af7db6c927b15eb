"""Scores of results against ground truth.

:mod:`~imapper_prob.evaluate.truth` and :mod:`~imapper_prob.evaluate.prediction` express truth and
results in camera axes; :mod:`~imapper_prob.evaluate.score` and
:mod:`~imapper_prob.evaluate.objects` compare them. Inference does not import this package.
"""
