"""A whole taxel array, forward: strain under the cover to the computer's readings."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from cnnum.arrays import Floats
from cnnum.tactile.taxel.bridge import COMBINE, Bridge
from cnnum.tactile.taxel.calibration import Calibration
from cnnum.tactile.taxel.readout import Reading, Readout
from cnnum.tactile.taxel.receptive_field import Coupling


@dataclass(frozen=True, slots=True, eq=False)
class Taxel:
    """Link to the cover, silicon and electronics of an array of identical taxels.

    Attributes
    ----------
    coupling : Coupling
    bridge : Bridge
    readout : Readout
    """

    coupling: Coupling
    bridge: Bridge = field(default_factory=Bridge)
    readout: Readout = field(default_factory=Readout)

    def read(
        self,
        strain: ArrayLike,
        *,
        time: ArrayLike = np.inf,
        rng: np.random.Generator | None = None,
    ) -> Reading:
        """Return the voltages of a strain field, with saturation and overload flagged.

        Parameters
        ----------
        strain : (..., rows, cols, 3) float
            ε_xz, ε_yz, ε_zz at the taxels (or the stresses, Pa, for a stress coupling).
        time : (...) float, s
            Time since switch-on, one per frame; infinity means warm.
        rng : numpy.random.Generator, optional
            Source of the noise; without it there is none.

        Returns
        -------
        Reading

        Raises
        ------
        ArrayError
            If the last axis does not hold three components, or a value is not finite.
        """
        force = self.coupling.force(strain)
        volts, saturated = self.readout.read(self.bridge.voltages(force), time=time, rng=rng)
        return Reading(volts, saturated, self.bridge.overloaded(force))

    def calibration(self, depth: float | None = None) -> Calibration:
        """Return the exact calibration of this array (for a linear bridge).

        Parameters
        ----------
        depth : float, m, optional
            Thickness of the cover, to be stored with the calibration.
        """
        per_force = 0.25 * self.readout.gain * self.bridge.supply
        per_force *= self.bridge.piezoresistor.pi_44
        shear = per_force * abs(self.bridge.shear) * self.coupling.shear  # V per −ε_xz
        normal = per_force * abs(self.bridge.normal) * self.coupling.normal
        return Calibration(
            alpha_normal=1.0 / normal,
            beta_ns=normal / shear,
            offsets=self.readout.offsets,
            cross=self._cross(shear, normal),
            heat=self.readout.heat,
            limit=self.readout.limit - 1.5 * self.readout.step,  # between the last two codes
            depth=depth,
        )

    def _cross(self, shear: float, normal: float) -> Floats:
        """Return the signals per ideal signal: the cover's and the bridges' mixing together."""
        volts = COMBINE @ (0.25 * self.readout.gain * self.bridge.supply * self.bridge.matrix)
        stiffness = np.array([self.coupling.shear, self.coupling.shear, self.coupling.normal])
        mixed = volts @ (self.coupling.cross * stiffness)
        return np.asarray(mixed / np.array([shear, shear, normal]), dtype=np.float64)
