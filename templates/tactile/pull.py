"""What acts on a contact sideways: force and torque, and the shear that they have built up."""

from dataclasses import dataclass

from cnnum.library import get_template
from cnnum.programs.fields import Field, maximum, sqrt, where
from cnnum.programs.machine import FrameFields
from cnnum.programs.transients import apply
from cnnum.templates.tactile.loads import Loads, Patch, square

ENGAGED = 0.15
"""Share of the normal load from which a sideways one counts; below it rest is learned anew."""

CLEAR = 6.0
"""The same in standard deviations of the noise."""

RADIUS = 2.5**0.5
"""Contact radius over the radius of gyration of Hertz's pressure: ⟨ρ²⟩ = 2a²/5."""

LEARN = 0.25
"""Rate, a frame, at which shear without a pull is learned."""


@dataclass(frozen=True, slots=True)
class Pair:
    """A map of shear vectors."""

    x: Field
    y: Field

    def power(self) -> Field:
        """Return the sum of squares over the array."""
        return (square(self.x) + square(self.y)).sum()


@dataclass(frozen=True, slots=True)
class Pull:
    """The sideways loads of a frame.

    Attributes
    ----------
    near : Field
        Logic map: taxels in contact and their neighbours, which carry the shear.
    cells : Field
        Their number.
    built : Pair
        What of the shear near the contact the present pull or twist has built up.
    force_x, force_y, torque : Field
        Sums of shear, and of its moment about the contact's centre, positive from x to y.
    force : Field
        Size of the force.
    pulled, twisted : Field
        Flags: which of the two is there and the stronger one.
    """

    near: Field
    cells: Field
    built: Pair
    force_x: Field
    force_y: Field
    torque: Field
    force: Field
    pulled: Field
    twisted: Field


def pull_of(loads: Loads, patch: Patch) -> Pull:
    """Return the sideways loads of a frame."""
    frame = loads.frame
    near = apply(get_template("smooth"), input=patch.weight) > 0.0
    from_row, from_column = frame.row - patch.row, frame.column - patch.column
    x, y = loads.shear_x.sum(), loads.shear_y.sum()
    torque = (from_column * loads.shear_y - from_row * loads.shear_x).sum()
    force, size = sqrt(square(x) + square(y)), abs(torque)
    least = CLEAR * sqrt(loads.shear_noise)
    cells = float(frame.shape[0] * frame.shape[1])
    arms = sqrt((square(from_row) + square(from_column)).sum())
    share = ENGAGED * patch.load
    sheared = _there(loads, force, maximum(share, least * (2.0 * cells) ** 0.5))
    turned = _there(loads, size, maximum(share * patch.spread, least * arms))
    more = force * RADIUS * patch.spread > size
    free = ~(sheared | turned)
    return Pull(
        near=near,
        cells=maximum(near.count(), 1.0),
        built=Pair(
            where(near, _built(frame, loads.shear_x, free), 0.0),
            where(near, _built(frame, loads.shear_y, free), 0.0),
        ),
        force_x=x,
        force_y=y,
        torque=torque,
        force=force,
        pulled=sheared & more,
        twisted=turned & ~more,
    )


def _there(loads: Loads, size: Field, least: Field) -> Field:
    """Return whether a load is there: above its least value, and from then on above half of it."""
    before = loads.frame.memory(scalar=True, logic=True)
    now = loads.contact & ((size > least) | (before.value & (size > 0.5 * least)))
    before.store(now)
    return now


def _built(frame: FrameFields, value: Field, free: Field) -> Field:
    held = frame.memory()
    held.store(held.value + where(free, LEARN, 0.0) * (value - held.value))
    return value - held.value
