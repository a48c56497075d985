"""Loads on single bumps, from the readings under them."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import get_args

import numpy as np

from cnnum.errors import name_error
from cnnum.programs import program
from cnnum.programs.fields import Field, maximum, sqrt, where
from cnnum.programs.loops import loop
from cnnum.programs.machine import FrameFields
from cnnum.programs.parameters import refuse_outside
from cnnum.programs.transients import apply, shift, transient
from cnnum.tactile.bump_loads import Taxels, bump_inverse
from cnnum.templates.tactile.shared.loads import LIFT, PUSH, loads_of
from cnnum.templating.library import get_template
from cnnum.templating.template import Template

NEIGHBOURS = tuple((r, c) for r in (-1, 0, 1) for c in (-1, 0, 1) if r or c)


@dataclass(frozen=True, slots=True)
class Patches:
    """Eight-connected patches.

    Attributes
    ----------
    count : Field
        Number of patches.
    label : Field
        Map: the number of the patch, which is one more than the index of its last cell in reading
        order; 0 outside.
    row, column : Field
        Maps: in each cell, the weighted centroid of its patch, cells; 0 outside.
    """

    count: Field
    label: Field
    row: Field
    column: Field


def patches_of(frame: FrameFields, inside: Field, weight: Field) -> Patches:
    """Return the patches of a logic map, with centroids by a weight that is positive inside."""
    rows, cols = frame.shape
    number = frame.row * cols + frame.column + 1.0
    label = _labels(inside, number, rows * cols)
    centre_row, centre_column = _centroids(frame, label, weight)
    return Patches(
        count=(inside & label.equals(number)).count(),
        label=label,
        row=centre_row,
        column=centre_column,
    )


def _labels(inside: Field, number: Field, cells: int) -> Field:
    """Let the largest number of each patch spread over it, a cell a turn.

    Numbers are whole; the results of transients are near enough to separate them.
    """

    def spread(label: Field) -> Field:
        most = label
        for row, col in NEIGHBOURS:
            other = shift(label, row, col)
            most = where(other > most + 0.5, other, most)
        return where(inside, most, 0.0)

    return loop(spread, where(inside, number, 0.0), limit=cells).value


def _centroids(frame: FrameFields, label: Field, weight: Field) -> tuple[Field, Field]:
    """Return each patch's centroid in its cells, patch by patch."""
    rows, cols = frame.shape

    def next_one(left: Field, row: Field, column: Field) -> tuple[Field, Field, Field]:
        mine = (left > left.max() - 0.5) & (left > 0.0)
        own = where(mine, weight, 0.0)
        own_row, own_column = frame.centroid(own)
        return where(mine, 0.0, left), where(mine, own_row, row), where(mine, own_column, column)

    def none_left(left: Field, *_: Field) -> Field:
        return ~(left > 0.0).any()

    limit = ((rows + 1) // 2) * ((cols + 1) // 2) + 1
    nothing = 0.0 * label
    done = loop(next_one, label, nothing, nothing, limit=limit, until=none_left)
    return done.values[1], done.values[2]


PITCH, DEPTH, SPACING = 7.5, 1.0, 1.5
"""Bump radii: Ø 0.4 mm bumps 1.5 mm apart, on 0.2 mm of rubber (dissertation 6.4.4). The pressure
pad has Ø 2 mm bumps 3 mm apart on 0.5 mm, and taxels 1.5 mm apart: 3, 0.5 and 1.5."""

SHARE = 0.1
"""Smallest load of a touched bump, as a share of the largest."""


@program
def localize(
    frame: FrameFields,
    *,
    push: float = PUSH,
    taxels: Taxels = "strain",
    bump_pitch: float = PITCH,
    bump_depth: float = DEPTH,
    bump_spacing: float = SPACING,
    share: float = SHARE,
    unit: float = 1.0,
) -> Mapping[str, Field]:
    """Measure the loads of single bumps, and group touched bumps into contacts.

    Parameters
    ----------
    frame : FrameFields
        One cell per bump: strain or stress of the taxel under it. For a pad of pressure taxels
        (with push = 1), this is the output of `Pad`. If only `normal` is read, all loads are
        assumed to be pushes, and the outputs of shear are missing.
    push : float
        −1 for strain and stress, which count tension as positive; +1 for signals and counts that
        rise under a push.
    taxels : "strain", "stress" or "pad"
        The measured quantity.
    bump_pitch, bump_depth, bump_spacing : float
        Distance between bumps, depth of the taxels below the base of the bumps, and distance
        between the taxels of a pad, all in bump radii.
    share : float
        Smallest load of a touched bump, as a share of the largest.
    unit : float
        Unit of the loads: E r² for strain, r² for stress and pads gives newtons.

    Returns
    -------
    mapping
        `bump_contact` (logic map), `bump_count`, `bump_load_x`, `bump_load_y`, `bump_load_normal`
        (maps of each bump's own load, 0 where it is not touched), `bump_shear_known` (logic map:
        touched, and neither its taxel nor one beside it is at an end of its range; elsewhere the
        shear, whose sign could be wrong, is 0), `bump_x`, `bump_y`, `bump_normal` (sums over all
        bumps whose load exceeds the noise; the shear is 0 unless it is known under all of them),
        `bump_row`, `bump_column` (centroid of their normal load, cells; its last value after the
        contact), `bump_patches` (number of contacts, where neighbouring touched bumps, including
        diagonal ones, form one contact), `bump_patch` (map: number of the contact, 0 for none),
        `bump_patch_row`, `bump_patch_column` (maps: for each bump, the centroid of the normal load
        of its contact, cells).

    Raises
    ------
    PhysicsError
        If the bumps are too close to be separated.
    ProgramError
        If the unit is not positive.
    """
    refuse_outside(
        bump_pitch=(bump_pitch, 1e-6, 1e6),
        bump_depth=(bump_depth, 1e-6, 1e6),
        bump_spacing=(bump_spacing, 1e-6, 1e6),
        unit=(unit, 1e-30, 1e30),
    )
    loads = frame.once(loads_of, push=push)
    alone = unmix(taxels, bump_pitch, bump_depth, bump_spacing, shear=bool(loads.shear))
    own = transient(alone, input=[*loads.shear, loads.normal]).outputs
    *sheared, normal = (unit * part for part in own)
    gain = unit * np.sqrt((alone.B[-1, -1] ** 2).sum())
    noise = float(gain) * sqrt(loads.normal_noise)
    touched = loads.contact & (normal > maximum(share * normal.max(), LIFT * noise))
    patches = patches_of(frame, touched, normal)
    # sums have smaller loads, too, down to the noise: together they are up to a tenth of the whole
    carries = loads.contact & (normal > LIFT * noise)
    carried = where(carries, normal, 0.0)
    sure = carries if frame.at_end is None else carries & ~near_the_end(frame.at_end)
    whole = sure.count() > carries.count() - 0.5
    known = touched & sure
    own_shear = [where(known, part, 0.0) for part in sheared]
    own_normal = where(touched, normal, 0.0)
    sums = [where(whole & carries, part, 0.0).sum() for part in sheared]
    row, column = frame.centroid(carried)
    any_touched = touched.any()
    return {
        "bump_contact": touched,
        "bump_count": touched.count(),
        **dict(zip(("bump_load_x", "bump_load_y"), own_shear, strict=bool(own_shear))),
        "bump_load_normal": own_normal,
        **({"bump_shear_known": known} if own_shear else {}),
        **dict(zip(("bump_x", "bump_y"), sums, strict=bool(own_shear))),
        "bump_normal": carried.sum(),
        "bump_row": frame.memory("last bump row", scalar=True).hold(row, any_touched),
        "bump_column": frame.memory("last bump column", scalar=True).hold(column, any_touched),
        "bump_patches": patches.count,
        "bump_patch": patches.label,
        "bump_patch_row": patches.row,
        "bump_patch_column": patches.column,
    }


def near_the_end(at_end: Field) -> Field:
    """Return the bumps whose own taxel, or one beside it, is at an end of its range.

    The part of a load that such a taxel cannot show is also missing when the loads of neighbours
    are subtracted: 4 % of a shear beside it, below 1 % farther away.
    """
    return apply(get_template("contact_dilation"), input=at_end.picture()).black()


def unmix(
    taxels: Taxels = "strain",
    pitch: float = PITCH,
    depth: float = DEPTH,
    spacing: float = SPACING,
    *,
    shear: bool = True,
) -> Template:
    """Return the template that subtracts neighbouring loads, one layer per axis.

    See `bump_inverse`.

    Raises
    ------
    UnknownNameError
        If `taxels` is unknown.
    PhysicsError
        If the bumps are too close.
    """
    if taxels not in get_args(Taxels):
        raise name_error("kind of taxels", taxels, get_args(Taxels))
    axes = 3 if shear else 1
    return Template(
        "unmix",
        np.zeros((axes, axes, 1, 1)),
        bump_inverse(taxels, float(pitch), float(depth), float(spacing), shear=shear),
        boundary=0.0,
        duration="settle",
        output="linear",
        description="Gives the load on every bump, its neighbours' crosstalk taken off.",
    )
