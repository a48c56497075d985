"""Ends of transients that are known without a time step.

The exact answer of a linear array through its modes, where its boundary makes them known.

A coupling that is even along both axes is diagonal in the modes of its boundary: zero-flux the
DCT-II, a fixed rim the DST-I (radius 1), periodic the real Fourier modes. With orthonormal modes as
rows of R and C, X̂ = R X Cᵀ. Every mode (k, l) follows layers × layers equations of its own.

No time stepping at all: where an array is linear, its state at time t is one product.

x(t) = e^{Mt} x₀ + t φ₁(Mt) S (w + g),     φ₁(z) = (e^z − 1)/z

No time stepping where cells see only themselves: three linear pieces, one after the other.

τ x' = −x + a f(x) + w with f(x) = (|x + 1| − |x − 1|)/2 is linear below −1, between, and above 1.
A state moves one way only, so that it passes each piece once at most. Times are in τ:

* outside, towards e = w + a s (s = ±1 the side): x = e + (x₀ − e) d, d = e^{−t}. It comes to s,
  if e lies inside of s, when d = (s − e)/(x₀ − e).
* between, with the slope m = a − 1 and the rate g(x) = m x + w: x = x₀ + g(x₀) (e^{mt} − 1)/m. It
  comes to b = sign g, if g(b) has g's sign, at t = ln(1 + m (b − x₀)/g(x₀))/m. For m < 0 both terms
  cancel near the rest: x = x₀ e^{mt} + w (e^{mt} − 1)/m then.

Both quotients by m are those of `expm1` and `log1p`, as they cancel where a is near 1. For m = 0
they are t and (b − x₀)/g(x₀).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats, Shape
from cnnum.integrators.estimate import LOST
from cnnum.safety.values import refuse_on_host
from cnnum.templating.boundary import Boundary
from cnnum.templating.network import Network
from cnnum.templating.template import Template

MODE_LIMIT = 512
"""Rows or columns above which products with all modes of an axis cost more than time steps."""

RATE_BYTES = 56
"""Held at once for a mode of one layer: its rate, its eigenvalue and their copies."""


@dataclass(frozen=True, slots=True, eq=False)
class Spectral:
    """Modal solution, x(t) = Rᵀ [state · (R x₀ Cᵀ) + drive · (R w Cᵀ)] C + constant.

    Attributes
    ----------
    rows, cols : (rows, rows) and (cols, cols) float
        R and C.
    state, drive : (layers, layers, rows, cols) float
        Factors of each mode, as [to, from].
    constant : (layers, rows, cols) float
        Contribution of a fixed boundary.
    rounding : float
        Error bound of the factors, relative to the largest number in a state.
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
    """Return the wave number of every mode of an axis of n cells, (n,), in radians per cell."""
    k = np.arange(n)
    if boundary.pad_mode == "symmetric":
        return np.asarray(np.pi * k / n, dtype=np.float64)
    if boundary.pad_mode == "constant":
        return np.asarray(np.pi * (k + 1) / (n + 1), dtype=np.float64)
    return np.asarray(2.0 * np.pi * k / n, dtype=np.float64)


def axis_modes(boundary: Boundary, n: int) -> Floats:
    """Return the orthonormal modes of an axis of n cells, (n, n), one per row.

    Rates need only the wave numbers, so this matrix is not computed for a long axis.
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
        Wave numbers, in radians per cell.

    Returns
    -------
    (to, from, rows, cols) float
    """
    radius = int(kernels.shape[-1]) // 2
    offsets = np.arange(-radius, radius + 1)
    along_rows, along_cols = np.cos(np.outer(rows, offsets)), np.cos(np.outer(cols, offsets))
    result = np.einsum("ri,tfij,cj->tfrc", along_rows, kernels, along_cols, optimize=True)
    return np.asarray(result, dtype=np.float64)


def mode_rates(template: Template, shape: Shape) -> Floats:
    """Return S(A − 1) for each mode, (rows, cols, layers, layers), in 1/time.

    Raises
    ------
    SizeError
        If the result does not fit into memory.
    """
    refuse_on_host("The rates of an array", shape, RATE_BYTES * template.layers**2)
    rows, cols = (wave_numbers(template.boundary, n) for n in shape)
    coupling = np.moveaxis(symbol(template.A, rows, cols), (0, 1), (2, 3))
    rates = (coupling - np.eye(template.layers)) / template.tau[:, np.newaxis]
    return np.asarray(rates, dtype=np.float64)


