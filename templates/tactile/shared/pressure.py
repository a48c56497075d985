"""The pressure under a contact and the loads behind it, the cover's blur and the pull taken off.

Effect of a pull on one cell on an array: on the sum of shear and the normal readings.

Cerruti's and Boussinesq's solutions, integrated over the cell.
"""

from dataclasses import dataclass
from functools import cache
from typing import get_args

import numpy as np

from cnnum.errors import name_error
from cnnum.programs.fields import Field, maximum, minimum, sqrt, square, total, where
from cnnum.programs.transients import apply
from cnnum.tactile.bump_loads import left_kernel
from cnnum.tactile.checks import Array, positive
from cnnum.tactile.halfspace import rectangle_strain, rectangle_stress
from cnnum.tactile.indenters import Reads
from cnnum.templates.tactile.cover_model.fields import (
    Carries,
    filter_template,
    noise_gain,
    surface_load,
)
from cnnum.templates.tactile.shared.loads import LIFT, Loads
from cnnum.templating.library import get_template

NEAR = 7
"""Cells to each side in which pulls are laid out cell by cell: all of an array of 8×8."""

BLOCK = 3
"""Cells to a side of the blocks beyond; 2 NEAR + 1 is a multiple of it."""


@dataclass(frozen=True, slots=True, eq=False)
class ShearSeen:
    """Sums of shear over an array, for a unit load on each of its cells.

    On an endless array a pull's own shear adds up to the pull, and a push's to nothing.

    Attributes
    ----------
    own_x, own_y : (rows, cols) float
        Sum of the shear along x or y under a pull along it.
    pushed_x, pushed_y : (rows, cols) float
        The same under a push.
    """

    own_x: Array
    own_y: Array
    pushed_x: Array
    pushed_y: Array


@cache
def shear_seen(shape: tuple[int, int], depth: float) -> ShearSeen:
    """Return the sum over an array.

    Parameters
    ----------
    shape : (rows, cols) int
    depth : float
        Cover above the taxels, in pitches.

    Raises
    ------
    PhysicsError
        If the depth is not positive.
    """
    positive("depth", depth)
    rows, cols = shape
    x, y = np.meshgrid(np.arange(1.0 - cols, cols), np.arange(1.0 - rows, rows))

    def summed(axis: int, load: list[float]) -> Array:
        # E = 1.5 makes shear strain the stress itself; a pull along x shears by less than 0
        strain = rectangle_strain(x, y, depth, load, size=(1.0, 1.0), youngs_modulus=1.5)
        table = -strain[..., axis, 2]
        return np.array(
            [
                [
                    table[rows - 1 - r : 2 * rows - 1 - r, cols - 1 - c : 2 * cols - 1 - c].sum()
                    for c in range(cols)
                ]
                for r in range(rows)
            ]
        )

    push = [0.0, 0.0, 1.0]
    return ShearSeen(
        summed(0, [1.0, 0.0, 0.0]), summed(1, [0.0, 1.0, 0.0]), summed(0, push), summed(1, push)
    )


@cache
def pulled_normal(depth: float, reads: Reads, reach: int) -> Array:
    """Return the normal readings of a pull on a cell, as weights of a correlation.

    Ahead of a pull the skin is squeezed along it and swells. Behind, it is stretched and sinks in.
    Strain falls off with no more than the square of the distance.

    Parameters
    ----------
    depth, reads
        As in `cnnum.tactile.bump_loads.unblur_kernel`.
    reach : int
        Cells to each side, up to `NEAR`.

    Returns
    -------
    (2, 2 reach + 1, 2 reach + 1) float
        For a unit pull along x and along y, in the sign of a push.

    Raises
    ------
    PhysicsError
        If the depth is not positive.
    """
    return _shear_seen_pulled(depth, reads, np.arange(reach, -reach - 1.0, -1.0), 1.0)


