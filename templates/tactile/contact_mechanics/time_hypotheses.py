"""How long a load that grows has to go: all answers weighed at once, each in a cell of its own.

Every cell holds one hypothesis T of the time that a law of growth is named after, and fits the law
with that T to all that the load has been (least squares with a forgotten past, one amplitude a
component, and an offset for what had grown before it was noticed). A second fit in the same cell is
the rival: the load began to follow the law and stopped at T. The residues' likelihoods say how much
each is to be believed.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from cnnum.programs.fields import Field, exp, maximum, minimum, where
from cnnum.programs.machine import FrameFields
from cnnum.templates.tactile.contact_mechanics.growth_laws import Law, Times

STOP = 0.35
"""Where on its law a load stands that stopped: of the force 48 %, of the torque 53 %. Their growth
up to there is straight enough to stand for any stop that is well before slip."""

FORGET, FORGET_MORE, LONG = 1.0, 4.0, 400.0
"""Past counts with (time/now)^p, p from 1 to 5 as a pull grows to 400 frames long: what a law says
of its end needs its speed to be constant lately, not always."""

TRUST = 0.002
"""RMS share of a load by which its law is off: what sums over taxels make of a contact that they
sample coarsely."""

ALONE = 8.0
"""Frames over which that error stays the same, for it is not noise: more frames do not average it
out."""

TINY = 1e-30


@dataclass(frozen=True, slots=True)
class Weighed:
    """What the hypotheses come to, as sums of weights; the largest weight is 1.

    Attributes
    ----------
    growing, stopped : Field
        Of all that follow the law, and of all that follow its rival.
    passed, ended : Field
        Of those among either whose time is over.
    soon : Field
        Of those that follow the law and are beyond `early` of their time by the next frame.
    sticks : Field
        Both kinds' c/a, weighed.
    astray : Field
        Mean square by which the load may be off its law, that is no noise.
    tried : Hypotheses
    weights : Field
        Of those that follow the law, a stack.
    """

    growing: Field
    stopped: Field
    passed: Field
    ended: Field
    soon: Field
    sticks: Field
    astray: Field
    tried: "Hypotheses"
    weights: Field


@dataclass(frozen=True, slots=True)
class Hypotheses:
    """A stack of as many maps as it takes to hold them all.

    Attributes
    ----------
    times : Field
        Frames.
    apart : Field
        How far each is from the next, as a share of it.
    """

    times: Field
    apart: Field

    def over(self, age: Field) -> Field:
        """Return whether a time is over: 0 to 1 over the distance to the next hypothesis."""
        return minimum(maximum((age / self.times - 1.0) / self.apart + 0.5, 0.0), 1.0)


def weighed(
    frame: FrameFields,
    law: Law,
    load: Sequence[Field],
    *,
    runs: Field,
    age: Field,
    offset: Field,
    noise: Field,
    beside: Field,
    early: float,
) -> Weighed:
    """Return the weights of all hypotheses after this frame's load.

    Parameters
    ----------
    frame : FrameFields
    law : Law
    load : sequence of Field
        Components of the load since it began, numbers.
    runs : Field
        Flag: the load grows; in frames without it everything is forgotten.
    age : Field
        Frames since it began, this one counted.
    offset : Field
        What it may have been at age 0, RMS.
    noise : Field
        Variance of a component.
    beside : Field
        Mean square by which something else may have put it off its law; no noise either.
    early : float
        Share of its time for `soon`.
    """
    keep = _keep(age)
    count = summed(frame, runs, keep, frame.constant(1.0), scalar=True)
    sums = [summed(frame, runs, keep, part, scalar=True) for part in load]
    size = sum((part * part for part in load[1:]), start=load[0] * load[0])
    peak = _largest(frame, runs, size)
    astray = TRUST**2 * peak + beside
    variance = variance_of(noise, astray, count)
    free = count + variance / maximum(offset * offset, TINY)
    tried = hypotheses(frame, law.times)
    share = age / tried.times
    likely, rival = (
        _likelihood(frame, shape, load, sums, runs, keep, free, variance)
        for shape in (law.load(share), law.load(STOP * minimum(share, 1.0)))
    )
    return _weights(law, age, tried, likely, rival, early, astray)


def hypotheses(frame: FrameFields, times: Times) -> Hypotheses:
    """Return the times in frames."""
    rows, columns = frame.shape
    maps = -(-times.count // (rows * columns))
    frames = times.frames(maps * rows * columns)
    return Hypotheses(
        *(
            frame.constant(part.reshape(maps, rows, columns))
            for part in (frames, times.shares(frames))
        )
    )


def variance_of(noise: Field, astray: Field, count: Field) -> Field:
    """Return the variance that each of so many frames has beside its law."""
    return maximum(noise + astray * maximum(count / ALONE, 1.0), TINY)


def _keep(age: Field) -> Field:
    """Return what is left of the past's weight."""
    power = FORGET + FORGET_MORE * minimum(age / LONG, 1.0)
    return where(age > power, 1.0 - power / age, 1.0)


def summed(
    frame: FrameFields, runs: Field, keep: Field | float, value: Field, *, scalar: bool = False
) -> Field:
    """Return the sum of a value over the frames since `runs` holds, the past times `keep`."""
    memory = frame.memory(scalar=scalar, maps=value.maps)
    now = where(runs, keep * memory.value + value, 0.0)
    memory.store(now)
    return now


def _largest(frame: FrameFields, runs: Field, size: Field) -> Field:
    memory = frame.memory(scalar=True)
    now = where(runs, maximum(memory.value, size), 0.0)
    memory.store(now)
    return now


def _likelihood(
    frame: FrameFields,
    shape: Field,
    load: Sequence[Field],
    sums: Sequence[Field],
    runs: Field,
    keep: Field,
    free: Field,
    variance: Field,
) -> Field:
    """Return the logarithm of a law's likelihood, up to a constant that both fits share."""
    mean = summed(frame, runs, keep, shape)
    own = maximum(summed(frame, runs, keep, shape * shape) - mean * mean / free, TINY)
    along = [
        summed(frame, runs, keep, shape * part) - mean * total / free
        for part, total in zip(load, sums, strict=True)
    ]
    power = sum((part * part for part in along[1:]), start=along[0] * along[0]) / own
    return power / (2.0 * variance)


def _weights(
    law: Law,
    age: Field,
    tried: Hypotheses,
    likely: Field,
    rival: Field,
    early: float,
    astray: Field,
) -> Weighed:
    best = maximum(likely.max(), rival.max())
    weights, against = (
        exp(each - best) * (tried.apart / law.times.share) for each in (likely, rival)
    )
    share = age / tried.times
    over = tried.over(age)
    stuck = weights * law.sticks(share) + against * law.sticks(STOP * minimum(share, 1.0))
    return Weighed(
        growing=weights.sum(),
        stopped=against.sum(),
        passed=(weights * over).sum(),
        ended=(against * over).sum(),
        soon=(weights * tried.over((age + 1.0) / early)).sum(),
        sticks=stuck.sum(),
        astray=astray,
        tried=tried,
        weights=weights,
    )