def spectral(network: Network, duration: float) -> Spectral | None:
    """Return the exact solution after `duration` (infinite for the equilibrium), or None.

    There is none if the couplings are not even or an axis is too long. An equilibrium also requires
    that every mode decays.
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
        norm = float((np.abs(rates).sum(axis=-1) + 1.0 / template.tau).max())
        turned = max(norm * duration, 1.0) if template.layers > 1 else 0.0
    rows, cols = (axis_modes(template.boundary, n) for n in shape)
    state, drive = (np.moveaxis(factor, (2, 3), (0, 1)).copy() for factor in (state, drive))
    constant = _through(rows, cols, drive, network.rim())
    gain = sum(float(np.abs(part).sum(axis=1).max()) for part in (state, drive))
    return Spectral(rows, cols, state, drive, constant, EXPONENTIAL * turned * max(gain, 1.0))


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
    result = by_mode @ np.moveaxis(factors, (0, 1, 2, 3), (3, 2, 0, 1))
    return np.moveaxis(result, (0, 1), (2, 3)).reshape(*lead, to, rows, cols)


Waves = NDArray[np.complexfloating]
"""(rows, cols, to, from): a matrix of layers for each wave."""

SHIFTS = "the array is linear on a torus: its equilibrium is a product of shifts"

MOST_WEIGHTS = 1 << 20
"""Largest number of weights for which it is offered, which the largest dense product has."""

MOST_CELLS = 1024
"""Largest number of cells in a layer for which it is offered: each cell is a sum over all."""

WAVE_BYTES = 80
"""Held at once for a wave of one pair of layers: complex numbers, their inverse and copies."""


@dataclass(frozen=True, slots=True, eq=False)
class Circulant:
    """Equilibrium of a linear array on a torus from any initial state, x = drive ∗ w.

    A coupling on a torus is a convolution, and therefore a factor on each wave, whether it is even
    or not. For each wave, the equilibrium is (1 − Â)⁻¹ times its drive, where Â is the
    layers × layers matrix of A.

    Attributes
    ----------
    drive : (layers, layers, rows, cols) float
        As [to, from]: the response to a drive of 1 at the cell (0, 0).
    rounding : float
        Error bound of this response, relative to the largest number in a drive.
    """

    drive: Floats
    rounding: float = 0.0

    def reach(self, start: Floats, drive: Floats) -> Floats:
        """Return the equilibrium of (..., layers, rows, cols) drives; the start does not count."""
        del start
        waves = np.fft.fft2(self.drive), np.fft.fft2(drive)
        return np.asarray(np.fft.ifft2(np.einsum("tfrc,...frc->...trc", *waves)).real)

    def flops(self, states: int, shape: Shape) -> int:
        """Return the arithmetic from the drive of that many states to their end."""
        del states
        return 2 * int(np.count_nonzero(self.drive.any(axis=(2, 3)))) * (shape[0] * shape[1]) ** 2

    def still(self) -> "Circulant":
        """Return the same without the part of a fixed boundary: a torus has none."""
        return self

    def gain(self, driven: Sequence[int]) -> float:
        """Return the largest state that drives up to 1 of these layers lead to."""
        return float(np.abs(self.drive[:, driven]).sum(axis=(1, 2, 3)).max(initial=0.0))


def shifts_fit(network: Network) -> bool:
    """Whether an array is small enough for a product of all of its cells."""
    rows, cols = network.shape
    cells = rows * cols
    return cells <= MOST_CELLS and network.template.layers**2 * cells <= MOST_WEIGHTS


def circulant(network: Network) -> Circulant | None:
    """Return the equilibrium of an array on a torus, or None.

    There is none if the array is not linear or not periodic, or if not every wave decays.

    Raises
    ------
    SizeError
        If the waves do not fit into memory.
    """
    template = network.template
    if not (template.plain and template.output.linear) or template.boundary.pad_mode != "wrap":
        return None
    refuse_on_host("The waves of an array", network.shape, WAVE_BYTES * template.layers**2)
    left = np.eye(template.layers) - _waves(network)
    if np.linalg.eigvals(-left / template.tau[:, np.newaxis]).real.max() >= -DECAYS:
        return None
    answers = np.linalg.inv(left)
    drive = np.fft.ifft2(np.moveaxis(answers, (2, 3), (0, 1))).real.copy()
    return Circulant(drive, _rounding(left, answers, network.states))


def _rounding(left: Waves, answers: Waves, states: int) -> float:
    """Return by how much the answer to drives up to 1 may be off.

    Of each wave by the answer to the residual of the inverse. Waves keep lengths: that of a state
    is √states times its largest number at most.
    """
    residual = left @ answers - np.eye(left.shape[-1])
    off = [np.linalg.norm(matrices, 2, axis=(2, 3)) for matrices in (answers, residual)]
    return float(np.sqrt(states) * (off[0] * off[1]).max())


def _waves(network: Network) -> Waves:
    """Return the factors of A for every wave, (rows, cols, layers, layers) complex."""
    A = network.template.A
    radius = int(A.shape[-1]) // 2
    offsets = np.arange(-radius, radius + 1)
    along = [np.exp(2j * np.pi / n * np.outer(np.arange(n), offsets)) for n in network.shape]
    result = np.einsum("ri,tfij,cj->rctf", along[0], A, along[1], optimize=True)
    return np.asarray(result)


DENSE_LIMIT = 1024
"""Cells of all layers above which the dense product is not offered: its matrices take n² numbers,
and time stepping with few taps is cheaper."""

DECAYS = 1e-9
"""Rate, 1/time, below which a mode or wave counts as not decaying."""

EXPONENTIAL = 1024.0 * float(np.finfo(np.float64).eps)
"""Error bound of SciPy's matrix exponential, relative to its norm times ‖M‖t (at least 1). Among
3,000 random matrices with norms from 0.1 to 200, the largest error was 735."""


@dataclass(frozen=True, slots=True, eq=False)
class Decay:
    """Solution for uncoupled cells (A = 0), x(t) = w + (x₀ − w) e^{−t/τ}.

    Attributes
    ----------
    kept : (layers,) float
        e^{−t/τ} of every layer; 0 at equilibrium, and 1 if no time passes. A cell then keeps its
        initial state exactly, which a sum with its drive would round.
    """

    kept: Floats

    rounding: ClassVar[float] = 0.0

    def reach(self, start: Floats, drive: Floats) -> Floats:
        """Return x(t) of (..., layers, rows, cols) initial states and drives."""
        kept = self.kept[:, np.newaxis, np.newaxis]
        ends = drive + kept * (start - drive)
        return np.where(kept == 0.0, drive, np.where(kept == 1.0, start, ends))

    def flops(self, states: int, shape: Shape) -> int:
        """Return the arithmetic from the drive and the start of that many states to their end."""
        del shape
        return 3 * states

    def still(self) -> "Decay":
        """Return the same without the part of a fixed boundary."""
        return self


@dataclass(frozen=True, slots=True, eq=False)
class Propagator:
    """Solution x(t) = state · x₀ + drive · w + constant, layers stacked, cells row-major.

    Attributes
    ----------
    state, drive : (n, n) float
    constant : (n,) float
        Contribution of a fixed boundary.
    rounding : float
        Error bound of the matrices, relative to the largest number in a state.
    """

    state: Floats
    drive: Floats
    constant: Floats
    rounding: float = 0.0

    def reach(self, start: Floats, drive: Floats) -> Floats:
        """Return x(t) of (batch, layers, rows, cols) initial states and drives."""
        flat = start.reshape(len(start), -1) @ self.state.T
        flat += drive.reshape(len(drive), -1) @ self.drive.T + self.constant
        return flat.reshape(drive.shape)

    def flops(self, states: int, shape: Shape) -> int:
        """Return the arithmetic from the drive and the start of that many states to their end."""
        del shape
        return 2 * states * states * (int(self.state.any()) + int(self.drive.any()))

    def still(self) -> "Propagator":
        """Return the same without the part of a fixed boundary."""
        return replace(self, constant=0.0 * self.constant)


def rounded_gain(matrices: Sequence[Floats], passes: Sequence[Floats]) -> float:
    """Return the error bound of a sum of products, in rounding errors of its largest number.

    In a sum over columns, each term is rounded by its own and by every later addition (Higham,
    Accuracy and Stability of Numerical Algorithms, 2002, section 3.1). The bound is the maximum
    over rows of Σ |b_ij| · passes_j, in units of half the distance from 1 to the next number.

    Parameters
    ----------
    matrices : sequence of (rows, n) float
    passes : sequence of (n,) float
        For each matrix, the number of times that its terms are rounded.
    """
    rows = sum(
        (np.abs(matrix) @ times for matrix, times in zip(matrices, passes, strict=True)),
        np.zeros(1),
    )
    return float(np.max(rows))


def passes_in_fours(columns: int) -> Floats:
    """Return the number of roundings of each column, by its own and all later additions.

    Columns are added in groups of four, and the remaining ones one by one.
    """
    alone = columns % 4
    fours = np.repeat(np.arange(columns // 4, 0, -1) + alone, 4)
    return np.concatenate([fours, np.arange(alone, 0, -1)]).astype(np.float64)


def decay(template: Template, duration: float) -> Decay:
    """Return the exact answer of uncoupled cells after `duration` (infinite: equilibrium)."""
    with np.errstate(under="ignore"):
        return Decay(np.exp(-duration / template.tau))


def propagator(network: Network, duration: float) -> Propagator | None:
    """Return the exact solution of a linear array after `duration`, or None if there is none.

    An infinite duration means the equilibrium, which exists if every mode decays.
    """
    from scipy.linalg import expm, solve  # imported late: it takes longer than all of the engine

    system = network.linear_system()
    n = network.states
    if math.isinf(duration):
        if float(np.linalg.eigvals(system.matrix).real.max()) >= -DECAYS:
            return None
        drive = solve(system.matrix, -np.diag(system.rates))
        return Propagator(np.zeros((n, n)), drive, drive @ system.rim)
    # e^{[[M, S], [0, 0]] t} holds e^{Mt} and t φ₁(Mt) S in its upper blocks (Van Loan 1978)
    block = np.zeros((2 * n, 2 * n))
    block[:n, :n] = system.matrix
    block[:n, n:] = np.diag(system.rates)
    exponential = np.asarray(expm(block * duration))
    drive = exponential[:n, n:]
    turned = max(float(np.abs(block).sum(axis=1).max()) * duration, 1.0)
    state = exponential[:n, :n]
    gain = sum(float(np.abs(part).sum(axis=1).max()) for part in (state, drive))
    rounding = EXPONENTIAL * turned * max(gain, 1.0)
    return Propagator(state, drive, drive @ system.rim, rounding)


LONGEST = 60.0
"""Time constants up to which no device takes the rest of a decay, e^{−60} = 9e-27, for 0. Longer
runs that are not to equilibrium take steps."""

STEEPEST = 1e30
"""Largest growth that is written out: a cell that would grow more has left the middle piece. Else
it began nearer to its rest than any number but 0 is."""

UNSURE = 4.0
"""Rounding errors of a rate up to which their growth is not taken from the rate."""

ROUNDED = 8
"""Largest number of rounded operations along the trajectory of a cell, without its drive."""


@dataclass(frozen=True, slots=True, eq=False)
class Separate:
    """Solution for cells that are coupled only to themselves, with the standard output.

    Attributes
    ----------
    own : (layers,) float
        Self-feedback a of every layer.
    time : (layers,) float
        Final t/τ of every layer; infinite at equilibrium.
    ends : bool
        Whether only outputs are needed, and starts within ±1 stay within as long as is seen: an
        engine may take f(x₀ e^{mt} + w (e^{mt} − 1)/m).
    """

    own: Floats
    time: Floats
    ends: bool = False

    rounding: ClassVar[float] = 0.0

    def sums(self, start: NDArray[Any], drive: NDArray[Any]) -> NDArray[Any]:
        """Return the arguments of f that give the outputs of (..., layers, rows, cols) maps."""
        columns = np.array([summed(*pair) for pair in zip(self.own - 1.0, self.time, strict=True)])
        kept, gain, weight = columns.T.astype(start.dtype)[..., np.newaxis, np.newaxis]
        with np.errstate(over="ignore"):  # whatever is beyond 1 is 1
            return np.asarray(kept * start + gain * (drive + weight * start))


def separate(template: Template, duration: float) -> Separate | None:
    """Return the exact solution after `duration` (infinite for the equilibrium), or None.

    There is none if cells are coupled to each other, the output function is not the standard one,
    or the run is too long, nor for an equilibrium with a = 1, where cells may rest anywhere.
    """
    middle = template.A.shape[-1] // 2
    own = np.array([template.A[n, n, middle, middle] for n in range(template.layers)])
    alone = np.count_nonzero(template.A) == np.count_nonzero(own)
    if not (alone and template.plain and template.output.name == "standard"):
        return None
    settles = bool(np.isinf(duration))
    if (settles and (own == 1.0).any()) or (
        not settles and duration > LONGEST * template.tau.min()
    ):
        return None
    return Separate(own, duration / template.tau)


def roundings(template: Template) -> float:
    """Return the largest number of roundings, including those of the drive."""
    return float(ROUNDED + np.count_nonzero(template.B))


def growth(slope: float, time: float) -> float:
    """Return e^{mt}, the factor by which a cell leaves its unstable rest; at most `STEEPEST`."""
    return math.exp(min(slope * time, math.log(STEEPEST))) if math.isfinite(time) else 1.0


def summed(slope: float, time: float) -> tuple[float, float, float]:
    """Return k, g and c of x = k x₀ + g (w + c x₀), the state after a time in the middle piece.

    Where a cell leaves its unstable rest, k = 1 and c = m: with a rate of 0 it stays. Where it
    comes to a stable one, both terms would cancel there, and k = e^{mt} and c = 0.
    """
    gain = moved(slope, time)
    return (math.exp(slope * time), gain, 0.0) if slope < 0.0 else (1.0, gain, slope)


def moved(slope: float, time: float) -> float:
    """Return (e^{mt} − 1)/m, by which a rate between moves its cell."""
    return math.expm1(min(slope * time, math.log(STEEPEST))) / slope if slope else time


def tips_over(own: float, time: float) -> bool:
    """Return whether rounding decides to which side of an equilibrium cells go, and how far.

    A cell whose rate is within its rounding error may go to either side, and to none if it is 0.
    """
    return math.isinf(time) and own > 1.0


def evaluate(
    scheme: Separate, start: Floats, drive: Floats, rounding: float
) -> tuple[Floats, Floats]:
    """Return x(t) for initial states and drives, and the magnitudes that are rounded.

    Rounding errors of this magnitude occur up to `roundings` times: in the time, in the result, and
    in the numbers of a rate, where they grow along the trajectory like the rate. For a cell that
    may go to either side, the magnitude is so large that nothing is known about the error.

    Parameters
    ----------
    scheme : Separate
    start, drive : (..., layers, rows, cols) float
    rounding : float
        All rounding errors together, relative to those magnitudes.
    """
    end, rounded = np.empty_like(start), np.empty_like(start)
    with np.errstate(all="ignore"):  # some results, computed for all cells, have no use
        for layer, (own, time) in enumerate(zip(scheme.own, scheme.time, strict=True)):
            at = (..., layer, slice(None), slice(None))
            end[at], rounded[at] = _end(float(own), float(time), start[at], drive[at], rounding)
    return end, rounded


def _end(
    own: float, time: float, start: Floats, drive: Floats, rounding: float
) -> tuple[Floats, Floats]:
    side = np.sign(start) * (np.abs(start) > 1.0)
    target, left = drive + own * side, math.exp(-time)
    # d when it comes to its edge; 0 where it never does, or is within it
    edge = np.where(side * target < side * side, (side - target) / (start - target), 0.0)
    away = (side != 0.0) & (edge <= left)
    entered = np.where(edge > left, edge, 1.0)
    now = np.clip(start, -1.0, 1.0)
    inside = _from_inside(own - 1.0, time, entered, now, drive)
    end = np.where(away, target + left * (start - target), inside)
    slope, seen = own - 1.0, np.clip(end, -1.0, 1.0)
    before, after = slope * now + drive, np.abs(slope * seen + drive + (seen - end))
    rounded = np.abs(drive) + np.abs(start) + np.abs(own * now)
    # the rate itself may be but a rounding error, and then says nothing of how such errors grow
    least = UNSURE * rounding * rounded if slope > 0.0 else 0.0
    grown = np.where(np.abs(before) <= least, growth(slope, time), after / np.abs(before))
    late = 0.0 if left == 0.0 else time * after
    numbers = np.abs(end) + np.where(away, left, grown) * rounded + late
    if tips_over(own, time):
        either = (np.abs(before) <= rounding * rounded) & (np.abs(drive) < slope) & ~away
        numbers = np.where(either, 2.0 * LOST / rounding, numbers)
    return end, numbers


def _from_inside(slope: float, time: float, entered: Floats, now: Floats, drive: Floats) -> Floats:
    """Return the end of cells in the middle piece, which they entered when d was `entered`."""
    rate = slope * now + drive
    to = np.where(rate < 0.0, -1.0, 1.0)
    rate_there = slope * to + drive
    # without a rate a cell stays, though it would leave from beside
    leaves = (to * rate_there > 0.0) & ((rate != 0.0) | (slope <= 0.0))
    if math.isinf(time):
        return np.where(leaves, to + rate_there, np.where(rate == 0.0, now, -drive / slope))
    # as a quotient of decays, which is exact where the end is near
    left = np.where(entered < 1.0, np.log(entered / math.exp(-time)), time)
    if slope == 0.0:
        ends, along = (to - now) / rate, left
    else:
        ends = np.log1p(slope * (to - now) / rate) / slope
        along = np.expm1(np.minimum(slope * left, math.log(STEEPEST))) / slope
    over = to + rate_there * (1.0 - np.exp(ends - left))
    between = now * np.exp(slope * left) + drive * along if slope < 0.0 else now + rate * along
    return np.where(leaves & (ends < left), over, between)
