"""Whether a contact moves on along the force: what tells slip from a pull that has stopped.

An object that slips goes on at the speed of the pull; one that has stopped stays. How far a contact
has moved is read from the whole map of the normal load: it is the map at rest, taken along its own
slope. Every cell that holds a hypothesis T of the time of slip fits a ramp to that way, 0 until T,
and says how much likelier it is with the ramp than without. A force shifts the map, too, so that
the ramp is what is left beside a constant and a multiple of the force.
"""

from dataclasses import dataclass

import numpy as np

from cnnum.arrays import Floats
from cnnum.programs.fields import Field, maximum, minimum, sqrt, where
from cnnum.programs.transients import apply
from cnnum.templates.tactile.contact_mechanics.load_growth import Growth, Learned
from cnnum.templates.tactile.contact_mechanics.time_hypotheses import summed
from cnnum.templates.tactile.cover_model.deconvolution import filter_template
from cnnum.templates.tactile.shared.loads import Loads, square

KEEP = 0.85
"""Weight of a frame in the next one's fit: of the way before, six frames count. It is that short
because the shift by the force is a straight line of it for a short way only."""

LONGEST = 32.0
"""Frames that a ramp rises: five times what counts. Longer ones are straight lines."""

LATE = 8.0
"""Frames after its time in which a hypothesis gains by the contact's moving on: slip moves on at
once; what begins later is another thing, such as rolling."""

SLOWEST = 0.04
"""Least way, in pitches, that an object has gone before it slips, for a force as large as the
normal load. It is 1.5 a²/(R g), g the gain of shear over normal readings: 0.04 to 0.25 in 18 of 20
pulls (tuning seeds). Over T it is the speed of slip."""

CHANCE, FARTHEST = 1.0, 3.5
"""Standard deviations of the ramp that count for slip: beyond the first, up to 3.5 more, by which
it is 85 times likelier. More would let a bend that says "stopped" be overruled by rolling."""

ASIDE, TURNED = 0.5, 0.15
"""Standard deviations that a ramp across the force may have for nothing, and share of the one along
it: what slips goes along the force, and what rolls goes anywhere. Coarse taxels turn a way, too: by
at most 0.17 in 19 of 20 pulls, eight frames on (88 that have moved, tuning seeds 1000 to 1149)."""

AWRY = 3.0
"""By so many times the rest of it the ramp along the force counts less: of one that is four
deviations high and 30° off nothing is left."""

AGAINST = 5.0
"""Logarithm of the likelihood that the lack of a ramp takes at most."""

STRANGE = 3.0
"""Standard deviations up to which a ramp may come from the force that still grows: its shift is no
straight line of it."""

SEEN = 1e-3
"""Share of a ramp that is neither constant nor like the force, from which it is told apart."""

SHORTEST = 1e-6
"""Square frames: less of a ramp is none."""

TAKEN, ASKEW = 0.05, 0.05
"""Share of the normal load by which a pull itself may change it; and pitches by which a contact
that taxels sample coarsely seems to move, over the share by which its load changes beyond."""

SINGLE = 1e-6
"""Share of a force's power to which float32 tells its changes."""

TINY = 1e-30

SLOPE = np.array([[0.0, 0.0, 0.0], [-0.5, 0.0, 0.5], [0.0, 0.0, 0.0]])


@dataclass(frozen=True, slots=True)
class Way:
    """How far a contact has moved along the force since that was at rest.

    Attributes
    ----------
    along : Field
        Pitches.
    noise : Field
        Its variance.
    across : Field
        How far it has moved across the force, in the same noise.
    """

    along: Field
    noise: Field
    across: Field


@dataclass(frozen=True, slots=True)
class Moves:
    """Weights of the hypotheses whose time is over, by how the contact moves.

    Attributes
    ----------
    against_stops : Field
        Beside a pull that has stopped at that time, in which nothing moves.
    against_growth : Field
        Beside a pull that goes on growing, which shifts the map itself.
    """

    against_stops: Field
    against_growth: Field


