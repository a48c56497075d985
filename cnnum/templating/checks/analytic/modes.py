"""The modes of a cell array: the basis that its boundary makes diagonal (DCT-II, DST-I or DFT)."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import fft

from cnnum.arrays import Floats, Shape
from cnnum.errors import TemplateError
from cnnum.templating.boundary import Boundary


@dataclass(frozen=True, slots=True, eq=False)
class Modes:
    """Modes of an array under every symmetric coupling.

    Attributes
    ----------
    apply : callable
        (array (..., rows, cols), factors (rows, cols)) to the array with each mode multiplied.
    cos_rows, cos_cols : (rows, 1) and (1, cols) float
        cos k of each mode, k the wave number in radians a cell.
    """

    apply: Callable[[Floats, Floats], Floats]
    cos_rows: Floats
    cos_cols: Floats

    def symbol(self, edge: float, corner: float = 0.0) -> Floats:
        """Return the eigenvalues of the sum over edge and corner neighbours, so weighed."""
        rows, cols = self.cos_rows, self.cos_cols
        return 2.0 * edge * (rows + cols) + 4.0 * corner * rows * cols

    @property
    def laplacian(self) -> Floats:
        """Eigenvalues of the five-point Laplacian; none is positive."""
        return self.symbol(1.0) - 4.0


def modes(boundary: Boundary, shape: Shape) -> Modes:
    """Return the modes of an array of that shape.

    Raises
    ------
    TemplateError
        If the boundary is a constant other than 0, which adds an inhomogeneous part.
    """
    if boundary.pad_mode == "symmetric":
        return _modes(_through_dct, shape, lambda n: np.pi * np.arange(n) / n)
    if boundary.pad_mode == "wrap":
        return _modes(_through_dft, shape, lambda n: 2.0 * np.pi * np.arange(n) / n)
    if boundary.constant == 0.0:
        # Sine modes vanish on the virtual cells 0 and n + 1; radius 1 only.
        return _modes(_through_dst, shape, lambda n: np.pi * np.arange(1, n + 1) / (n + 1))
    raise TemplateError(
        f"The modes of an array are known for the boundaries 0, 'zero-flux' and 'periodic', "
        f"got {boundary}."
    )


def _modes(
    apply: Callable[[Floats, Floats], Floats], shape: Shape, wave_numbers: Callable[[int], Floats]
) -> Modes:
    rows, cols = (np.cos(wave_numbers(n)) for n in shape)
    return Modes(apply, rows[:, np.newaxis], cols[np.newaxis, :])


def _through_dct(array: Floats, factors: Floats) -> Floats:
    spectrum = fft.dctn(array, type=2, axes=(-2, -1))
    return np.asarray(fft.idctn(spectrum * factors, type=2, axes=(-2, -1)), dtype=np.float64)


def _through_dst(array: Floats, factors: Floats) -> Floats:
    spectrum = fft.dstn(array, type=1, axes=(-2, -1))
    return np.asarray(fft.idstn(spectrum * factors, type=1, axes=(-2, -1)), dtype=np.float64)


def _through_dft(array: Floats, factors: Floats) -> Floats:
    spectrum = fft.fftn(array, axes=(-2, -1))
    return np.asarray(fft.ifftn(spectrum * factors, axes=(-2, -1)).real, dtype=np.float64)
