"""Loads above rest, now and a moment ago, shared by `slip` and `twist`."""

from math import exp
from typing import NamedTuple

from cnnum.programs.blocks import Block, Sums, blocks
from cnnum.programs.fields import Field, length, maximum, mean, sqrt, where
from cnnum.programs.machine import FrameFields
from cnnum.programs.parameters import refuse_outside
from cnnum.programs.transients import apply
from cnnum.templates.tactile.shared.rest import level_at_rest, mean_at_rest
from cnnum.templating.library import get_template

FAST = 0.02  # s, time constant of the smoothing
FEW = 4  # frames of rest at least, from which the noise of an array is known
ROUNDING, LEAST_LOAD = 1e-6, 1e-12  # least noise over the reading at rest; least load, in its unit


class Pad(NamedTuple):
    """Read-outs of one pad; `total` sums over it, `inner` without its cells next to another pad."""

    total: Sums
    inner: Sums
    load: Field  # normal load and the least load
    before: Field  # the same a moment ago
    power: Field  # sum of the squares of the normal load
    even: Field  # the same of the least load, spread evenly
    ratio: Field  # shear over normal load
    x: Field  # shear, as a unit vector
    y: Field


class RecentLoads:
    """Templates and read-outs that both programs need; parameters are those of `slip`."""

    def __init__(
        self, frame: FrameFields, *, push: float, shear_gain: float, pads: int,
        rest: float, look: float, floor: float,
    ) -> None:  # fmt: skip
        refuse_outside(rest=(rest, 0.0, 1e6), look=(look, 1e-6, 1e6))
        self.frame, self.rate = frame, frame.rate
        self._quiet = frame.frames_of(rest, FEW)
        self.resting = frame.age < float(self._quiet)
        # templates: above rest, smoothed, delayed
        z, x, y = map(self._above_rest, (frame.normal, frame.shear_x, frame.shear_y))
        above = maximum(push * z, 0.0), push * shear_gain * x, push * shear_gain * y
        self.z, *self.shear = self._now = [self._leaky(each, FAST)[0] for each in above]
        self.old_z, *self.old_shear = (self._leaky(each, look)[1] for each in self._now)
        # of a change by 1 since then
        self.per_s = self.rate * (1.0 - exp(-1.0 / (self.rate * look)))
        # read-outs
        self.noise = maximum(self._noise(frame.normal), ROUNDING * abs(frame.normal - z).max())
        self.pads = [self._pad(floor * self.noise, block) for block in blocks(frame, 1, pads)]
        self.load, before = mean([p.load for p in self.pads]), mean([p.before for p in self.pads])
        self.ratio = mean([pad.ratio for pad in self.pads])
        self.load_rate = self.per_s * abs(self.load - before) / self.load  # 1/s

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
        x, y = (total(shear) for shear in self.shear)
        force, even = length([x, y]), least * least / cells
        return Pad(total, inner, load, before, power, even, force / load, x / force, y / force)
