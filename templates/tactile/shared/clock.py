"""Time from frame to frame in seconds: rest and noise, layers of leaky cells, receptive fields."""

from collections.abc import Sequence
from dataclasses import replace
from math import pi

import numpy as np

from cnnum.graph.nodes import RunSpec
from cnnum.programs.fields import Field, maximum, sqrt, where
from cnnum.programs.machine import FrameFields
from cnnum.programs.parameters import refuse_outside
from cnnum.programs.transients import apply, transient
from cnnum.templates.tactile.shared.rest import level_at_rest
from cnnum.templating.library import get_template
from cnnum.templating.template import Template

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
