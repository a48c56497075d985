"""Twist of an object on the skin or in the hand, from the curl of its shear.

The curl over the normal load must exceed the ratio of shear to normal load, else the contact is
pulled. The curl at the load's last change is taken off: a press alone can show some.
"""

from collections.abc import Mapping

from cnnum.programs import program
from cnnum.programs.fields import Field, where
from cnnum.programs.machine import FrameFields
from cnnum.programs.transients import apply
from cnnum.templates.tactile.shared.false_reports import TWIST, level_of
from cnnum.templates.tactile.shared.recent_loads import RecentLoads, most
from cnnum.templating.library import get_template


@program
def twist(
    frame: FrameFields,
    *,
    push: float = -1.0,
    shear_gain: float = 1.0,
    pads: int = 1,
    rate: float = 200.0,
    rest: float = 0.4,
    look: float = 0.08,
    floor: float = 240.0,
    still: float = 0.25,
    false_reports: float = 0.3,
    hold_time: float = 0.1,
) -> Mapping[str, Field]:
    """Twist of an object that is touched or held.

    Parameters
    ----------
    frame, push, shear_gain, pads, rate, rest, floor, false_reports, hold_time
        As in `slip`.
    look : float, s
        Time constant of the delayed maps.
    still : float, 1/s
        Change of the load, as a share of it, above which a curl is the load's.

    Returns
    -------
    mapping
        `twist` (flag), `twist_sense` (+1 from x to y, −1, 0 without), `twist_strength` (curl over
        normal load), `twist_row`, `twist_column` (centre of the load, cells).
    """
    recent = frame.once(
        RecentLoads, push=push, shear_gain=shear_gain, pads=pads, rate=rate, rest=rest, look=look,
        floor=floor,
    )  # fmt: skip
    # templates
    curl, weight = apply(get_template("shear_curl"), input=recent.shear), recent.z * recent.z
    # read-outs
    curls = [pad.inner(recent.z * curl) / (pad.power + pad.even / 16.0) for pad in recent.pads]
    turns = [_since(recent, each, recent.jolt > still) for each in curls]
    row, column = ((weight * place).sum() / weight.sum() for place in (frame.row, frame.column))
    # decision
    strength, turned = most([(abs(each), each) for each in turns])
    level = level_of(false_reports, TWIST)
    flag = recent.latch(where(strength > recent.ratio, strength, 0.0), level, hold_time)
    return {
        "twist": flag,
        "twist_sense": where(flag, where(turned > 0.0, 1.0, -1.0), 0.0),
        **recent.shown(twist_strength=strength, twist_row=row, twist_column=column),
    }


def _since(recent: RecentLoads, value: Field, changes: Field) -> Field:
    """Return a number less its value at the load's last change."""
    memory = recent.frame.memory("curl at last change", scalar=True)
    then = where(recent.resting | changes, value, memory.value)
    memory.store(then)
    return value - then
