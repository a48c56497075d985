"""The array at rest: its clock, its noise, and what lies above it.

Rest at the start of a stream and after it, and its noise; one outlier spoils neither.

While readings stay near rest it is followed slowly. It is kept while something touches, and while
readings are far below it: a sensor that zeroes itself under a load, or loses some taxels for a
while, comes back to the rest that it had. Where readings are far below and nothing moves for long,
as after a stream that began in a touch, they are the new rest.
"""

from collections.abc import Sequence
from dataclasses import replace
from math import pi

import numpy as np

from cnnum.frame import FORCE_AXES
from cnnum.graph.nodes import RunSpec
from cnnum.programs.fields import Field, maximum, minimum, sqrt, square, where
from cnnum.programs.machine import BEGINS, ENOUGH, FrameFields
from cnnum.programs.parameters import refuse_outside
from cnnum.programs.transients import apply, transient
from cnnum.templating.library import get_template
from cnnum.templating.template import Template

FORGET = 4.0
"""s over which rest and noise are followed: slower than a touch, faster than warming up. What grows
by less than 1.5 times the noise a second is followed, too, and is no load."""

STILL = 10.0
"""s for which nothing moves until readings far below rest become the new one. What comes back from
an automatic zero with a time constant up to that moves all the time."""

CALM = 30.0
"""Change of a frame, in power, over that of others at rest, from which it is an outlier's. The mean
over the cells and axes of `MANY` noisy readings leaves the factor once in 10⁸ frames."""

MANY = 8
"""Readings of a frame from which outliers are told by its mean change; few readings scatter more
themselves."""


def level_at_rest(
    frame: FrameFields, channel: Field, resting: Field, count: Field, name: str = "rest"
) -> Field:
    """Return the mean of a channel over the frames at rest, without each taxel's two extremes.

    The middle of a reading and both extremes so far goes into the mean: whatever leaves it, of
    three readings or more one outlier is never in it.

    Parameters
    ----------
    frame : FrameFields
    channel : Field
        Map.
    resting : Field
        Flag: it holds from the first frame on.
    count : Field
        Frames at rest, this one among them.
    name : str
        Name of the memories, in traces.
    """
    low, high, mean = (frame.memory(f"{part}{name}") for part in ("least of ", "most of ", ""))
    begins = frame.first
    least, most = (where(begins, channel, memory.value) for memory in (low, high))
    middle = maximum(minimum(channel, most), least)
    low.store(where(resting, minimum(channel, least), least))
    high.store(where(resting, maximum(channel, most), most))
    share = where(resting, 1.0 / maximum(count - 2.0, 1.0), 0.0)
    return mean.mean(middle, share)


def mean_at_rest(frame: FrameFields, power: Field, counted: Field) -> Field:
    """Return the mean of a number over the frames at rest, but for those of an outlier.

    A reading that is off for a frame makes two changes. So the two largest are left out where they
    are many times the mean of the others.

    Parameters
    ----------
    frame : FrameFields
    power : Field
        Number, 0 or above.
    counted : Field
        Flag: the frame counts.
    """
    largest, second, others, seen = (
        frame.memory(f"{name} at rest", scalar=True)
        for name in ("largest change", "second change", "other changes", "changes")
    )
    new = where(counted, power, 0.0)
    middle = maximum(minimum(new, largest.value), second.value)
    left_over = minimum(new, second.value)
    count = seen.value + where(counted, 1.0, 0.0)
    share = where(counted & (count > 2.5), 1.0 / maximum(count - 2.0, 1.0), 0.0)
    mean = others.mean(left_over, share)
    most = maximum(new, largest.value)
    largest.store(most)
    second.store(middle)
    seen.store(count)
    whole = (mean * maximum(count - 2.0, 0.0) + most + middle) / maximum(count, 1.0)
    return where((count > 2.5) & (mean > 0.0) & (most > CALM * mean), mean, whole)


def calm(frame: FrameFields, power: Field, counted: Field, readings: int) -> tuple[Field, Field]:
    """Return whether the change of a frame is one of noise, and whether it is the first such one.

    Parameters
    ----------
    frame : FrameFields
    power : Field
        Mean square change of the readings since the frame before, a number.
    counted : Field
        Flag: the frame is at rest and no repeat.
    readings : int
        How many there are.

    Returns
    -------
    (Field, Field)
        Flags. With the second one all that was known of the noise was an outlier's.
    """
    memory = frame.memory("least change", scalar=True)
    none = ~(memory.value > 0.0)
    if readings < MANY:
        memory.store(where(counted, power, memory.value))
        return counted, counted & none
    some = power > 0.0  # where nothing has changed, the reading is coarse or came twice
    anew = counted & some & (none | (power * CALM < memory.value))
    fits = counted & (anew | (power <= CALM * memory.value))
    lowers = fits & some & (none | (power < memory.value))
    memory.store(where(lowers, power, memory.value))
    return fits, anew


def frames_followed(frame: FrameFields) -> float:
    """Return the frames over which rest and noise are followed.

    At long steps it is `ENOUGH` frames: a mean over fewer is as noisy as a reading, and one whose
    share of a reading is above 2 grows without bound.
    """
    return max(float(ENOUGH), FORGET * frame.rate)


