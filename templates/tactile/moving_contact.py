"""Slip and twist of what touches the skin or is held, from what every skin shows.

Slip is a contact whose pattern moves and whose shear rearranges, under a shear load. It counts as
far as it exceeds what a load that changes, or a shear that still grows, explains:

    slip_strength = (moves² · loosens)^⅓ · ratio / (still + |trend| + swing · jolt + pull · grows)

`moves`, `loosens`, `trend`, `jolt` and `grows` are rates, 1/s; `ratio` is shear over normal load.
Twist is a curl of the shear over the normal load that exceeds that ratio. Templates give the maps,
sums over a pad the numbers, bistable latches the flags.
"""

from collections.abc import Callable, Mapping
from math import ceil, exp
from typing import NamedTuple

import numpy as np

from cnnum.errors import ProgramError
from cnnum.programs import program
from cnnum.programs.fields import Field, maximum, sqrt, where
from cnnum.programs.machine import FrameFields
from cnnum.programs.parameters import refuse_outside
from cnnum.programs.transients import apply
from cnnum.templates.tactile.shared.loads import PUSH, ROUNDING, square
from cnnum.templating.library import get_template

ALONG = 1.5  # 1 plus the cosine of a pattern's change and its slope, as it slides along the shear
TINY = 1e-12  # least load of an array without noise, in its unit

Total = Callable[[Field], Field]
Reads = dict[str, Field]


@program
def moving_contact(
    frame: FrameFields,
    *,
    push: float = PUSH,
    shear_gain: float = 1.0,
    axes: bool = True,
    pads: int = 1,
    rate: float = 200.0,
    rest: float = 0.4,
    fast: float = 0.02,
    look: float = 0.08,
    spread: float = 4.0,
    load: float = 0.35,
    floor: float = 240.0,
    still: float = 0.25,
    pull: float = 0.75,
    swing: float = 0.3,
    level: float = 0.28,
    hold: float = 0.5,
    turn: float = 0.1,
) -> Mapping[str, Field]:
    """Slip and twist of an object that is touched or held.

    Parameters
    ----------
    frame : FrameFields
        Strain, stress, signals or raw counts, several `pads` side by side in the columns.
    push, shear_gain : float
        −1 for strain and stress, which count tension as positive; +1 for what rises under a push.
        Reading of the normal channel over that of a shear channel, under the same force.
    axes : bool
        Whether signs and directions of the axes are known: a slip then moves along its shear.
    rate, rest : float, Hz, s
        Frames a second; time at the start without motion, which gives rest and noise.
    fast, look, load : float, s
        Time constants of the smoothing, of the delayed maps, and of the trend of the load.
    spread, floor : float, cells², none
        Diffusion time of the local mean of shear; least load of a pad, in noise of its sum.
    still, pull, swing : float, 1/s, none, none
        Slowest movement that counts, in contact sizes a second; weights of a shear that still
        grows, and of a load that swings.
    level, turn, hold : float
        Strengths from which a slip and a twist are reported, and the share at which reports end.

    Returns
    -------
    mapping
        `gross_slip` (flag), `slip_x`, `slip_y` (unit vector of the shear), `slip_strength` (see
        above), `twist` (flag), `twist_sense` (+1 from x to y, −1, 0 without), `twist_strength`
        (curl over normal load), `twist_row`, `twist_column` (centre of the load, cells).

    Raises
    ------
    ProgramError
        If a parameter is out of range, or the columns cannot be divided among the pads.
    """
    refuse_outside(rate=(rate, 1e-3, 1e6), rest=(rest, 0.0, 1e6), spread=(spread, 0.0, 1e3))
    refuse_outside(fast=(fast, 1e-6, 1e6), look=(look, 1e-6, 1e6), load=(load, 1e-6, 1e6))
    cells = _Cells(frame, rate, rest)
    maps, noise = _templates(cells, push, shear_gain, fast, look, spread)
    reads = [_read_outs(maps, floor * noise, *pad) for pad in _pads(frame, pads)]
    mean = {name: sum((r[name] for r in reads[1:]), reads[0][name]) / pads for name in reads[0]}
    jolt, trend = abs(mean["jolt"]) / mean["load"], cells.trend(mean["load"], load)
    strength = (square(mean["moves"]) * mean["loosens"]) ** (1 / 3) * mean["ratio"]
    strength = strength / (still + abs(trend) + swing * jolt + pull * mean["grows"])
    strength = strength * maximum(1.0 + mean["along"], 0.0) / ALONG if axes else strength
    _, x, y = _most([(read["ratio"] * read["load"], read["x"], read["y"]) for read in reads])
    curls = [cells.since(read["turn"], jolt > still) for read in reads]
    curled, turned = _most([(abs(each), each) for each in curls])
    twists = cells.bistable(where(curled > mean["ratio"], curled, 0.0), turn, hold)
    weight = square(maps.z)
    return {
        "gross_slip": cells.bistable(strength, level, hold),
        "slip_x": where(cells.resting, 0.0, x),
        "slip_y": where(cells.resting, 0.0, y),
        "slip_strength": where(cells.resting, 0.0, strength),
        "twist": twists,
        "twist_sense": where(twists, where(turned > 0.0, 1.0, -1.0), 0.0),
        "twist_strength": where(cells.resting, 0.0, curled),
        "twist_row": where(cells.resting, 0.0, (weight * frame.row).sum() / weight.sum()),
        "twist_column": where(cells.resting, 0.0, (weight * frame.column).sum() / weight.sum()),
    }


