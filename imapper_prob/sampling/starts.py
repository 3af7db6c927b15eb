"""Where chains start, and each of their temperatures."""

from __future__ import annotations

from imapper_prob.models.posterior import State, empty_state
from imapper_prob.sampling.cast import Cast

__all__ = ["starts_of"]


def starts_of(cast: Cast, count: int) -> list[tuple[State, ...]]:
    """By chain where its temperatures start, from the posterior itself to the hottest.

    The coldest are far apart on purpose: the best scene, none at all, and the alternatives, worst
    first. The hotter ones are at all that the solver found, the better the colder, so that what is
    worth more than where the coldest started can come to it, stretch by stretch.
    """
    others = list(cast.states[:0:-1]) or [cast.states[0]]
    pool = [cast.states[0], empty_state(cast.problem), *others]
    coldest = [pool[i % len(pool)] for i in range(count)]
    return [(own, *(s for s in cast.states if s is not own)) for own in coldest]
