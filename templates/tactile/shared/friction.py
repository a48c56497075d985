"""How much friction a force would need if what it pulls at slipped.

Taxels under a cover read another share of a pull than of a push: under thin flat covers seven times
as much, under thick ones and bumps twice as much. Where the cover is known, so is that gain, for
what slides pulls where it presses, friction times as much.
"""

from cnnum.programs.fields import Field, maximum
from cnnum.templates.tactile.contact_mechanics.contact_wrench import Place, Side
from cnnum.templates.tactile.contact_mechanics.cover_response import Skin, as_read

TINY = 1e-30


def friction_needed(contact: Place, force: Side, skin: Skin) -> Field:
    """Return the force over the normal load, as taxels would read them of a friction of 1."""
    seen = as_read(contact.loads.frame.shape, skin)
    gain = seen.at(contact.spread, seen.gain)
    return force.growth.size / (gain * maximum(force.normal, TINY))
