"""What acts on a contact sideways: a force and a torque, each followed by its law."""

from dataclasses import dataclass, replace

from cnnum.programs.fields import Field, maximum, minimum, where
from cnnum.programs.machine import LocalMemory
from cnnum.programs.transients import apply
from cnnum.templates.tactile.contact_mechanics.growth_laws import Law
from cnnum.templates.tactile.contact_mechanics.load_growth import (
    FOLLOW,
    Growth,
    LawOf,
    Learned,
    Reading,
    length,
)
from cnnum.templates.tactile.shared.loads import Loads, Patch, square
from cnnum.templating.library import get_template

RADIUS = 2.5**0.5
"""Place radius over the radius of gyration of Hertz's pressure: ⟨ρ²⟩ = 2a²/5."""

LOOSE = 0.75
"""Share of its time at which half the contact radius sticks in a pull: c/a = √(1 − x)."""

HALF_NEAR = 0.1
"""Share of the largest load at which a taxel is half near: as more come in, what is felt sideways
must not jump."""

SMALLEST = 0.5
"""Cells: least radius of gyration, for a contact that one taxel feels."""


@dataclass(frozen=True, slots=True)
class Place:
    """Where a frame's contact is, for what acts on it.

    Attributes
    ----------
    loads : Loads
    there : Field
        Flag: a contact with a place.
    near : Field
        Logic map: taxels in contact and their neighbours, which carry the shear.
    felt : Field
        Logic map: these and their neighbours, which tell a shear force: the fewer of it are left
        out, the less does it matter where in the contact it acts.
    missing : Field
        Map: 1 where such taxels are broken, or read nothing.
    nearness : Field
        Map: 0 where they begin, near 1 within.
    from_row, from_column : Field
        Cells from the contact's centre, maps.
    spread : Field
        Radius of gyration, cells.
    row, column : Field
        Its centre.
    load : Field
        Normal load that the centre was taken from.
    """

    loads: Loads
    there: Field
    near: Field
    felt: Field
    missing: Field
    nearness: Field
    from_row: Field
    from_column: Field
    spread: Field
    row: Field
    column: Field
    load: Field


@dataclass(frozen=True, slots=True)
class Side:
    """A force or a torque on the contact.

    Attributes
    ----------
    growth : Growth
    outweighs : Field
        Flag: it is the larger one of the two, a torque being a force at the contact's rim.
    normal, normal_noise : Field
        Normal load near the contact, and its variance.
    memory : LocalMemory
        Of the taxels near the contact when the load was last at rest.
    near : Field
        Those that are near it now.
    """

    growth: Growth
    outweighs: Field
    normal: Field
    normal_noise: Field
    memory: LocalMemory
    near: Field

    def close(self, kept: Field) -> Learned:
        """Store what the next frame needs; `kept` as for `Growth.close`."""
        learned = self.growth.close(kept)
        self.memory.store((learned.anew & self.near) | (~learned.anew & self.memory.value))
        return learned


def place_of(loads: Loads, patch: Patch) -> Place:
    """Return where the contact is."""
    frame = loads.frame
    there = loads.contact & (patch.load > 0.0)
    around = apply(get_template("smooth"), input=patch.weight)
    near = (around > 0.0) & loads.healthy
    further = apply(get_template("smooth"), input=around) > 0.0
    row, column = (where(there, place, 0.0) for place in (patch.row, patch.column))
    return Place(
        loads=loads,
        there=there,
        near=near,
        felt=further & loads.healthy,
        missing=where(further & ~(loads.healthy & loads.alive), 1.0, 0.0),
        nearness=where(near, around / (around + HALF_NEAR * around.max()), 0.0),
        from_row=frame.row - row,
        from_column=frame.column - column,
        spread=where(there, maximum(patch.spread, SMALLEST), SMALLEST),
        row=row,
        column=column,
        load=patch.load,
    )


