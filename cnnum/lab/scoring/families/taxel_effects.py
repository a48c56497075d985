"""Effects of real taxels on strain: creep, hysteresis, gains, cross-talk, saturation, dead ones."""

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from cnnum.arrays import Floats
from cnnum.drivers.simulated.array import SimulatedArray

CREEP_TIME = 2.0
"""s, of the cover's creep: 5 %/s at first is a tenth in the end."""

HEAVY = 3
"""Degrees of freedom of the noise that is not Gaussian."""


@dataclass(frozen=True, slots=True)
class Skin:
    """Faults of an array.

    Attributes
    ----------
    creep : float, 1/s
        Share by which a constant strain grows at first.
    hysteresis : float
        Width of a taxel's loop, as a share of the largest strain.
    gains : float
        Largest share by which a channel's gain is off; each draws its own.
    crosstalk : float
        Share of a taxel's signal that comes from its four neighbours.
    shear : float
        Gain of the shear channels, against that of the normal ones.
    limit : float
        Where channels saturate, as a share of the largest strain.
    dead : int
        Taxels that read 0.
    heavy : bool
        Whether as much noise again comes with rare large jumps (Student's t).
    """

    creep: float = 0.0
    hysteresis: float = 0.0
    gains: float = 0.0
    crosstalk: float = 0.0
    shear: float = 1.0
    limit: float = 1.0
    dead: int = 0
    heavy: bool = False

    def read(self, array: SimulatedArray, strain: Floats, rng: np.random.Generator) -> Floats:
        """Return the strain as taxels read it.

        Parameters
        ----------
        array : SimulatedArray
            Its bridges, noise and converter.
        strain : (frames, rows, cols, 3) float
            True strain.
        rng : numpy.random.Generator
        """
        strain = creeping(strain, self.creep, array.rate) if self.creep else strain
        strain = loops(strain, self.hysteresis) if self.hysteresis else strain
        strain = strain * np.array([self.shear, self.shear, 1.0])
        strain = strain * rng.uniform(1 - self.gains, 1 + self.gains, strain.shape[1:])
        if self.limit < 1.0:
            most = self.limit * np.abs(strain).max()
            strain = np.clip(strain, -most, most)
        times = np.arange(len(strain)) / array.rate
        read = array.calibration.to_strain(array.read(strain).volts, time=times)
        return self._disturbed(mixed(read, self.crosstalk), rng)

    def _disturbed(self, read: Floats, rng: np.random.Generator) -> Floats:
        if self.heavy:
            noise = np.std(np.diff(read[:10], axis=0)) / 2**0.5
            # a variance of one, as Student's t has f/(f − 2)
            jumps = rng.standard_t(HEAVY, read.shape) * ((HEAVY - 2) / HEAVY) ** 0.5
            read = read + noise * jumps
        for taxel in rng.permutation(read.shape[1] * read.shape[2])[: self.dead]:
            read[:, taxel // read.shape[2], taxel % read.shape[2]] = 0.0
        return read


def creeping(strain: Floats, share: float, rate: float) -> Floats:
    """Return strain that creeps: a constant one grows by a share a second at first."""
    keep = float(np.exp(-1.0 / (rate * CREEP_TIME)))
    lags = lfilter([1.0 - keep], [1.0, -keep], strain, axis=0)
    return np.asarray(strain + share * CREEP_TIME * lags)


def loops(strain: Floats, width: float) -> Floats:
    """Return strain with play: it follows only when half the loop's width is used up."""
    half = 0.5 * width * np.abs(strain).max()
    made, last = np.empty_like(strain), strain[0]
    for n, now in enumerate(strain):
        last = np.clip(last, now - half, now + half)
        made[n] = last
    return made


def mixed(read: Floats, share: float) -> Floats:
    """Return signals with a share from the four neighbours each; rims repeat."""
    wide = np.pad(read, ((0, 0), (1, 1), (1, 1), (0, 0)), mode="edge")
    around = wide[:, 2:, 1:-1] + wide[:, :-2, 1:-1] + wide[:, 1:-1, 2:] + wide[:, 1:-1, :-2]
    return np.asarray((1.0 - share) * read + share * around / 4.0)
