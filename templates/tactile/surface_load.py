"""The load on the surface of a cover from what taxels under it see."""

from collections.abc import Mapping

from cnnum.graph.nodes import RunSpec
from cnnum.programs import program
from cnnum.programs.fields import Field, sqrt
from cnnum.programs.machine import FrameFields
from cnnum.programs.transients import transient
from cnnum.templates.tactile.load_network import LoadNetwork

PATIENCE = 1e6
"""Time constants after which the network gives up."""


@program
def surface_load(
    frame: FrameFields,
    *,
    thickness: float = 1.0e-3,
    pitch: float = 1.5e-3,
    youngs_modulus: float = 0.87e6,
    noise: float = 1e-4,
    likely: float = 3.0e3,
    reach: int = 7,
    tolerance: float = 1e-4,
) -> Mapping[str, Field]:
    """Tractions all over the surface, any number of contacts at once.

    What noise drowns is left out: the answer is smeared over the width of its point response.
    A uniform pressure makes no strain in an incompressible half-space, so that a pressure is seen
    by its edges.

    Parameters
    ----------
    frame : FrameFields
        Tensor strains at the taxels, tension positive: `shear_x`, `shear_y`, `normal`.
    thickness, pitch : float, m
        Of the cover, and of the taxels.
    youngs_modulus : float, Pa
        Of the cover.
    noise : float
        RMS of the noise of each strain, as measured at rest.
    likely : float, Pa
        RMS of the loads that are taken as likely: with the noise it sets the regularisation
        (Wiener's choice).
    reach : int
        Taxels, along each axis, over which a load is felt.
    tolerance : float
        Of the equilibrium where the array is too large for one exact product.

    Returns
    -------
    mapping
        `load_x`, `load_y`, `load_normal`: maps, Pa, a pressure counting as positive; `residual`:
        RMS of what no load explains, in units of the noise.

    Raises
    ------
    ProgramError
        If a parameter is not above 0.

    References
    ----------
    Tikhonov & Arsenin, Solutions of Ill-Posed Problems (1977).
    """
    network = LoadNetwork(thickness, pitch, youngs_modulus, noise, likely, reach)
    spec = RunSpec(rtol=tolerance, atol=tolerance, settle_limit=PATIENCE)
    signals = [frame.channel(c) * (1.0 / noise) for c in ("shear_x", "shear_y", "normal")]
    states = transient(network.template(), input=signals, spec=spec).states
    x, y, normal = (state * (noise / network.scale) for state in states[:3])
    left = sum((s * s for s in states[4:]), start=states[3] * states[3])
    residual = sqrt(left.mean() * (1.0 / 3.0))
    return {"load_x": x, "load_y": y, "load_normal": normal, "residual": residual}
