"""Which bumps of a bumpy cover are touched, and the load on each."""

from collections.abc import Mapping

from cnnum.errors import ProgramError
from cnnum.programs import program
from cnnum.programs.fields import Field, maximum, sqrt, where
from cnnum.programs.machine import FrameFields
from cnnum.programs.transients import apply
from cnnum.template import Template
from cnnum.templates.tactile.loads import LIFT, PUSH, Loads, loads_of

CROSSTALK = 0.05
"""What a taxel reads of the bump next to it, as a share of its own: normal stress of a point load
1.5 depths away, (1 + 1.5²)^(−5/2) = 0.053. Normal strain has nearly none there, −0.007."""

SHARE = 0.1
"""Least load of a touched bump, as a share of the largest."""


@program
def localize(
    frame: FrameFields,
    *,
    push: float = PUSH,
    crosstalk: float = CROSSTALK,
    share: float = SHARE,
) -> Mapping[str, Field]:
    """Loads of single bumps, one above each taxel.

    Parameters
    ----------
    frame : FrameFields
        Strain, stress or calibrated signals, in any unit.
    push : float
        −1 for strain and stress, which count tension as positive; +1 for signals and counts that
        rise under a push.
    crosstalk : float
        What a taxel reads of each of its four neighbours' loads; below 1/4 in size.
    share : float
        Least load of a touched bump, as a share of the largest.

    Returns
    -------
    mapping
        `bump_contact` (logic map), `bump_count`, `bump_load_x`, `bump_load_y`, `bump_load_normal`
        (maps of each bump's own load, 0 where it is not touched).

    Raises
    ------
    ProgramError
        If the crosstalk can not be undone.
    """
    return localize_of(loads_of(frame, push), crosstalk=crosstalk, share=share)


def localize_of(
    loads: Loads, *, crosstalk: float = CROSSTALK, share: float = SHARE
) -> Mapping[str, Field]:
    """Return the outputs of `localize` from what other programs share with it."""
    alone = unmix(crosstalk)
    normal = apply(alone, input=loads.normal)
    level = maximum(share * normal.max(), LIFT * sqrt(loads.normal_noise))
    touched = loads.contact & (normal > level)

    def load(channel: Field) -> Field:
        return where(touched, apply(alone, input=channel), 0.0)

    return {
        "bump_contact": touched,
        "bump_count": touched.count(),
        "bump_load_x": load(loads.shear_x),
        "bump_load_y": load(loads.shear_y),
        "bump_load_normal": where(touched, normal, 0.0),
    }


def unmix(crosstalk: float) -> Template:
    """Return the template that takes neighbours' loads off: it settles where x + c Σ x' = u.

    Raises
    ------
    ProgramError
        If four neighbours together would weigh as much as the taxel's own load.
    """
    if not abs(crosstalk) < 0.25:
        raise ProgramError(
            f"'crosstalk' must be between −0.25 and 0.25 to be undone, got {crosstalk}."
        )
    c = -crosstalk
    return Template(
        "unmix",
        [[0.0, c, 0.0], [c, 0.0, c], [0.0, c, 0.0]],
        [[1.0]],
        output="linear",
        duration="settle",
        description="Undoes crosstalk between taxels that are neighbours along rows or columns.",
    )
