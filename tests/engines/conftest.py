"""Every engine in every precision, made once; the reference stands apart.

`CNNUM_TEST_ENGINE=name` puts an engine of another package in the place of "numba".
"""

import os

import pytest

from cnnum.engine import Engine
from cnnum.engines.devices.selection import choose_device

OUTSIDE = os.environ.get("CNNUM_TEST_ENGINE", "numba")
NAMES = ("opencl-float32", "opencl-float64", "numba-float32", "numba-float64")


class Engines(dict[str, Engine]):
    """All engines that work here but the reference, by name and precision."""

    def __missing__(self, label: str) -> Engine:
        """Return the reference; another that is not here raises, which skips the test."""
        name, _, precision = label.partition("-")
        return _made(name, precision or None)


@pytest.fixture(scope="session")
def engines(fast: Engine) -> Engines:
    """Engines that tests choose from by name and precision; the reference stands apart."""
    here = [label for label in NAMES if label.startswith("numba")]
    if fast.name == "opencl":
        double = choose_device(None).double
        here = [label for label in NAMES if double or label != "opencl-float64"]
    made = ((label, label.split("-")) for label in here)
    return Engines({label: _made(name, precision) for label, (name, precision) in made})


def _made(name: str, precision: str | None) -> Engine:
    return Engine(OUTSIDE if name == "numba" else name, precision=precision)


@pytest.fixture(scope="session")
def names(fast: Engine) -> tuple[str, ...]:
    """Names of the engines that work here, but the reference."""
    return ("opencl", "numba") if fast.name == "opencl" else ("numba",)


@pytest.fixture(scope="session")
def reference():
    """The engine that the others are held to."""
    return Engine("reference")
