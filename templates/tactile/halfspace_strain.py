"""Strain under an elastic cover from the load on its surface, by diffusion waves."""

from collections.abc import Mapping

from cnnum.programs import program
from cnnum.programs.fields import Field
from cnnum.programs.machine import FrameFields
from cnnum.programs.parameters import refuse_outside
from cnnum.templates.tactile.cover_model.fields import depth_in_cells
from cnnum.templates.tactile.halfspace_stress import surface_of


@program
def halfspace_strain(
    frame: FrameFields,
    *,
    thickness: float = 1.0e-3,
    pitch: float = 1.5e-3,
    cells: int = 1,
    youngs_modulus: float = 0.87e6,
    tolerance: float = 1e-6,
) -> Mapping[str, Field]:
    """Compute the strain at the taxels under a load on an incompressible cover.

    The normal strain under a pressure is a band-pass, kz exp(−kz), and has no mean. Boundaries,
    errors and the frame are those of `halfspace_stress`.

    Parameters
    ----------
    frame, thickness, pitch, cells
        As in `halfspace_stress`.
    youngs_modulus : float, Pa
        Young's modulus of the cover; 0.87 MPa is that of Vásárhelyi's calculations (2007).
    tolerance : float
        As in `halfspace_stress`.

    Returns
    -------
    mapping
        `strain_xz`, `strain_yz` (tensor shear), `strain_zz`: maps, tension positive.

    References
    ----------
    Hooke's law on the stress of `halfspace_stress` at ν = 1/2.
    """
    refuse_outside(youngs_modulus=(youngs_modulus, 1e-9, 1e15))
    depth = depth_in_cells(thickness, pitch, cells)
    return surface_of(frame, depth, tolerance).strain(youngs_modulus)
