"""Slip of an object on the skin or in the hand, from its pattern and its shear.

Slip is a contact whose pattern moves and whose shear rearranges, under a shear load. Two things
move a pattern, too: a load that changes, and a ratio of shear to normal load that still grows. Slip
counts as far as it exceeds their effect, once less than half of the contact sticks:

    strength = (pattern_speed² · incoherent_shear)^⅓ · ratio
               / (still + trend + swing · load_rate + look · swings² + pull · ratio_rate)

All of these are rates in 1/s, but for `ratio`, which is shear over normal load, and `look`, a time.
`swings` is `load_rate` as large as it lately was: where a load turns, its pattern still moves.
Where the axes are known, the strength is weighed by how far the pattern moves along the shear, and
by whether the shear lies where the contact presses. Of several pads the one with the largest
strength counts.

An array that reads shear alone, as a field of markers does, has its magnitude for a load. One that
reads no shear cannot tell a slide: a touch, a grip and a roll move the pattern of the load as much.
"""

from collections.abc import Mapping
from math import exp

from cnnum.graph.nodes import RunSpec
from cnnum.programs import program
from cnnum.programs.fields import Field, length, maximum, mean, minimum, most, sqrt, square, where
from cnnum.programs.machine import FrameFields, root_sum
from cnnum.programs.parameters import refuse_outside
from cnnum.programs.reports import level_of, report
from cnnum.programs.transients import apply, transient
from cnnum.templates.tactile.shared.loads import LEAST_LOAD, Pad, RecentLoads
from cnnum.templating.library import get_template

SPREAD = 4.0  # cells², diffusion time of the local mean of the shear
LOOSE, STIRS = 0.25, 0.05  # a cell is loose from that change of its shear off the local mean on:
# over the local mean, and in its load a second; half of it keeps it so
TOUCHED, STICKS = 0.1, 0.5  # load of a cell in contact, over the largest; share that sticks at most
ALONG = 0.75  # weight of a motion over 1 plus its cosine to the shear: 1 at a third
WAVE = RunSpec(method="euler")  # of a time constant: no cell turns back, so the picture is the same
ALIGNED = 0.3  # cosine of the shear's map to the load's, from which a shear can be that of a slip
PULL, TURN = ("pull_x", "pull_y"), ("torque", "row", "column")
SIGNS = (
    "pattern_speed", "incoherent_shear", "trend", "load_rate", "swings", "ratio_rate", "stick_share"
)  # fmt: skip
PIVOTS, CENTRED = 0.1, 0.5  # turning, 1/s, from which a slip is a pivot; torque over ratio from
# which its centre, at most two sizes of the contact away, is known
AXIAL = ("motion_cosine", "alignment")  # read-outs that are shown, the latter with known axes
LEVELS = (
    (0.5, 0.60), (1.2, 0.50), (2.0, 0.40), (3.2, 0.36), (4.7, 0.32), (5.9, 0.28), (6.4, 0.25),
    (11.6, 0.20),
)  # fmt: skip
"""False reports in ten minutes, and the level of the strength that leads to them: upper bounds
(90 %) on simulated hands that neither slip, roll nor touch obliquely, by
`docs/figures/false_reports.py`."""
SHEAR_LEVELS = ((1.5, 0.60), (2.5, 0.50), (6.8, 0.40), (15.0, 0.28), (31.0, 0.20))
"""The same where shear alone is read."""


