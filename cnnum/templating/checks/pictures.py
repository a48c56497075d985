"""Pictures that checks run on: random ones, and those that show every neighbourhood.

Pictures that show a cell every black-and-white neighbourhood there is.

A cell that reads 3×3 cells has 512 neighbourhoods, one on a side of the array 64 of real cells, and
one in a corner 16. Random pictures show few of them: twelve of 8×8 cells some 205 of the 512. The
pictures here are filled cell by cell, row after row, each cell with the colour that completes a
neighbourhood which no picture has shown yet.
"""

import itertools
from collections.abc import Callable, Iterator
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from cnnum.arrays import Floats, Shape
from cnnum.templating.boundary import ZERO_FLUX, Boundary
from cnnum.templating.checks.records import Case
from cnnum.templating.template import Template

Bools = NDArray[np.bool_]
Held = Callable[[Bools], Bools]
"""Black cells (pictures, rows, cols) to the cells at which a rule holds."""

Key = tuple[int, int]
"""The kind of place, and the colours of its real cells as bits."""

NINE = tuple((down, east) for down in (-1, 0, 1) for east in (-1, 0, 1))

LARGE = 4096
"""Cells of an array that is not filled cell by cell."""

_IN_VAIN = 12
"""Tries in a row that show nothing new, after which the rest is taken for impossible."""

_MANY, _FEW, _SOME = 40, 3, 16
"""Neighbourhoods planted where no picture is avoided, and where some are; pictures of a try."""

_TRIES, _QUICK = 400, 60
"""Changes of a picture, and of one of many, until it shows nothing that is avoided."""


def covering(
    rng: np.random.Generator, shape: Shape, boundary: Boundary, avoided: Held | None = None
) -> Floats:
    """Return pictures that show every 3×3 neighbourhood, inside the array and at its rim.

    The first two are all white and all black, where nothing forbids that. Arrays of more than
    `LARGE` cells show most neighbourhoods by chance, and the rest is planted.

    Parameters
    ----------
    rng : numpy.random.Generator
        Decides where both colours are as good.
    shape : (rows, cols)
    boundary : Boundary
        Boundary of the pictures.
    avoided : callable, optional
        Says which cells have a neighbourhood that no picture may show.

    Returns
    -------
    (pictures, rows, cols) float, ±1
    """
    if avoided is None:
        return _covering(int(rng.integers(2**32)), shape).copy()
    return _pictures(_Filler(rng, shape, boundary, avoided))


@lru_cache(maxsize=16)
def _covering(seed: int, shape: Shape) -> Floats:
    """Return pictures that do not depend on the boundary, once for all checks of a seed."""
    return _pictures(_Filler(np.random.default_rng(seed), shape, ZERO_FLUX, None))


def _pictures(filler: "_Filler") -> Floats:
    result = [flat for flat in (filler.even(False), filler.even(True)) if flat is not None]
    result += filler.pictures()
    return np.where(np.stack(result), 1.0, -1.0)


