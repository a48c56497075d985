"""Slip of a touching object over the skin: incipient and gross, and where it goes."""

from collections.abc import Mapping

from cnnum.programs import FrameFields, program
from cnnum.programs.fields import Field, where
from cnnum.templates.tactile.latch import lasting, latched
from cnnum.templates.tactile.loads import Loads, loads_of, patch_of
from cnnum.templates.tactile.pull import Pull, pull_of
from cnnum.templates.tactile.sticking import Sticking, sticking_of

INCIPIENT = 0.935
GROSS = 0.4


@program
def slip(frame: FrameFields) -> Mapping[str, Field]:
    loads = loads_of(frame)
    pull = pull_of(loads, patch_of(loads))
    return slip_outputs(loads, pull, sticking_of(loads, pull))


def slip_outputs(loads: Loads, pull: Pull, sticking: Sticking) -> Mapping[str, Field]:
    frame = loads.frame
    holds = lasting(frame, pull.force, pull.pulled)
    creeps = sticking.grows & (sticking.stick < INCIPIENT)
    begun = latched(frame, holds, creeps & frame.previous(creeps))
    gone = latched(frame, holds & begun, sticking.goes & (sticking.travel < GROSS))
    out = {
        "incipient_slip": begun & ~gone,
        "gross_slip": gone,
        "slip_x": where(pull.pulled, pull.force_x / pull.force, 0.0),
        "slip_y": where(pull.pulled, pull.force_y / pull.force, 0.0),
        "slip_strength": 1.0 - sticking.stick,
    }
    out |= {"dbg_pulled": pull.pulled, "dbg_travel":sticking.travel, "dbg_goes":sticking.goes}
    return out