@cache
def pulled_far(depth: float, reads: Reads, reach: int) -> Array:
    """Return the same for pulls on blocks of 3×3 cells that lie beyond `NEAR`.

    Parameters and errors are those of `pulled_normal`.

    Returns
    -------
    (2, 2 n + 1, 2 n + 1) float
        n is the next multiple of 3 from `reach`. The numbers are 0 but in every third row and
        column, for the sum of a pull on the block around.
    """
    most = -(-reach // BLOCK) * BLOCK
    away = np.arange(most, -most - 1.0, -BLOCK)
    blocks = _shear_seen_pulled(depth, reads, away, float(BLOCK))
    near = np.abs(away) <= NEAR
    sparse = np.zeros((2, 2 * most + 1, 2 * most + 1))
    sparse[:, ::BLOCK, ::BLOCK] = np.where(near[:, None] & near, 0.0, blocks)
    sparse.setflags(write=False)
    return sparse


def _shear_seen_pulled(depth: float, reads: Reads, away: Array, side: float) -> Array:
    """Return readings at (x, y) from a pull on a square; a correlation asks for them mirrored."""
    positive("depth", depth)
    x, y = np.meshgrid(away, away)
    kernels: list[Array] = []
    for pull in ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0]):
        load, size = np.array(pull) / side**2, (side, side)
        if reads == "stress":
            seen = rectangle_stress(x, y, depth, load, size=size)
        else:
            seen = rectangle_strain(x, y, depth, load, size=size, youngs_modulus=1.5)
        kernels.append(-seen[..., 2, 2])
    pulled = np.stack(kernels)
    pulled.setflags(write=False)
    return pulled


LEVEL = 0.1
"""Threshold of the template `contact_threshold`."""

SEEN = 0.05
"""Share of the largest squared strain from which a taxel counts as pulled, at first."""

CLEAR = 3.0
"""The same in standard deviations of the noise."""

ROUNDS = 2
"""Times that the pull is laid out and taken off. After one, contacts wider than the cover is thick
carry up to 40 % too little; after two, the error is that of no pull at all."""

AROUND = 1
"""Cells around a narrow contact in which part of its load comes back: a hollow next to a peak."""

NARROW, WIDE = 12.0, 24.0
"""Taxels touched up to which that counts in full, and from which not at all: around wide contacts
the rest of a pull is more than the hollow. They are radii of 2 and of 2.8 cells."""

NOTHING = 1e-30
"""Least sum of loads, so that no contact divides by 0."""


@dataclass(frozen=True, slots=True)
class Pressed:
    """The pressure on the skin.

    Attributes
    ----------
    touched : Field
        Logic map.
    weight : Field
        Pressure of the taxels touched, 0 elsewhere, a map.
    normal : Field
        The whole load, a number in the unit of a reading of unit pressure, times cells.
    pulls : tuple of Field
        The same along x and y; empty where the array reads no shear.
    """

    touched: Field
    weight: Field
    normal: Field
    pulls: tuple[Field, ...]


def pressed_of(
    loads: Loads, share: float, depth: float, reads: Carries, normal_gain: float
) -> Pressed:
    """Return the pressure on the skin, from its readings; it raises as the program `contact`."""
    if reads not in get_args(Carries):
        raise name_error("reading", reads, get_args(Carries))
    normal = normal_gain * where(loads.sound, loads.normal, 0.0)
    noise = normal_gain * sqrt(loads.normal_noise)
    if reads == "force":
        return _carried(loads, normal, noise, share)
    return _under_cover(loads, normal, noise, _Cover(share, float(depth), reads))


def touched_map(loads: Loads, pressure: Field, level: Field) -> Field:
    """Return the taxels that are touched, by the threshold template on scaled loads."""
    scaled = minimum(maximum(LEVEL * pressure / level, -1.0), 1.0)
    return apply(
        get_template("contact_threshold"), input=where(loads.contact, scaled, -1.0)
    ).black()


def _level(pressure: Field, noise: Field, share: float) -> Field:
    """Return the least pressure of a taxel that is touched: half of the peak at most."""
    top = pressure.max()
    return maximum(maximum(share * top, minimum(LIFT * noise, 0.5 * top)), NOTHING)


@dataclass(frozen=True, slots=True)
class _Cover:
    """Parameters of a reading under a cover."""

    share: float
    depth: float
    reads: Reads


def _carried(loads: Loads, normal: Field, noise: Field, share: float) -> Pressed:
    touched = touched_map(loads, normal, _level(normal, noise, share))
    weight = where(touched, normal, 0.0)
    pulls = tuple(where(touched, shear, 0.0).sum() for shear in loads.shear)
    return Pressed(touched, weight, weight.sum(), pulls)


def _under_cover(loads: Loads, normal: Field, noise: Field, cover: _Cover) -> Pressed:
    """Return the pressure on a cover: its shape and the pull's are found in turns.

    In an incompressible cover a pull strains the skin as a pressure behind it would. So one map
    looks like the other. But the sum of the shear is the pull, and it acts where the pressure does.
    """
    gained = noise_gain(cover.depth, cover.reads) * noise
    shape, result = _start(loads, normal), loads.frame.constant(0.0)
    for _ in range(ROUNDS - 1):
        pressure = _pressure(loads, normal, shape, result, cover)
        weight = where(pressure > _level(pressure, gained, cover.share), pressure, 0.0)
        # a pull is spread more evenly than the pressure
        shape, result = _shared(sqrt(weight)), weight.sum()
    pressure = _pressure(loads, normal, shape, result, cover)
    touched = touched_map(loads, pressure, _level(pressure, gained, cover.share))
    weight = where(touched, maximum(pressure, 0.0), 0.0)
    shape = _shared(weight)
    result = weight.sum() * _missed(pressure, weight, touched, cover)
    return Pressed(touched, weight, result, _pulls(loads, shape, result, cover.depth))


