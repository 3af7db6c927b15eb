"""How good a result is, where the truth is known.

:mod:`~imapper_prob.evaluate.truth` and :mod:`~imapper_prob.evaluate.prediction` bring both into
the axes of the camera, :mod:`~imapper_prob.evaluate.score` and
:mod:`~imapper_prob.evaluate.objects` compare them. Inference imports nothing of this.
"""
