"""A machine whose processor is newer than the compiler of the PoCL wheel, played on this one.

A Python that finds this folder on PYTHONPATH sees the wheel's devices as such a machine does: the
processor is "generic", and the compiler refuses every kernel until the device is repaired.
With CNNUM_PLAY=unrepairable no name that the compiler knows fits the processor.
"""

import os
import sys
from importlib.abc import MetaPathFinder
from importlib.util import find_spec


class _AfterPyOpenCL(MetaPathFinder):
    """Changes PyOpenCL's list of platforms when it is imported."""

    def find_spec(self, name, path=None, target=None):
        if name != "pyopencl":
            return None
        sys.meta_path.remove(self)
        spec = find_spec(name)
        load = spec.loader.exec_module

        def exec_module(module):
            load(module)
            _play(module)

        spec.loader.exec_module = exec_module
        return spec


def _play(cl):
    listed, played = cl.get_platforms, set()

    def get_platforms():
        from cnnum.engines.devices.pocl import (
            TARGETS,
            UNKNOWN,
            is_wheel,
            rename_target,
        )

        if os.environ.get("CNNUM_PLAY") == "unrepairable":
            TARGETS.clear()
        platforms = listed()
        for platform in platforms:
            for device in platform.get_devices():
                if device.int_ptr not in played and is_wheel(device):
                    rename_target(device, UNKNOWN)
                    played.add(device.int_ptr)
        return platforms

    cl.get_platforms = get_platforms


sys.meta_path.insert(0, _AfterPyOpenCL())
