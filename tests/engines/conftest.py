"""Every engine in every precision, made once; the reference stands apart."""

import pytest

from cnnum.engine import Engine

NAMES = ("opencl-float32", "opencl-float64", "numba-float32", "numba-float64")


@pytest.fixture(scope="session")
def engines():
    """All engines but the reference, by name and precision."""
    made = {}
    for label in NAMES:
        name, precision = label.split("-")
        made[label] = Engine(name, precision=precision)
    return made


@pytest.fixture(scope="session")
def reference():
    """The engine that the others are held to."""
    return Engine("reference")
