"""The peak of a device, measured again beside every figure that is given as a share of it."""

from cnnum.engine import Engine
from cnnum.engines.opencl.devices import choose_device
from cnnum.engines.opencl.measure import measure


class PeakMeter:
    """Measures the multiply-add peak of an engine's device; the best so far counts."""

    def __init__(self, engine: Engine) -> None:
        self._device = choose_device(engine.device)
        self._best = 0.0

    def flops(self) -> float:
        """Return the best multiply-add rate seen on this device in this run."""
        self._best = max(self._best, measure(self._device).flops)
        return self._best
