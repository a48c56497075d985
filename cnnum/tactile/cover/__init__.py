"""Covers of a taxel array: from a load on the cover's top to stress and strain at the taxels.

`FlatCover` is the half-space, and `LayerCover` a layer on a rigid base. `RidgeCover`, `HairCover`
and `BumpCover` are the shapes that emerge from a cover. All answer as `Cover` says. Any of them may
creep (`StandardLinearSolid`, `creep_step`). `compare` says how far flat models get from measured
covers, `plane_figures` the data of the dissertation's own bump model. The bump's coefficients ship
with the package; `cnnum.tactile.cover.fem` works them out anew.
"""

from cnnum.tactile.cover.bump import BumpCover, BumpTables, PlaneFigures, load_tables, plane_figures
from cnnum.tactile.cover.comparison import MODELS, ComparisonRow, Merit, Model, compare, merit
from cnnum.tactile.cover.hair import HairCover, RidgeCover
from cnnum.tactile.cover.layer import (
    LayerCover,
    LayerWaves,
    layer_displacement_transfer,
    layer_stress_transfer,
    layer_waves,
)
from cnnum.tactile.cover.protocol import Cover, FlatCover
from cnnum.tactile.cover.viscoelastic import Creep, StandardLinearSolid, at_rest, creep_step

__all__ = [
    "MODELS",
    "BumpCover",
    "BumpTables",
    "ComparisonRow",
    "Cover",
    "Creep",
    "FlatCover",
    "HairCover",
    "LayerCover",
    "LayerWaves",
    "Merit",
    "Model",
    "PlaneFigures",
    "RidgeCover",
    "StandardLinearSolid",
    "at_rest",
    "compare",
    "creep_step",
    "layer_displacement_transfer",
    "layer_stress_transfer",
    "layer_waves",
    "load_tables",
    "merit",
    "plane_figures",
]
