"""Creep of the simulated cover: the strain of every scan run through the standard linear solid."""

import numpy as np

from cnnum.arrays import Floats
from cnnum.drivers.simulated.settings import Settings
from cnnum.tactile.cover import Creep, StandardLinearSolid, at_rest, creep_step


class Creeping:
    """A cover that creeps, as a stream of strain in and out.

    Tractions are taken as they come: the contact is the one on a cover with the instant modulus.

    Parameters
    ----------
    options : Settings
    """

    def __init__(self, options: Settings) -> None:
        instant = options.youngs_modulus
        relaxed = instant * (1 - options.creep)
        self._solid = StandardLinearSolid(instant, relaxed, options.creep_time)
        self._elastic = options.creep == 0
        self._shape = (*options.taxels, 3)
        self._step = 1 / options.rate

    def rest(self) -> Creep:
        """Return the memory of the cover before the first scan."""
        return at_rest(self._shape)

    def __call__(self, before: Creep, elastic: Floats) -> tuple[Floats, Creep]:
        """Return the strain that scans see, and the memory after them.

        Parameters
        ----------
        before : Creep
        elastic : (scans, rows, cols, 3) float
            Strain of a cover with the instant modulus, under the same tractions.
        """
        if self._elastic:
            return elastic, before
        strain = np.empty_like(elastic)
        memory = before
        for n, now in enumerate(elastic):
            memory = creep_step(self._solid, memory, now, self._step)
            strain[n] = memory.strain
        return strain, memory
