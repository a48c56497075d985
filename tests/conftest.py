"""The engines of the suite; the suite on another OpenCL device, or on none.

`CNNUM_TEST_DEVICE=Intel pytest` runs it on another device. Where no OpenCL device works, tests that
ask for the engine "opencl" by name are skipped with that reason. The others run on Numba.

Cases that each build kernels of their own are thinned by `@pytest.mark.one_in(n)`: `make test` runs
every n-th of a test's, `make test-full` all. Where parameters are crossed, n and the number of
values of the inner ones have no common factor: then no value is always left out. Of other tests
with many cases a short run takes the first and one in sixteen or twenty-four, and of those with few
one in eight, drawn by their names. The slowest are left to `make test-full` and `make faults`:
`@pytest.mark.in_full(by)` names the tests that keep a part of their promise in a short run.

Tests of faults on purpose keep an account of trials and losses. `make faults` runs them in full and
prints it; `make test` runs a short version.
"""

import gc
import os
import subprocess
import sys
from collections import Counter
from collections.abc import Generator, Iterator, Sequence
from contextlib import contextmanager
from typing import TypeVar
from zlib import crc32

import pytest
from hypothesis import HealthCheck, settings

from cnnum import Engine
from cnnum.errors import DeviceError, NoOpenCLError, say_once

Case = TypeVar("Case")
FULL = os.environ.get("CNNUM_FAULTS") == "full"
PRECISIONS = ("float32", "float64")
SOME, MANY = 6, 24
"""Cases of a test from which a short run takes one in sixteen of them, and one in twenty-four."""

# a machine that has more to do is no fault of a test
settings.register_profile("busy", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("busy")


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", "one_in(n): a short run takes every n-th case of the test")
    config.addinivalue_line("markers", "in_full(by): a short run leaves it out, and has `by`")
    config.addinivalue_line(
        "markers", "promise(text): each case is a trial of that promise, or of the test's docstring"
    )
    wanted = os.environ.get("CNNUM_TEST_DEVICE")
    if wanted:
        only(wanted)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out of a short run the cases between every n-th of a test that is marked so."""
    if os.environ.get("CNNUM_TESTS") == "full":
        return
    seen, kept, left = Counter[str](), list[pytest.Item](), list[pytest.Item]()
    cases = Counter(item.nodeid.partition("[")[0] for item in items)
    for item in items:
        mark, test = item.get_closest_marker("one_in"), item.nodeid.partition("[")[0]
        if item.get_closest_marker("in_full"):
            spared = os.environ.get("CNNUM_FAULTS") != "full"
        elif mark is not None:
            spared = seen[test] % mark.args[0]
        else:  # drawn by name, so that no value of a crossed parameter is always left out
            often = 64 if cases[test] >= MANY else 40 if cases[test] >= SOME else 12
            spared = seen[test] and crc32(item.nodeid.encode()) % often
        (left if spared else kept).append(item)
        seen[test] += 1
    config.hook.pytest_deselected(items=left)
    items[:] = kept


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Spare Python's garbage collector the modules and the 7,000 tests, which stay to the end."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


def pytest_sessionstart(session: pytest.Session) -> None:
    """Compile the engine "numba" before there are workers: each would compile the same."""
    if not session.config.getoption("numprocesses", None):
        return
    code = "import cnnum, sys; cnnum.Engine('numba', precision=sys.argv[1])"
    code += ".run(cnnum.get_template('DIFFUS'), input=[[0.0]])"
    started = [subprocess.Popen([sys.executable, "-c", code, each]) for each in PRECISIONS]
    for process in started:
        process.wait()


def only(wanted: str) -> None:
    """Leave no other device in this process than those whose name has `wanted` in it.

    Processes that a test starts choose for themselves: `measure` counts all devices, as they do.
    """
    from cnnum.engines.devices import listing, selection
    from cnnum.engines.devices import peak as measure

    listed = listing.list_devices
    # their own names for it are kept: they count devices as the processes that they start do
    assert measure.list_devices is selection.list_devices is listed
    try:
        label = selection.choose_device(wanted).label
    except DeviceError as error:
        raise pytest.UsageError(str(error)) from None
    listing.list_devices = selection.list_devices = lambda: tuple(
        device for device in listed() if wanted.lower() in device.label.lower()
    )
    assert selection.choose_device(None).label == label


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup(item: pytest.Item) -> Generator[None, object, object]:
    """Skip a test whose fixtures ask for what OpenCL does not have here."""
    with _skipped():
        return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, object, object]:
    """Skip a test that asks for what OpenCL does not have here."""
    with _skipped():
        return (yield)


@contextmanager
def _skipped() -> Iterator[None]:
    try:
        yield
    except NoOpenCLError as error:
        pytest.skip(f"this test is about OpenCL: {error.reason}")
    except DeviceError as error:
        if not (os.environ.get("CNNUM_TEST_DEVICE") and "double precision" in str(error)):
            raise
        pytest.skip(str(error))


@pytest.fixture(scope="session")
def fast() -> Engine:
    """The engine that users get: OpenCL where a device works, else Numba."""
    return Engine()


@pytest.fixture(scope="session")
def opencl() -> Engine:
    """The OpenCL engine; the test is skipped where there is none."""
    return Engine("opencl")


@pytest.fixture(autouse=True)
def _unsaid() -> None:
    """Let what cnnum says once a process be said in every test, whichever ran before it."""
    say_once.cache_clear()


class Faults:
    """The trials of a test, and its losses beyond those that are allowed."""

    full = FULL

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


def note_trials(item: pytest.Item, tried: int, lost: int, promise: str = "") -> None:
    """Put trials in the account that is printed at the end; the test's docstring is the promise."""
    function = getattr(item, "function", None)
    said = promise or " ".join((getattr(function, "__doc__", "") or item.name).split())
    item.user_properties.append(("fault", (said, tried, lost)))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Count each case of a test that is marked with a promise as a trial."""
    report = yield
    mark = item.get_closest_marker("promise")
    if mark is not None and call.when == "call" and not report.skipped:
        note_trials(item, 1, int(report.failed), *mark.args)
    return report


@pytest.fixture
def faults(request: pytest.FixtureRequest) -> Iterator[Faults]:
    """The account of one test: its docstring is the promise, and a loss fails it."""
    account = Faults()
    yield account
    lost = len(account.losses)
    note_trials(request.node, account.tried, lost)
    assert account.tried, "a fault test that tried nothing"
    assert not lost, f"{lost} of {account.tried} lost: {'; '.join(account.losses[:5])}"


def pytest_terminal_summary(terminalreporter):
    """Print the table: tried, survived, lost; tests with the same promise share a row."""
    tried, lost = Counter[str](), Counter[str]()
    for kind in ("", "error"):  # a teardown that passes is of no kind
        for report in terminalreporter.stats.get(kind, []):
            for key, value in getattr(report, "user_properties", []):  # one of collecting has none
                if key == "fault" and report.when == "teardown":
                    promise, trials, losses = value
                    tried[promise] += trials
                    lost[promise] += losses
    if tried:
        terminalreporter.section("faults")
        terminalreporter.line(f"{'tried':>8}{'survived':>10}{'lost':>6}  promise")
    for promise, trials in sorted(tried.items()):
        losses = lost[promise]
        terminalreporter.line(f"{trials:>8}{trials - losses:>10}{losses:>6}  {promise}")
