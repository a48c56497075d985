"""Contacts of a rigid body with the cover: pressure, partial slip, twist, and their maps.

Loads grow monotonically from zero; pressure and tractions act on the cover, and z points into it.
On maps, columns run along x and rows along y, with the origin in the middle.
"""

from cnnum.tactile.contact.cells import (
    cell_average,
    inverse_average,
    root_average,
    swirl_average,
    twist_average,
)
from cnnum.tactile.contact.normal import (
    Hertz,
    PartialSlip,
    contact_modulus,
    hertz,
    partial_slip,
    punch_indentation,
    punch_pressure,
    shear_compliance,
    stuck_traction,
    tangential_displacement,
)
from cnnum.tactile.contact.sphere import ContactState, sphere_traction
from cnnum.tactile.contact.torsion import (
    TorsionSlip,
    sliding_torque,
    stuck_torsion_traction,
    stuck_twist,
    torsion_slip,
)

__all__ = [
    "ContactState",
    "Hertz",
    "PartialSlip",
    "TorsionSlip",
    "cell_average",
    "contact_modulus",
    "hertz",
    "inverse_average",
    "partial_slip",
    "punch_indentation",
    "punch_pressure",
    "root_average",
    "shear_compliance",
    "sliding_torque",
    "sphere_traction",
    "stuck_torsion_traction",
    "stuck_traction",
    "stuck_twist",
    "swirl_average",
    "tangential_displacement",
    "torsion_slip",
    "twist_average",
]
