"""The independent simulator of `tests/helpers/small_steps.py`, for checks against closed forms."""

import pytest
from small_steps import Simulator


@pytest.fixture(scope="session")
def simulator() -> Simulator:
    return Simulator()


@pytest.fixture(scope="session")
def hasty_simulator() -> Simulator:
    """Gives up early: for templates that may never settle."""
    return Simulator(limit=40.0)
