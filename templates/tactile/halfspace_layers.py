"""Stress and strain under an elastic cover by relaxing a stack of depth layers."""

from collections.abc import Mapping

from cnnum.programs import program
from cnnum.programs.fields import Field
from cnnum.programs.machine import FrameFields
from cnnum.programs.parameters import refuse_outside
from cnnum.templates.tactile.cover_model.depth_layers import relaxed, stack_of
from cnnum.templates.tactile.cover_model.fields import Surface, depth_in_cells


@program
def halfspace_layers(
    frame: FrameFields,
    *,
    thickness: float = 1.0e-3,
    pitch: float = 1.5e-3,
    cells: int = 1,
    youngs_modulus: float = 0.87e6,
    layers: int = 8,
    order: int = 4,
    tolerance: float = 1e-6,
    method: str = "auto",
) -> Mapping[str, Field]:
    """Stress and strain under a load on an incompressible cover, by layers of depth at rest.

    The same lattice as `halfspace_stress`, rim and all, reached the other way: the depth is cut
    into slabs, and the error falls as their thickness squared, or to the fourth.

    Parameters
    ----------
    frame, thickness, pitch, cells
        As in `halfspace_stress`.
    youngs_modulus : float, Pa
        Young's modulus of the cover.
    layers : int
        Slabs between surface and taxels; below them they get thicker.
    order : 2 or 4
        Order of the error in the slabs: templates of 3×3 or of 5×5.
    tolerance : float
        Tolerance of the reflection at the end of the stack, as a share of the load.
    method : str
        How the layers come to rest: "auto" goes there without time steps where the engine can,
        "runge-kutta-chebyshev" relaxes.

    Returns
    -------
    mapping
        `stress_xz`, `stress_yz`, `stress_zz`, Pa, and `strain_xz`, `strain_yz`, `strain_zz`.

    Raises
    ------
    ProgramError
        If a size, the layers, the order or the tolerance is out of range.
    """
    refuse_outside(youngs_modulus=(youngs_modulus, 1e-9, 1e15), layers=(layers, 0, 256))
    depth = depth_in_cells(thickness, pitch, cells)
    stack = stack_of(depth, frame.shape, layers, order, tolerance)
    x, y, p = (
        relaxed(frame.channel(c), stack, method, tolerance)
        for c in ("shear_x", "shear_y", "normal")
    )
    surface = Surface(x, y, p, depth)
    return {**surface.stress(), **surface.strain(youngs_modulus)}
