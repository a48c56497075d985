"""Loads of a frame, and of the frames before it.

The first step of the tactile programs: loads above rest, noise at rest, the contact.

The first tenth of a second of a stream defines rest (`rest`), which is followed slowly afterwards,
so that an offset or its drift never becomes a load.
"""

from dataclasses import dataclass
from math import exp
from typing import NamedTuple

from cnnum.frame import FORCE_AXES
from cnnum.programs.fields import Field, length, maximum, mean, sqrt, square, total, where
from cnnum.programs.machine import Block, FrameFields, Sums, blocks
from cnnum.programs.parameters import refuse_outside
from cnnum.programs.transients import apply, shift
from cnnum.templates.tactile.shared.rest import (
    Rest,
    calm,
    frames_followed,
    level_at_rest,
    mean_at_rest,
)
from cnnum.templating.library import get_template

BREAKS = 0.08
"""s of contact from which a taxel may break: a touch that begins is sudden everywhere."""

TOUCH, LIFT = 6.0, 4.0
"""Peak loads, in standard deviations of the noise, at which contact begins and ends. The largest
of 256 noisy taxels exceeds 6 once in 4 million frames; it must in two frames in a row."""

LIFTS = 0.02
"""s for which a peak stays below that until the contact is over, and two frames at least: a press
that begins or fades slowly passes through the noise in many frames of a fast array."""

NOISY = 5.0
"""Noise power, in its mean over the array, above which a taxel is broken. One of 16 with ten times
the noise has 14 times the mean; a sound one, known from 16 frames, exceeds 5 once in 10⁵."""

ASTRAY = 8.0
"""Rest of a taxel, over the typical one or the noise, above which it is broken: 5.4 standard
deviations of the calibration's residual. A bridge that is stuck stands anywhere in the range."""

BREAK = 300.0
"""Change of a taxel's normal load from one frame to the next, over its neighbours' and the noise,
as powers, above which it breaks: several taxels feel a contact under a cover. `docs/calibration.md`
has the scenes that it was set by."""

JUMP = 10.0
"""The same over the taxel's change in the frame before, as powers. A load that grows evenly on one
taxel has 1, and one that begins to accelerate evenly 9: its steps are as 1 to 3 to 5."""

AWAY = 0.5
"""Least share of all weights that must be known where a broken taxel is filled in."""

TINY = 1e-30

ROUNDING = 1e-6
"""Least noise, as a share of the largest raw value: the rounding of float32 on a perfect sensor."""

PUSH = -1.0
"""Sign of strain and stress under a push, as of a calibrated array."""


@dataclass(frozen=True, slots=True)
class Loads:
    """Loads of one frame above rest, positive as a push or a pull on the skin reads.

    Attributes
    ----------
    frame : FrameFields
    shear : tuple of Field
        Maps along x and y, in the frame's own unit; empty where the array reads no shear.
    normal : Field
        Map, in the frame's own unit.
    shear_variance : Field or None
        Variance of one reading of shear, a number.
    normal_noise : Field
        Variance of one normal reading, a number.
    contact : Field
        Flag.
    clear : Field
        Flag: the peak stands above the noise as far as it must for a contact to begin. A load that
        fades is in contact for some frames more, in which noise decides where.
    sound, healthy : Field
        Logic maps: taxels whose noise is no outlier in the normal axis, and in any. Only sound ones
        locate a contact, only healthy ones measure its load.
    alive : Field
        Logic map: taxels that read something, be it noise at rest.
    """

    frame: FrameFields
    shear: tuple[Field, ...]
    normal: Field
    shear_variance: Field | None
    normal_noise: Field
    contact: Field
    clear: Field
    sound: Field
    healthy: Field
    alive: Field

    @property
    def shear_x(self) -> Field:
        """Map of the shear along x; a program that asks for it needs an array that reads it."""
        return self.shear[0] if self.shear else self.frame.channel(FORCE_AXES[0])

    @property
    def shear_y(self) -> Field:
        """Map of the shear along y; see `shear_x`."""
        return self.shear[1] if self.shear else self.frame.channel(FORCE_AXES[1])

    @property
    def shear_noise(self) -> Field:
        """Variance of one reading of shear, a number; see `shear_x`."""
        if self.shear_variance is None:
            return self.frame.channel(FORCE_AXES[0])
        return self.shear_variance