class Rest:
    """Readings at rest: followed from both sides, and learned anew where nothing moves for long.

    Attributes
    ----------
    begins : Field
        Flag: the frame is one of the first, which define rest.
    known : dict of str to LocalMemory
        By channel, as it was before this frame.
    """

    def __init__(self, frame: FrameFields) -> None:
        self._frame, self._count = frame, frame.age + 1.0
        self._follows = 1.0 / frames_followed(frame)
        self.begins = frame.age < float(frame.frames_of(BEGINS, ENOUGH))
        axes = (name for name in FORCE_AXES if name in frame.channels)
        self.known = {name: frame.memory(f"{name} at rest") for name in axes}
        self._lasts = frame.memory("frames without a move")

    def still(self, waits: Field, least: Field) -> Field:
        """Return the taxels that wait and have not moved for long, by their normal axis.

        Parameters
        ----------
        waits : Field
            Logic map of the taxels whose readings may be a new rest.
        least : Field
            Square of the change from which something has moved.
        """
        reading, memory = self._frame.normal, self._frame.memory("normal when it last moved")
        goes_on = waits & ~(square(reading - memory.value) > least)
        memory.store(where(goes_on, memory.value, reading))
        return self._lasts.count(goes_on) > float(self._frame.frames_of(STILL))

    def above(self, name: str, free: Field, anew: Field, since: Field) -> Field:
        """Return a channel above its rest, which is followed where it is free.

        A contact that is over may leave a load within the noise, as a sensor does that zeroes
        itself. It is at rest now, or the noise would make contacts of it: the frames `since` are
        taken into a mean that the rest before counts in as `ENOUGH` frames.
        """
        reading, memory = self._frame.channel(name), self.known[name]
        first = level_at_rest(self._frame, reading, self.begins, self._count, f"{name} at first")
        share = maximum(1.0 / minimum(self._count, since + ENOUGH), self._follows)
        share = where(free, share, 0.0)
        late = self._frame.memory(f"{name} lately")
        late.mean(reading, maximum(1.0 / (self._lasts.value + 1.0), self._follows))
        followed = memory.value + share * (reading - memory.value)
        result = where(self.begins, first, where(anew, late.value, followed))
        memory.store(result)
        return reading - result


QUIET = 8
"""Frames of rest at least, which make noise of 4 taxels known to a fifth."""

SPREAD = 1.0 / (16.0 * np.log(2.0))
"""Diffusion time (cells²) over the square of the width at half height that it gives a point."""

TINY = 1e-30
"""Least noise, of a sensor without any."""

ROUNDING = 1e-6
"""Least noise as a share of the largest raw value: the rounding of float32."""


def with_corners(name: str, corners: Sequence[float]) -> Template:
    """Return a template whose layers, but for the signal's own, have these corners, Hz."""
    return replace(get_template(name), tau=np.array([1.0, *map(corner, corners)]))


def corner(hertz: float) -> float:
    """Return the time constant of a corner, s."""
    return 0.5 / pi / hertz


def over_field(signal: Field, width: float) -> Field:
    """Return the mean of a signal over a field: a bell that is so wide at half its height."""
    refuse_outside(field=(width, 0.0, 1e3))
    spreads = get_template("tactile_diffusion")
    return apply(spreads, input=signal, duration=SPREAD * width**2) if width > 0.0 else signal


class Clock:
    """The frames of a stream in time.

    Parameters
    ----------
    frame : FrameFields
    rest : float, s
        Time at the start that gives rest and noise, at least `QUIET` frames.
    held : bool
        Whether signals keep the value of the later frame between two of them; else they run
        straight.

    Attributes
    ----------
    resting : Field
        Flag.
    """

    def __init__(self, frame: FrameFields, rest: float, *, held: bool = False) -> None:
        refuse_outside(rest=(rest, 0.0, 1e6))
        self.frame, self.rate, self._held = frame, frame.rate, held
        self._quiet = frame.frames_of(rest, QUIET)
        self.resting = frame.age < float(self._quiet)

    def above_rest(self, channel: str, push: float) -> Field:
        """Return a channel above its mean at rest, positive as a load."""
        reading, count = self.frame.channel(channel), self.frame.age + 1.0
        name = f"{channel} at rest"
        return push * (reading - level_at_rest(self.frame, reading, self.resting, count, name))

    def behind(self, template: Template, signal: Field) -> Field:
        """Return the last layer of a template that goes on from frame to frame."""
        return self.layers_behind(template, signal)[-1]

    def layers_behind(self, template: Template, signal: Field) -> tuple[Field, ...]:
        """Return the layers of a template that go on from frame to frame, the first the signal."""
        before = signal if self._held else self.frame.previous(signal)
        layers = [self.frame.memory(f"{template.name} {n}") for n in range(1, template.layers)]
        run = transient(
            template,
            input=self.rate * (signal - before),
            state=[before, *(layer.value for layer in layers)],
            spec=RunSpec(duration=1.0 / self.rate),
        )
        for layer, state in zip(layers, run.states[1:], strict=True):
            layer.store(state)
        return run.states

    def noise(self, power: Field, channels: Sequence[str]) -> Field:
        """Return the root of the mean power of an output in the second half of the rest."""
        memory, half = self.frame.memory("noise", scalar=True), self._quiet // 2
        counted = self.resting & (self.frame.age >= float(half))
        share = where(counted, 1.0 / (self._quiet - half), 0.0)
        memory.store(memory.value + share * power)
        sizes = [abs(self.frame.channel(name)).max() for name in channels]
        largest = sizes[0] if len(sizes) == 1 else maximum(*sizes)
        return maximum(sqrt(memory.value), maximum(ROUNDING * largest, TINY))
