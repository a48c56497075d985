"""All that a frame of a calibrated array tells, as one program that shares what it can."""

from collections.abc import Mapping

from cnnum.programs import program
from cnnum.programs.fields import Field
from cnnum.programs.machine import FrameFields
from cnnum.programs.parameters import refuse_outside
from cnnum.tactile.indenters import Reads
from cnnum.templates.tactile.contact import contact_of
from cnnum.templates.tactile.contact_mechanics.contact_wrench import place_of
from cnnum.templates.tactile.contact_mechanics.cover_response import Skin
from cnnum.templates.tactile.cover_model.deconvolution import DEPTH, READS
from cnnum.templates.tactile.edges import edges_of
from cnnum.templates.tactile.localize import localize_of
from cnnum.templates.tactile.shared.loads import PUSH, loads_of, patch_of
from cnnum.templates.tactile.slip import slip_of
from cnnum.templates.tactile.twist import BUMP, RATE, Cover, twist_of


@program
def tactile(
    frame: FrameFields,
    *,
    push: float = PUSH,
    depth: float = DEPTH,
    reads: Reads = READS,
    unit: float = 1.0,
    rate: float = RATE,
    cover: Cover = "flat",
    bump: float = BUMP,
) -> Mapping[str, Field]:
    """Contact, slip, twist, edges and bumps; compile it with the outputs that are needed.

    The stream must begin without contact: its first frames say what rest is.

    Parameters
    ----------
    frame : FrameFields
        Strain, stress or calibrated signals, in any unit.
    push : float
        −1 for strain and stress, which count tension as positive; +1 for signals and counts that
        rise under a push.
    depth, reads
        See `edges` and `contact`; they are for `slip`, and the depth for `twist_rate`, too.
    unit : float
        See `contact`: what a unit of its loads is.
    rate : float, Hz
    cover : "flat", "bumpy" or "bumps-fem"
    bump : float
        See `slip` and `twist`.

    Returns
    -------
    mapping
        All outputs of `contact`, `slip`, `twist`, `edges` and `localize`.
    """
    refuse_outside(depth=(depth, 1e-6, 1e6))
    loads = loads_of(frame, push)
    place = place_of(loads, patch_of(loads))
    return {
        **contact_of(loads, depth=depth, reads=reads, unit=unit),
        **slip_of(place, Skin(float(depth), reads, cover, float(bump))),
        **twist_of(place, rate=rate, depth=depth, cover=cover, bump=bump),
        **edges_of(loads, depth=depth, reads=reads),
        **localize_of(loads),
    }
