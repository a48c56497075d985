"""What presses, by all that an array reads: smooth or edged, two spheres or a flat punch."""

from collections.abc import Sequence
from dataclasses import replace
from functools import reduce
from operator import add

from cnnum.programs.fields import Field, maximum, where
from cnnum.programs.loops import branch
from cnnum.templates.tactile.contact_mechanics.elliptic_contact_fit import Whole
from cnnum.templates.tactile.contact_mechanics.rim_circle_fit import Circle
from cnnum.templates.tactile.contact_mechanics.several_spheres_fit import several_on
from cnnum.templates.tactile.contact_mechanics.sphere_fit import MET, Round, punch_on, sphere_on
from cnnum.templates.tactile.shared.least_squares import TINY, Felt
from cnnum.templates.tactile.shared.loads import square

SMOOTH = 0.03
"""Share of the signal that a smooth contact leaves, beside the noise: from half a pitch of cover on
a sphere leaves 0.01, one that is pulled 0.03, an ellipse 1.25 times as long as wide 0.02 in stress
and 0.04 in strain, and a rectangle 0.05 and more."""

FLAT = 0.2
"""Flatness up to which a load may be a smooth contact's: a uniform disc's is 0.6 to 0.9, one of 1.3
cells' under thin covers 0.27."""

KNOWN = 0.12
"""Standard deviation of the flatness below which a frame may be called smooth."""

MIDWAY = 0.3
"""Flatness up to which two contacts are smooth together: half of the 0.6 that two uniform discs
have at least."""

ALL_KNOWN = 0.5 * MIDWAY
"""Standard deviation of their common flatness up to which they may be: midway is two of it from
either."""

NARROWEST = 1.4
"""Cells: contact radius from which it may; the flatness of smaller squares is anything."""

SURE, UNKNOWN, FITS = 5.0, 0.2, 0.06
"""Standard deviations that a narrow contact's flatness must lie above 0 for an edge; what they may
be at most, and the share of the signal that its sphere may leave: 0.03 of a round contact in most
cases, 0.1 in all. Steps that end beside it leave more, and tell nothing."""

LEAST = 1.2
"""Cells: radius of a load whose rim the array does not tell. That of a sphere of 1.2 cells comes
out as 1.1 to 1.2, of a uniform disc of one cell as 1 to 1.2."""

APART = 0.95
"""Distance of two spheres in sums of their radii from which they are two: the halves of an edged
body overlap."""

MOST = 3
"""Smooth contacts that are told beside each other."""

SEVERAL, HOLLOWED = 0.2, 1.0
"""Share of the signal that one ellipse leaves from which two spheres are looked for, and that or
the flatness from which a flat punch is: two spheres leave 0.2 to 0.9."""

ROUND = 0.5
"""Cells that places lie off a circle at most where a flat punch is looked for."""

EDGED, ONE = 0.25, 0.35
"""Flatness, above two of its standard deviations, and share of the signal left, from which and up
to which one edged body presses."""

ROUGH = (0.05, 0.18)
"""Share of the signal left from which and up to which that is so whatever the flatness: a rectangle
leaves 0.05 to 0.25, a sphere that is pulled up to 0.03, two spheres from 0.18 on."""

THICK = 0.75
"""Pitches of cover from which that holds in strain, too: under thinner ones the fit of a pull may
end beside it, and leaves as much as a rectangle."""


def is_smooth(whole: Whole) -> Field:
    """Return whether a contact is smooth, and leaves nothing that others would explain."""
    hertz = abs(whole.flatness) < FLAT + whole.unsure
    known = (whole.unsure < KNOWN) & (whole.radius > NARROWEST)
    return (whole.left < SMOOTH) & hertz & known