class Rest:
    """The map of the normal load when the force was last at rest.

    Parameters
    ----------
    loads : Loads
    """

    def __init__(self, loads: Loads) -> None:
        self._normal, self._memory = loads.normal, loads.frame.memory()
        self._known = loads.sound & loads.alive
        self.map = where(self._known, self._memory.value, 0.0)

    def way(self, growth: Growth, normal: Field, noise: Field) -> Way:
        """Return how far the contact has moved along the force that grows, and across it.

        Parameters
        ----------
        growth : Growth
        normal : Field
            Normal load.
        noise : Field
            Variance of a reading.
        """
        x, y = (part / maximum(growth.size, TINY) for part in growth.load)
        east, south = _sloped(self.map, SLOPE), _sloped(self.map, SLOPE.T)
        lost = where(self._known, self.map - self._normal, 0.0)
        power = maximum(square(self.map).sum(), TINY)
        bare = (self.map * lost).sum() / power
        along, left = self._moved(x * east + y * south, lost, power, bare)
        across, aside = self._moved(x * south - y * east, lost, power, bare)
        changed = growth.steady / maximum(normal, TINY)
        askew = ASKEW * maximum(changed - TAKEN, 0.0)
        # both in the noise of the way along
        across = across * sqrt(aside / left)
        return Way(along, noise / left + square(askew), across)

    def _moved(self, slope: Field, lost: Field, power: Field, bare: Field) -> tuple[Field, Field]:
        """Return the way down a slope, and the slope's power."""
        slope = where(self._known, slope, 0.0)
        # a load that changes everywhere by the same share has not moved
        own = (slope * self.map).sum()
        left = maximum(square(slope).sum() - square(own) / power, TINY)
        return ((slope * lost).sum() - own * bare) / left, left

    def learn(self, learned: Learned) -> None:
        """Store what the next frame needs."""
        was = self._memory.value
        now = was + learned.rate * (self._normal - was)
        self._memory.store(where(learned.anew, self._normal, now))


def moves_on(loads: Loads, growth: Growth, way: Way, ratio: Field) -> Moves:
    """Return what the contact's way says of each time of slip.

    Parameters
    ----------
    loads : Loads
    growth : Growth
        Of the force.
    way : Way
    ratio : Field
        Force over normal load.
    """
    fit = _Fit(loads, growth, way)
    tried = growth.found.tried
    late = growth.age - tried.times
    height, turned, exact = fit.ramp(minimum(maximum(late, 0.0), LONGEST))
    least = SLOWEST * ratio * exact / tried.times
    aside = maximum(abs(turned) - ASIDE - TURNED * maximum(height, 0.0), 0.0)
    near = minimum(maximum(height - CHANCE - AWRY * aside, 0.0), FARTHEST)
    near = where(late > LATE, 0.0, near)
    far = minimum(maximum(height - STRANGE, 0.0), FARTHEST)
    lack = minimum(maximum((0.5 * least - height) * least, 0.0), AGAINST)
    weight = growth.found.weights * tried.over(growth.age)
    slips = weight * _fourth(_likelier(near) / (1.0 + 0.25 * lack))
    strays = weight * _fourth(_likelier(far))
    return Moves(slips.sum(), strays.sum())


class _Fit:
    """Least squares of the way by a constant, the force, and a ramp in each cell."""

    def __init__(self, loads: Loads, growth: Growth, way: Way) -> None:
        self._frame, self._runs = loads.frame, growth.grows
        self._force = growth.size
        count = maximum(self._sum(loads.frame.constant(1.0), scalar=True), 1.0)
        ways = (way.along, way.across)
        self._forces = self._sum(growth.size, scalar=True) / count
        self._means = [self._sum(part, scalar=True) / count for part in ways]
        powers = self._sum(square(growth.size), scalar=True)
        both = [self._sum(growth.size * part, scalar=True) for part in ways]
        power = maximum(powers - count * square(self._forces), maximum(SINGLE * powers, TINY))
        self._flat = 1.0 / power
        self._shifts = [
            (one - count * self._forces * mean) * self._flat
            for one, mean in zip(both, self._means, strict=True)
        ]
        self._ways = ways
        self._share = 1.0 / count
        self._sharp = 1.0 / sqrt(maximum(way.noise, TINY))

    def ramp(self, ramp: Field) -> tuple[Field, Field, Field]:
        """Return how high it is along and across, standard deviations, and one over the slope's."""
        plain = self._sum(ramp)
        power = self._sum(ramp * ramp)
        own = power - plain * plain * self._share
        force = self._sum(ramp * self._force) - plain * self._forces
        left = own - force * force * self._flat
        clear = left > maximum(SEEN * own, SHORTEST)
        root = sqrt(maximum(left, SHORTEST))
        along, across = (
            self._sum(ramp * way) - plain * mean - force * shift
            for way, mean, shift in zip(self._ways, self._means, self._shifts, strict=True)
        )
        sharp = where(clear, self._sharp / root, 0.0)
        return along * sharp, across * sharp, where(clear, root * self._sharp, 0.0)

    def _sum(self, value: Field, *, scalar: bool = False) -> Field:
        return summed(self._frame, self._runs, KEEP, value, scalar=scalar)


def _likelier(deviations: Field) -> Field:
    """Return the fourth root of about exp(x²/2), x up to 3.5, with less of a rise at the end."""
    return 1.0 + square(deviations) / 6.0


def _fourth(value: Field) -> Field:
    return square(square(value))


def _sloped(values: Field, kernel: Floats) -> Field:
    return apply(filter_template("slope", kernel, "Central difference."), input=values)