@program
def slip(
    frame: FrameFields,
    *,
    push: float = -1.0,
    shear_gain: float = 1.0,
    axes: bool = True,
    pads: int = 1,
    rest: float = 0.4,
    look: float = 0.08,
    load: float = 0.35,
    floor: float = 240.0,
    still: float = 0.2,
    pull: float = 0.6,
    swing: float = 0.6,
    false_reports: float = 2.0,
    level: float = 0.0,
    hold_time: float = 0.1,
) -> Mapping[str, Field]:
    """Detect the slip of an object that is touched or held.

    Parameters
    ----------
    frame : FrameFields
        Strain, stress, signals or raw counts, with all `pads` side by side in the columns.
    push, shear_gain : float
        `push` is −1 for strain and stress, which count tension as positive, and +1 if readings rise
        under a push. `shear_gain` is the reading of the normal channel over that of a shear channel
        under the same force.
    axes : bool
        Whether signs and directions of the axes are known. A slip must then move along its shear,
        and the shear must lie where the load is.
    rest : float, s
        Time without motion at the start, from which rest and noise are learned.
    look, load : float, s
        Time constants of the delayed maps, and of the trend of the load.
    floor : float
        Smallest load of a pad, in multiples of the noise of its sum.
    still, pull, swing : float, 1/s, none, none
        Slowest movement that counts, in contact sizes per second, and the weights of a ratio that
        still grows and of a load that swings.
    false_reports, level : float, 1/10 min, none
        Accepted rate of false reports, which sets the level of the strength above which slip is
        reported; or that level itself, if it is above 0.
    hold_time : float, s
        A report ends once the strength has been below half the level for this time.

    Returns
    -------
    mapping
        `gross_slip` (flag), `slip_x`, `slip_y` (unit vector of the shear), `slip_strength`, and
        its ingredients: `slip_level`, and for the pad with the largest strength
        `slip_pattern_speed`, `slip_incoherent_shear`, `slip_trend`, `slip_load_rate`,
        `slip_swings`, `slip_ratio_rate` (1/s), `slip_ratio`, `slip_stick_share`, and with known
        axes `slip_motion_cosine`, `slip_alignment`. For all pads together `slip_torque` (torque of
        the shear about the centre of the load, divided by load and size) and `slip_turning` (1/s:
        pattern speed times the torque's share of the friction). `slip_pivots` (flag: the slip
        turns), and for the pad with the largest strength `slip_sense` (as `twist_sense`),
        `slip_row`, `slip_column` (centre of the turn, cells) and `slip_centred` (flag: that centre
        is known). All are 0 during the rest.
    """
    refuse_outside(load=(load, 1e-6, 1e6), hold_time=(hold_time, 0.0, 1e6))
    recent = frame.once(
        RecentLoads, push=push, shear_gain=shear_gain, pads=pads, rest=rest, look=look,
        floor=floor,
    )  # fmt: skip
    signs_of_pads = frame.once(read_outs, recent=recent, load=load)
    # decision: a hand's load changes under all of its fingers, an object may slip under one alone
    explained = mean(
        [
            signs["trend"] + swing * signs["load_rate"] + look * square(signs["swings"])
            + pull * signs["ratio_rate"]
            for signs in signs_of_pads
        ]
    )  # fmt: skip
    (ratio,) = most([[signs["ratio"]] for signs in signs_of_pads])
    names = SIGNS + AXIAL if axes else SIGNS
    rows: list[list[Field]] = []
    for signs in signs_of_pads:
        speed = signs["pattern_speed"]
        strength = (speed * speed * signs["incoherent_shear"]) ** (1 / 3) * ratio
        strength = where(signs["stick_share"] < STICKS, strength / (still + explained), 0.0)
        if axes:  # an object slides along its shear, which is μ times the load
            counts = ALONG * maximum(1.0 + signs["motion_cosine"], 0.0)
            strength = strength * (
                counts * counts * minimum(maximum(signs["alignment"], 0.0) / ALIGNED, 1.0)
            )
        rows.append([strength, *(signs[name] for name in (*PULL, *TURN, *names))])
    strength, x, y, sense, row, column, *others = most(rows)
    # an object that turns between fingers turns on all of them, by a torque of either sense
    speed, torque, force = (
        mean([abs(signs[name]) for signs in signs_of_pads])
        for name in ("pattern_speed", "torque", "ratio")
    )
    turning = speed * torque / (length([torque, force]) + LEAST_LOAD)
    shown = recent.shown(slip_x=x, slip_y=y, slip_strength=strength)
    needed = level_of(false_reports, LEVELS if recent.pressed else SHEAR_LEVELS, level)
    flag = report(frame, shown["slip_strength"], needed, hold_time * frame.rate)
    pivots = flag & (turning > PIVOTS)
    made_of = {f"slip_{name}": value for name, value in zip(names, others, strict=True)}
    return {
        "gross_slip": flag,
        **shown,
        "slip_level": frame.constant(needed),
        **recent.shown(**made_of, slip_ratio=ratio, slip_torque=torque, slip_turning=turning),
        "slip_pivots": pivots,
        "slip_sense": where(pivots, where(sense > 0.0, 1.0, -1.0), 0.0),
        "slip_centred": pivots & (abs(sense) > CENTRED * ratio),
        **recent.shown(slip_row=row, slip_column=column),
    }


