"""The law of a torque as taxels feel it, from the contact's radius and its place among them.

A sphere that turns on, with a disc of radius c that sticks, adds to the traction what such a disc
has without slip (Jäger). So the moment that is summed over the taxels grows with the angle by
felt(c), where the torque itself grows by 16/3 G c³. As a function of Lubkin's torque, a share L of
its last value, it grows by κ = felt(c)/(c/a)³. Were κ the same for all c, the moment would follow
Lubkin's law; with few taxels or bumps it is not. Here κ is taken at a few radii, and goes straight
from one to the next.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial import polynomial

from cnnum.programs.fields import Field, maximum, where
from cnnum.programs.machine import FrameFields, LocalMemory
from cnnum.tactile.bumps_felt import BumpsFelt
from cnnum.templates.tactile.contact_mechanics.bump_loads import levers_on_bumps, turned_on_bumps
from cnnum.templates.tactile.contact_mechanics.contact_radius import TINY, Round, round_under
from cnnum.templates.tactile.contact_mechanics.contact_wrench import Place, sideways_on
from cnnum.templates.tactile.contact_mechanics.growth_laws import CURVE, SHRINK, TWIST, Law
from cnnum.templates.tactile.contact_mechanics.load_growth import length
from cnnum.templates.tactile.contact_mechanics.sphere_response import turned_by
from cnnum.templates.tactile.shared.loads import square

KNOTS = (0.0, 0.2, 0.4, 0.6, 0.75, 0.87, 0.94, 0.98)
"""Shares of the last torque at which κ is looked at: c is a to 0.30 a there. On bumps κ grows up to
twofold while little of the contact sticks. Eight contacts on bumps (tuning seeds) follow the law
that straight lines between these make within 0.7 % in the mean; a polynomial through κ at five
radii was 1.3 % off."""

LOCKED = (0.391, 0.354)
"""What shear that is locked in takes from the torque: L² (1 − L) (0.391 − 0.354 L). It is left by a
pull that slid and was let go, and uses up friction until the contact has turned. Fitted to a row of
springs that keep (u/u_max)² + (F/F_max)² ≤ 1 (Jäger's model of a sphere), within 0.2 % of the last
torque; after a pull of half that way it takes half as much."""

RING = 6
"""Knot at whose c/a, 0.42, the ring begins that this is taken from, and felt by. Taken from where
torque is added at the time, it made rates 0.5 to 2.9 % too high (seven contacts under flat covers,
without noise); now they are within 0.4 %."""

FELT = 0.8
"""Share of the contact's radius that sticks while most of a torque grows."""

ASTRAY = 0.2
"""Pitches from the loads' centroid at which a fitted centre is none: that of a single taxel, as
where a bridge is stuck, wanders. Centroids are up to 0.1 off (tuning seeds)."""

LEAST = 0.05
"""Least κ: moment, a radian, that the taxels near a contact feel at least."""


@dataclass(frozen=True, slots=True)
class Turning:
    """How the torque on a contact is felt.

    Attributes
    ----------
    law : Law
        Of the summed moment.
    weight : Field
        Map: how much the moment of a taxel counts in the sum.
    felt : Field
        Moment that they feel for a turn of 1 rad without slip.
    contact : Place
        The contact about whose centre moments are taken.
    kept : Kept
        All of this, from the frame on in which the torque begins to grow.
    """

    law: Law
    weight: Field
    felt: Field
    contact: Place
    kept: "Kept"


class Kept:
    """Numbers that stay what they were when the torque began to grow.

    Parameters
    ----------
    frame : FrameFields
    """

    def __init__(self, frame: FrameFields) -> None:
        self._frame, self._grew = frame, frame.memory(scalar=True, logic=True)
        self._held = list[tuple[LocalMemory, Field]]()

    def __call__(self, value: Field) -> Field:
        """Return the number as it is or was."""
        memory = self._frame.memory(scalar=True)
        now = where(self._grew.value, memory.value, value)
        self._held.append((memory, now))
        return now

    def close(self, grows: Field) -> None:
        """Store what the next frame needs; `grows` tells whether the torque does."""
        self._grew.store(grows)
        for memory, now in self._held:
            memory.store(now)


def turning_of(contact: Place, near: Field, depth: float, bumps: BumpsFelt | None) -> Turning:
    """Return how a torque on a contact is felt, as it was known when the torque began to grow.

    Parameters
    ----------
    contact : Place
    near : Field
        Logic map: the taxels whose moment is summed.
    depth : float
        Of the taxels, pitches.
    bumps : BumpsFelt, optional
        Of a cover with bumps; a flat one unless given.
    """
    kept = Kept(contact.loads.frame)
    place = round_under(contact, sideways_on(contact), depth, bumps)
    centred = _about(contact, kept(place.row), kept(place.column))
    weight = _weight(centred, place, depth)
    summed = where(near & contact.loads.alive, weight, 0.0)
    discs = [_disc(share) for share in KNOTS]
    if bumps is None:
        felt = _on_flat(centred, place, summed, discs, depth)
    else:
        felt = _on_bumps(centred, place, summed, discs, bumps)
    steep = [maximum(one / disc**3, LEAST) for one, disc in zip(felt, discs, strict=True)]
    ring = (1.0 - (discs[RING] ** 3 / steep[0]) * steep[RING]) / (1.0 - discs[RING] ** 3)
    locked = kept(where(place.sheared, ring, 0.0))
    law = _law(locked, [kept(bend / steep[0]) for bend in _bends(steep)])
    return Turning(law, weight, kept(steep[0]), centred, kept)


def _about(contact: Place, row: Field, column: Field) -> Place:
    """Return the contact with another centre, if near: a force beside it would be a torque."""
    near = length([row - contact.row, column - contact.column]) < ASTRAY
    row, column = where(near, row, contact.row), where(near, column, contact.column)
    rows, columns = contact.loads.frame.row - row, contact.loads.frame.column - column
    return replace(contact, row=row, column=column, from_row=rows, from_column=columns)


def _weight(contact: Place, place: Round, depth: float) -> Field:
    """Return what tells a torque from noise best: the shear strain that it makes, over the lever.

    Such a sum over an endless array is about as large as that of moments.
    """
    away = maximum(square(contact.from_row) + square(contact.from_column), TINY)
    moment = turned_by(away, FELT * place.radius, depth)
    strain = moment / away
    return strain * (moment.sum() / maximum((strain * moment).sum(), TINY))


def _on_flat(
    contact: Place, place: Round, summed: Field, discs: Sequence[float], depth: float
) -> list[Field]:
    """Return the moment of discs that turn by 1 rad, shares of the contact's radius."""
    frame = contact.loads.frame
    rows, columns = frame.row - place.row, frame.column - place.column
    # the moment is taken about the centroid, and the strain goes round the centre
    away = maximum(square(rows) + square(columns), TINY)
    lever = summed * (contact.from_row * rows + contact.from_column * columns) / away
    return [(lever * turned_by(away, disc * place.radius, depth)).sum() for disc in discs]


def _on_bumps(
    contact: Place, place: Round, summed: Field, discs: Sequence[float], bumps: BumpsFelt
) -> list[Field]:
    frame = contact.loads.frame
    rows, columns = frame.row - place.row, frame.column - place.column
    lever = levers_on_bumps(-1.0 * summed * contact.from_row, summed * contact.from_column, bumps)
    turned = [turned_on_bumps(rows, columns, disc * place.radius) for disc in discs]
    return [(lever.x * drag.x + lever.y * drag.y).sum() for drag in turned]


def _disc(share: float) -> float:
    """Return c/a at which Lubkin's torque is a share of its last value."""
    return float(np.exp(-polynomial.polyval(_time(share), [0.0, *SHRINK])))


def _time(share: float) -> float:
    """Return x at which Lubkin's torque is a share of its last value."""
    roots = polynomial.polyroots([np.log(1.0 - share), *CURVE])
    return float(min(root.real for root in roots if abs(root.imag) < 1e-9 and root.real > -1e-9))


def _bends(steep: Sequence[Field]) -> list[Field]:
    """Return half of the change of κ's slope at every knot; beyond the last it is level."""
    spans = np.diff(KNOTS).tolist()
    level = 0.0 * steep[0]
    slopes = [(b - a) / span for a, b, span in zip(steep[:-1], steep[1:], spans, strict=True)]
    return [0.5 * (b - a) for a, b in zip([level, *slopes], [*slopes, level], strict=True)]


def _law(locked: Field, bends: Sequence[Field]) -> Law:
    """Return κ's integral over Lubkin's torque L, less what is locked in times `locked`."""
    takes, less = LOCKED

    def load(x: Field) -> Field:
        share = TWIST.load(x)
        whole = share - locked * square(share) * (1.0 - share) * (takes - less * share)
        for knot, bend in zip(KNOTS, bends, strict=True):
            whole = whole + bend * square(maximum(share - knot, 0.0))
        return whole

    return Law(load, TWIST.sticks, TWIST.times)
