"""The grasp code of Kis, Kovács and Szolgay (2006): one bit per shear component, interpreted.

Two fingers hold an object, each with 2×2 three-axial taxels. The sign of both shear components of
every taxel makes 2 · 4 · 2 = 16 bits, 65,536 codes. The fingers lie side by side on the frame, each
in its own axes: x to the right, y down, z into that finger. Facing fingers mirror each other's x.
"""

from collections.abc import Mapping
from itertools import product

from cnnum.programs import program
from cnnum.programs.fields import Field, length, maximum, mean, sqrt, total, where
from cnnum.programs.machine import Block, FrameFields, blocks
from cnnum.templates.tactile.shared.loads import LIFT, PUSH, Loads, loads_of

AGREE = 0.75
"""Least agreement of the signs with a motion's pattern, from −1 to 1. A straight pull is judged by
the 8 bits of its stronger axis, of which one may be wrong; a twist or a squeeze by all 16, of which
two may. By chance 27 % of all codes agree so far with one of the four."""

PLACES = tuple(product((0, 1), repeat=3))
"""Finger, row and column of every taxel, in the order of its bits."""

MOTIONS = ("slip", "twist", "tilt", "squeeze")


@program
def grasp_code(
    frame: FrameFields, *, push: float = PUSH, agree: float = AGREE
) -> Mapping[str, Field]:
    """Classify the state of a grasp by the signs of the shear under two fingers.

    The axes of the grasp are those of the first finger. Along them, the shear has a part that both
    fingers share (the object moves), and a part that is opposite on the two (the fingers are
    pressed against each other).

    * slip: both fingers are pulled the same way, and all taxels of a finger agree;
    * tilt: the fingers are pulled in opposite directions, so the object turns about an axis
      across the fingers;
    * twist: the shear circles the centre of each pad in the same sense, so the object turns about
      the normal;
    * squeeze: the shear points away from the centre of each pad, or towards it, because the rubber
      bulges.

    Parameters
    ----------
    frame : FrameFields
        An array of rows × 2·columns with the second finger in the right half; each finger has an
        even number of rows and columns. More than 2×2 taxels per finger are summed by quarters.
    push : float
        −1 for strain and stress, +1 for signals that rise under a push.
    agree : float
        Smallest agreement of the signs with the pattern of a motion, −1 to 1.

    Returns
    -------
    mapping
        `grasp_code` (0 to 65535: bit 8·finger + 2·taxel + axis, taxels row by row, set for a
        positive component), `code_known` (flag: contact on both fingers, and every bit exceeds the
        noise), `grasp_slip`, `grasp_twist`, `grasp_tilt`, `grasp_squeeze` (flags, at most one),
        `grasp_x`, `grasp_y` (unit vector of a slip, or of the pull on the first finger in
        a tilt; 0 otherwise), `grasp_sense` (for a twist, +1 from x to y; for a squeeze, +1 if
        it grows outwards; 0 otherwise).

    Raises
    ------
    ProgramError
        If the frame cannot be divided into two fingers of 2×2 quarters.
    """
    loads, quarters = frame.once(loads_of, push=push), blocks(frame, 2, 4)
    taxels = [quarters[4 * row + 2 * finger + column] for finger, row, column in PLACES]
    sums = [[taxel.total(shear) for shear in (loads.shear_x, loads.shear_y)] for taxel in taxels]
    bits = [[component > 0.0 for component in pair] for pair in sums]
    signs = [[where(bit, 1.0, -1.0) for bit in pair] for pair in bits]
    known = _known(loads, sums, taxels)
    return {"grasp_code": _code(bits), "code_known": known, **_decoded(signs, known, agree)}


def _decoded(signs: list[list[Field]], known: Field, agree: float) -> Mapping[str, Field]:
    """Return the motion whose pattern the signs follow best, and where it goes."""
    # the second finger faces the first: its x is the other's −x
    first, two = signs[:4], [[-x, y] for x, y in signs[4:]]
    x1, y1 = (mean([pair[k] for pair in first]) for k in (0, 1))
    x2, y2 = (mean([pair[k] for pair in two]) for k in (0, 1))
    together, apart = (x1 + x2, y1 + y2), (x1 - x2, y1 - y2)
    turns = [_turn(first), _turn(two, mirrored=True)]
    growth_codes = [_grow(first), _grow(two, mirrored=True)]
    turn, grow = (turns[0] + turns[1]) / 2.0, (growth_codes[0] + growth_codes[1]) / 2.0
    scores = [_straight(together), abs(turn), _straight(apart), abs(grow)]
    flags = _best(scores, known, agree)
    slip, twist, tilt, squeeze = flags
    along = tuple(where(slip, a, where(tilt, b, 0.0)) for a, b in zip(together, apart, strict=True))
    size = length(along)
    sense = where(twist, turn, where(squeeze, grow, 0.0))
    return {
        **{f"grasp_{name}": flag for name, flag in zip(MOTIONS, flags, strict=True)},
        "grasp_x": where(size > 0.0, along[0] / size, 0.0),
        "grasp_y": where(size > 0.0, along[1] / size, 0.0),
        "grasp_sense": where(sense > 0.0, 1.0, where(sense < 0.0, -1.0, 0.0)),
    }


def _best(scores: list[Field], known: Field, agree: float) -> list[Field]:
    """Return flags of which at most one holds; of equal scores the first."""
    result: list[Field] = []
    for number, score in enumerate(scores):
        flag = known & (score >= agree)
        for other, value in enumerate(scores):
            if other != number:
                flag = flag & ((score > value) if other < number else (score >= value))
        result.append(flag)
    return result


def _straight(pull: tuple[Field, Field]) -> Field:
    """Return how far signs agree with a straight pull: the stronger axis decides.

    A pull along x leaves the signs of y to chance, one along the diagonal sets all.
    """
    return maximum(abs(pull[0]), abs(pull[1])) / 2.0


def _turn(signs: list[list[Field]], *, mirrored: bool = False) -> Field:
    """Return how far the signs turn from x to y about the middle of a pad, −1 to 1."""
    parts = [
        where_y * pair[1] - row * pair[0]
        for (row, where_y), pair in zip(_corners(mirrored), signs, strict=True)
    ]
    return mean(parts) / 2.0


def _grow(signs: list[list[Field]], *, mirrored: bool = False) -> Field:
    """Return how far the signs point away from the middle of a pad, −1 to 1."""
    parts = [
        col * pair[0] + row * pair[1]
        for (row, col), pair in zip(_corners(mirrored), signs, strict=True)
    ]
    return mean(parts) / 2.0


def _corners(mirrored: bool) -> list[tuple[float, float]]:
    side = -1.0 if mirrored else 1.0
    return [(row, side * col) for row in (-1.0, 1.0) for col in (-1.0, 1.0)]


def _known(loads: Loads, sums: list[list[Field]], taxels: list[Block]) -> Field:
    least = LIFT * sqrt(loads.shear_noise * float(taxels[0].cells))
    known = loads.contact
    for pair in sums:
        known = known & (length(pair) > least)
    for finger in (taxels[:4], taxels[4:]):
        high = (loads.normal * sum(taxel.share for taxel in finger)).max()
        known = known & (high > LIFT * sqrt(loads.normal_noise))
    return known


def _code(bits: list[list[Field]]) -> Field:
    flat = [bit for pair in bits for bit in pair]
    return total([where(bit, float(1 << number), 0.0) for number, bit in enumerate(flat)])
