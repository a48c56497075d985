"""How long a load that grows has to go: all answers weighed at once, each in a cell of its own.

Every cell holds one hypothesis T of the time that a law of growth is named after, and fits the law
with that T to all that the load has been (least squares with a forgotten past, one amplitude a
component, and an offset for what had grown before it was noticed). A second fit in the same cell is
the rival: the load began to follow the law and stopped at T. The residues' likelihoods say how much
each is to be believed.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from operator import add

import numpy as np

from cnnum.programs.fields import Field, exp, maximum, minimum, where
from cnnum.programs.machine import FrameFields
from cnnum.templates.tactile.laws import Law, Times

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
    tried : tuple of Hypotheses
        As many maps as it takes.
    weights : tuple of Field
        Of each of those that follows the law.
    """

    growing: Field
    stopped: Field
    passed: Field
    ended: Field
    soon: Field
    sticks: Field
    astray: Field
    tried: tuple["Hypotheses", ...]
    weights: tuple[Field, ...]


@dataclass(frozen=True, slots=True)
class Hypotheses:
    """A map of them.

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


@dataclass(frozen=True, slots=True)
class Fit:
    """Sums of one law in one group of cells, and how well it fits.

    Attributes
    ----------
    tried : Hypotheses
    likelihood : Field
        Its logarithm, up to a constant that all fits share.
    """

    tried: Hypotheses
    likelihood: Field


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
    fits: list[Fit] = []
    rivals: list[Fit] = []
    for tried in hypotheses(frame, law.times):
        share = age / tried.times
        for found, shape in (
            (fits, law.load(share)),
            (rivals, law.load(STOP * minimum(share, 1.0))),
        ):
            found.append(_fit(frame, tried, shape, load, sums, runs, keep, free, variance))
    return _weights(law, age, fits, rivals, early, astray)


def hypotheses(frame: FrameFields, times: Times) -> list[Hypotheses]:
    """Return the times in frames, as many maps as it takes to hold them all."""
    rows, columns = frame.shape
    groups = -(-times.count // (rows * columns))
    frames = times.frames(groups * rows * columns)
    parts = (np.split(part, groups) for part in (frames, times.shares(frames)))
    return [
        Hypotheses(*(frame.constant(part.reshape(frame.shape)) for part in both))
        for both in zip(*parts, strict=True)
    ]


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
    memory = frame.memory(scalar=scalar)
    now = where(runs, keep * memory.value + value, 0.0)
    memory.store(now)
    return now


def _largest(frame: FrameFields, runs: Field, size: Field) -> Field:
    memory = frame.memory(scalar=True)
    now = where(runs, maximum(memory.value, size), 0.0)
    memory.store(now)
    return now


def _fit(
    frame: FrameFields,
    tried: Hypotheses,
    shape: Field,
    load: Sequence[Field],
    sums: Sequence[Field],
    runs: Field,
    keep: Field,
    free: Field,
    variance: Field,
) -> Fit:
    mean = summed(frame, runs, keep, shape)
    own = maximum(summed(frame, runs, keep, shape * shape) - mean * mean / free, TINY)
    along = [
        summed(frame, runs, keep, shape * part) - mean * total / free
        for part, total in zip(load, sums, strict=True)
    ]
    power = reduce(add, [part * part for part in along]) / own
    return Fit(tried, power / (2.0 * variance))


def _weights(
    law: Law, age: Field, fits: Sequence[Fit], rivals: Sequence[Fit], early: float, astray: Field
) -> Weighed:
    best = reduce(maximum, [fit.likelihood.max() for fit in (*fits, *rivals)])
    tried = [fit.tried for fit in fits]
    weights, against = (
        [exp(fit.likelihood - best) * (fit.tried.apart / law.times.share) for fit in each]
        for each in (fits, rivals)
    )
    next_age = (age + 1.0) / early
    stuck = [
        weight * law.sticks(age / one.times)
        + rival * law.sticks(STOP * minimum(age / one.times, 1.0))
        for weight, rival, one in zip(weights, against, tried, strict=True)
    ]
    return Weighed(
        growing=total(weights),
        stopped=total(against),
        passed=_over(weights, tried, age),
        ended=_over(against, tried, age),
        soon=_over(weights, tried, next_age),
        sticks=total(stuck),
        astray=astray,
        tried=tuple(tried),
        weights=tuple(weights),
    )


def _over(weights: Sequence[Field], tried: Sequence[Hypotheses], age: Field) -> Field:
    return total([w * one.over(age) for w, one in zip(weights, tried, strict=True)])


def total(maps: Sequence[Field]) -> Field:
    """Return the sum of maps over all of their cells."""
    return reduce(add, maps).sum()
