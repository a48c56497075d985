"""Contact: whether and where something touches, its load, and how much of its friction is used."""

from collections.abc import Mapping

from cnnum.programs import program
from cnnum.programs.fields import Field, length, where
from cnnum.programs.machine import FrameFields, place_on
from cnnum.templates.tactile.cover_model.fields import DEPTH, READS, Carries
from cnnum.templates.tactile.shared.loads import PUSH, loads_of
from cnnum.templates.tactile.shared.pressure import pressed_of

SHARE = 0.1
"""Share of the peak pressure above which a taxel counts as touched. What remains of the blur of the
cover lies below it."""


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
    """Detect contact and measure its loads.

    The stream must begin without contact: its first frames define rest. The blur of the cover is
    removed as in `edges`; the part of the load that strain does not show is inferred from the shape
    of the contact.

    Parameters
    ----------
    frame : FrameFields
        Strain, stress or calibrated signals, in any unit. If only `normal` is read, the effect of
        a pull on it cannot be removed, and `load_x`, `load_y`, `friction_used` and `shear_known`
        are missing.
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
        Number of pads side by side in the columns. The position is on the pad with the most load.

    Returns
    -------
    mapping
        `contact` (flag), `contact_map` (logic), `contact_area` (cells), `contact_row`,
        `contact_column` (centroid of the load, cells; its last value once the load no longer
        exceeds the noise), `load_x`, `load_y`, `load_normal` (totals over all contacts),
        `friction_used` (ratio of tangential to normal load), `shear_known` (flag: something
        touches, and no taxel is at an end of its range; otherwise `load_normal` is a lower bound,
        and the shear and the ratio may be wrong in either direction).

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
