"""A load followed from frame to frame: at rest, growing, or over.

At rest its mean is known ever better. It begins to grow when it leaves that mean by more than the
noise, away from zero, and not as a by-product of a changing grip. From then on the hypotheses of
its law are weighed, until it has fallen again, or has stopped without what the law is named after.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from cnnum.programs.fields import Field, maximum, minimum, sqrt, where
from cnnum.programs.machine import FrameFields, LocalMemory
from cnnum.templates.tactile.contact_mechanics.growth_laws import Law
from cnnum.templates.tactile.contact_mechanics.growth_rate import Pace, pace_of
from cnnum.templates.tactile.contact_mechanics.time_hypotheses import weighed

BEGINS = 5.0
"""Standard deviations from its mean at which a load grows: by chance once in 270,000 frames, for
two components."""

QUIET = 2.0
"""The same below which it has not begun; the frames since then are its age as it is noticed, as far
as a load that grows evenly would not have been noticed before."""

TINY = 1e-30

LawOf = Callable[[tuple[Field, ...]], Law]
"""The law of a load with such components since it began."""

BESIDE = 0.3
"""Share of a change of the normal load that a sideways one must exceed: contacts that taxels sample
unevenly read up to about a tenth of it as shear."""

CROSS = 0.1
"""That tenth: by so much of the largest change of the normal load since it began a load may be off
the law that it follows."""

AROUND, UNSEEN = 0.3, 1.0
"""What a sudden load may have been at age 0: so much of a frame's growth, for it may begin anywhere
between two frames, and so many standard deviations of the noise that it was noticed through."""

ANOTHER = 1.5
"""Ratio of the whole contact's load to that at rest, either way, at which it is another contact."""

STEADY = 0.02
"""Share of the normal load by which it may change at rest."""

AWAY = 0.5
"""Share of its growth by which a load must lie further from zero than before: a hand that gives way
makes loads change, too."""

HELD = 0.05
"""Share of the normal load below which a load is let go, and zero is learned anew."""

FOLLOW = 32.0
"""Frames over which the mean at rest is taken."""

RELEASED = 0.7
"""Share of its largest value below which a load is over."""

SURE = 0.9
"""Weight of all hypotheses whose time is over at which a load has stopped growing."""

WAIT = 6.0
"""Frames after which a load that stopped is at rest again."""


@dataclass(frozen=True, slots=True)
class Reading:
    """A load of one frame.

    Attributes
    ----------
    load : sequence of Field
        Components, summed over the taxels that were near the contact when it was last at rest.
    beside : sequence of Field
        What else acts, to be known from zero as well.
    load_now, beside_now : sequence of Field
        The same over those that are near it now.
    noise : Field
        Variance of a component.
    normal, normal_now : Field
        Normal load over the same taxels.
    normal_noise : Field
        Its variance.
    arm : Field
        What a normal load is multiplied by to compare it with this one: 1 for a force, the
        contact's radius of gyration for a torque.
    whole : Field
        Load of the whole contact.
    jolt : Field
        Flag: the loads are not comparable with those of the frame before.
    """

    load: tuple[Field, ...]
    beside: tuple[Field, ...]
    load_now: tuple[Field, ...]
    beside_now: tuple[Field, ...]
    noise: Field
    normal: Field
    normal_now: Field
    normal_noise: Field
    arm: Field
    whole: Field
    jolt: Field


@dataclass(frozen=True, slots=True)
class Learned:
    """How means at rest are learned in a frame.

    Attributes
    ----------
    rate : Field
        Share of the way to what is now that they go.
    anew : Field
        Flag: they are what is now, over the taxels that are near the contact now.
    """

    rate: Field
    anew: Field