def force_on(contact: Place, law: LawOf) -> Side:
    """Return the force on a contact, x and y, beside the torque.

    Parameters
    ----------
    contact : Place
    law : callable
        By which it grows, of its components since it began.
    """
    frame = contact.loads.frame
    near, alike = frame.memory(logic=True), frame.constant(1.0)
    return _side(replace(contact, near=contact.felt), law, near, alike, FOLLOW, torque=False)


def torque_on(contact: Place, law: Law, near: LocalMemory, weight: Field, follow: float) -> Side:
    """Return the torque about the contact's centre, positive from x to y, beside the force.

    Parameters
    ----------
    contact : Place
    law : Law
        By which what is summed over the taxels grows.
    near : LocalMemory
        Logic map, for the taxels that are summed.
    weight : Field
        Map: how much the moment of a taxel counts.
    follow : float
        Frames over which the torque at rest is taken.
    """
    return _side(contact, lambda _: law, near, weight, follow, torque=True)


def moved_since(contact: Place, side: Side) -> Field:
    """Return how far the contact has moved since the force or torque began to grow, pitches."""
    now = (contact.column, contact.row)
    return length([part - _before(contact, side, part) for part in now])


def widened_since(contact: Place, side: Side) -> Field:
    """Return by what share of it the contact's radius of gyration has changed since then."""
    return abs(contact.spread / _before(contact, side, contact.spread) - 1.0)


def _before(contact: Place, side: Side, now: Field) -> Field:
    """Return what a number was in the frame before the force or torque began to grow."""
    memory = contact.loads.frame.memory(scalar=True)
    before = where(side.growth.grows, memory.value, now)
    memory.store(before)
    return before


def sideways_on(contact: Place) -> tuple[Field, ...]:
    """Return force and torque on the taxels near the contact, over the normal load on them."""
    all_alike = contact.loads.frame.constant(1.0)
    force, moment, normal = _sums(contact, contact.nearness, all_alike)
    return tuple(part / normal for part in (*force, moment[0] / contact.spread))


def _side(
    contact: Place, law: LawOf, memory: LocalMemory, weight: Field, follow: float, *, torque: bool
) -> Side:
    loads, frame = contact.loads, contact.loads.frame
    held, now = (where(near, 1.0, 0.0) for near in (memory.value, contact.near))
    away = square(contact.from_row) + square(contact.from_column)
    cells, arms = held.sum(), (held * square(weight) * away).sum()
    force, moment, normal = _sums(contact, held, weight)
    force_now, moment_now, normal_now = _sums(contact, now, weight)
    normal_noise = loads.normal_noise * cells
    growth = Growth(
        frame,
        contact.there,
        Reading(
            load=moment if torque else force,
            beside=force if torque else moment,
            load_now=moment_now if torque else force_now,
            beside_now=force_now if torque else moment_now,
            noise=loads.shear_noise * (arms if torque else cells),
            normal=normal,
            normal_now=normal_now,
            normal_noise=normal_noise,
            arm=contact.spread if torque else frame.constant(1.0),
            whole=where(contact.there, contact.load, 0.0),
            jolt=loads.breaks,
        ),
        law,
        early=1.0 if torque else LOOSE,
        sudden=torque,
        follow=follow,
    )
    own, other = length(growth.acts), length(growth.beside)
    if torque:
        # zero may have been learned in a pull, before a torque was felt at all
        other = minimum(other, length(force))
    rim = RADIUS * contact.spread
    return Side(
        growth=growth,
        outweighs=own > other * rim if torque else own * rim > other,
        normal=normal,
        normal_noise=normal_noise,
        memory=memory,
        near=contact.near,
    )


def _sums(
    contact: Place, near: Field, weight: Field
) -> tuple[tuple[Field, Field], tuple[Field], Field]:
    """Return force, torque and normal load over some taxels."""
    loads = contact.loads
    x, y = near * loads.shear_x, near * loads.shear_y
    moment = (weight * (contact.from_column * y - contact.from_row * x)).sum()
    return (x.sum(), y.sum()), (moment,), (near * loads.normal).sum()
