"""Contact: whether, where, how much, and how near to slip its friction is."""

from collections.abc import Mapping

from cnnum.programs import program
from cnnum.programs.fields import Field, length, where
from cnnum.programs.machine import FrameFields, place_on
from cnnum.templates.tactile.cover_model.fields import DEPTH, READS, Carries
from cnnum.templates.tactile.shared.loads import PUSH, loads_of
from cnnum.templates.tactile.shared.pressure import pressed_of

SHARE = 0.1
"""Share of the peak pressure from which a taxel counts as touched: the rest of the cover's blur
stays below it."""


@program
def contact(
    frame: FrameFields,
    *,
    push: float = PUSH,
    share: float = SHARE,
    depth: float = DEPTH,
    reads: Carries = READS,
    normal_gain: float = 1.0,
    unit: float = 1.0,
    pads: int = 1,
) -> Mapping[str, Field]:
    """Contact and its loads.

    The stream must begin without contact: its first frames define rest. The cover's blur is
    taken off as in `edges`; the contact's own shape gives the part that strain cannot pass.

    Parameters
    ----------
    frame : FrameFields
        Strain, stress or calibrated signals, in any unit. Where only `normal` is read, the pull's
        part of it cannot be taken off, and the last four outputs but `load_normal` are missing.
    push : float
        −1 for strain and stress, which count tension as positive; +1 for signals and counts that
        rise under a push.
    share : float
        Share of the peak pressure from which a taxel counts as touched.
    depth : float
        Cover above the taxels, in pitches.
    reads : "strain", "stress" or "force"
        The measured quantity; "force" for taxels that each carry their own share of the load.
    normal_gain : float
        Normal load over the reading of the normal channel, in the shear channels' unit.
    unit : float
        Unit of the loads: 2/3 E pitch² for strain, pitch² for stress gives newtons.
    pads : int
        Pads that lie next to one another in the columns; the place is on the one with most load.

    Returns
    -------
    mapping
        `contact` (flag), `contact_map` (logic), `contact_area` (cells), `contact_row`,
        `contact_column` (centroid of the load, cells; once it no longer stands clear of the noise,
        where it was last), `load_x`, `load_y`, `load_normal` (of all that touches), `friction_used`
        (tangential over normal load), `shear_known` (flag: something touches, and no taxel is at an
        end of its range, where `load_normal` is a lower bound and the shear and its ratio may be
        off either way).

    Raises
    ------
    PhysicsError
        If the depth is out of range.
    UnknownNameError
        If `reads` is unknown.
    """
    loads = frame.once(loads_of, push=push)
    load = pressed_of(loads, share, depth, reads, normal_gain)
    row, column = place_on(frame, load.weight, pads)
    touches = load.touched.any()
    clear_touch = touches & loads.clear
    normal, *pulls = (where(touches, unit * part, 0.0) for part in (load.normal, *load.pulls))
    frictions = {}
    if pulls:
        frictions = {
            "friction_used": where(touches, length(pulls) / normal, 0.0),
            "shear_known": frame.within_range(touches),
        }
    return {
        "contact": loads.contact,
        "contact_map": load.touched,
        "contact_area": load.touched.count(),
        "contact_row": frame.memory("last row", scalar=True).hold(row, clear_touch),
        "contact_column": frame.memory("last column", scalar=True).hold(column, clear_touch),
        **dict(zip(("load_x", "load_y"), pulls, strict=bool(pulls))),
        "load_normal": normal,
        **frictions,
    }
