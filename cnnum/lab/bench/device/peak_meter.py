"""The peak of a device, measured again with each figure that is a share of it."""

import math
from collections.abc import Callable

from cnnum.engine import Engine


class PeakMeter:
    """Measures the multiply-add peak of an engine's device; the best of a whole run counts.

    Only OpenCL devices have kernels to measure it with: it is NaN on other engines.

    Attributes
    ----------
    best : float
        Best rate so far of any kernel, operations a second; 0 before the first measurement.
    kernel : str
        The kernel that had it; empty before.
    """

    def __init__(self, engine: Engine) -> None:
        self._name = engine.device if engine.name == "opencl" else None
        self.best, self.kernel = (math.nan if self._name is None else 0.0), ""

    def measure(self, times: int = 1) -> None:
        """Measure all kernels a number of times."""
        if self._name is None:
            return
        from cnnum.engines.devices.selection import choose_device
        from cnnum.lab.bench.device.peak_measurement import measure

        for _ in range(times):
            found = measure(choose_device(self._name))
            if found.flops > self.best:
                self.best, self.kernel = found.flops, found.kernel

    def turn(self) -> Callable[[], float]:
        """Return a function that runs the best kernel once, some 20 ms, for operations a second.

        It runs here, not in a process of its own, for it has run in one: `measure` comes first.
        """
        if self._name is None:
            return lambda: math.nan
        from cnnum.engines.devices.selection import choose_device
        from cnnum.lab.bench.device.peak_kernels import Bench, arithmetic_kernels

        (kernel,) = (known for known in arithmetic_kernels() if known.label == self.kernel)
        return Bench(choose_device(self._name)).rate(kernel)