class _Filler:
    """The neighbourhoods that are still to be shown, and pictures that show them."""

    def __init__(
        self,
        rng: np.random.Generator,
        shape: Shape,
        boundary: Boundary,
        avoided: Held | None,
    ) -> None:
        self.rng, self.shape, self.boundary, self.avoided = rng, shape, boundary, avoided
        rows, cols = shape
        self.real = {place: self._real(*place) for place in np.ndindex(rows, cols)}
        self.places = dict[int, list[tuple[int, int]]]()
        for place, mask in self.real.items():
            self.places.setdefault(mask, []).append(place)
        self.kinds = np.array([self.real[place] for place in np.ndindex(shape)]).reshape(shape)
        self.forbidden = self._forbidden()
        self.left: set[Key] = {
            (mask, bits)
            for mask, places in self.places.items()
            for bits in _within(mask)
            if not self.forbidden[self._seen(mask, bits, places[0])]
        }

    def _real(self, row: int, col: int) -> int:
        """Return which of the nine cells around a place the array has, as bits."""
        rows, cols = self.shape
        return sum(
            1 << n
            for n, (down, east) in enumerate(NINE)
            if 0 <= row + down < rows and 0 <= col + east < cols
        )

    def _forbidden(self) -> Bools:
        """Return of each of the 512 neighbourhoods whether it is avoided."""
        if self.avoided is None:
            return np.zeros(512, dtype=np.bool_)
        cells = (np.arange(512)[:, np.newaxis] >> np.arange(9)) & 1 > 0
        return self.avoided(cells.reshape(-1, 3, 3))[:, 1, 1]

    def _seen(self, mask: int, bits: int, place: tuple[int, int]) -> int:
        """Return the nine colours that a cell sees, the rim's among them, as bits."""
        if self.boundary.constant is not None:
            beyond = self.boundary.constant > 0.0
            return bits | (511 & ~mask if beyond else 0)
        if self.boundary.pad_mode != "symmetric":
            return bits  # what lies on the other side is known once the picture is whole
        rows, cols = self.shape
        result = 0
        for n, (down, east) in enumerate(NINE):
            row = min(max(place[0] + down, 0), rows - 1) - place[0]
            col = min(max(place[1] + east, 0), cols - 1) - place[1]
            result |= (bits >> (3 * (row + 1) + col + 1) & 1) << n
        return result

    def even(self, black: bool) -> Bools | None:
        """Return the picture of one colour, unless it is to be avoided."""
        picture = np.full(self.shape, black)
        return self._taken(picture)

    def pictures(self) -> Iterator[Bools]:
        """Yield pictures until every neighbourhood is shown."""
        in_vain = 0
        while self.left and in_vain < _IN_VAIN:
            in_vain += 1
            for picture in self._drawn():
                if self._shown(picture) & self.left and self._taken(picture) is not None:
                    yield picture
                    in_vain = 0

    def _drawn(self) -> Iterator[Bools]:
        """Yield a picture that shows much of what is left, or some where much is avoided."""
        if self.avoided is None:
            yield self._filled()
            return
        planted = [self._planted(_FEW) for _ in range(_SOME)]
        fixed = np.stack([places for _, places in planted])
        black = np.stack([picture for picture, _ in planted])
        black |= (self.rng.random(black.shape) < self.rng.uniform(0.2, 0.8)) & ~fixed
        yield from steered(self.rng, black, self.avoided, fixed, reach=1, tries=_QUICK)

    def _taken(self, picture: Bools) -> Bools | None:
        """Strike what a picture shows off the list, unless it shows what is to be avoided."""
        if self.avoided is not None and self.avoided(picture[np.newaxis]).any():
            return None
        self.left -= self._shown(picture)
        return picture

    def _shown(self, picture: Bools) -> set[Key]:
        """Return the neighbourhoods that a picture shows."""
        rows, cols = self.shape
        padded = np.pad(picture, 1).astype(np.int64)
        bits = sum(
            padded[1 + down : 1 + down + rows, 1 + east : 1 + east + cols] << n
            for n, (down, east) in enumerate(NINE)
        )
        codes = np.unique(512 * self.kinds + bits)
        return {divmod(code, 512) for code in codes.tolist()}

    def _bits(self, picture: Bools, place: tuple[int, int]) -> int:
        rows, cols = self.shape
        result = 0
        for n, (down, east) in enumerate(NINE):
            row, col = place[0] + down, place[1] + east
            if 0 <= row < rows and 0 <= col < cols and picture[row, col]:
                result |= 1 << n
        return result

    def _filled(self) -> Bools:
        """Return a picture with some neighbourhoods planted, and the rest filled greedily."""
        picture, fixed = self._planted(_MANY)
        rows, cols = self.shape
        given = self.rng.random(self.shape) < self.rng.uniform(0.3, 0.7)
        picture = np.where(fixed, picture, given)
        if rows * cols > LARGE:
            return picture
        done = set[Key]()
        for row, col in np.ndindex(rows, cols):
            complete = [
                place
                for place in itertools.product({max(row - 1, 0), row}, {max(col - 1, 0), col})
                if min(place[0] + 1, rows - 1) == row and min(place[1] + 1, cols - 1) == col
            ]
            shown = list[set[Key]]()
            for turned in (False, True) if not fixed[row, col] else (False,):
                picture[row, col] ^= turned
                shown.append({(self.real[place], self._bits(picture, place)) for place in complete})
            gains = [len((keys & self.left) - done) for keys in shown]
            if len(shown) > 1 and gains[0] >= gains[1]:
                picture[row, col] ^= True
            done |= shown[int(np.argmax(gains))]
        return picture

    def _planted(self, most: int) -> tuple[Bools, Bools]:
        """Return a picture with neighbourhoods that are left, and the cells that those take."""
        picture, fixed = np.zeros(self.shape, dtype=bool), np.zeros(self.shape, dtype=bool)
        left = sorted(self.left)
        order: list[int] = self.rng.permutation(len(left)).tolist()
        for number in order[:most]:
            mask, bits = left[number]
            places = self.places[mask]
            row, col = places[self.rng.integers(len(places))]
            cells = [
                (row + down, col + east, bool(bits >> n & 1))
                for n, (down, east) in enumerate(NINE)
                if mask >> n & 1
            ]
            if any(fixed[r, c] and picture[r, c] != black for r, c, black in cells):
                continue
            for r, c, black in cells:
                picture[r, c], fixed[r, c] = black, True
        return picture, fixed


