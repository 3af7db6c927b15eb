from __future__ import annotations

from imapper_prob.models.jit import compiled, inlined


@inlined
def product(a: float, b: float) -> float:
    return a * b


@compiled
def product_less(a: float, b: float, c: float) -> float:
    return product(a, b) - c


def test_products_are_rounded_before_they_are_subtracted() -> None:
    """With fused operations, which depend on what is inlined, this is -2^-54."""
    assert product_less(1.0 + 2.0**-27, 1.0 - 2.0**-27, 1.0) == 0.0