def loads_of(frame: FrameFields, push: float) -> Loads:
    """Return a frame's loads above rest, and the measures with them.

    Parameters
    ----------
    frame : FrameFields
    push : float
        Factor from a channel's sign to that of a load: −1 for strain and stress, which count
        tension as positive, +1 for signals and counts that rise under a push.
    """
    touched = frame.memory("touched", scalar=True, logic=True)
    rest = Rest(frame)
    axes = FORCE_AXES[:2] if set(FORCE_AXES[:2]) <= set(frame.channels) else ()
    shear = _Noise(frame, axes) if axes else None
    normal = _Noise(frame, ("normal",))
    above = push * (frame.normal - rest.known["normal"].value)
    broken = _broken(frame, touched.value, normal, abs(above), ~rest.begins & (above < 0.0))
    sound = normal.healthy & ~_astray(normal, rest.known["normal"].value) & ~broken
    peak, low = where(sound, above, 0.0).max(), where(sound, above, 0.0).min()
    least = TOUCH**2 * normal.held
    high = ~rest.begins & (peak > 0.0) & (square(peak) > least)
    begins = high & frame.previous(high)
    lifted = frame.memory("frames lifted", scalar=True).count(
        ~((peak > 0.0) & (square(peak) > LIFT**2 * normal.held))
    )
    contact = touched.latch(begins, lifted < float(frame.frames_of(LIFTS, 2)))
    # a touch that begins must not become part of rest, nor its jump of the noise
    far = ~rest.begins & ((low < 0.0) & (square(low) > least))
    free = ~(high | far | touched.value)
    since = frame.memory("frames since a contact", scalar=True).count(~contact)
    still = rest.still((far & ~high | broken) & ~touched.value, least)
    kept = free & ~broken
    *sheared, z = (push * rest.above(name, kept, still, since) for name in (*axes, "normal"))
    healthy = sound
    if shear is not None:
        aside = total(abs(rest.known[name].value) for name in axes)
        healthy = sound & shear.healthy & ~_astray(shear, aside)
    return Loads(
        frame=frame,
        shear=tuple(sheared),
        normal=z,
        shear_variance=None if shear is None else shear.follow(free, rest.begins, broken),
        normal_noise=normal.follow(free, rest.begins, broken),
        contact=contact,
        clear=high,
        sound=sound,
        healthy=healthy,
        alive=normal.alive | (abs(z) > 0.0),
    )


def whole_normal(loads: Loads) -> Field:
    """Return the normal loads, of broken taxels the mean of their neighbours."""
    known, around = loads.sound & loads.alive, get_template("between_neighbours")
    normal = where(known, loads.normal, 0.0)
    share = apply(around, input=where(known, 1.0, 0.0))
    return where(known, normal, apply(around, input=normal) / maximum(share, AWAY))


def _astray(noise: "_Noise", rest: Field) -> Field:
    """Return the taxels whose rest is far from the others': the mean of roots bears outliers."""
    far = abs(rest)
    return far > ASTRAY * maximum(square(sqrt(far).mean()), sqrt(noise.held))


def _broken(
    frame: FrameFields, touched: Field, normal: "_Noise", above: Field, below: Field
) -> Field:
    """Return the taxels that broke under a contact, or fell below rest by themselves.

    One is broken until it reads as at rest again while nothing touches.
    """
    lasts, early = frame.memory("frames of contact", scalar=True), frame.frames_of(BREAKS, 2)
    broken = frame.memory("broken", logic=True)
    lasts.count(touched)
    change = normal.change / maximum(normal.held, TINY)
    size = sqrt(change)
    around = (apply(get_template("smooth"), input=size) - 0.25 * size) / 0.75
    alone = (change > BREAK * (square(around) + 1.0)) & (change > JUMP * frame.previous(change))
    # a load pulls its surroundings along, and falls below rest nowhere by itself
    falls = below & (change > BREAK * (square(_largest_around(size)) + 1.0))
    new = (falls | (alone & (lasts.value > float(early)))) & normal.healthy & ~broken.value
    back = ~touched & (above < LIFT * sqrt(normal.held))
    return broken.latch(new, ~back)