def read_outs(frame: FrameFields, *, recent: RecentLoads, load: float) -> list[dict[str, Field]]:
    """Return the signs of slip of each pad."""
    # templates: the change of the shear, its local mean, and the region that sticks
    changes = [recent.per_s * (s - o) for s, o in zip(recent.shear, recent.old_shear, strict=True)]
    spreads = get_template("tactile_diffusion")
    around = [apply(spreads, input=change, duration=SPREAD) for change in changes]
    rests = [change - local for change, local in zip(changes, around, strict=True)]
    stick = stick_region(recent, rests, around)
    # read-outs
    share = 1.0 - exp(-1.0 / (recent.rate * load))
    return [
        {**_of_load(recent, pad, share), **_of_pad(recent, pad, rests, stick)}
        for pad in recent.pads
    ]


def stick_region(recent: RecentLoads, rests: list[Field], around: list[Field]) -> Field:
    """Return the cells of the contact that stick, which a wave of bistable cells erodes.

    The wave starts from cells whose shear clearly changes differently from its local mean, and from
    those that were loose before. It spreads over all cells that do so half as clearly.
    """
    memory, contact = recent.frame.memory("loose", logic=True), recent.z > TOUCHED * recent.z.max()
    rest, local = (abs(x) + abs(y) for x, y in (rests, around))
    least = LOOSE * local + STIRS * recent.z
    may = contact & (rest > 0.5 * least)
    begins = may & (memory.value | (rest > least))
    spread = get_template("RECALL")
    wave = transient(spread, input=may.picture(), state=begins.picture(), spec=WAVE)
    loose = wave.outputs[0].black()
    memory.store(loose)
    return contact & ~loose


def _of_load(recent: RecentLoads, pad: Pad, share: float) -> dict[str, Field]:
    """Return the trend of a pad's load and its last change, 1/s, and both as large as lately.

    A touch that comes and goes has no trend at its turn, but it is no load at rest there.
    """
    frame = recent.frame
    growth, load_rate = (
        where(recent.resting, 0.0, rate * (pad.load - before) / pad.load)
        for rate, before in ((recent.rate, frame.previous(pad.load)), (recent.per_s, pad.before))
    )
    trend = abs(frame.memory("trend", scalar=True).mean(growth, share))
    load_rate = abs(load_rate)
    lately = list[Field]()
    for name, value in (("trend", trend), ("load rate", load_rate)):
        largest = frame.memory(f"largest {name}", scalar=True)
        lately.append(maximum(value, (1.0 - share) * largest.value))
        largest.store(lately[-1])
    swings = lately[1] if recent.pressed else 0.0 * load_rate  # a pull is no swing of a load
    return {"trend": lately[0], "load_rate": load_rate, "swings": swings, "ratio": pad.ratio}


def _of_pad(recent: RecentLoads, pad: Pad, rests: list[Field], stick: Field) -> dict[str, Field]:
    # templates: slopes of the load's pattern
    now, old = recent.z / pad.load, recent.old_z / pad.before
    right, down = (apply(get_template(f"gradient_{axis}"), input=mean([now, old])) for axis in "xy")
    # read-outs
    motion, size = root_sum(pad.total, [now - old]), sqrt(pad.power + pad.even)
    x, y = pad.pull
    along = pad.inner((old - now) * (x * right + y * down))
    shear = x * recent.shear[0] + y * recent.shear[1]
    was = [pad.total(earlier) / pad.before for earlier in recent.old_shear]
    ways = [pad.ratio * part - before for part, before in zip(pad.pull, was, strict=True)]
    return {
        "pull_x": x,
        "pull_y": y,
        "pattern_speed": recent.per_s * motion * pad.load / size,
        "incoherent_shear": root_sum(pad.total, rests) / size,
        "stick_share": pad.total(where(stick, recent.z, 0.0)) / pad.load,
        "ratio_rate": recent.per_s * length(ways),
        "motion_cosine": along / (motion * root_sum(pad.inner, [right, down])),
        "alignment": pad.total(recent.z * shear) / (sqrt(pad.power) * root_sum(pad.total, [shear])),
        **dict(zip(TURN, recent.turn(pad), strict=True)),
    }
