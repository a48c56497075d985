"""From a case to what the program is given: strain at the taxels, with the truth beside it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.drivers.simulated.array import SimulatedArray
from cnnum.lab.scoring.generated.case import Case
from cnnum.report.record import truth_columns
from cnnum.tactile.taxel import Readout


@dataclass(frozen=True, slots=True, eq=False)
class Simulated:
    """A case with its frames.

    Attributes
    ----------
    case : Case
    times : (frames,) float, s
    strain : (frames, rows, cols, 3) float32
        As the calibration of the whole array has it.
    truth : dict of str to (frames,) float
    """

    case: Case
    times: Floats
    strain: NDArray[np.float32]
    truth: dict[str, Floats]


class Simulator:
    """Simulates cases; those of one geometry, one after the other, share their influence."""

    def __init__(self) -> None:
        self._geometry: tuple[object, ...] = ()
        self._influence: Floats | None = None

    def __call__(self, case: Case) -> Simulated:
        """Return the frames of a case.

        Raises
        ------
        PhysicsError
            If the contact leaves the array.
        """
        known = self._influence if case.geometry == self._geometry else None
        array = SimulatedArray(case.settings, known)
        self._geometry, self._influence = case.geometry, array.influence
        frames = list(array.frames())
        times = np.array([frame.time for frame in frames])
        volts = np.stack([frame.values for frame in frames])
        settings = case.settings
        readout = Readout(gain=settings.gain, noise=settings.noise, bits=settings.bits or None)
        broken = case.faults.apply(volts, times, readout)
        strain = array.calibration.to_strain(broken, time=times)
        return Simulated(
            case, times, strain.astype(np.float32), truth_columns([f.truth for f in frames])
        )
