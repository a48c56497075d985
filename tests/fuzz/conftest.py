"""Random input for all that takes some: a few cases in `make test`, ten minutes in `make fuzz`.

`CNNUM_FUZZ` is the number of seconds that all fuzz tests together take; each has an equal share.
"""

import os
import resource
import time
import warnings
from collections.abc import Callable, Generator, Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from cnnum.errors import CnnumError

SECONDS = float(os.environ.get("CNNUM_FUZZ", "0"))
PATIENCE_S = 20.0
"""s that one call may take on a busy machine."""

ROOM = 3 << 30
"""Bytes of address space that a case may take beyond the process's own."""

TESTS = [0]


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item,
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Let the account of a test know that it failed."""
    report = yield
    if report.when == "call" and report.failed:
        item.case_failed = True  # type: ignore[attr-defined]
    return report


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    TESTS[0] = sum("fuzz" in getattr(item, "fixturenames", ()) for item in items)


PROMISE = "Random input to parsers and public functions ends in a result or in one sentence."


@pytest.fixture
def fuzz(request: pytest.FixtureRequest) -> Iterator[Callable[..., None]]:
    """A function that runs a call on random cases, until the time is over in a long run.

    Its cases stand in the account of trials.
    """
    tried = [0]

    def run(cases: st.SearchStrategy[Any], call: Callable[[Any], object], short: int = 25) -> None:
        end = time.monotonic() + SECONDS / max(TESTS[0], 1)
        examples = 300 if SECONDS else short
        phases = (Phase.generate, Phase.shrink)

        @settings(
            max_examples=examples,
            deadline=None,
            database=None,
            derandomize=not SECONDS,
            phases=phases,
            suppress_health_check=list(HealthCheck),
        )
        @given(cases)
        def one(case: Any) -> None:
            tried[0] += 1
            ends_well(call, case)

        one()
        while time.monotonic() < end:
            one()

    yield run
    failed = getattr(request.node, "case_failed", False)
    promise = " ".join((request.function.__doc__ or PROMISE).split())
    request.node.user_properties.append(("fault", (promise, tried[0], int(failed))))


def ends_well(call: Callable[[Any], object], case: Any) -> None:
    """Call, and let nothing through but an error of ours in one sentence, in time and memory."""
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    statm = Path("/proc/self/statm")
    pages = int(statm.read_text().split()[0]) if statm.exists() else 0
    if pages:
        used = pages * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (used + ROOM, hard))
    began = time.monotonic()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            call(case)
    except CnnumError as error:
        said = str(error)
        assert "\n" not in said, f"not one sentence: {said:.200}"
        assert len(said) <= 2000, f"a long sentence: {said:.200}"
    finally:
        if pages:
            resource.setrlimit(resource.RLIMIT_AS, (soft, hard))
    took = time.monotonic() - began
    assert took < PATIENCE_S, f"took {took:.1f} s"