def _pressure(loads: Loads, normal: Field, shape: Field, whole: Field, cover: _Cover) -> Field:
    """Return the pressure that is left of the readings when a pull of this shape is taken off."""
    pulls = _pulls(loads, shape, whole, cover.depth)
    if pulls:
        normal = normal - _pulled(loads.frame.shape, shape, pulls, cover)
    return surface_load(normal, cover.depth, cover.reads)


def _start(loads: Loads, normal: Field) -> Field:
    """Return where the load acts, by the squares of all three readings.

    A pull shifts the square of the normal strain one way and that of the shear the other.
    """
    power, noise = square(normal), loads.normal_noise
    if loads.shear:
        power = power + where(loads.healthy, total(map(square, loads.shear)), 0.0)
        noise = noise + 2.0 * loads.shear_noise
    least = maximum(SEEN * power.max(), CLEAR**2 * noise)
    return _shared(maximum(power - least, 0.0))


def _shared(weight: Field) -> Field:
    return weight / maximum(weight.sum(), NOTHING)


def _pulled(array: tuple[int, int], shape: Field, pulls: tuple[Field, ...], cover: _Cover) -> Field:
    """Return the normal reading of a pull that is laid out over the contact."""
    depth, reads, reach = cover.depth, cover.reads, max(array) - 1
    kernels = [("pulled", pulled_normal(depth, reads, min(reach, NEAR)), shape)]
    if reach > NEAR:
        block = filter_template("block", np.ones((BLOCK, BLOCK)), "Sums the cells around a cell.")
        spread = apply(block, input=shape)
        kernels.append(("pulled far", pulled_far(depth, reads, reach), spread))
    parts: list[Field] = []
    for name, both, spread in kernels:
        for axis, kernel, pull in zip("xy", both, pulls, strict=True):
            text = f"Gives the normal {reads} of a pull along {axis}."
            template = filter_template(f"{name} {axis} {depth:g}", kernel, text)
            parts.append(apply(template, input=pull * spread))
    return total(parts)


def _pulls(loads: Loads, shape: Field, whole: Field, depth: float) -> tuple[Field, ...]:
    """Return the tangential loads: the whole array's shear, with the part beyond the array.

    Shear strain and stress add up to the load on an endless array. On this one a cell's load adds
    up to a share that depends on its place. The pressure's own shear, which cancels on an endless
    array, is taken off. Shear is taken to be spread as the pressure is.
    """
    seen = shear_seen(loads.frame.shape, depth)
    ways = ((seen.own_x, seen.pushed_x), (seen.own_y, seen.pushed_y))
    result: list[Field] = []
    for shear, (own, pushed) in zip(loads.shear, ways, strict=bool(loads.shear)):
        total = where(loads.healthy, shear, 0.0).sum()
        share, tilt = ((shape * loads.frame.constant(weights)).sum() for weights in (own, pushed))
        result.append((total - whole * tilt) / maximum(share, NOTHING))
    return tuple(result)


def _missed(pressure: Field, weight: Field, touched: Field, cover: _Cover) -> Field:
    """Return the factor of a load over its part on the touched taxels.

    Strain passes no mean, so the pressure comes back on a ground below 0, the lower the wider the
    contact. And a load between taxels, or narrower than one, comes back too high, in a hollow of
    its own. The filter is run on a load of this shape. Its result on the taxels touched and around
    them, against the found one, gives the factor.
    """
    kernel = left_kernel(cover.depth, cover.reads)
    left = filter_template(f"left {cover.reads} {cover.depth:g}", kernel, "The residual of unblur.")
    size = 2 * AROUND + 1
    box = filter_template(f"around {AROUND}", np.ones((size, size)), "Counts the cells around.")
    near = apply(box, input=where(touched, 1.0, 0.0)) > 0.5
    narrow = minimum(maximum((WIDE - touched.count()) / (WIDE - NARROW), 0.0), 1.0)
    share = where(touched, 1.0, where(near, narrow, 0.0))
    result = (share * pressure).sum()
    held = (share * (weight - apply(left, input=weight))).sum()
    return maximum(result, 0.0) / maximum(held, NOTHING)
