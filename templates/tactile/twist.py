"""Twist of an object on the skin: that it turns, which way, and about where."""

from collections.abc import Mapping

from cnnum.programs import program
from cnnum.programs.fields import Field, maximum, minimum, where
from cnnum.programs.machine import FrameFields
from cnnum.templates.tactile.latch import lasting, latched, twice
from cnnum.templates.tactile.loads import PUSH, Loads, Patch, loads_of, patch_of
from cnnum.templates.tactile.pull import Pull, pull_of
from cnnum.templates.tactile.sticking import Sticking, sticking_of

SLIPS = 0.17
"""Looseness at which the stick radius under a torque is half the contact radius, set as for slip.
More than under a force, since the outer ring carries more of a torque."""


@program
def twist(frame: FrameFields, *, push: float = PUSH, slips: float = SLIPS) -> Mapping[str, Field]:
    """Twist of what touches the skin, from how the shear about the contact's centre grows.

    The stream must begin without contact: its first frames say what rest is.

    Parameters
    ----------
    frame : FrameFields
        Strain, stress or calibrated signals, in any unit.
    push : float
        −1 for strain and stress, which count tension as positive; +1 for signals and counts that
        rise under a push.
    slips : float
        Looseness (1 − `stick`, see `sticking`) from which the object turns on the skin.

    Returns
    -------
    mapping
        `twist` (flag, until the torque is let go), `twist_sense` (+1 from x to y, that is from
        columns to rows, clockwise as seen from above; −1; 0 without a torque), `twist_strength`
        (0 sticks, 1 turns freely), `twist_row`, `twist_column` (centre, cells).
    """
    loads = loads_of(frame, push)
    patch = patch_of(loads)
    pull = pull_of(loads, patch)
    return twist_of(loads, patch, pull, sticking_of(loads, pull), slips=slips)


def twist_of(
    loads: Loads, patch: Patch, pull: Pull, sticking: Sticking, *, slips: float = SLIPS
) -> Mapping[str, Field]:
    """Return the outputs of `twist` from what other programs share with it."""
    frame = loads.frame
    holds = lasting(frame, abs(pull.torque), pull.twisted)
    creeps = sticking.grows & (sticking.loose > slips)
    memory = frame.memory(scalar=True)
    loose = minimum(maximum(sticking.loose, 0.0), 1.0)
    strength = where(holds, where(sticking.grows, loose, memory.value), 0.0)
    memory.store(strength)
    return {
        "twist": latched(frame, holds, twice(frame, creeps)),
        "twist_sense": where(pull.twisted, where(pull.torque > 0.0, 1.0, -1.0), 0.0),
        "twist_strength": strength,
        "twist_row": patch.row,
        "twist_column": patch.column,
    }
