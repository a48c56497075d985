"""Slip of an object on the skin or in the hand, by signs that every skin shows.

Slip is a contact whose pattern moves and whose shear rearranges, under a shear load. It counts as
far as it exceeds the effect of a load that changes, or of a shear that still grows:

    slip_strength = (moves² · loosens)^⅓ · ratio / (still + |trend| + swing · jolt + pull · grows)

All of these are rates in 1/s, but for `ratio`, which is shear over normal load.
"""

from collections.abc import Mapping
from math import exp

from cnnum.programs import program
from cnnum.programs.fields import Field, maximum, sqrt, where
from cnnum.programs.machine import FrameFields
from cnnum.programs.parameters import refuse_outside
from cnnum.programs.transients import apply
from cnnum.templates.tactile.shared.false_reports import SLIP, level_of
from cnnum.templates.tactile.shared.recent_loads import Pad, RecentLoads, length, mean, most
from cnnum.templating.library import get_template

SPREAD = 4.0  # cells², diffusion time of the local mean of the shear
ALONG = 0.75  # weight of a motion over 1 plus its cosine to the shear: 1 at a third


@program
def slip(
    frame: FrameFields,
    *,
    push: float = -1.0,
    shear_gain: float = 1.0,
    axes: bool = True,
    pads: int = 1,
    rate: float = 200.0,
    rest: float = 0.4,
    look: float = 0.08,
    load: float = 0.35,
    floor: float = 240.0,
    still: float = 0.2,
    pull: float = 0.5,
    swing: float = 0.3,
    false_reports: float = 2.0,
    hold_time: float = 0.1,
) -> Mapping[str, Field]:
    """Slip of an object that is touched or held.

    Parameters
    ----------
    frame : FrameFields
        Strain, stress, signals or raw counts, several `pads` next to one another in the columns.
    push, shear_gain : float
        −1 for strain and stress, which count tension as positive; +1 if readings rise under a push.
        Reading of the normal channel over that of a shear channel, under the same force.
    axes : bool
        Whether signs and directions of the axes are known: a slip then moves along its shear.
    rate, rest : float, Hz, s
        Frames a second; time at the start without motion, which gives rest and noise.
    look, load : float, s
        Time constants of the delayed maps, and of the trend of the load.
    floor : float
        Least load of a pad, in noise of its sum.
    still, pull, swing : float, 1/s, none, none
        Slowest movement that counts, in contact sizes a second; weights of a shear that still
        grows, and of a load that swings.
    false_reports, hold_time : float, 1/10 min, s
        Accepted rate, which sets the level of a report; it ends once below half of that for a time.

    Returns
    -------
    mapping
        `gross_slip` (flag), `slip_x`, `slip_y` (unit vector of the shear), `slip_strength`.
    """
    refuse_outside(load=(load, 1e-6, 1e6), hold_time=(hold_time, 0.0, 1e6))
    recent = frame.once(
        RecentLoads, push=push, shear_gain=shear_gain, pads=pads, rate=rate, rest=rest, look=look,
        floor=floor,
    )  # fmt: skip
    shows = [read_outs(recent, pad) for pad in recent.pads]
    moves, loosens, grows, along = (mean(list(each)) for each in zip(*shows, strict=True))
    # decision
    explained = abs(trend(recent, load)) + swing * recent.jolt + pull * grows
    strength = (moves * moves * loosens) ** (1 / 3) * recent.ratio / (still + explained)
    strength = strength * weight(along) if axes else strength
    _, x, y = most([(pad.ratio * pad.load, pad.x, pad.y) for pad in recent.pads])
    return {
        "gross_slip": recent.latch(strength, level_of(false_reports, SLIP), hold_time),
        **recent.shown(slip_x=x, slip_y=y, slip_strength=strength),
    }


def read_outs(recent: RecentLoads, pad: Pad) -> list[Field]:
    """Return how the pattern moves, its shear loosens and grows, and the cosine to the shear."""
    # templates: slopes of the load's pattern, and the change of its shear without the local mean
    now, old = recent.z / pad.load, recent.old_z / pad.before
    right, down = (apply(get_template(f"gradient_{axis}"), input=mean([now, old])) for axis in "xy")
    changes = [recent.per_s * (s - o) for s, o in zip(recent.shear, recent.old_shear, strict=True)]
    spreads = get_template("tactile_diffusion")
    loose = [each - apply(spreads, input=each, duration=SPREAD) for each in changes]
    # read-outs
    moves, size = length(pad.total, [now - old]), sqrt(pad.power + pad.even)
    along = pad.inner((old - now) * (pad.x * right + pad.y * down))
    along = along / (moves * length(pad.inner, [right, down]))
    x, y = (pad.total(each) for each in changes)
    grows, loosens = sqrt(x * x + y * y) / pad.load, length(pad.total, loose) / size
    return [recent.per_s * moves * pad.load / size, loosens, grows, along]


def weight(along: Field) -> Field:
    """Return the weight of a motion by its cosine to the shear: an object slides along it."""
    counts = ALONG * maximum(1.0 + along, 0.0)
    return counts * counts


def trend(recent: RecentLoads, time: float) -> Field:
    """Return the relative growth of the load, 1/s, as remembered over a time."""
    memory, before = recent.frame.memory("trend", scalar=True), recent.frame.previous(recent.load)
    growth = recent.rate * (recent.load - before) / recent.load
    now = memory.value + (1.0 - exp(-1.0 / (recent.rate * time))) * (growth - memory.value)
    memory.store(where(recent.resting, 0.0, now))
    return now
