"""The peak of a device, measured again and again beside figures that are given as shares of it."""

from cnnum.engine import Engine
from cnnum.engines.opencl.devices import choose_device
from cnnum.engines.opencl.measure import measure


class PeakMeter:
    """Measures the multiply-add peak of an engine's device; the best of a whole run counts.

    Attributes
    ----------
    best : float
        Best rate so far of any kernel, operations a second; 0 before the first measurement.
    """

    def __init__(self, engine: Engine) -> None:
        self._device = choose_device(engine.device)
        self.best = 0.0

    def measure(self, times: int = 1) -> None:
        """Measure all kernels so many times."""
        for _ in range(times):
            self.best = max(self.best, measure(self._device).flops)
