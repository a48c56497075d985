"""The suite on another OpenCL device: `CNNUM_TEST_DEVICE=Intel pytest`; Numba compiles once."""

import os

import pytest


def pytest_configure():
    wanted = os.environ.get("CNNUM_TEST_DEVICE")
    if wanted:
        only(wanted)


def pytest_sessionstart():
    """Compile for one precision a worker: both would compile the same at the same time."""
    precisions = {"gw0": "float32", "gw1": "float64"}
    precision = precisions.get(os.environ.get("PYTEST_XDIST_WORKER", ""))
    if precision is not None:
        from cnnum import Engine, get_template

        Engine("numba", precision=precision).run(get_template("DIFFUS"), input=[[0.0]])


def only(wanted: str) -> None:
    """Leave no other device in this process than those whose name has `wanted` in it.

    Processes that a test starts choose for themselves: `measure` counts all devices, as they do.
    """
    from cnnum.engines.opencl import devices, measure
    from cnnum.errors import DeviceError

    assert measure.list_devices is devices.list_devices  # its own name for it is kept
    listed = devices.list_devices
    try:
        label = devices.choose_device(wanted).label
    except DeviceError as error:
        raise pytest.UsageError(str(error)) from None
    devices.list_devices = lambda: tuple(
        device for device in listed() if wanted.lower() in device.label.lower()
    )
    assert devices.choose_device(None).label == label