def _largest_around(size: Field) -> Field:
    """Return the largest value of a cell's eight neighbours, 0 or above."""
    rows, cols = size.graph.shape
    field = 0.0 * size
    for down in (-1, 0, 1):
        for right in (-1, 0, 1):
            if (down or right) and abs(down) < rows and abs(right) < cols:
                field = maximum(field, shift(size, down, right))
    return field


class _Noise:
    """Variance of one reading, from the changes from frame to frame at rest.

    Attributes
    ----------
    change : Field
        Half the mean square change of a taxel since the frame before, a map.
    held : Field
        As it was known before this frame, a mean over the healthy taxels.
    healthy : Field
        Logic map.
    """

    def __init__(self, frame: FrameFields, names: tuple[str, ...]) -> None:
        self._frame, self._axes = frame, len(names)
        channels = [frame.channel(name) for name in names]
        changes = [square(channel - frame.previous(channel)) for channel in channels]
        self.change = total(changes) / (2.0 * len(channels))
        of = " and ".join(names)
        self._variance = frame.memory(f"variance of {of}")
        self._seen = frame.memory(f"frames in the variance of {of}", scalar=True)
        size = maximum(channels[0].max(), -channels[0].min())
        self._least = square(ROUNDING * size)
        known = self._variance.value
        self.healthy = known <= NOISY * known.mean()
        self.alive = (known > 0.0) | ~(known.max() > 0.0)
        self.held = self._typical(known)

    def follow(self, free: Field, begins: Field, broken: Field) -> Field:
        """Return it after this frame; one that repeats the one before is not counted.

        Nor is a taxel that is broken: what it reads may be a load.
        """
        changes = free & (self.change.max() > 0.0)
        readings = self._axes * self._frame.shape[0] * self._frame.shape[1]
        fits, anew = calm(self._frame, self.change.mean(), changes & begins, readings)
        news = fits | (changes & ~begins)
        count = where(anew, 0.0, self._seen.value) + where(news, 1.0, 0.0)
        follows = 1.0 / frames_followed(self._frame)
        share = where(news, maximum(1.0 / maximum(count, 1.0), follows), 0.0)
        self._seen.store(count)
        return self._typical(self._variance.mean(self.change, where(broken, 0.0, share)))

    def _typical(self, variance: Field) -> Field:
        sound = where(self.healthy, variance, 0.0)
        return maximum(sound.sum() / maximum(self.healthy.count(), 1.0), self._least)


FAST = 0.02  # s, time constant of the smoothing
FEW = 4  # frames of rest at least, from which the noise of an array is known
FAR = 4.0  # sizes of a contact, to which a place about which it turns is limited
RECENT_ROUNDING, LEAST_LOAD = (
    1e-6,
    1e-12,
)  # least noise over the reading at rest; least load, in its unit


class Pad(NamedTuple):
    """Read-outs of one pad; `total` sums over it, `inner` without its cells next to another pad."""

    total: Sums
    inner: Sums
    load: Field  # normal load and the least load
    least: Field  # the least load
    before: Field  # the same a moment ago
    power: Field  # sum of the squares of the normal load
    even: Field  # the same of the least load, spread evenly
    ratio: Field  # shear over normal load
    pull: tuple[Field, ...]  # shear, as a unit vector


