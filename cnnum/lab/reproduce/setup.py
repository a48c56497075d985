"""The conditions of the experiments that are reproduced."""

from math import pi

import numpy as np

from cnnum.arrays import Floats
from cnnum.tactile.halfspace import strain
from cnnum.tactile.taxel import Coupling, Readout, Taxel

E = 0.87e6
"""Young's modulus of the figures, Pa (section 4.2.4)."""

Z = 200e-6
"""Thickness of the cover, m (Fig. 4.5, 4.14, 4.17)."""

BETA = 1.5
"""α_s/α_n, "an average value … used as a good approximation" (4.3.3)."""

NEWTON = np.array([0.0, 0.0, 1.0])
"""The normal load of the figures of chapter 4, N (4.2.4)."""

NOISE = 2.5e-3
"""RMS of an amplified voltage, V: Table 3.II says 2–3 mV."""

LOAD = 15e-3
"""Load of the simulated scans, N: within the 30 mN of section 4.3.2, and no bridge above 1.5 V."""

RATE = 50.0
"""Frames a second of the scan of Fig. 5.3."""

MM = 1e3
UM = 1e6


def covered_taxel(beta_ns: float = BETA, depth: float = Z) -> Taxel:
    """Return one taxel under a flat cover that divides the sensitivity by ten (Table 3.II)."""
    coupling = Coupling.nominal(depth=depth, youngs_modulus=E, reduction=10.0, beta_ns=beta_ns)
    return Taxel(coupling, readout=Readout(gain=55.0, noise=NOISE))


def point_strain(x: Floats, y: Floats, load: float, depth: float = Z) -> Floats:
    """Return (..., 3) ε_xz, ε_yz, ε_zz at the taxel, for a normal load at (x, y)."""
    full = strain(-x, -y, depth, load * NEWTON, youngs_modulus=E)
    return np.asarray(full[..., 2])


def largest_strain(load: float, depth: float = Z) -> float:
    """Return A of (4.18)."""
    return 3.0 * load / (2.0 * pi * E * depth**2)
