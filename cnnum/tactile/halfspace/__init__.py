"""The elastic half-space: an infinitely thick flat cover, loaded on its surface.

x and y lie in the surface, z points into the material; forces and pressures are positive into
the material, stress is positive in tension. On maps, columns run along x and rows along y.
"""

from cnnum.tactile.halfspace.point import displacement, strain, strain_energy_density, stress
from cnnum.tactile.halfspace.rectangle import (
    rectangle_displacement,
    rectangle_strain,
    rectangle_stress,
)
from cnnum.tactile.halfspace.surface import (
    SurfaceToDepth,
    surface_load_strain,
    surface_load_stress,
)

__all__ = [
    "SurfaceToDepth",
    "displacement",
    "rectangle_displacement",
    "rectangle_strain",
    "rectangle_stress",
    "strain",
    "strain_energy_density",
    "stress",
    "surface_load_strain",
    "surface_load_stress",
]
