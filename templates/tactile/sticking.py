"""How much of a contact sticks, read from how alike a change of shear and the shear built up are.

Under a growing force or torque only the sticking disc takes up more shear; what slips keeps
friction times pressure (Cattaneo, Mindlin; Lubkin). While all sticks, an increment d repeats the
map c that was built up; the smaller the stick radius, the more it gathers in the middle; in gross
slip loads change from taxel to taxel as the contact travels, and none of it repeats c. So

    stick = (Σ d·c)² / (Σ d² Σ c²)

is 1 in full stick and 0 in gross slip. Gains, friction, direction and speed do not enter.
"""

from dataclasses import dataclass, replace

from cnnum.programs.fields import Field, maximum, sqrt, where
from cnnum.templates.tactile.change import WINDOWS, changes
from cnnum.templates.tactile.loads import Loads, square
from cnnum.templates.tactile.pull import Pair, Pull

CLEAR = 200.0
"""Power of a change, in powers of its noise, from which a window is long enough: `stick` is then
known to about 1 %. Shorter windows lose more to noise than they gain in time."""

RESOLVED = 16.0
"""The same that the longest window needs at least: `stick` to 5 %."""

MOVES = 2.0
"""The same from which there is a change at all."""

EARLY = 4.0
"""Frames by which a pull is older than what is known of it."""

RISES, STILL_RISES = 4.0, 2.0
"""Standard deviations by which what is built up must grow over a window to count as growing, and
over one a quarter as long, so that a pull that has just stopped is not carried on."""

STEADY = 0.25
"""Largest share of a change of normal load that may go along with the load itself: above, the grip
changes, and the shear around it."""

TINY = 1e-30


@dataclass(frozen=True, slots=True)
class Change:
    """A change of the loads over one window.

    Attributes
    ----------
    there, clear, resolved, steady, rises, lately : Field
        Flags: there is one; it is clear of the noise; it can be told from it; the grip does not
        change; what is built up grows, surely or likely.
    stick : Field
        Number, see above; negative where what is built up goes down.
    delay : Field
        Frames from the middle of the window to now.
    shear : Pair
        Maps.
    """

    there: Field
    clear: Field
    resolved: Field
    steady: Field
    rises: Field
    lately: Field
    stick: Field
    delay: Field
    shear: Pair


@dataclass(frozen=True, slots=True)
class Sticking:
    """What the shortest window tells that can tell it.

    Attributes
    ----------
    grows : Field
        Flag: a resolved change that adds to what is built up, under a steady grip.
    goes : Field
        Flag: there is a change under a steady grip.
    loose : Field
        1 − `stick` of the change behind `grows`, carried on to now: 0 to 1 and above.
    travel : Field
        `stick` of the change behind `goes`.
    shear : Pair
        The resolved change.
    """

    grows: Field
    goes: Field
    loose: Field
    travel: Field
    shear: Pair


def sticking_of(loads: Loads, pull: Pull) -> Sticking:
    """Return how alike the latest change of shear and the built-up shear are."""
    channels = (loads.shear_x, loads.shear_y, loads.normal)
    maps = zip(*(changes(loads.frame, channel) for channel in channels), strict=True)
    found = [
        _change(loads, pull, Pair(x, y), normal, window)
        for (x, y, normal), window in zip(maps, WINDOWS, strict=True)
    ]
    found = [
        replace(change, rises=change.rises & found[max(0, number - 2)].lately)
        for number, change in enumerate(found)
    ]
    clear = _first(found, [change.clear for change in found])
    there = _first(found, [change.there for change in found])
    grows = clear.resolved & clear.rises & clear.steady
    return Sticking(
        grows=grows,
        goes=there.there & there.steady,
        loose=(1.0 - clear.stick) * _carried(loads, pull, clear, grows),
        travel=there.stick,
        shear=clear.shear,
    )


def _carried(loads: Loads, pull: Pull, clear: Change, grows: Field) -> Field:
    """Return how much looser the contact is now than when the window saw it.

    At a constant speed, looseness grows about as the third power of a pull's age while it is small.
    A window that reaches back to before the pull says nothing: 0.
    """
    memory = loads.frame.memory(scalar=True)
    age = where(pull.pulled | pull.twisted, memory.value + where(grows, 1.0, 0.0), EARLY)
    memory.store(age)
    ratio = age / maximum(age - clear.delay, 1.0)
    return where(ratio < 2.0, ratio * square(ratio), 0.0)


def _change(loads: Loads, pull: Pull, shear: Pair, normal: Field, window: int) -> Change:
    """Return one window's change, its noise taken off."""
    share = 2.0 / window
    noise = 2.0 * share * loads.shear_noise * pull.cells
    normal_noise = share * loads.normal_noise * pull.cells
    near = where(pull.near, normal, 0.0)
    shear = Pair(where(pull.near, shear.x, 0.0), where(pull.near, shear.y, 0.0))
    strength, normal_strength = shear.power(), square(near).sum()
    built = maximum(pull.built.power() - 2.0 * loads.shear_noise * pull.cells, TINY)
    growth = (shear.x * pull.built.x + shear.y * pull.built.y).sum()
    clean = maximum(strength - noise, TINY)
    weight = square(loads.normal).sum()
    along, own = square((near * loads.normal).sum()), maximum(normal_strength - normal_noise, 0.0)
    chance = sqrt(share * loads.shear_noise * built)
    by_chance = RISES**2 * share * loads.normal_noise
    return Change(
        there=strength / noise + normal_strength / normal_noise > 2.0 * MOVES,
        clear=strength > CLEAR * noise,
        resolved=strength > RESOLVED * noise,
        steady=along < (STEADY * own + by_chance) * weight,
        rises=growth > RISES * chance,
        lately=growth > STILL_RISES * chance,
        stick=growth * abs(growth) / (clean * built),
        delay=loads.frame.constant(float(window)),
        shear=shear,
    )


def _first(found: list[Change], conditions: list[Field]) -> Change:
    """Return the change of the shortest window for which the condition holds, else the longest."""
    best = found[-1]
    for change, condition in zip(reversed(found[:-1]), reversed(conditions[:-1]), strict=True):
        best = Change(
            there=where(condition, change.there, best.there),
            clear=where(condition, change.clear, best.clear),
            resolved=where(condition, change.resolved, best.resolved),
            steady=where(condition, change.steady, best.steady),
            rises=where(condition, change.rises, best.rises),
            lately=where(condition, change.lately, best.lately),
            stick=where(condition, change.stick, best.stick),
            delay=where(condition, change.delay, best.delay),
            shear=Pair(
                where(condition, change.shear.x, best.shear.x),
                where(condition, change.shear.y, best.shear.y),
            ),
        )
    return best
