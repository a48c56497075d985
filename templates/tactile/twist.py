from collections.abc import Mapping

from cnnum.programs import FrameFields, program
from cnnum.programs.fields import Field, where
from cnnum.templates.tactile.latch import lasting, latched
from cnnum.templates.tactile.loads import Loads, Patch, loads_of, patch_of
from cnnum.templates.tactile.pull import Pull, pull_of
from cnnum.templates.tactile.sticking import Sticking, sticking_of

INCIPIENT = 0.885


@program
def twist(frame: FrameFields) -> Mapping[str, Field]:
    loads = loads_of(frame)
    patch = patch_of(loads)
    pull = pull_of(loads, patch)
    return twist_outputs(loads, patch, pull, sticking_of(loads, pull))


def twist_outputs(
    loads: Loads, patch: Patch, pull: Pull, sticking: Sticking
) -> Mapping[str, Field]:
    frame = loads.frame
    holds = lasting(frame, abs(pull.torque), pull.twisted)
    creeps = sticking.grows & (sticking.stick < INCIPIENT)
    slips = latched(frame, holds, creeps & frame.previous(creeps))
    return {
        "twist": slips,
        "twist_sense": where(slips, where(pull.torque > 0.0, 1.0, -1.0), 0.0),
        "twist_strength": 1.0 - sticking.stick,
        "twist_row": patch.row,
        "twist_column": patch.column,
        "dbg_twisted": pull.twisted,
    }
