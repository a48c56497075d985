"""Lets the whole suite run on another OpenCL device: `CNNUM_TEST_DEVICE=Intel pytest`."""

import os


def pytest_configure():
    device = os.environ.get("CNNUM_TEST_DEVICE")
    if device:
        from cnnum.engines import opencl

        choose = opencl.choose_device
        opencl.choose_device = lambda name: choose(name or device)