class _Maps(NamedTuple):
    z: Field  # normal load
    old: Field  # that of a while ago
    x: Field  # shear
    y: Field
    change: list[Field]  # of the shear since a while ago, 1/s
    loose: list[Field]  # the same without its local mean
    curl: Field
    per_s: float  # rate of what differs by 1 from a while ago


def _templates(
    cells: "_Cells", push: float, shear_gain: float, fast: float, look: float, spread: float
) -> tuple[_Maps, Field]:
    """Return the maps, and the noise of the normal load."""
    frame, per_s = cells.frame, cells.rate * (1.0 - exp(-1.0 / (cells.rate * look)))
    z, zero = cells.above_rest(frame.normal)
    x, y = (push * shear_gain * cells.above_rest(s)[0] for s in (frame.shear_x, frame.shear_y))
    z, x, y = (cells.leaky(now, fast)[0] for now in (maximum(push * z, 0.0), x, y))
    old, old_x, old_y = (cells.leaky(now, look)[1] for now in (z, x, y))
    change, spreads = [per_s * (x - old_x), per_s * (y - old_y)], get_template("tactile_diffusion")
    loose = [each - apply(spreads, input=each, duration=spread) for each in change]
    curl = apply(get_template("shear_curl"), input=(x, y))
    noise = maximum(cells.noise(frame.normal), ROUNDING * abs(zero).max())
    return _Maps(z, old, x, y, change, loose, curl, per_s), noise


def _read_outs(maps: _Maps, noise: Field, cells: int, total: Total, inner: Total) -> Reads:
    """Return what one pad shows, by the names in the formula."""
    least, pressed, before = maximum(noise * cells**0.5, TINY), total(maps.z), total(maps.old)
    power, mass, x, y = total(square(maps.z)), pressed + least, total(maps.x), total(maps.y)
    size, force = sqrt(power + square(least) / cells), sqrt(square(x) + square(y))
    share, old, x, y = maps.z / mass, maps.old / (before + least), x / force, y / force
    moved, mean = sqrt(total(square(share - old))), 0.5 * (share + old)
    right, down = (apply(get_template(f"gradient_{axis}"), input=mean) for axis in "xy")
    steep = sqrt(inner(square(right) + square(down)))
    return {
        "moves": maps.per_s * moved * mass / size,
        "loosens": sqrt(total(square(maps.loose[0]) + square(maps.loose[1]))) / size,
        "along": inner((old - share) * (x * right + y * down)) / (moved * steep),
        "ratio": force / mass,
        "grows": sqrt(square(total(maps.change[0])) + square(total(maps.change[1]))) / mass,
        "jolt": maps.per_s * (pressed - before),
        "load": mass,
        "x": x,
        "y": y,
        "turn": inner(maps.z * maps.curl) / (power + square(least) / (16.0 * cells)),
    }


