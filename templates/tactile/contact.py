"""Contact: whether, where, how much, and how near to slip its friction is."""

from collections.abc import Mapping

from cnnum.library import get_template
from cnnum.programs import program
from cnnum.programs.fields import Field, maximum, minimum, sqrt, where
from cnnum.programs.machine import FrameFields
from cnnum.programs.transients import apply
from cnnum.templates.tactile.loads import LIFT, PUSH, Loads, loads_of, square

SHARE = 0.1
"""Share of the peak load from which a taxel counts as touched: what the cover spreads beyond the
contact stays below it."""

LEVEL = 0.1
"""Threshold of the template `contact_threshold`."""


@program
def contact(
    frame: FrameFields, *, push: float = PUSH, share: float = SHARE, normal_gain: float = 1.0
) -> Mapping[str, Field]:
    """Contact and its loads.

    The stream must begin without contact: its first frames say what rest is.

    Parameters
    ----------
    frame : FrameFields
        Strain, stress or calibrated signals, in any unit.
    push : float
        −1 for strain and stress, which count tension as positive; +1 for signals and counts that
        rise under a push.
    share : float
        Share of the peak normal load from which a taxel counts as touched.
    normal_gain : float
        Normal load over what the normal channel reads, in the shear channels' unit, for
        `friction_used`.

    Returns
    -------
    mapping
        `contact` (flag), `contact_map` (logic), `contact_area` (cells), `contact_row`,
        `contact_column` (centroid of the load, cells; afterwards, where it
        was last), `load_x`, `load_y`,
        `load_normal` (sums over the contact, the frame's unit), `friction_used` (tangential over
        normal load).
    """
    return contact_of(loads_of(frame, push), share=share, normal_gain=normal_gain)


def contact_of(
    loads: Loads, *, share: float = SHARE, normal_gain: float = 1.0
) -> Mapping[str, Field]:
    """Return the outputs of `contact` from what other programs share with it."""
    touched = touched_map(loads, share)
    inside = where(touched, 1.0, 0.0)
    normal, x, y = (
        (channel * inside).sum() for channel in (loads.normal, loads.shear_x, loads.shear_y)
    )
    weight = maximum(loads.normal, 0.0) * inside
    frame, whole = loads.frame, weight.sum()
    return {
        "contact": loads.contact,
        "contact_map": touched,
        "contact_area": touched.count(),
        "contact_row": _kept(loads, (weight * frame.row).sum() / whole),
        "contact_column": _kept(loads, (weight * frame.column).sum() / whole),
        "load_x": x,
        "load_y": y,
        "load_normal": normal,
        "friction_used": sqrt(square(x) + square(y)) / (normal_gain * normal),
    }


def _kept(loads: Loads, value: Field) -> Field:
    """Return a number while there is contact, and afterwards what it was at last."""
    memory = loads.frame.memory(scalar=True)
    now = where(loads.contact, value, memory.value)
    memory.store(now)
    return now


def touched_map(loads: Loads, share: float = SHARE) -> Field:
    """Return the taxels that are touched, by the threshold template on scaled loads."""
    level = maximum(share * loads.normal.max(), LIFT * sqrt(loads.normal_noise))
    scaled = minimum(maximum(LEVEL * loads.normal / level, -1.0), 1.0)
    black = apply(get_template("contact_threshold"), input=scaled).black()
    return black & loads.contact
