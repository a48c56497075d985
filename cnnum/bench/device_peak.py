"""The peak of a device, measured again and again beside figures that are given as shares of it."""

from collections.abc import Callable

from cnnum.engine import Engine
from cnnum.engines.opencl.devices import choose_device
from cnnum.engines.opencl.measure import measure
from cnnum.engines.opencl.measure_kernels import Bench, arithmetic_kernels


class PeakMeter:
    """Measures the multiply-add peak of an engine's device; the best of a whole run counts.

    Attributes
    ----------
    best : float
        Best rate so far of any kernel, operations a second; 0 before the first measurement.
    kernel : str
        The kernel that had it; empty before.
    """

    def __init__(self, engine: Engine) -> None:
        self._device = choose_device(engine.device)
        self.best, self.kernel = 0.0, ""

    def measure(self, times: int = 1) -> None:
        """Measure all kernels so many times."""
        for _ in range(times):
            found = measure(self._device)
            if found.flops > self.best:
                self.best, self.kernel = found.flops, found.kernel

    def turn(self) -> Callable[[], float]:
        """Return what runs the best kernel once, some 20 ms, and tells its operations a second.

        It runs here, not in a process of its own, for it has run in one: `measure` comes first.
        """
        (kernel,) = (known for known in arithmetic_kernels() if known.label == self.kernel)
        return Bench(self._device).rate(kernel)
