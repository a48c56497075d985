"""Faults on purpose: how many were tried, survived and lost.

`make faults` runs them in full and prints the table; `make test` runs a short version.
"""

import os
from collections.abc import Iterator, Sequence
from typing import TypeVar

import pytest

Case = TypeVar("Case")
FULL = os.environ.get("CNNUM_FAULTS") == "full"


class Faults:
    """What a test tried, and what was lost beyond what is promised."""

    def __init__(self) -> None:
        self.tried = 0
        self.losses: list[str] = []

    def trials(self, *, short: int, full: int) -> Iterator[int]:
        """Yield the numbers of as many trials as this run takes, and count them."""
        for number in range(full if FULL else short):
            self.tried += 1
            yield number

    def each(self, cases: Sequence[Case], *, short: int) -> Iterator[Case]:
        """Yield every case, or in a short run some of them, evenly spread; count them."""
        step = 1 if FULL else max(1, -(-len(cases) // short))
        for case in cases[::step]:
            self.tried += 1
            yield case

    def lose(self, what: str) -> None:
        """Note the loss of the present trial."""
        self.losses.append(what)


@pytest.fixture
def faults(request: pytest.FixtureRequest) -> Iterator[Faults]:
    """The account of one test: its docstring is the promise, and a loss fails it."""
    account = Faults()
    yield account
    promise = " ".join((request.function.__doc__ or request.node.name).split())
    lost = len(account.losses)
    request.node.user_properties.append(("fault", (promise, account.tried, lost)))
    assert account.tried, "a fault test that tried nothing"
    assert not lost, f"{lost} of {account.tried} lost: {'; '.join(account.losses[:5])}"


def pytest_terminal_summary(terminalreporter):
    """Print the table: tried, survived, lost."""
    rows = [
        value
        for kind in ("", "error")  # a teardown that passes is of no kind
        for report in terminalreporter.stats.get(kind, [])
        for key, value in report.user_properties
        if key == "fault" and report.when == "teardown"
    ]
    if rows:
        terminalreporter.section("faults")
        terminalreporter.line(f"{'tried':>8}{'survived':>10}{'lost':>6}  promise")
        for promise, tried, lost in sorted(rows):
            terminalreporter.line(f"{tried:>8}{tried - lost:>10}{lost:>6}  {promise}")
