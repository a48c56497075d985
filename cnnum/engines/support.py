"""Which ways to run a transient each engine knows."""

from cnnum.integrators.choice import ALL_SCHEMES, BASIC_SCHEMES

_SCHEMES = {"opencl": ALL_SCHEMES, "reference": ALL_SCHEMES}


FUSING = frozenset({"opencl", "numba"})
"""Engines whose plans fuse linear operations; the reference runs every one of them, so that it
can tell whether the others are right."""


def schemes_of(engine: str) -> frozenset[type]:
    """Return the schemes that an engine of that name runs."""
    return _SCHEMES.get(engine, BASIC_SCHEMES)
