"""The elastic half-space: an infinitely thick flat cover, loaded on its surface.

x and y lie in the surface, and z points into the material. Forces and pressures are positive into
the material; stress is positive in tension. On maps, columns run along x and rows along y.
"""

from cnnum.tactile.halfspace.influence import strain_from_stress
from cnnum.tactile.halfspace.point import (
    displacement,
    line_load_stress,
    strain,
    strain_energy_density,
    stress,
)
from cnnum.tactile.halfspace.rectangle import (
    circle_axis_stress,
    rectangle_displacement,
    rectangle_strain,
    rectangle_stress,
)
from cnnum.tactile.halfspace.surface import (
    SurfaceToDepth,
    band_pass,
    harmonic_extension,
    low_pass,
    strain_transfer,
    stress_transfer,
    surface_load_strain,
    surface_load_stress,
)

__all__ = [
    "SurfaceToDepth",
    "band_pass",
    "circle_axis_stress",
    "displacement",
    "harmonic_extension",
    "line_load_stress",
    "low_pass",
    "rectangle_displacement",
    "rectangle_strain",
    "rectangle_stress",
    "strain",
    "strain_energy_density",
    "strain_from_stress",
    "strain_transfer",
    "stress",
    "stress_transfer",
    "surface_load_strain",
    "surface_load_stress",
]