def steered(
    rng: np.random.Generator,
    black: Bools,
    avoided: Held | None,
    fixed: Bools | None = None,
    *,
    reach: int = 2,
    tries: int = _TRIES,
) -> Bools:
    """Return pictures without avoided neighbourhoods.

    A picture becomes white where no change outside its fixed cells cures it.

    Parameters
    ----------
    rng : numpy.random.Generator
    black, fixed : (pictures, rows, cols) bool
    avoided : callable or None
    reach : int
        Cells up to which a neighbourhood reaches.
    tries : int
    """
    if avoided is None:
        return black
    square = np.ones((1, 2 * reach + 1, 2 * reach + 1), dtype=np.bool_)
    for _ in range(tries):
        near: Bools = np.asarray(ndimage.binary_dilation(avoided(black), square))
        if not near.any():
            return black
        flip = near & (rng.random(black.shape) < 0.15)
        black = black ^ (flip if fixed is None else flip & ~fixed)
    unclean = np.any(avoided(black), axis=(-2, -1), keepdims=True)
    return np.asarray(black & ~unclean, dtype=np.bool_)


def _within(mask: int) -> Iterator[int]:
    """Yield all numbers whose bits are among those of a mask."""
    bits = mask
    while True:
        yield bits
        if not bits:
            return
        bits = (bits - 1) & mask


DENSITIES = (0.0, 0.15, 0.35, 0.5, 0.7, 1.0)
"""Shares of black cells; the empty and the full picture are among them."""


def binary(rng: np.random.Generator, shape: Shape) -> Floats:
    """Return black-and-white pictures, speckled and blobby ones, of several densities.

    Nothing keeps the objects away from the frame, and many of them touch it.

    Returns
    -------
    (2·densities, rows, cols) float, ±1
    """
    noise = rng.random((len(DENSITIES), *shape))
    smooth = ndimage.gaussian_filter(noise, (0.0, 1.2, 1.2), mode="reflect")
    blobs = np.stack(
        [field < np.quantile(field, share) for field, share in zip(smooth, DENSITIES, strict=True)]
    )
    speckles = noise < np.reshape(DENSITIES, (-1, 1, 1))
    return as_picture(np.concatenate([speckles, blobs]))


def gray(rng: np.random.Generator, shape: Shape, amplitude: float = 0.95) -> Floats:
    """Return gray pictures within ±amplitude: noise, two smooth ones, a single cell, an empty one.

    Returns
    -------
    (5, rows, cols) float
    """
    noise = rng.uniform(-1.0, 1.0, (3, *shape))
    smooth = ndimage.gaussian_filter(noise[1:], (0.0, 1.0, 1.0), mode="reflect")
    point = np.zeros((1, *shape))
    point[0, rng.integers(shape[0]), rng.integers(shape[1])] = 1.0
    pictures = np.concatenate([noise[:1], smooth, point])
    peaks = np.max(np.abs(pictures), axis=(-2, -1), keepdims=True)
    drawn = np.asarray(amplitude * pictures / peaks, dtype=np.float64)
    return with_even(drawn, -amplitude)


def with_even(pictures: Floats, level: float) -> Floats:
    """Return pictures (pictures, ..., rows, cols) and one more, with that level in every cell."""
    return np.concatenate([pictures, np.full_like(pictures[:1], level)])


def as_picture(cells: np.ndarray[tuple[int, ...], np.dtype[np.bool_]]) -> Floats:
    """Return +1 where a cell is set and −1 elsewhere."""
    return np.where(cells, 1.0, -1.0)


def binary_input(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    """Return a case of black-and-white pictures as the input."""
    return Case(input=binary(rng, shape))


def every_neighbourhood(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    """Return a case whose input shows every 3×3 neighbourhood, also at the rim."""
    return Case(input=covering(rng, shape, template.input_boundary))


def every_pair(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    """Return a case with every neighbourhood in the input, under a white and a black state."""
    pictures = covering(rng, shape, template.input_boundary)
    state = as_picture(rng.random(pictures.shape) < 0.5)
    return Case(input=np.concatenate([pictures, pictures]), state=np.concatenate([state, -state]))


def binary_case(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    """Return black-and-white pictures for all that a template reads: its inputs, or its state."""

    def drawn(count: int) -> Floats:
        maps = [rng.permutation(binary(rng, shape)) for _ in range(count)]
        return maps[0] if count == 1 else np.stack(maps, axis=1)

    given = drawn(template.inputs) if template.inputs else None
    late = given if template.delayed is not None else None
    return Case(
        input=given, previous=late, state=None if template.inputs else drawn(template.layers)
    )
