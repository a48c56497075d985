"""Every engine in every precision, made once; the reference stands apart."""

import pytest

from cnnum.engine import Engine

NAMES = ("opencl-float32", "opencl-float64", "numba-float32", "numba-float64")


class Engines(dict[str, Engine]):
    """Engines by name and precision, each made when it is first asked for."""

    def __missing__(self, label: str) -> Engine:
        name, precision = label.split("-")
        self[label] = Engine(name, precision=precision)
        return self[label]


@pytest.fixture(scope="session")
def engines() -> Engines:
    """All engines but the reference, by name and precision."""
    return Engines()


@pytest.fixture(scope="session")
def names(fast: Engine) -> tuple[str, ...]:
    """Names of the engines that work here, but the reference."""
    return ("opencl", "numba") if fast.name == "opencl" else ("numba",)


@pytest.fixture(scope="session")
def reference():
    """The engine that the others are held to."""
    return Engine("reference")
