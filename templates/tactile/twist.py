"""Twist of an object on the skin or in the hand, from the curl of its shear.

The curl over the normal load must exceed twice the ratio of shear to normal load, else the contact
is pulled: what turns under a pull is a slip that pivots. It must exceed a share of the divergence,
too: a shear that settles pulls apart as well as it turns. Curl and divergence at the load's last
change are taken off: a press alone can show both. Where shear alone is read, it is the load, too: a
turn changes it, so its curl is not taken off there.

A shear beyond any friction of the load above rest says that some load is part of the rest. No curl
can be compared with it, so nothing is reported until nothing touches any more or a load that counts
is there, as after a reading that jumped. If it lasts, the rest must be learned anew.
"""

from collections.abc import Mapping

from cnnum.programs import program
from cnnum.programs.fields import Field, maximum, minimum, most, where
from cnnum.programs.machine import FrameFields
from cnnum.programs.reports import level_of, report
from cnnum.programs.transients import apply
from cnnum.templates.tactile.shared.loads import Pad, RecentLoads
from cnnum.templating.library import get_template

PULLED = 2.0  # curl at least, over the ratio of shear to normal load
HIDDEN, CLEAR = 3.0, 1 / 12  # shear over the load above rest beyond any friction, once it exceeds
# that share of the least load: some load is hidden in the rest
LASTS, AS_AT_REST = 0.2, 1 / 48  # s of that until it is sure; and s after a shorter one in which a
# load counts, or readings stay below that share of the least one, five times the noise
DIVERGING = 0.2  # curl at least, over the divergence, beyond the ratio of shear to normal load
LEVELS = ((0.3, 0.1), (0.5, 0.03), (0.7, 0.02), (5.0, 0.01))
SHEAR_LEVELS = ((1.5, 0.03), (6.7, 0.01))
"""As in `slip`."""


@program
def twist(
    frame: FrameFields,
    *,
    push: float = -1.0,
    shear_gain: float = 1.0,
    pads: int = 1,
    rest: float = 0.4,
    look: float = 0.08,
    floor: float = 240.0,
    still: float = 0.25,
    false_reports: float = 0.3,
    level: float = 0.0,
    hold_time: float = 0.1,
) -> Mapping[str, Field]:
    """Detect the twist of an object that is touched or held.

    Parameters
    ----------
    frame, push, shear_gain, pads, rest, floor, false_reports, level, hold_time
        As in `slip`.
    look : float, s
        Time constant of the delayed maps.
    still : float, 1/s
        Relative change of the load above which a curl is attributed to the load.

    Returns
    -------
    mapping
        `twist` (flag), `twist_sense` (+1 from x to y, −1 the other way, 0 without a twist),
        `twist_strength` (curl over normal load), `twist_row`, `twist_column` (centre of the load on
        the pad that turns most, cells), and the ingredients of the decision: `twist_level`,
        `twist_ratio` (of that pad) and `twist_divergence`.
    """
    recent = frame.once(
        RecentLoads, push=push, shear_gain=shear_gain, pads=pads, rest=rest, look=look,
        floor=floor,
    )  # fmt: skip
    signs = frame.once(read_outs, recent=recent, still=still)
    # decision
    strength, curl = abs(signs["curl"]), signs["curl"]
    least = PULLED * signs["ratio"] + DIVERGING * signs["divergence"]
    counts = ~recent.resting & ~load_hidden(recent) & (strength > least)
    needed = level_of(false_reports, LEVELS if recent.pressed else SHEAR_LEVELS, level)
    flag = report(frame, where(counts, strength, 0.0), needed, hold_time * frame.rate)
    return {
        "twist": flag,
        "twist_sense": where(flag, where(curl > 0.0, 1.0, -1.0), 0.0),
        **recent.shown(twist_strength=strength, twist_row=signs["row"]),
        **recent.shown(twist_column=signs["column"]),
        "twist_level": frame.constant(needed),
        **recent.shown(twist_ratio=signs["ratio"], twist_divergence=signs["divergence"]),
    }


def read_outs(frame: FrameFields, *, recent: RecentLoads, still: float) -> dict[str, Field]:
    """Return the signs of twist on the pad that turns most."""
    # templates
    curl, divergence = (
        apply(get_template(f"shear_{name}"), input=recent.shear) for name in ("curl", "divergence")
    )
    # read-outs
    curls, parts = (
        [_over_load(recent, pad, rate) for pad in recent.pads] for rate in (curl, divergence)
    )
    # over `look`, the load seems to change for a while after a press, when a turn may have begun
    now = recent.rate * abs(recent.load - frame.previous(recent.load)) / recent.load
    changes = minimum(recent.load_rate, now) > still
    if recent.pressed:
        curls = [_since(recent, "curl", curl, changes) for curl in curls]
    parts = [abs(_since(recent, "divergence", part, changes)) for part in parts]
    rows = [
        (abs(turn), turn, part, pad.ratio, *recent.centre(pad))
        for turn, part, pad in zip(curls, parts, recent.pads, strict=True)
    ]
    return dict(
        zip(("size", "curl", "divergence", "ratio", "row", "column"), most(rows), strict=True)
    )


def load_hidden(recent: RecentLoads) -> Field:
    """Return whether a shear beyond any friction shows that a load is part of the rest."""
    frame, lasts, least = recent.frame, recent.frame.frames_of(LASTS) - 0.5, recent.pads[0].least
    loads = [pad.load - pad.least for pad in recent.pads]
    shears = [pad.ratio * pad.load for pad in recent.pads]
    ((excess,), (load,), (shear,)) = (
        most([[value] for value in values])
        for values in (
            [shear - HIDDEN * load for shear, load in zip(shears, loads, strict=True)],
            loads,
            shears,
        )
    )
    beyond = ~recent.resting & (excess > CLEAR * least)
    sound = (load > least) | (maximum(load, shear) < AS_AT_REST * least)
    long, over = (
        frame.memory(f"frames {name}", scalar=True).count(holds) > lasts
        for name, holds in (("beyond friction", beyond), ("without doubt", sound & ~beyond))
    )
    sure = frame.memory("load is hidden", scalar=True, logic=True).latch(long, frame.age > 0.0)
    return sure | frame.memory("load may be hidden", scalar=True, logic=True).latch(beyond, ~over)


def _over_load(recent: RecentLoads, pad: Pad, slope: Field) -> Field:
    """Return a slope of the shear over the load, each cell by the square of its load.

    A faint load counts in full; a faint shear that is the load, as after a pull, does not.
    """
    least = pad.even / 16.0 if recent.pressed else pad.even
    return pad.inner(recent.z * slope) / (pad.power + least)


def _since(recent: RecentLoads, name: str, value: Field, changes: Field) -> Field:
    """Return a number less its value at the load's last change."""
    memory = recent.frame.memory(f"{name} at last change", scalar=True)
    return value - memory.hold(value, recent.resting | changes)
