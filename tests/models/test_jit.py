from __future__ import annotations

from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest
from numba.core.caching import FunctionCache, NullCache
from numba.core.codegen import CPUCodegen
from numba.core.errors import TypingError

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


def test_an_inlined_kernel_neither_allocates_nor_returns_arrays() -> None:
    """It does not count references, so a caller would free what it still uses."""

    @inlined
    def itself(row: Any) -> Any:
        return row

    @inlined
    def beside_a_number(row: Any) -> Any:
        return 1.0, row

    @inlined
    def allocated(n: int) -> Any:
        return np.empty(n)[0]

    with pytest.raises(TypeError, match="itself is inlined"):
        itself(np.zeros(3))
    with pytest.raises(TypeError, match="beside_a_number is inlined"):
        beside_a_number(np.zeros(3))
    with pytest.raises(TypingError, match="empty"):
        allocated(3)


def test_one_process_at_a_time_adds_to_the_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    fcntl = pytest.importorskip("fcntl")
    saved = []

    def save(self: FunctionCache, sig: Any, _: object) -> None:
        with (Path(self.cache_path) / "lock").open() as another, pytest.raises(BlockingIOError):
            fcntl.flock(another, fcntl.LOCK_EX | fcntl.LOCK_NB)
        saved.append(sig)

    monkeypatch.setattr(FunctionCache, "save_overload", save)

    @compiled
    def twice(number: float) -> float:
        return 2 * number

    assert twice(1.5) == 3.0
    assert len(saved) == 1


def test_numba_keeps_its_level_of_optimisation(monkeypatch: pytest.MonkeyPatch) -> None:
    levels: list[int] = []
    manager = CPUCodegen._module_pass_manager
    config: Any = numba.config

    def noted(self: Any, **options: Any) -> Any:
        levels.append(int(config.OPT))
        return manager(self, **options)

    monkeypatch.setattr(CPUCodegen, "_module_pass_manager", noted)
    before = config.OPT

    def twice(number: float) -> float:
        return 2.0 * number

    function = compiled(twice)
    function._cache = NullCache()  # type: ignore[attr-defined]
    assert function(1.5) == 3.0
    assert set(levels) == {1}
    assert config.OPT is before
