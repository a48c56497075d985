"""Piezoresistive three-axial taxels: strain to bridge voltages, and back.

Forward: `Coupling` (cover to silicon), `Bridge` (silicon), `Readout` (electronics), together a
`Taxel`. Back: `Calibration`, fitted from a scan of point loads by `fit_calibration`.
"""

from cnnum.tactile.taxel.bridge import SIDES, Bridge, Piezoresistor, von_mises
from cnnum.tactile.taxel.calibration import Calibration, identity_of
from cnnum.tactile.taxel.fit import CalibrationFit, fit_calibration
from cnnum.tactile.taxel.readout import Heat, Reading, Readout
from cnnum.tactile.taxel.receptive_field import Coupling, ReceptiveField, receptive_field
from cnnum.tactile.taxel.sensor import Taxel

__all__ = [
    "SIDES",
    "Bridge",
    "Calibration",
    "CalibrationFit",
    "Coupling",
    "Heat",
    "Piezoresistor",
    "Reading",
    "Readout",
    "ReceptiveField",
    "Taxel",
    "fit_calibration",
    "identity_of",
    "receptive_field",
    "von_mises",
]