def is_round(felt: Felt, load: Field, whole: Whole, asked: Field) -> Field:
    """Return whether the whole frame is a smooth contact, or one too narrow to tell from one.

    An edge needs evidence: where noise or the distance between taxels hides how flat a load is, it
    shows none. A sphere is fitted, for fewer numbers are known better; a contact that is pulled or
    longer than wide is explained by what was fitted before.

    Parameters
    ----------
    felt : Felt
    load : Field
        On the surface, for the first guess.
    whole : Whole
        What the frame is as one contact.
    asked : Field
        Flag: it is asked at all.
    """

    def judged(*values: Field) -> tuple[Field, ...]:
        _, normal, start = values
        sphere = sphere_on(replace(felt, normal=normal), start)
        found = sphere.found
        may = (found.left < SMOOTH) | (sphere.begun < LEAST) | unknown
        smooth = may & ~(_is_flat(found) & (found.left < FITS))
        return where(smooth, 1.0, 0.0), normal, start

    unknown = (whole.left < SMOOTH) & ~_is_flat(whole)
    return branch(asked, judged, felt.frame.constant(0.0), felt.normal, load)[0] > 0.5


def _is_flat(whole: Whole) -> Field:
    """Return whether a load is known to be too flat for a smooth contact's."""
    known = (whole.flatness > SURE * whole.unsure) & (whole.unsure < UNKNOWN)
    return known & (whole.flatness > MIDWAY)


def is_edged(felt: Felt, whole: Whole) -> Field:
    """Return whether the whole frame is one body with an edge."""
    flat = (whole.flatness - 2.0 * whole.unsure > EDGED) & (whole.left < ONE)
    if felt.reads == "strain" and felt.depth < THICK:
        return flat
    low, high = ROUGH
    return flat | ((whole.left > low) & (whole.left < high))


def are_spheres(felt: Felt, load: Field, whole: Whole, asked: Field) -> Field:
    """Return whether the whole frame is two or three smooth contacts.

    Parameters
    ----------
    felt : Felt
    load : Field
        On the surface, for the first guess.
    whole : Whole
        What the frame is as one contact.
    asked : Field
        Flag: it is asked at all.
    """
    found: tuple[Field, ...] = (felt.frame.constant(0.0), felt.frame.constant(1.0))
    for number in range(2, _most(felt) + 1):

        def judged(*values: Field, number: int = number) -> tuple[Field, ...]:
            normal, start = values[2:]
            several = several_on(replace(felt, normal=normal), start, number)
            smooth = _are_smooth(several.each) & (several.apart > APART)
            return where(smooth, 1.0, 0.0), several.left, normal, start

        # what so many explain is no more of them
        more = asked & (whole.left > SEVERAL) & ~(found[1] < SMOOTH)
        found = branch(more, judged, *found, felt.normal, load)[:2]
    return found[0] > 0.5


def _most(felt: Felt) -> int:
    """Return how many smooth contacts an array may tell."""
    return MOST if min(felt.frame.shape) > MOST * NARROWEST else MOST - 1


def _are_smooth(each: Sequence[Whole]) -> Field:
    """Return whether contacts are smooth.

    Under thick covers noise hides how flat a small one is, but not how flat all are: each counts
    by what is known of it, and none may be flatter alone by more than its standard deviation.
    """
    may = [
        (one.left < SMOOTH) & (one.radius > NARROWEST) & (one.flatness - one.unsure < MIDWAY)
        for one in each
    ]
    weights = [1.0 / maximum(square(one.unsure), TINY) for one in each]
    flat = [weight * one.flatness for weight, one in zip(weights, each, strict=True)]
    sure = reduce(add, weights)
    known = sure > ALL_KNOWN**-2
    smooth = reduce(lambda one, other: one & other, may)
    return smooth & known & (reduce(add, flat) < MIDWAY * sure)


def punch_of(felt: Felt, whole: Whole, circle: Circle, asked: Field) -> tuple[Field, Round]:
    """Return whether the whole frame is one flat punch, and its rim.

    Parameters
    ----------
    felt : Felt
    whole : Whole
        What the frame is as one smooth contact.
    circle : Circle
        Through the outline that was found, for the first guess.
    asked : Field
        Flag: it is asked at all.
    """

    def judged(*values: Field) -> tuple[Field, ...]:
        punch = punch_on(replace(felt, normal=values[4]), Round(*values[1:4]))
        return punch.left, punch.at.radius, punch.at.column, punch.at.row, values[4]

    rough = (whole.left > SEVERAL) | (whole.flatness - 2.0 * whole.unsure > HOLLOWED)
    at = circle.at
    start = (felt.frame.constant(1.0), at.radius, at.column, at.row, felt.normal)
    left, *found = branch(asked & rough & (circle.off < ROUND), judged, *start)[:4]
    return left < MET, Round(*found)
