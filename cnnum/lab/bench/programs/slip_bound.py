"""How soon the movement of a contact shows slip.

`python -m cnnum.lab.bench.programs.slip_bound [COUNT]` prints it.

An oracle knows the scene without noise, and when a pull slips or stops. It has to say which of the
two: what slips moves on, and every taxel reads it; what stopped at that moment stays as it was. So
the readings of the frames after it differ by a known amount, and what the most powerful test
(Neyman and Pearson) tells of it at a given rate of false reports follows from the noise alone. It
is not told how the force came to where it is: a stop well before slip shows in that, too. Tuning
seeds only.
"""

import sys
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from math import sqrt
from statistics import NormalDist

import numpy as np

from cnnum.arrays import Floats
from cnnum.drivers.simulated.array import SimulatedArray
from cnnum.drivers.simulated.settings import Settings
from cnnum.lab.scoring.generated.case import SCORING, Case
from cnnum.lab.scoring.generated.scripts import slip_case
from cnnum.report.verdicts import MAX_DELAY
from cnnum.tactile.taxel import Readout

FALSE = 0.01
"""Rate of false reports."""


@dataclass(frozen=True, slots=True)
class Told:
    """How well a pull's slip is told from a stop.

    Attributes
    ----------
    seed : int
    rate : float, Hz
    apart : float
        Distance of the two in standard deviations of the noise, over all taxels and axes and
        the frames from the onset to `MAX_DELAY` after it. All taxels are taken as whole.
    """

    seed: int
    rate: float
    apart: float

    @property
    def chance(self) -> float:
        """How likely the oracle is to tell it."""
        return power(self.apart)


def power(apart: float, false: float = FALSE) -> float:
    """Return how often the best test tells two normal readings that lie so far apart.

    Parameters
    ----------
    apart : float
        Standard deviations.
    false : float
        How often it may take the first for the second.
    """
    normal = NormalDist()
    return normal.cdf(apart - normal.inv_cdf(1.0 - false))


def told(case: Case) -> Told | None:
    """Return how well the slip of a case is told; None if it has none.

    Raises
    ------
    PhysicsError
        If the contact leaves the array.
    """
    array = SimulatedArray(case.settings)
    scans = list(array.scans())
    onset = next((n for n, (_, truth) in enumerate(scans) if truth["slip"]), None)
    if onset is None:
        return None
    strain = array.strain([state for state, _ in scans[onset - 1 : onset + MAX_DELAY + 1]])
    moved = (strain[1:] - strain[0]) / _noise(case.settings, array)
    return Told(case.seed, case.settings.rate, float(np.sqrt((moved**2).sum())))


def all_told(seeds: Iterable[int]) -> Iterator[Told]:
    """Yield how well slip is told in the tuning scenes that have one."""
    for case in (slip_case(seed) for seed in seeds if seed < SCORING):
        found = told(case) if "pull" in case.kind else None
        if found is not None:
            yield found


def _noise(settings: Settings, array: SimulatedArray) -> Floats:
    """Return the noise of strain, RMS, of the three axes; what rounding adds is in it."""
    step = Readout(bits=settings.bits or None).step
    shear, normal = array.calibration.strain_noise(sqrt(settings.noise**2 + step**2 / 12.0))
    return np.array([shear, shear, normal])


def main(count: int) -> None:
    """Print the figures of so many tuning seeds, by frames a second."""
    groups = defaultdict[float, list[Told]](list)
    for one in all_told(range(count)):
        groups[one.rate].append(one)
    for rate, ones in sorted(groups.items()):
        apart = np.median([one.apart for one in ones])
        chance = np.mean([one.chance for one in ones])
        print(f"{rate:6g} Hz: {len(ones):4} pulls, {apart:5.1f} apart (median), told {chance:.3f}")
    everyone = [one.chance for ones in groups.values() for one in ones]
    print(f"all: {len(everyone)} pulls, told {np.mean(everyone):.3f} at {FALSE:g} false")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 300)
