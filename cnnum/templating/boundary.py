"""The values that a cell at the rim sees outside the array."""

from dataclasses import dataclass
from numbers import Real
from typing import Literal, cast

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Shape
from cnnum.errors import TemplateError
from cnnum.safety.values import is_real


@dataclass(frozen=True, slots=True)
class Boundary:
    """A rule that gives every virtual cell beyond the rim its state.

    Attributes
    ----------
    name : str or float
        Name in template files: "zero-flux", "periodic", or the constant itself.
    pad_mode : str
        The `numpy.pad` mode that fills a rim in this way.
    constant : float or None
        The state of all virtual cells (Dirichlet), None if they copy a cell of the array.
    """

    name: str | float
    pad_mode: Literal["constant", "symmetric", "wrap"]
    constant: float | None = None

    def __post_init__(self) -> None:
        if self.constant is not None and not isinstance(cast(object, self.constant), Real):
            raise TemplateError(f"A fixed boundary needs a number, got {self.constant!r:.60}.")
        if self.pad_mode not in ("constant", "symmetric", "wrap"):
            raise TemplateError(
                "The pad mode of a boundary must be 'constant', 'symmetric' or 'wrap', got "
                f"{self.pad_mode!r:.60}."
            )

    def __str__(self) -> str:
        return self.name if isinstance(self.name, str) else f"{self.name:g}"


ZERO_FLUX = Boundary("zero-flux", "symmetric")
"""Mirrors the array about its rim, so nothing flows across it (Neumann). The mirror line lies
between cells, which makes it the boundary of the DCT-II; at radius 1 it repeats the rim."""

PERIODIC = Boundary("periodic", "wrap")
"""The array is a torus."""

_NAMED = {str(boundary.name): boundary for boundary in (ZERO_FLUX, PERIODIC)}


def parse_boundary(value: float | str | Boundary) -> Boundary:
    """Return the boundary given by a number or a name.

    Raises
    ------
    TemplateError
        If it is neither a finite number, nor "zero-flux", nor "periodic".
    """
    if isinstance(value, Boundary):
        return value
    if isinstance(value, str):
        if value not in _NAMED:
            raise TemplateError(
                f"Unknown boundary {value!r:.60}: expected a number, 'zero-flux' or 'periodic'."
            )
        return _NAMED[value]
    if not is_real(value):
        raise TemplateError(
            "A boundary must be a finite number (a fixed one), 'zero-flux' or 'periodic', "
            f"got {value!r:.60}."
        )
    return Boundary(float(value), "constant", float(value))


def halo_sources(boundary: Boundary, shape: Shape, radius: int) -> NDArray[np.int64]:
    """Return for each cell of the padded array the index of the cell it copies, −1 for a constant.

    Parameters
    ----------
    boundary : Boundary
    shape : (rows, cols)
    radius : int
        Width of the rim of virtual cells; if it exceeds the array, mirrors repeat.

    Returns
    -------
    (rows + 2·radius, cols + 2·radius) int
        Row-major index of a cell.
    """
    rows, cols = (line_sources(boundary, length, radius) for length in shape)
    sources = rows[:, np.newaxis] * shape[1] + cols
    if boundary.pad_mode == "constant":
        sources[rows < 0] = -1
        sources[:, cols < 0] = -1
    return sources


def line_sources(boundary: Boundary, length: int, radius: int) -> NDArray[np.int64]:
    """Return the cell that each element of a padded row or column copies, −1 for a constant."""
    places = np.arange(-radius, length + radius)
    if boundary.pad_mode == "constant":
        places[(places < 0) | (places >= length)] = -1
        return places
    if boundary.pad_mode == "wrap":
        return places % length
    # a mirror at both ends has the period 2·length
    there = places % (2 * length)
    return np.where(there < length, there, 2 * length - 1 - there)


def rim_copies(boundary: Boundary, shape: Shape, radius: int) -> NDArray[np.int64]:
    """Return the indices of the rim of a padded array, and of the cells that it copies.

    Parameters
    ----------
    boundary : Boundary
    shape : (rows, cols)
    radius : int

    Returns
    -------
    (2, virtual cells) int
        Row-major places in the padded array. A constant rim copies itself.
    """
    pitch = shape[1] + 2 * radius
    rows, cols = (line_sources(boundary, length, radius) for length in shape)
    own = np.arange(len(rows) * pitch)
    if boundary.pad_mode == "constant":
        outside = (rows < 0)[:, np.newaxis] | (cols < 0)
        (places,) = np.nonzero(outside.ravel())
        return np.array([places, places])
    sources = ((rows[:, np.newaxis] + radius) * pitch + cols + radius).ravel()
    (places,) = np.nonzero(sources != own)
    return np.array([places, sources[places]])