class _Cells:
    """What remembers, from frame to frame."""

    def __init__(self, frame: FrameFields, rate: float, rest: float) -> None:
        self.frame, self.rate = frame, rate
        quiet = max(4, ceil(round(rest * rate, 6)))
        count = frame.memory("count", scalar=True)
        count.store(count.value + 1.0)
        self.count, self.changes = count.value, 2.0 * (quiet - 1)
        self.resting, self.starts = self.count < float(quiet), self.count <= float(quiet)

    def leaky(self, value: Field, time: float) -> tuple[Field, Field]:
        """Return a map that follows another one with a time constant, and what it was before."""
        memory, duration = self.frame.memory(), 1.0 / (self.rate * time)
        before = where(self.starts, value, memory.value)
        now = apply(get_template("leaky_cell"), input=value, state=before, duration=duration)
        memory.store(now)
        return now, before

    def above_rest(self, channel: Field) -> tuple[Field, Field]:
        """Return a channel above its mean at rest, and that mean."""
        memory, step = self.frame.memory(), where(self.resting, 1.0 / (self.count + 1.0), 0.0)
        rest = memory.value + step * (channel - memory.value)
        memory.store(rest)
        return channel - rest, rest

    def noise(self, channel: Field) -> Field:
        """Return the standard deviation of a reading, from its changes at rest."""
        memory, change = self.frame.memory(scalar=True), channel - self.frame.previous(channel)
        power = memory.value + where(self.resting, square(change).mean() / self.changes, 0.0)
        memory.store(power)
        return sqrt(power)

    def trend(self, load: Field, time: float) -> Field:
        """Return the relative growth of a load, 1/s, as remembered over a time."""
        memory, growth = self.frame.memory(scalar=True), load - self.frame.previous(load)
        step = 1.0 - exp(-1.0 / (self.rate * time))
        now = memory.value + step * (self.rate * growth / load - memory.value)
        memory.store(where(self.starts, 0.0, now))
        return where(self.starts, 0.0, now)

    def since(self, value: Field, changes: Field) -> Field:
        """Return a number less what it was when the load last changed."""
        memory = self.frame.memory(scalar=True)
        then = where(self.starts | changes, value, memory.value)
        memory.store(then)
        return value - then

    def bistable(self, value: Field, level: float, hold: float) -> Field:
        """Return a flag that goes on at a level and off at a share of it."""
        latch = self.frame.memory(scalar=True, logic=True)
        now = ~self.resting & (value > where(latch.value, hold * level, level))
        latch.store(now)
        return now


def _pads(frame: FrameFields, pads: int) -> list[tuple[int, Total, Total]]:
    """Return for each pad its cells, a sum over them, and one without those beside another pad."""
    (rows, cols), place = frame.shape, np.arange(frame.shape[1])
    if pads < 1 or cols % pads:
        raise ProgramError(f"{cols} columns cannot be divided among 'pads' = {pads}.")
    if pads == 1:
        return [(rows * cols, Field.sum, Field.sum)]
    wide = cols // pads
    differs = place[1:] // wide != place[:-1] // wide
    alone = ~np.append(differs, False) & ~np.append(False, differs)

    def over(share: np.ndarray) -> Total:
        weight = frame.constant(np.broadcast_to(1.0 * share, (rows, cols)))
        return lambda value: (value * weight).sum()

    shares = [place // wide == pad for pad in range(pads)]
    return [(rows * wide, over(share), over(share & alone)) for share in shares]


def _most(values: list[tuple[Field, ...]]) -> tuple[Field, ...]:
    """Return the tuple whose first number is the largest."""
    best = values[0]
    for each in values[1:]:
        best = tuple(where(each[0] > best[0], a, b) for a, b in zip(each, best, strict=True))
    return best
