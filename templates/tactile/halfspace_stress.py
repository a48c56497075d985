"""Stress under an elastic cover from the load on its surface, by diffusion waves."""

from collections.abc import Mapping

from cnnum.programs import program
from cnnum.programs.fields import Field
from cnnum.programs.machine import FrameFields
from cnnum.templates.tactile.cover_model.diffusion_waves import (
    WaveExtension,
    read_out_times,
    waves_of,
)
from cnnum.templates.tactile.cover_model.fields import Surface, depth_in_cells


def surface_of(frame: FrameFields, depth: float, tolerance: float) -> Surface:
    """Return the surface loads of a frame as waves, `depth` cells below the surface."""
    times = read_out_times(depth, frame.shape, tolerance)
    x, y, p = (
        WaveExtension(waves_of(frame.channel(c), times), depth)
        for c in ("shear_x", "shear_y", "normal")
    )
    return Surface(x, y, p, depth)


@program
def halfspace_stress(
    frame: FrameFields,
    *,
    thickness: float = 1.0e-3,
    pitch: float = 1.5e-3,
    cells: int = 1,
    tolerance: float = 1e-6,
) -> Mapping[str, Field]:
    """Stress that taxels see under a load on an incompressible cover.

    On the lattice k is the root of the five-point Laplacian's eigenvalue. No flux crosses the rim
    of the array, as if the load went on mirrored. The error against the half-space falls as the
    square of the cell over the thickness.

    Parameters
    ----------
    frame : FrameFields
        Surface tractions, Pa: `shear_x`, `shear_y`, and the pressure `normal`, a value a cell.
    thickness : float, m
        Thickness of the cover.
    pitch : float, m
        Pitch of the taxels.
    cells : int
        Cells a taxel along each axis: 8×8 taxels at 4 cells each are an array of 32×32.
    tolerance : float
        Tolerance of every wave's fading, as a share of the load.

    Returns
    -------
    mapping
        `stress_xz`, `stress_yz`, `stress_zz`: maps, Pa, tension positive.

    Raises
    ------
    ProgramError
        If a size or the tolerance is out of range.

    References
    ----------
    Johnson, Contact Mechanics, 3.2 (Boussinesq, Cerruti), transformed along the surface.
    """
    return surface_of(frame, depth_in_cells(thickness, pitch, cells), tolerance).stress()
