"""The engine that benchmarks measure."""

import pytest

from cnnum.engine import Engine


@pytest.fixture(scope="session")
def opencl() -> Engine:
    return Engine("opencl")
