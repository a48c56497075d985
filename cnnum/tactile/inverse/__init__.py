"""From the strain at taxels back to the load on the cover (dissertation, chapter 5).

From one taxel: `locate` (strain), `locate_stress`, `locate_signals` (bridge signals). From several:
`locate_load`, a load in three directions. From a whole frame: `LoadMap`, a map of tractions.
"""

from cnnum.tactile.inverse.load_map import LoadMap, SurfaceLoad
from cnnum.tactile.inverse.moments import (
    force_from_moments,
    largest_spacing,
    resolution_limit,
    sliding_force,
)
from cnnum.tactile.inverse.point import PointLoad, locate, locate_signals, locate_stress
from cnnum.tactile.inverse.spatial import SpatialLoad, locate_load

__all__ = [
    "LoadMap",
    "PointLoad",
    "SpatialLoad",
    "SurfaceLoad",
    "force_from_moments",
    "largest_spacing",
    "locate",
    "locate_load",
    "locate_signals",
    "locate_stress",
    "resolution_limit",
    "sliding_force",
]
