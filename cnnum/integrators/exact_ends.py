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
from typing import ClassVar

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
    result = np.einsum("ri,tfij,cj->tfrc", along_rows, kernels, along_cols, optimize=True)
    return np.asarray(result, dtype=np.float64)


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
"""Weights above which it is not offered: as many as the largest dense product has."""

MOST_CELLS = 1024
"""Cells of a layer above which it is not offered: each cell is a sum over all of them."""

WAVE_BYTES = 80
"""Held at once for a wave of one pair of layers: complex numbers, their inverse and copies."""


@dataclass(frozen=True, slots=True, eq=False)
class Circulant:
    """x = drive ∗ w on a torus: the equilibrium of a linear array there, from any start.

    A coupling on a torus is a convolution, so that it is a factor of each wave, even or not. Of a
    wave the equilibrium is (1 − Â)⁻¹ of its drive, with Â the layers × layers matrix of A.

    Attributes
    ----------
    drive : (layers, layers, rows, cols) float
        As [to, from]: the answer to a drive of 1 of the cell (0, 0).
    rounding : float
        By how much it may be off itself, as a part of the largest number in a drive.
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
    """Return the equilibrium of an array on a torus, None where there is none.

    There is none where the array is not linear, its boundary is another, or not every wave decays.

    Raises
    ------
    SizeError
        If its waves do not fit into memory.
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
"""1/time: a mode or wave that decays more slowly counts as one that does not."""

EXPONENTIAL = 1024.0 * float(np.finfo(np.float64).eps)
"""The error bound of SciPy's exponential of a matrix, as a part of its norm and of ‖M‖t, or of 1
where that is less: of 3,000 random ones with a norm of 0.1 to 200 the worst was off by 735."""


@dataclass(frozen=True, slots=True, eq=False)
class Decay:
    """Cells that do not see each other (A = 0): x(t) = w + (x₀ − w) e^{−t/τ}.

    Attributes
    ----------
    kept : (layers,) float
        e^{−t/τ} of every layer; 0 at equilibrium, and 1 where no time passes: then a cell is at
        its start, which a sum with its drive would round.
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
    """x(t) = state · x₀ + drive · w + constant, layers stacked, cells row-major.

    Attributes
    ----------
    state, drive : (n, n) float
    constant : (n,) float
        The sum of a fixed boundary.
    rounding : float
        By how much the matrices themselves may be off, as a part of the largest number in a state.
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
    """Return by how many roundings of its largest number a sum of products is off at most.

    Of a sum over columns each term is rounded by every addition from its own on. See Higham,
    Accuracy and Stability of Numerical Algorithms, 2002, section 3.1. The bound is the largest over
    rows of Σ |b_ij| · passes_j. Its unit is half the distance from 1 to the next number.

    Parameters
    ----------
    matrices : sequence of (rows, n) float
    passes : sequence of (n,) float
        Of each matrix how often its terms are rounded.
    """
    rows = sum(
        (np.abs(matrix) @ times for matrix, times in zip(matrices, passes, strict=True)),
        np.zeros(1),
    )
    return float(np.max(rows))


def passes_in_fours(columns: int) -> Floats:
    """Return how often a column is rounded by the additions from its own on.

    The sums of four columns at a time are added, then those that are left one by one.
    """
    alone = columns % 4
    fours = np.repeat(np.arange(columns // 4, 0, -1) + alone, 4)
    return np.concatenate([fours, np.arange(alone, 0, -1)]).astype(np.float64)


def decay(template: Template, duration: float) -> Decay:
    """Return the exact answer of uncoupled cells after `duration` (infinite: equilibrium)."""
    with np.errstate(under="ignore"):
        return Decay(np.exp(-duration / template.tau))


def propagator(network: Network, duration: float) -> Propagator | None:
    """Return the exact answer of a linear array after `duration`, None where there is none.

    An infinite duration asks for the equilibrium, which exists where every mode decays.
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

ROUNDED = 8
"""Rounded operations from one end of a cell's way to the other, at the most; the drive apart."""


@dataclass(frozen=True, slots=True, eq=False)
class Separate:
    """Cells that see only themselves, with the standard output function.

    Attributes
    ----------
    own : (layers,) float
        a of every layer.
    time : (layers,) float
        t/τ at the end of every layer; infinite at equilibrium.
    """

    own: Floats
    time: Floats

    rounding: ClassVar[float] = 0.0


def separate(template: Template, duration: float) -> Separate | None:
    """Return the exact answer after `duration` (infinite: equilibrium), None where there is none.

    There is none where a cell sees another one, f is another, or a run is too long. Nor is there
    one at equilibrium for a = 1, whose cells may rest anywhere.
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
    """Return how many roundings there are at most, those of its drive counted."""
    return float(ROUNDED + np.count_nonzero(template.B))


def growth(slope: float, time: float) -> float:
    """Return e^{mt}, by which a cell goes away from its rest between; `STEEPEST` at the most."""
    return math.exp(min(slope * time, math.log(STEEPEST))) if math.isfinite(time) else 1.0


def moved(slope: float, time: float) -> float:
    """Return (e^{mt} − 1)/m, by which a rate between moves its cell."""
    return math.expm1(min(slope * time, math.log(STEEPEST))) / slope if slope else time


def tips_over(own: float, time: float) -> bool:
    """Return whether cells fall to one side or the other of an equilibrium, and how far: to a rest.

    A cell whose rate is no more than its roundings may fall to either, and at a rate of 0 to none.
    """
    return math.isinf(time) and own > 1.0


def evaluate(
    scheme: Separate, start: Floats, drive: Floats, rounding: float
) -> tuple[Floats, Floats]:
    """Return x(t) of (..., layers, rows, cols) initial states and drives, and the rounded numbers.

    Roundings of that size are made up to `roundings` times: of time, of the end, and of the numbers
    in a rate. These grow along the way as the rate does. The numbers of a cell that may fall to
    either side are so large that nothing is known of the error.

    Parameters
    ----------
    scheme : Separate
    start, drive : (..., layers, rows, cols) float
    rounding : float
        All roundings together, as a part of those numbers.
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
    grown = np.where(before == 0.0, growth(slope, time), after / np.abs(before))
    rounded = np.abs(drive) + np.abs(start) + np.abs(own * now)
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
