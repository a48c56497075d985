"""How fast a load grew at first, and how well that is known.

All times that its law may be named after are weighed, as in `hypotheses`, but by all that the load
has been: nothing is forgotten, for an object that turned at one rate until now tells that rate best
by all of it. What is not known beside amplitude and time is when the load began; so the law's slope
stands beside the law in the fit. With a constant instead the rates of 115 twists were 3.3 % off
instead of 2.8 % (RMS; tuning seeds 7000 to 7299, a replica in NumPy).
"""

from dataclasses import dataclass

from cnnum.programs.fields import Field, exp, maximum, sqrt
from cnnum.programs.machine import FrameFields
from cnnum.templates.tactile.contact_mechanics.growth_laws import CURVE, Law
from cnnum.templates.tactile.contact_mechanics.time_hypotheses import (
    TINY,
    Hypotheses,
    hypotheses,
    summed,
    variance_of,
)


@dataclass(frozen=True, slots=True)
class Pace:
    """The first slope of a load.

    Attributes
    ----------
    slope : Field
        The load's change a frame, RMS over all answers.
    error : Field
        Its standard error, as a share of it: what the answers differ by, and what noise leaves
        within each.
    """

    slope: Field
    error: Field


@dataclass(frozen=True, slots=True)
class _Answer:
    """What the law says with each time: likelihood (logarithm), slope and its variance."""

    likelihood: Field
    slope: Field
    variance: Field


def pace_of(
    frame: FrameFields,
    law: Law,
    load: Field,
    *,
    runs: Field,
    age: Field,
    offset: Field,
    noise: Field,
    astray: Field,
) -> Pace:
    """Return the first slope of a load after this frame.

    Parameters
    ----------
    frame : FrameFields
    law : Law
        With a first slope of `CURVE`'s: a torque's.
    load : Field
        Since it began, a number.
    runs : Field
        Flag: the load grows; in frames without it everything is forgotten.
    age : Field
        Frames since it began, this one counted.
    offset : Field
        What it may have been at age 0, RMS: by so much it may have begun earlier or later.
    noise : Field
        Its variance.
    astray : Field
        Mean square by which it may be off its law.
    """
    count = summed(frame, runs, 1.0, frame.constant(1.0), scalar=True)
    variance = variance_of(noise, astray, count)
    free = variance / maximum(offset * offset, TINY)
    tried = hypotheses(frame, law.times)
    found = _answer(frame, law, tried, load, runs, age, free, variance)
    weights = exp(found.likelihood - found.likelihood.max()) * tried.apart
    whole = weights.sum()
    mean = (weights * found.slope).sum() / whole
    square = (weights * found.slope * found.slope).sum() / whole
    within = (weights * found.variance).sum() / whole
    spread = maximum(square - mean * mean, 0.0) + within
    return Pace(sqrt(square), sqrt(spread / maximum(square, TINY)))


def _answer(
    frame: FrameFields,
    law: Law,
    tried: Hypotheses,
    load: Field,
    runs: Field,
    age: Field,
    free: Field,
    variance: Field,
) -> _Answer:
    shape = law.load(age / tried.times)
    before = law.load(maximum(age - 1.0, 0.0) / tried.times)
    later = (shape - before) * tried.times / CURVE[0]

    def over(value: Field) -> Field:
        return summed(frame, runs, 1.0, value)

    shift, both, late = over(later * later) + free, over(shape * later), over(later * load)
    own = maximum(over(shape * shape) - both * both / shift, TINY)
    along = over(shape * load) - both * late / shift
    power = along * along / own + late * late / shift
    slope = CURVE[0] * along / (own * tried.times)
    spread = CURVE[0] ** 2 * variance / (own * tried.times * tried.times)
    return _Answer(power / (2.0 * variance), slope, spread)