class RecentLoads:
    """Templates and read-outs that both programs need; parameters are those of `slip`.

    An array that reads shear alone, as a field of markers does, has the magnitude of its shear for
    a load: its ratio is the share of the shear that points one way.
    """

    def __init__(
        self, frame: FrameFields, *, push: float, shear_gain: float, pads: int,
        rest: float, look: float, floor: float,
    ) -> None:  # fmt: skip
        refuse_outside(rest=(rest, 0.0, 1e6), look=(look, 1e-6, 1e6))
        self.frame, self.rate = frame, frame.rate
        self._quiet = frame.frames_of(rest, FEW)
        self.resting = frame.age < float(self._quiet)
        *axes, normal = FORCE_AXES
        main, gain = normal if normal in frame.channels else axes[0], push * shear_gain
        # templates: above rest, smoothed, delayed
        above = {
            name: self._above_rest(frame.channel(name)) for name in dict.fromkeys([main, *axes])
        }
        self.shear = [self._leaky(gain * above[name], FAST)[0] for name in axes]
        self.pressed = main == normal
        if self.pressed:
            self.z = self._leaky(maximum(push * above[main], 0.0), FAST)[0]
        else:
            self.z = length(self.shear)
        self.old_z, *self.old_shear = (self._leaky(x, look)[1] for x in (self.z, *self.shear))
        # of a change by 1 since then
        self.per_s = self.rate * (1.0 - exp(-1.0 / (self.rate * look)))
        # read-outs
        self.noise = maximum(
            self._noise(frame.channel(main)),
            RECENT_ROUNDING * abs(frame.channel(main) - above[main]).max(),
        )
        self.pads = [self._pad(floor * self.noise, block) for block in blocks(frame, 1, pads)]
        self.load, before = mean([p.load for p in self.pads]), mean([p.before for p in self.pads])
        self.load_rate = self.per_s * abs(self.load - before) / self.load  # 1/s

    def centre(self, pad: "Pad") -> tuple[Field, Field]:
        """Return row and column of the centre of a pad's load, each cell by its square."""
        weight = square(self.z)
        row, column = (
            pad.total(weight * place) / maximum(pad.power, TINY)
            for place in (self.frame.row, self.frame.column)
        )
        return row, column

    def turn(self, pad: "Pad") -> tuple[Field, Field, Field]:
        """Return a pad's torque in use, and row and column of the place about which it turns.

        The torque is that of the shear about the middle of the load, over load and size. Let
        friction grow with the way from a place as k (row₀ − row, column − column₀) times the load.
        Then its mean is the ratio of shear to load, and its torque k size². A place is known up to
        `FAR` sizes from the middle.
        """
        row, column = self.centre(pad)
        down, right = self.frame.row - row, self.frame.column - column
        power = pad.total(self.z * (square(down) + square(right))) / pad.load + LEAST_LOAD
        size = sqrt(power)
        torque = pad.total(right * self.shear[1] - down * self.shear[0]) / pad.load / size
        least = maximum(pad.ratio / FAR, LEAST_LOAD)
        arm = pad.ratio * size / maximum(abs(torque), least) * where(torque < 0.0, -1.0, 1.0)
        return torque, row + arm * pad.pull[0], column - arm * pad.pull[1]

    def shown(self, **outputs: Field) -> dict[str, Field]:
        """Return outputs that are 0 during the rest."""
        return {name: where(self.resting, 0.0, value) for name, value in outputs.items()}

    def _above_rest(self, channel: Field) -> Field:
        return channel - level_at_rest(self.frame, channel, self.resting, self.frame.age + 1.0)

    def _leaky(self, value: Field, time: float) -> tuple[Field, Field]:
        """Return a map that follows another one with a time constant, and its value before."""
        memory, duration = self.frame.memory(f"mean of {time:g} s"), 1.0 / (self.rate * time)
        now = apply(get_template("leaky_cell"), input=value, state=memory.value, duration=duration)
        memory.store(now)
        return now, memory.value

    def _noise(self, channel: Field) -> Field:
        """Return the standard deviation of a reading, from its changes at rest."""
        change = channel - self.frame.previous(channel)
        power = 0.5 * (change * change).mean()
        return sqrt(mean_at_rest(self.frame, power, self.resting & ~self.frame.first))

    def _pad(self, noise: Field, block: Block) -> Pad:
        cells, _, total, inner = block
        least, power = maximum(noise * cells**0.5, LEAST_LOAD), total(self.z * self.z)
        load, before = total(self.z) + least, total(self.old_z) + least
        even, pulls = least * least / cells, [total(shear) for shear in self.shear]
        force = length(pulls)
        pull = tuple(component / force for component in pulls)
        return Pad(total, inner, load, least, before, power, even, force / load, pull)