class Growth:
    """A load, and what its law says of it.

    Attributes
    ----------
    grows : Field
        Flag: it is growing, or has been and is still there.
    age : Field
        Frames since it began, this one counted.
    load : tuple of Field
        Its components since it began.
    size : Field
        Their size.
    acts, beside : tuple of Field
        The components from zero, and those of what else acts.
    grown_beside : Field
        What else acts, since this load began.
    steady : Field
        Change of the normal load since it began, as an amount of this load.
    found : Weighed
    first : Field
        Its size as it was noticed.
    """

    def __init__(
        self,
        frame: FrameFields,
        contact: Field,
        reading: Reading,
        law: LawOf,
        *,
        early: float,
        sudden: bool = False,
        follow: float = FOLLOW,
    ) -> None:
        self._frame, self._reading, self._contact = frame, reading, contact
        self._sudden, self._follow = sudden, follow
        parts = (*reading.load, *reading.beside)
        self._zero = [frame.memory(scalar=True) for _ in parts]
        self._rest = [frame.memory(scalar=True) for _ in parts]
        self._whole = frame.memory(scalar=True)
        self._normal, self._count = frame.memory(scalar=True), frame.memory(scalar=True)
        self._low, self._age = frame.memory(scalar=True), frame.memory(scalar=True)
        self._still, self._peak = frame.memory(scalar=True), frame.memory(scalar=True)
        self._first = frame.memory(scalar=True)
        self._offset, self._shaken = frame.memory(scalar=True), frame.memory(scalar=True)
        self._loaded = frame.memory(scalar=True, logic=True)
        self._active = frame.memory(scalar=True, logic=True)
        own = len(reading.load)
        self.load = tuple(
            now - rest.value for now, rest in zip(reading.load, self._rest[:own], strict=True)
        )
        self.size = length(self.load)
        acts = tuple(now - zero.value for now, zero in zip(parts, self._zero, strict=True))
        self.acts, self.beside = acts[:own], acts[own:]
        rests = zip(reading.beside, self._rest[own:], strict=True)
        self.grown_beside = length([now - rest.value for now, rest in rests])
        self._changed = abs(reading.normal - self._normal.value)
        self.steady = self._changed * reading.arm
        self._known = contact & (self._count.value > 0.0)
        self._begin()
        self._weigh(law(self.load), early)

    def _begin(self) -> None:
        """Work out whether it begins, goes on, or is over."""
        reading, known = self._reading, self._known
        idle = known & ~self._active.value
        spread = sqrt(1.0 + 1.0 / maximum(self._count.value, 1.0))
        clear = self.size > BEGINS * sqrt(reading.noise) * spread
        rested = zip(self._rest, self._zero[: len(self.load)], strict=False)
        before = length([rest.value - zero.value for rest, zero in rested])
        acts = length(self.acts)
        whole, rested_whole = reading.whole, self._whole.value
        same = (whole < ANOTHER * rested_whole) & (rested_whole < ANOTHER * whole)
        smooth = ~reading.jolt & same
        begins = idle & smooth & clear & (self.size > BESIDE * self.steady)
        self._begins = begins & (acts > before + AWAY * self.size)
        moves = (self._changed > BEGINS * sqrt(reading.normal_noise) * spread) & (
            self._changed > STEADY * abs(reading.normal)
        )
        self._jumps = idle & ~self._begins & (clear | moves)
        # as near to its mean as this it had not begun
        back = known & self._active.value & (self.size < QUIET * sqrt(reading.noise))
        self._rests = smooth & ((idle & ~self._begins & ~self._jumps) | back)
        held = acts > HELD * reading.normal * reading.arm
        self._holds = known & (self._begins | (self._loaded.value & (held | ~idle)))
        peak = where(self._begins, self.size, maximum(self._peak.value, self.size))
        least = RELEASED * peak - 3.0 * sqrt(reading.noise)
        goes_on = known & smooth & self._active.value & ~back
        goes_on = goes_on & (self.size > least) & (self.steady < self.size)
        self.grows = self._begins | goes_on
        self._peak.store(where(self.grows, peak, 0.0))

    def _weigh(self, law: Law, early: float) -> None:
        """Weigh the hypotheses, and see whether it has stopped."""
        self.age = age = where(self._begins, self._since(), self._age.value + 1.0)
        self._age.store(where(self.grows, age, 0.0))
        excess = maximum(self._changed - BEGINS * sqrt(self._reading.normal_noise), 0.0)
        shaken = where(self._begins, excess, maximum(self._shaken.value, excess))
        self._shaken.store(where(self.grows, shaken, 0.0))
        beside = CROSS * shaken * self._reading.arm
        self.first = where(self._begins, self.size, self._first.value)
        self._first.store(self.first)
        self._missing = where(self._begins, self._missed(), self._offset.value)
        self._offset.store(self._missing)
        self.found = weighed(
            self._frame,
            law,
            self.load,
            runs=self.grows,
            age=age,
            offset=self._missing,
            noise=self._reading.noise,
            beside=beside * beside,
            early=early,
        )
        found = self.found
        over = found.passed + found.ended > SURE * (found.growing + found.stopped)
        self._stood = where(self.grows & over, self._still.value + 1.0, 0.0)
        self._still.store(self._stood)

    def _since(self) -> Field:
        """Return how long it has grown as it is noticed, frames, this one counted."""
        low = self._low.value + 1.0
        if self._sudden:
            return low
        unseen = maximum(self.size - BEGINS * sqrt(self._reading.noise), TINY)
        return minimum(low, self.size / unseen)

    def _missed(self) -> Field:
        """Return what it may have been at age 0, RMS, as it begins."""
        if not self._sudden:
            return 0.5 * self.size
        frame = AROUND * self.size / self.age
        return sqrt(frame * frame + UNSEEN * UNSEEN * self._reading.noise)

    def pace(self, law: Law) -> Pace:
        """Return how fast its only component grew at first, by the law that it follows."""
        return pace_of(
            self._frame,
            law,
            self.load[0],
            runs=self.grows,
            age=self.age,
            offset=self._missing,
            noise=self._reading.noise,
            astray=self.found.astray,
        )

    def close(self, kept: Field) -> Learned:
        """Store everything for the next frame.

        Parameters
        ----------
        kept : Field
            Flag: something holds that keeps a load that stopped from being at rest again.
        """
        goes_on = self.grows & ~((self._stood > WAIT) & ~kept)
        self._active.store(goes_on)
        restarts = self._contact & ~self._rests & ~goes_on
        count = where(self._rests, self._count.value + 1.0, self._count.value)
        self._count.store(where(self._contact, where(restarts, 1.0, count), 0.0))
        rate = where(self._rests, maximum(1.0 / maximum(count, 1.0), 1.0 / self._follow), 0.0)
        loaded = self._holds & self._contact
        self._loaded.store(loaded)
        reading = self._reading
        now = (*reading.load, *reading.beside, reading.normal, reading.whole)
        fresh = (*reading.load_now, *reading.beside_now, reading.normal_now, reading.whole)
        held = (*self._rest, self._normal, self._whole)
        means = [_moved(*part, rate, restarts) for part in zip(held, now, fresh, strict=True)]
        for memory, mean in zip(held, means, strict=True):
            memory.store(mean)
        unloaded = ~loaded & (restarts | self._rests)
        for zero, mean in zip(self._zero, means, strict=False):
            zero.store(where(unloaded, mean, zero.value))
        low = self._rests & (self.size > QUIET * sqrt(reading.noise))
        self._low.store(where(low, self._low.value + 1.0, 0.0))
        return Learned(rate, restarts)


def _moved(memory: LocalMemory, now: Field, fresh: Field, rate: Field, restarts: Field) -> Field:
    return where(restarts, fresh, memory.value + rate * (now - memory.value))


def length(parts: Sequence[Field]) -> Field:
    """Return the length of a vector."""
    return sqrt(sum((part * part for part in parts[1:]), start=parts[0] * parts[0]))
