"""The exact answer of a linear array through its modes, where its boundary makes them known.

A coupling that is even along both axes is diagonal in the modes of its boundary: zero-flux the
DCT-II, a fixed rim the DST-I (radius 1), periodic the real Fourier modes. With orthonormal modes as
rows of R and C, X̂ = R X Cᵀ. Every mode (k, l) follows layers × layers equations of its own.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from cnnum.arrays import Floats, Shape
from cnnum.integrators.exact_ends.propagator import DECAYS, EXPONENTIAL
from cnnum.safety.memory import refuse_on_host
from cnnum.templating.boundary import Boundary
from cnnum.templating.network import Network
from cnnum.templating.template import Template

MODE_LIMIT = 512
"""Rows or columns above which products with all modes of an axis cost more than time steps."""

RATE_BYTES = 56
"""Held at once for a mode of one layer: its rate, its eigenvalue and their copies."""


@dataclass(frozen=True, slots=True, eq=False)
class Spectral:
    """x(t) = Rᵀ [state · (R x₀ Cᵀ) + drive · (R w Cᵀ)] C + constant, modes apart.

    Attributes
    ----------
    rows, cols : (rows, rows) and (cols, cols) float
        R and C.
    state, drive : (layers, layers, rows, cols) float
        Factors of each mode, as [to, from].
    constant : (layers, rows, cols) float
        The sum of a fixed boundary.
    rounding : float
        By how much the factors themselves may be off, as a part of the largest number in a state.
    """

    rows: Floats
    cols: Floats
    state: Floats
    drive: Floats
    constant: Floats
    rounding: float = 0.0

    def reach(self, start: Floats, drive: Floats) -> Floats:
        """Return x(t) of (..., layers, rows, cols) initial states and drives."""
        modes = np.zeros(start.shape)
        for factors, maps in ((self.state, start), (self.drive, drive)):
            moved = [n for n in range(maps.shape[-3]) if maps[..., n, :, :].any()]
            if moved and factors.any():
                seen = maps[..., moved, :, :]
                modes += _weighed(factors[:, moved], self.rows @ seen @ self.cols.T)
        return np.asarray(self.rows.T @ modes @ self.cols + self.constant)

    def flops(self, states: int, shape: Shape) -> int:
        """Return the arithmetic into the modes along both axes, of their factors, and back."""
        parts = int(self.state.any()) + int(self.drive.any())
        return 2 * states * (sum(shape) * (parts + 1) + len(self.state) * parts)

    def still(self) -> "Spectral":
        """Return the same without the part of a fixed boundary."""
        return replace(self, constant=0.0 * self.constant)


def wave_numbers(boundary: Boundary, n: int) -> Floats:
    """Return the wave number of every mode of an axis of n cells, (n,), radians a cell."""
    k = np.arange(n)
    if boundary.pad_mode == "symmetric":
        return np.asarray(np.pi * k / n, dtype=np.float64)
    if boundary.pad_mode == "constant":
        return np.asarray(np.pi * (k + 1) / (n + 1), dtype=np.float64)
    return np.asarray(2.0 * np.pi * k / n, dtype=np.float64)


def axis_modes(boundary: Boundary, n: int) -> Floats:
    """Return the orthonormal modes of an axis of n cells, (n, n), one a row.

    Rates need the wave numbers only: a long axis never asks for this matrix.
    """
    cells, k = np.arange(n), np.arange(n)[:, np.newaxis]
    if boundary.pad_mode == "symmetric":
        matrix = np.cos(np.pi * k * (cells + 0.5) / n)
    elif boundary.pad_mode == "constant":
        matrix = np.sin(np.pi * (k + 1) * (cells + 1) / (n + 1))
    else:
        # cosines up to n/2, then the sines of the same wave numbers
        angle = 2.0 * np.pi * k * cells / n
        matrix = np.where(k <= n // 2, np.cos(angle), np.sin(angle))
    norms = np.sqrt((matrix**2).sum(axis=1, keepdims=True))
    return np.asarray(matrix / norms, dtype=np.float64)


def even(kernels: Floats) -> bool:
    """Whether kernels are the same upside down and left to right."""
    flipped = np.array_equal(kernels, kernels[..., ::-1, :])
    return flipped and np.array_equal(kernels, kernels[..., :, ::-1])


def diagonal_in_modes(template: Template) -> bool:
    """Whether the boundary's modes are those of every coupling in A.

    Where virtual cells are fixed, modes vanish on the first cell beyond the rim only.
    """
    reach = template.boundary.constant is None or _reach(template.A) <= 1
    return template.plain and even(template.A) and reach


def _reach(kernels: Floats) -> int:
    places = np.argwhere(kernels)[:, 2:] - kernels.shape[-1] // 2
    return int(np.abs(places).max(initial=0))


def symbol(kernels: Floats, rows: Floats, cols: Floats) -> Floats:
    """Return the eigenvalues of even kernels at wave numbers.

    Parameters
    ----------
    kernels : (to, from, k, k) float
    rows, cols : (rows,) and (cols,) float
        Wave numbers, radians a cell.

    Returns
    -------
    (to, from, rows, cols) float
    """
    radius = int(kernels.shape[-1]) // 2
    offsets = np.arange(-radius, radius + 1)
    along_rows, along_cols = np.cos(np.outer(rows, offsets)), np.cos(np.outer(cols, offsets))
    found = np.einsum("ri,tfij,cj->tfrc", along_rows, kernels, along_cols, optimize=True)
    return np.asarray(found, dtype=np.float64)


def mode_rates(template: Template, shape: Shape) -> Floats:
    """Return S(A − 1) of each mode, (rows, cols, layers, layers) in 1/time.

    Raises
    ------
    SizeError
        If they do not fit into memory.
    """
    refuse_on_host("The rates of an array", shape, RATE_BYTES * template.layers**2)
    rows, cols = (wave_numbers(template.boundary, n) for n in shape)
    coupling = np.moveaxis(symbol(template.A, rows, cols), (0, 1), (2, 3))
    rates = (coupling - np.eye(template.layers)) / template.tau[:, np.newaxis]
    return np.asarray(rates, dtype=np.float64)


def spectral(network: Network, duration: float) -> Spectral | None:
    """Return the exact answer after `duration` (infinite: equilibrium), None where there is none.

    There is none where the couplings are not even, or an axis is too long. Nor is there one for an
    equilibrium if not every mode decays.
    """
    template, shape = network.template, network.shape
    if not diagonal_in_modes(template) or max(shape) > MODE_LIMIT:
        return None
    rates = mode_rates(template, shape)
    inverse_tau = np.broadcast_to(np.diag(1.0 / template.tau), rates.shape)
    turned = 0.0
    if math.isinf(duration):
        if np.linalg.eigvals(rates).real.max() >= -DECAYS:
            return None
        state = np.zeros_like(rates)
        drive = np.asarray(-np.linalg.solve(rates, inverse_tau), dtype=np.float64)
    else:
        state, drive = _after(rates, inverse_tau, duration)
        # one layer's exponentials are numbers, which are exact
        turned = float(np.abs(rates).sum(axis=-1).max()) * duration if template.layers > 1 else 0.0
    rows, cols = (axis_modes(template.boundary, n) for n in shape)
    state, drive = (np.moveaxis(factor, (2, 3), (0, 1)).copy() for factor in (state, drive))
    constant = _through(rows, cols, drive, network.rim())
    return Spectral(rows, cols, state, drive, constant, EXPONENTIAL * turned)


def _after(rates: Floats, inverse_tau: Floats, duration: float) -> tuple[Floats, Floats]:
    """Return e^{Mt} and t φ₁(Mt) S of every mode (Van Loan 1978 for several layers)."""
    layers = rates.shape[-1]
    if layers == 1:
        growth = rates * duration
        still = rates == 0.0
        gained = np.where(still, duration, np.expm1(growth) / np.where(still, 1.0, rates))
        return np.exp(growth), gained * inverse_tau
    from scipy.linalg import expm  # imported late: it takes longer than all of the engine

    block = np.zeros((*rates.shape[:2], 2 * layers, 2 * layers))
    block[..., :layers, :layers] = rates
    block[..., :layers, layers:] = inverse_tau
    exponential = np.asarray(expm(block * duration))
    return exponential[..., :layers, :layers], exponential[..., :layers, layers:]


def _through(rows: Floats, cols: Floats, factors: Floats, maps: Floats) -> Floats:
    modes = np.einsum("tfkl,fkl->tkl", factors, rows @ maps @ cols.T)
    return np.asarray(rows.T @ modes @ cols)


def _weighed(factors: Floats, modes: Floats) -> Floats:
    """Return Σ_f factors[t, f, k, l] · modes[..., f, k, l]; as matrix products, which are quick."""
    lead, (to, layers, rows, cols) = modes.shape[:-3], factors.shape
    by_mode = np.moveaxis(modes.reshape(-1, layers, rows, cols), (2, 3), (0, 1))
    found = by_mode @ np.moveaxis(factors, (0, 1, 2, 3), (3, 2, 0, 1))
    return np.moveaxis(found, (0, 1), (2, 3)).reshape(*lead, to, rows, cols)
