"""By how much a pull that is read lags behind Mindlin's force.

A shear load that is added nearer to the contact's middle, as the disc that sticks shrinks, is felt
more by the taxels near the contact. How much more depends on the cover, on the contact's size and
place among the taxels, on the pull's direction, and on the taxels that are missing.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import product
from typing import TypeVar

import numpy as np

from cnnum.arrays import Floats, Shape
from cnnum.programs.fields import Field, exp, maximum, minimum, where
from cnnum.templates.tactile.contact_mechanics.contact_wrench import Place
from cnnum.templates.tactile.contact_mechanics.cover_response import (
    Felt,
    Seen,
    Skin,
    felt_by,
    hertz,
    seen_as,
)
from cnnum.templates.tactile.contact_mechanics.growth_laws import NEARER
from cnnum.templates.tactile.contact_mechanics.load_growth import Learned
from cnnum.templates.tactile.shared.loads import square

RADII = (1.0, 1.15, 1.3, 1.45, 1.6, 1.75, 1.9)
"""Pitches: contact radii that are looked at."""

PLACES = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5)
"""Pitches from the array's middle, along both axes, at which contacts are looked at."""

CELLS = 8
"""Cells to a pitch: of 4 small discs are too few, and lags are up to 0.014 off; of 8, 0.003."""

SHARES = np.linspace(0.02, 1.0, 50)
"""Of a pull's time that are left: the disc that sticks is √ of that share of the contact."""

WIDTHS = (0.35, 0.5, 0.7, 1.0, 1.4, 2.0)
"""Pitches: of the bells that make up what a taxel adds, by where it is."""

SIZES = 4
"""Powers of the contact's size that each part of a lag has."""

LESS = 0.005
"""By so much less pulls lag than the elastic half-space says: 0.003 with a standard error of 0.0015
(63 pulls of 200 frames and more, tuning seeds 31000 to 33499); with 0.005 slip is told on time in
the mean."""

LEAST = 0.3
"""Share of what is felt of a pull that whole taxels feel at least, where others are broken."""

TINY = 1e-30

Number = TypeVar("Number", Floats, Field)


@dataclass(frozen=True, slots=True, eq=False)
class Lags:
    """Lags of pulls along x, polynomials in size and place of a contact.

    Attributes
    ----------
    middle, half : float
        Of the spreads that were looked at, pitches.
    along, turned : array, (places, SIZES) float
        Of what is read along the pull, and aside.
    bulge, whole : array, (bells, SIZES) float
        What a taxel adds to the lag, and to the pull as read.
    """

    middle: float
    half: float
    along: Floats
    turned: Floats
    bulge: Floats
    whole: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Looked:
    """A pull along x on a contact, as the taxels that are looked at read it.

    Attributes
    ----------
    seen : Seen
    lag, turned : float
        Of their sum along the pull, and of that aside as a share of the sum along it.
    away, ahead : (taxels,) float
        Squared distances of the taxels that count, and those along x.
    whole, bulge : (taxels,) float
        What each has of Mindlin's law and of s^(3/2) (1 − s), as shares of their sum.
    """

    seen: Seen
    lag: float
    turned: float
    away: Floats
    ahead: Floats
    whole: Floats
    bulge: Floats


class AtRest:
    """Where a contact was, and how large, when the force was last at rest.

    A pull itself moves the normal readings aside, by up to a third of a pitch.

    Parameters
    ----------
    contact : Place
    """

    def __init__(self, contact: Place) -> None:
        frame = contact.loads.frame
        self._now = (contact.row, contact.column, contact.spread)
        self._held = tuple(frame.memory(scalar=True) for _ in self._now)
        self.row, self.column, self.spread = (memory.value for memory in self._held)

    def learn(self, learned: Learned) -> None:
        """Store what the next frame needs."""
        for memory, now in zip(self._held, self._now, strict=True):
            followed = memory.value + learned.rate * (now - memory.value)
            memory.store(where(learned.anew, now, followed))


def lag_of(contact: Place, rest: AtRest, skin: Skin, load: Sequence[Field]) -> Field:
    """Return by how much of s^(3/2) (1 − s), s = 1 − t/T, a pull lags behind Mindlin's force.

    Parameters
    ----------
    contact : Place
    rest : AtRest
    skin : Skin
    load : sequence of Field
        The pull, x and y.
    """
    frame = contact.loads.frame
    if skin.reads == "force":
        return frame.constant(NEARER)
    rows, columns = frame.shape
    plain, swapped = lags_of((rows, columns), skin), lags_of((columns, rows), skin)
    power = maximum(square(load[0]) + square(load[1]), TINY)
    xx, yy, xy = (a * b / power for a, b in ((load[0],) * 2, (load[1],) * 2, load))
    right = rest.column - (frame.column + 0.5 < rest.column).sum() / float(rows)
    down = rest.row - (frame.row + 0.5 < rest.row).sum() / float(columns)
    size = minimum(maximum((rest.spread - plain.middle) / plain.half, -1.0), 1.0)
    lag = (
        xx * _sum(plain.along, _even(right, down), size)
        + yy * _sum(swapped.along, _even(down, right), size)
        + 2.0 * xy * _sum(plain.turned, _odd(right, down), size)
    )
    x, y = frame.column - rest.column, frame.row - rest.row
    away = square(x) + square(y)
    ahead = square(x * load[0] + y * load[1]) / power
    missing = [(contact.missing * bell).sum() for bell in _bells(away, ahead, exp)]
    lost, bulge = (_sum(parts, missing, size) for parts in (plain.whole, plain.bulge))
    return (lag - LESS + bulge) / maximum(1.0 - lost, LEAST)


