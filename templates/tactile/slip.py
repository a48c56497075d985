"""Slip of an object that the array felt touch: incipient, gross, and where to."""

from collections.abc import Mapping

from cnnum.programs import program
from cnnum.programs.fields import Field, maximum, minimum, where
from cnnum.programs.machine import FrameFields
from cnnum.templates.tactile.latch import lasting, latched, twice
from cnnum.templates.tactile.loads import PUSH, Loads, loads_of, patch_of
from cnnum.templates.tactile.pull import Pull, pull_of
from cnnum.templates.tactile.sticking import Sticking, sticking_of

INCIPIENT = 0.065
"""Looseness at which the stick radius is half the contact radius (seven eighths of μP, in a pull
that only grows). Set on simulated pulls: noise of 2.5 mV, covers of 0.7 to 1.3 mm, taxels 1.5 mm
apart, contacts of 2 to 3 mm radius, at 200 Hz. Under thicker covers and bumps, which blur the stick
disc, it comes later."""

GROSS = 0.45
"""`stick` of gross slip: well below the 0.7 to 0.8 that is left just before it, yet far enough from
0 to be quick."""


@program
def slip(
    frame: FrameFields, *, push: float = PUSH, incipient: float = INCIPIENT, gross: float = GROSS
) -> Mapping[str, Field]:
    """Slip between the skin and what touches it, from how the shear map grows.

    The stream must begin without contact: its first frames say what rest is.

    Parameters
    ----------
    frame : FrameFields
        Strain, stress or calibrated signals, in any unit.
    push : float
        −1 for strain and stress, which count tension as positive; +1 for signals and counts that
        rise under a push.
    incipient : float
        Looseness (1 − `stick`, see `sticking`) from which slip is incipient.
    gross : float
        `stick` below which it is gross.

    Returns
    -------
    mapping
        `incipient_slip`, `gross_slip` (flags, never both; until the pull is over), `slip_x`,
        `slip_y` (unit vector, along columns and rows, of the object's motion or the tendency to
        it; 0 without a pull), `slip_strength` (0 sticks, 1 slides), `stick_map` (logic: contact
        that took up its share of the last increment).
    """
    loads = loads_of(frame, push)
    patch = patch_of(loads)
    pull = pull_of(loads, patch)
    return slip_of(loads, pull, sticking_of(loads, pull), incipient=incipient, gross=gross)


def slip_of(
    loads: Loads,
    pull: Pull,
    sticking: Sticking,
    *,
    incipient: float = INCIPIENT,
    gross: float = GROSS,
) -> Mapping[str, Field]:
    """Return the outputs of `slip` from what other programs share with it."""
    frame = loads.frame
    holds = lasting(frame, pull.force, pull.pulled)
    creeps = sticking.grows & (sticking.loose > incipient)
    begun = latched(frame, holds, twice(frame, creeps))
    gone = latched(frame, holds & begun, sticking.goes & (abs(sticking.travel) < gross))
    return {
        "incipient_slip": begun & ~gone,
        "gross_slip": gone,
        "slip_x": where(pull.pulled, pull.force_x / pull.force, 0.0),
        "slip_y": where(pull.pulled, pull.force_y / pull.force, 0.0),
        "slip_strength": _strength(loads, sticking, holds, gone),
        "stick_map": _sticks(loads, pull, sticking, holds, gone),
    }


def _strength(loads: Loads, sticking: Sticking, holds: Field, gone: Field) -> Field:
    """Return 1 − stick, held where a frame does not tell it."""
    memory = loads.frame.memory(scalar=True)
    loose = minimum(maximum(sticking.loose, 0.0), 1.0)
    value = where(holds, where(sticking.grows, loose, memory.value), 0.0)
    value = where(gone, 1.0, value)
    memory.store(value)
    return value


def _sticks(loads: Loads, pull: Pull, sticking: Sticking, holds: Field, gone: Field) -> Field:
    """Return where shear grows at least half as fast as it does on the whole."""
    frame, shear, built = loads.frame, sticking.shear, pull.built
    along = shear.x * built.x + shear.y * built.y
    own = built.x * built.x + built.y * built.y
    memory = frame.memory(logic=True)
    share = along * own.sum() > 0.5 * own * along.sum()
    loaded = loads.contact & (loads.normal > 0.1 * loads.normal.max())
    now = where(sticking.grows, share, where(holds, memory.value, loaded)) & ~gone
    memory.store(now)
    return now & loaded
