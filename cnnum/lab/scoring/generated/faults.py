"""What happens to voltages on the way: warming up, dead and stuck bridges, noisy taxels.

The simulated array itself is whole; these are added to what it reads, and put through its
converter once more.
"""

from dataclasses import dataclass

import numpy as np

from cnnum.arrays import Floats
from cnnum.tactile.taxel import Readout


@dataclass(frozen=True, slots=True)
class Faults:
    """Faults of an array.

    Attributes
    ----------
    seed : int
        Of which taxels are hit, and how.
    dead : int
        Taxels that read 0 V on all bridges.
    stuck : int
        Bridges that stand at a voltage of their own.
    noisy : int
        Taxels with ten times the noise.
    begins : float, s
        When taxels and bridges break; before 0 they always were.
    drift : float, V
        Warming up: how far the bridges drift in all (Table 3.II: 10 mV under a cover).
    drift_time : float, s
        Its time constant.
    drift_spread : float
        RMS share by which a bridge differs from the others: what is left in a difference.
    """

    seed: int = 0
    dead: int = 0
    stuck: int = 0
    noisy: int = 0
    begins: float = 0.0
    drift: float = 0.0
    drift_time: float = 180.0
    drift_spread: float = 0.2

    @property
    def name(self) -> str:
        """The kinds of faults, for people."""
        kinds = {
            "dead": self.dead,
            "stuck": self.stuck,
            "noisy": self.noisy,
            "drift": self.drift,
        }
        return " and ".join(kind for kind, amount in kinds.items() if amount) or "none"

    def apply(self, volts: Floats, times: Floats, readout: Readout) -> Floats:
        """Return the voltages with the faults in them.

        Parameters
        ----------
        volts : (frames, rows, cols, 4) float, V
        times : (frames,) float, s
        readout : Readout
            Its converter, range and noise.
        """
        if self.name == "none":
            return volts
        rng = np.random.default_rng(self.seed)
        spread = 1.0 + self.drift_spread * rng.standard_normal(volts.shape[1:])
        rise = self.drift * (1.0 - np.exp(-times / self.drift_time))
        moved = volts + rise[:, None, None, None] * spread
        broken = moved[times >= self.begins]
        self._break(broken.reshape(len(broken), -1, 4), rng, readout)
        moved[times >= self.begins] = broken
        return Readout(gain=1.0, bits=readout.bits, limit=readout.limit).read(moved)[0]

    def _break(self, volts: Floats, rng: np.random.Generator, readout: Readout) -> None:
        """Change (frames, taxels, 4) voltages in place; no taxel is hit twice."""
        hit = rng.permutation(volts.shape[1])
        ends = np.cumsum([self.dead, self.stuck, self.noisy])
        dead, stuck, noisy = hit[: ends[0]], hit[ends[0] : ends[1]], hit[ends[1] : ends[2]]
        volts[:, dead] = 0.0
        sides = rng.integers(0, 4, stuck.size)
        volts[:, stuck, sides] = rng.uniform(-readout.limit, readout.limit, stuck.size)
        more = 99**0.5 * readout.noise
        volts[:, noisy] += rng.normal(0.0, more, (len(volts), noisy.size, 4))
