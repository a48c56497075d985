"""Where the eigenvalues of an array's Jacobian lie: exactly, or within a region.

Regions that hold the eigenvalues of an array, where these are not known.

* The field of values of M = S (A − 1): a box from the extents of its symmetric and its skew part.
  It bounds powers too, however far M is from normal: ‖p(M)‖ ≤ (1 + √2) max |p| over it (Crouzeix &
  Palencia, SIAM J. Matrix Anal. Appl. 38 (2017) 649-655).
* Gershgorin's discs of S (A D − 1), whatever cells saturate: centre (−1 + d a_kk)/τ with
  0 ≤ d ≤ 1 (d = 1 where f(x) = x), radius Σ |a_kj|/τ.

J = S(A D − 1) with D = diag f'(x), 0 ≤ f' ≤ 1, whatever cells saturate.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats, Shape, distinct
from cnnum.integrators.closed_forms import diagonal_in_modes, mode_rates
from cnnum.integrators.estimate import error_growth
from cnnum.safety.values import refuse_on_host
from cnnum.templating.network import Network, widened
from cnnum.templating.template import Template
from cnnum.values import ByContent

Complexes = NDArray[np.complex128]

POINTS = 400
"""Points a side of a box or a quarter of a circle."""

MODE_BYTES = 80
"""Held at once for a Fourier mode of one layer: its coupling, its eigenvalues and their copies."""

SAMPLE_LIMIT = 800
"""States of the small array whose rows represent those of a large one; more take seconds."""


@dataclass(frozen=True, slots=True)
class Box:
    """Real parts from `left` to `right`, imaginary parts from −`height` to `height`, 1/time."""

    left: float
    right: float
    height: float

    def decaying(self) -> Complexes:
        """Return points around the upper half of the part with Re ≤ 0; none if that is empty."""
        if self.left > 0.0:
            return np.zeros(0, dtype=np.complex128)
        along = np.linspace(self.left, min(self.right, 0.0), POINTS)
        up = 1j * np.linspace(0.0, self.height, POINTS)
        sides = (along + 0j, along + 1j * self.height, along[0] + up, along[-1] + up)
        return distinct(np.concatenate(sides).astype(np.complex128))


@dataclass(frozen=True, slots=True, eq=False)
class Discs(ByContent):
    """Gershgorin's discs of an array, whichever cells saturate.

    Attributes
    ----------
    points : (n,) complex
        Points around the upper half of their union, 1/time.
    growth : float
        Largest real part of the discs if positive, otherwise 0.
    reach : float
        Largest |λ| in the discs.
    """

    points: Complexes
    growth: float
    reach: float


def discs(network: Network) -> Discs:
    """Return the discs of an array; couplings that are not plain widen them by their slopes."""
    template, reach = network.template, network.fastest_rate()
    own = _own(template)
    growth = max(error_growth(template), 0.0)
    parts: list[Complexes] = []
    for layer, tau in enumerate(template.tau.tolist()):
        # a cell that saturates sees nothing of itself; a linear one does not saturate
        least, seen = (slope * float(own[layer]) for slope in template.output.slope)
        parts.append(_around(least - 1.0, seen - 1.0, _others(template, layer)) / tau)
    return Discs(distinct(np.concatenate(parts)), growth, reach)


def _around(this: float, other: float, radius: float) -> Complexes:
    """Return points around two discs and those in between, upper half."""
    angles = np.linspace(0.0, np.pi, 2 * POINTS)
    turn = np.asarray(radius * np.exp(1j * angles), dtype=np.complex128)
    tops = np.linspace(this, other, POINTS, dtype=np.complex128) + 1j * radius
    return np.concatenate([this + turn, other + turn, tops])


def _own(template: Template) -> Floats:
    middle = template.A.shape[-1] // 2
    return np.array([template.A[n, n, middle, middle] for n in range(template.layers)])


def _others(template: Template, layer: int) -> float:
    total = float(np.abs(template.A[layer]).sum()) - abs(float(_own(template)[layer]))
    total *= template.output.steepest
    return total + float(widened(template)[layer])


def field_of_values(network: Network) -> Box:
    """Return a box around the field of values of an unsaturated array with plain couplings.

    With D = S^½ the matrix is D⁻¹ M D = −S + D A D, which has the same eigenvalues.
    """
    template = network.template
    if template.boundary.constant is not None:
        return _torus_box(network)
    radius = template.A.shape[-1] // 2
    # an array of this size has every row of a large one, and the reach into it from the rim
    rows, cols = (min(n, 4 * radius + 1) for n in network.shape)
    sample = Network(template, (rows, cols))
    if sample.states > SAMPLE_LIMIT:
        return _row_box(network)
    system = sample.linear_system()
    root = np.sqrt(system.rates)
    matrix = system.matrix / root[:, None] * root
    even, odd = 0.5 * (matrix + matrix.T), 0.5 * (matrix - matrix.T)
    middle = np.diag(even)
    radii = np.abs(even).sum(axis=1) - np.abs(middle)
    height = float(np.abs(odd).sum(axis=1).max())
    return Box(float((middle - radii).min()), float((middle + radii).max()), height)


def _torus_box(network: Network) -> Box:
    """An array with a fixed rim is part of a torus that is larger by the radius of its couplings.

    The field of values of a part lies within that of the whole.
    """
    template = network.template
    radius = template.A.shape[-1] // 2
    root = np.sqrt(1.0 / template.tau)
    coupling = torus_coupling(template, (network.shape[0] + radius, network.shape[1] + radius))
    matrix = coupling * np.outer(root, root) - np.diag(root**2)
    adjoint = np.conj(np.swapaxes(matrix, -1, -2))
    real = np.linalg.eigvalsh(0.5 * (matrix + adjoint))
    turning = np.linalg.eigvalsh(-0.5j * (matrix - adjoint))
    return Box(float(real.min()), float(real.max()), float(np.abs(turning).max()))


def _row_box(network: Network) -> Box:
    around = discs(network)
    return Box(-around.reach, error_growth(network.template), float(around.points.imag.max()))


def torus_coupling(template: Template, shape: tuple[int, int]) -> Complexes:
    """Return A of every Fourier mode of a torus, (rows, cols, layers, layers).

    Raises
    ------
    SizeError
        If they do not fit into memory.
    """
    refuse_on_host("The modes of an array", shape, MODE_BYTES * template.layers**2)
    radius = int(template.A.shape[-1]) // 2
    offsets = np.arange(-radius, radius + 1)
    waves = [2j * np.pi * np.outer(np.arange(n) / n, offsets) for n in shape]
    result = np.einsum(
        "ri,tfij,cj->rctf", np.exp(waves[0]), template.A, np.exp(waves[1]), optimize=True
    )
    return np.asarray(result, dtype=np.complex128)


KEPT = 512
"""Matrices whose eigenvalues are kept: a search runs every template of the library many times."""

EIGENVALUE_LIMIT = 256
"""States up to which the eigenvalues of an array without known modes are computed: a tenth of a
second."""


@dataclass(frozen=True, slots=True, eq=False)
class Spectrum(ByContent):
    """Eigenvalues of the Jacobian, or points around a region that holds them.

    Attributes
    ----------
    values : (n,) complex
        Values for the array while no cell saturates, 1/time.
    exact : bool
        Whether the values are the eigenvalues themselves (of the array without saturation).
    real : bool
        Whether all values are known to be real, and to cover all growth of the array.
    reason : str
        How the values were obtained.
    growth : float
        Rate at which a step may let a decaying mode grow: the fastest growth rate of an array that
        saturates, otherwise 0.
    discs : Discs, optional
        Bound on the rates, whichever cells saturate, or for growth that the eigenvalues miss.
    """

    values: NDArray[np.complex128]
    exact: bool
    real: bool
    reason: str
    growth: float = 0.0
    discs: Discs | None = None

    @property
    def fastest(self) -> float:
        """The largest |λ|, 1/time."""
        known = float(np.abs(self.values).max(initial=0.0))
        return known if self.discs is None else max(known, self.discs.reach)


def spectrum(template: Template, shape: Shape) -> Spectrum:
    """Return the eigenvalues of a template's array, or a bound if they are not known.

    Parameters
    ----------
    template : Template
    shape : (rows, cols)

    Notes
    -----
    For a symmetric A, the eigenvalues of A D lie between those of A and 0, because A D is similar
    to D^½ A D^½, whose Rayleigh quotients are those of A times factors of at most 1. The bound is
    thus exact for saturating outputs as well. Otherwise, the values are those without saturation
    or, if these are not known, a box around the field of values. Gershgorin's discs bound the rest.
    """
    network = Network(template, shape)
    if not (template.plain and template.output.saturates):
        none = np.zeros(0, dtype=np.complex128)
        return Spectrum(none, False, False, "Gershgorin's discs", discs=discs(network))
    linear = _linear(network)
    if template.output.linear:
        return linear or _boxed(network)
    if linear is not None and _symmetric(template) and not template.output.limited:
        values = np.concatenate([linear.values.real, -1.0 / template.tau]).astype(complex)
        reason = f"{linear.reason}, A being symmetric"
        return Spectrum(values, exact=False, real=True, reason=reason)
    inner = linear or _boxed(network)
    reason = f"{inner.reason}, and Gershgorin's discs where cells saturate"
    growth = float(inner.values.real.max(initial=0.0)) if inner.exact else inner.growth
    return Spectrum(inner.values, False, False, reason, growth, discs(network))


def _boxed(network: Network) -> Spectrum:
    box = field_of_values(network)
    growth = 0.0 if network.template.output.linear else max(box.right, 0.0)
    reason = "a box around its field of values"
    return Spectrum(box.decaying(), False, False, reason, growth, discs(network))


def _symmetric(template: Template) -> bool:
    """Whether the matrix of A is symmetric: even kernels, the same both ways between layers."""
    return bool(
        np.array_equal(template.A, np.swapaxes(template.A, 0, 1))
        and np.ptp(template.tau) == 0.0
        and diagonal_in_modes(template)
    )


def _linear(network: Network) -> Spectrum | None:
    template, shape = network.template, network.shape
    if template.uncoupled:
        return _exact(-1.0 / template.tau, "A = 0: every cell decays on its own")
    if diagonal_in_modes(template):
        rates = mode_rates(template, shape)
        values = np.asarray(np.linalg.eigvals(rates), dtype=np.complex128).ravel()
        return _exact(values, "the modes of its boundary")
    if template.boundary.pad_mode == "wrap":
        return _exact(_torus(template, shape), "the Fourier modes of a torus")
    if network.states <= EIGENVALUE_LIMIT:
        return _of_matrix(template, shape)
    return None


@lru_cache(maxsize=KEPT)
def _of_matrix(template: Template, shape: Shape) -> Spectrum:
    """Return the eigenvalues of the matrix, with discs where they miss a part of its growth."""
    network = Network(template, shape)
    matrix = network.linear_system().matrix
    result = _exact(np.asarray(np.linalg.eigvals(matrix), dtype=np.complex128), "its matrix")
    if np.allclose(matrix @ matrix.T, matrix.T @ matrix, atol=1e-12):
        return result
    # a matrix that does not commute with its transpose: its powers may grow long before they decay
    return Spectrum(result.values, True, False, "its matrix", discs=discs(network))


def _exact(values: NDArray[np.float64] | NDArray[np.complex128], reason: str) -> Spectrum:
    result = values.astype(np.complex128)
    real = bool(np.all(np.abs(result.imag) <= 1e-9 * np.abs(result).max()))
    return Spectrum(result, exact=True, real=real, reason=reason)


def _torus(template: Template, shape: Shape) -> NDArray[np.complex128]:
    rates = torus_coupling(template, shape) - np.eye(template.layers)
    rates = rates / template.tau[:, np.newaxis]
    return np.asarray(np.linalg.eigvals(rates), dtype=np.complex128).ravel()