@cache
def lags_of(shape: Shape, skin: Skin) -> Lags:
    """Return the lags of pulls along x near the middle of an array: least squares over places.

    Parameters
    ----------
    shape : (rows, cols) int
    skin : Skin

    Raises
    ------
    PhysicsError
        If depth or bumps are out of range.
    """
    felt = felt_by(shape, skin, CELLS)
    row, column = felt.y.mean(), felt.x.mean()
    looked = [
        looked_at(felt, radius, row + down, column + right)
        for radius, down, right in product(RADII, PLACES, PLACES)
    ]
    spreads = np.array([each.seen.spread for each in looked])
    middle = float(spreads.max() + spreads.min()) / 2.0
    half = max(float(spreads.max()) - middle, TINY)
    sizes = (spreads - middle) / half
    places = np.array([(each.seen.column, each.seen.row) for each in looked]).T
    right, down = places - np.rint(places)
    away, ahead, whole, bulge = (
        np.concatenate([getattr(each, name) for each in looked])
        for name in ("away", "ahead", "whole", "bulge")
    )
    bells = _bells(away, ahead, np.exp)
    of_taxels = np.repeat(sizes, [each.away.size for each in looked])
    return Lags(
        middle,
        half,
        _fitted(_even(right, down), sizes, np.array([each.lag for each in looked])),
        _fitted(_odd(right, down), sizes, np.array([each.turned for each in looked])),
        _fitted(bells, of_taxels, bulge),
        _fitted(bells, of_taxels, whole),
    )


def looked_at(felt: Felt, radius: float, row: float, column: float) -> Looked:
    """Return a pull along x on a sphere's contact of a radius at a place, pitches."""
    away = felt.away(row, column)
    under = away < radius * radius
    away = away[under]
    seen = seen_as((felt.push[:, under] @ hertz(radius, away)).reshape(felt.shape))
    counts = np.ix_(seen.felt.ravel(), under)
    pull, aside = felt.pull[counts], felt.aside[counts].sum(axis=0)
    whole, bulge = _parts(np.vstack([pull, pull.sum(axis=0), aside]), radius, away)
    total = float(whole[-2])
    rows, cols = np.indices(felt.shape)[:, seen.felt]
    ahead = (cols - seen.column) ** 2
    return Looked(
        seen,
        lag=-float(bulge[-2]) / total,
        turned=-float(bulge[-1]) / total,
        away=(rows - seen.row) ** 2 + ahead,
        ahead=ahead,
        whole=whole[:-2] / total,
        bulge=bulge[:-2] / total,
    )


def _parts(felt: Floats, radius: float, away: Floats) -> tuple[Floats, Floats]:
    """Return how much readings have of Mindlin's law and of s^(3/2) (1 − s).

    A pull's traction is that of sliding over the contact less that over the disc that sticks
    (Cattaneo, Mindlin). Both are of Hertz's form; so what is still missing of the last force is
    what the taxels feel of the disc, which of the force itself is s^(3/2).

    Parameters
    ----------
    felt : (readings, cells) float
        What is read of a load in each cell.
    """
    law = SHARES**1.5
    discs = np.array([hertz(radius * float(np.sqrt(share)), away) for share in SHARES])
    # in cells a small disc has not quite its load
    discs *= (law / np.maximum(discs.sum(axis=1), TINY))[:, np.newaxis]
    fitted = np.stack([1.0 - law, law * (1.0 - SHARES), np.ones_like(law)], axis=1)
    whole, bulge, _ = np.linalg.pinv(fitted) @ -(discs @ felt.T)
    return whole, bulge


def _even(ahead: Number, aside: Number) -> list[Number]:
    """Return powers of a place among the taxels, pitches from the nearest, along and across."""
    x, y = 4.0 * ahead * ahead, 4.0 * aside * aside
    return [1.0 + 0.0 * x, x, y, x * y, x * x, y * y]


def _odd(ahead: Number, aside: Number) -> list[Number]:
    """Return the same of what changes sign with either, and is 0 at a taxel and between two."""
    x, y = 4.0 * ahead * ahead, 4.0 * aside * aside
    both = 4.0 * ahead * (1.0 - x) * aside * (1.0 - y)
    return [both, both * x, both * y]


def _bells(away: Number, ahead: Number, rises: Callable[[Number], Number]) -> list[Number]:
    """Return bells of a squared distance, and the wider ones by that along the pull."""
    bells = [rises(away * (-0.5 / width**2)) for width in WIDTHS]
    return bells + [ahead * bell for bell in bells[2:]]


def _sum(factors: Floats, parts: Sequence[Field], size: Field) -> Field:
    """Return the sum of parts, each times its polynomial in the size."""
    total = 0.0 * size
    for part, row in zip(parts, factors, strict=True):
        factor = 0.0 * size
        for power in row[::-1]:
            factor = factor * size + float(power)
        total = total + part * factor
    return total


def _fitted(parts: list[Floats], sizes: Floats, values: Floats) -> Floats:
    powers = np.stack([sizes**n for n in range(SIZES)], axis=1)
    columns = np.stack(parts, axis=1)[:, :, np.newaxis] * powers[:, np.newaxis]
    found, *_ = np.linalg.lstsq(columns.reshape(len(values), -1), values, rcond=1e-6)
    return np.asarray(found, dtype=np.float64).reshape(-1, SIZES)
