"""The posterior in torch: many states of one problem at once, with gradients.

The same terms as :mod:`imapper_prob.models.compiled`, which chains use; this executor is for
what asks for many states together or for derivatives. torch is imported by these modules only.
"""
