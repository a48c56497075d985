"""The first step of the tactile programs: loads above rest, noise at rest, the contact.

The first frames of a stream define rest. While nothing touches, rest and noise are followed slowly,
so that an offset or its drift never becomes a load. While something touches, both are kept.
"""

from dataclasses import dataclass

from cnnum.frame import FORCE_AXES
from cnnum.programs.fields import Field, maximum, sqrt, square, where
from cnnum.programs.machine import REST, FrameFields
from cnnum.programs.several import total
from cnnum.programs.transients import apply
from cnnum.templating.library import get_template

FORGET = 256.0
"""Frames over which rest and noise are followed: slower than any touch, faster than warming up."""

TOUCH, LIFT = 6.0, 4.0
"""Peak loads, in standard deviations of the noise, at which contact begins and ends. The largest
of 256 noisy taxels exceeds 6 once in 4 million frames; it must in two frames in a row."""

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
    shear_x, shear_y, normal : Field
        Maps, in the frame's own unit.
    shear_noise, normal_noise : Field
        Variance of one reading, a number.
    contact : Field
        Flag.
    sound, healthy : Field
        Logic maps: taxels whose noise is no outlier in the normal axis, and in any. Only sound ones
        locate a contact, only healthy ones measure its load.
    alive : Field
        Logic map: taxels that read something, be it noise at rest.
    """

    frame: FrameFields
    shear_x: Field
    shear_y: Field
    normal: Field
    shear_noise: Field
    normal_noise: Field
    contact: Field
    sound: Field
    healthy: Field
    alive: Field


def loads_of(frame: FrameFields, push: float) -> Loads:
    """Return a frame's loads above rest, and the measures with them.

    Parameters
    ----------
    frame : FrameFields
    push : float
        Factor from a channel's sign to that of a load: −1 for strain and stress, which count
        tension as positive, +1 for signals and counts that rise under a push.
    """
    count = frame.age + 1.0
    touched = frame.memory("touched", scalar=True, logic=True)
    rest = {name: frame.memory(f"{name} at rest") for name in FORCE_AXES}
    shear, normal = _Noise(frame, ("shear_x", "shear_y")), _Noise(frame, ("normal",))
    above = push * (frame.normal - rest["normal"].value)
    broken = _broken(frame, touched.value, normal, abs(above))
    sound = normal.healthy & ~_astray(normal, rest["normal"].value) & ~broken
    aside = abs(rest["shear_x"].value) + abs(rest["shear_y"].value)
    peak = where(sound, above, 0.0).max()
    high = (count > float(REST)) & (square(peak) > TOUCH**2 * normal.held)
    begins = high & frame.previous(high)
    contact = touched.latch(begins, square(peak) > LIFT**2 * normal.held)
    # a first touch must not become part of rest, nor its jump of the noise
    free = ~(high | touched.value)
    rate = where(free, maximum(1.0 / count, 1.0 / FORGET), 0.0)

    given = {name: frame.channel(name) for name in FORCE_AXES}
    x, y, z = (push * (given[name] - rest[name].mean(given[name], rate)) for name in FORCE_AXES)
    return Loads(
        frame=frame,
        shear_x=x,
        shear_y=y,
        normal=z,
        shear_noise=shear.follow(free),
        normal_noise=normal.follow(free),
        contact=contact,
        sound=sound,
        healthy=sound & shear.healthy & ~_astray(shear, aside),
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


def _broken(frame: FrameFields, touched: Field, normal: "_Noise", above: Field) -> Field:
    """Return the taxels that broke under a contact.

    One is broken until it reads as at rest again while nothing touches.
    """
    lasts = frame.memory("frames of contact", scalar=True)
    broken = frame.memory("broken", logic=True)
    lasts.count(touched)
    change = normal.change / maximum(normal.held, TINY)
    size = sqrt(change)
    around = (apply(get_template("smooth"), input=size) - 0.25 * size) / 0.75
    alone = change > BREAK * (square(around) + 1.0)
    new = alone & normal.healthy & (lasts.value > float(REST)) & ~broken.value
    back = ~touched & (above < LIFT * sqrt(normal.held))
    return broken.latch(new, ~back)


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

    def follow(self, free: Field) -> Field:
        """Return it after this frame; one that repeats the one before is not counted."""
        news = free & (self.change.max() > 0.0)
        count = self._seen.value + where(news, 1.0, 0.0)
        rate = where(news, maximum(1.0 / count, 1.0 / FORGET), 0.0)
        self._seen.store(count)
        return self._typical(self._variance.mean(self.change, rate))

    def _typical(self, variance: Field) -> Field:
        sound = where(self.healthy, variance, 0.0)
        return maximum(sound.sum() / maximum(self.healthy.count(), 1.0), self._least)
