"""The engines of the suite; the suite on another OpenCL device, or on none.

`CNNUM_TEST_DEVICE=Intel pytest` runs it on another device. Where no OpenCL device works, tests that
ask for the engine "opencl" by name are skipped with that reason, and the others run on Numba.
"""

import os
from collections.abc import Generator

import pytest

from cnnum import Engine, get_template
from cnnum.errors import NoOpenCLError


def pytest_configure():
    wanted = os.environ.get("CNNUM_TEST_DEVICE")
    if wanted:
        only(wanted)


def pytest_sessionstart():
    """Compile for one precision a worker: both would compile the same at the same time."""
    precisions = {"gw0": "float32", "gw1": "float64"}
    precision = precisions.get(os.environ.get("PYTEST_XDIST_WORKER", ""))
    if precision is not None:
        Engine("numba", precision=precision).run(get_template("DIFFUS"), input=[[0.0]])


def only(wanted: str) -> None:
    """Leave no other device in this process than those whose name has `wanted` in it.

    Processes that a test starts choose for themselves: `measure` counts all devices, as they do.
    """
    from cnnum.engines.opencl import devices
    from cnnum.engines.opencl.runtime import peak_measurement as measure
    from cnnum.engines.opencl.runtime import selection, self_test
    from cnnum.errors import DeviceError

    listed = devices.list_devices
    # their own names for it are kept: they count devices as the processes that they start do
    assert measure.list_devices is self_test.list_devices is listed
    try:
        label = selection.choose_device(wanted).label
    except DeviceError as error:
        raise pytest.UsageError(str(error)) from None
    devices.list_devices = selection.list_devices = lambda: tuple(
        device for device in listed() if wanted.lower() in device.label.lower()
    )
    assert selection.choose_device(None).label == label


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup(item: pytest.Item) -> Generator[None, object, object]:
    """Skip a test whose fixtures ask for OpenCL where there is none."""
    try:
        return (yield)
    except NoOpenCLError as error:
        pytest.skip(f"this test is about OpenCL: {error.reason}")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, object, object]:
    """Skip a test that asks for OpenCL by name where there is none."""
    try:
        return (yield)
    except NoOpenCLError as error:
        pytest.skip(f"this test is about OpenCL: {error.reason}")


@pytest.fixture(scope="session")
def fast() -> Engine:
    """The engine that users get: OpenCL where a device works, else Numba."""
    return Engine()


@pytest.fixture(scope="session")
def opencl() -> Engine:
    """The OpenCL engine; the test is skipped where there is none."""
    return Engine("opencl")
