"""Where the eigenvalues of an array's Jacobian lie: exactly where they are known, else a bound.

J = S(A D − 1) with D = diag f'(x), 0 ≤ f' ≤ 1, whatever cells saturate.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Shape
from cnnum.integrators.enclosure import Discs, discs, field_of_values, torus_coupling
from cnnum.integrators.exact_ends.spectral import diagonal_in_modes, mode_rates
from cnnum.templating.network import Network
from cnnum.templating.template import Template

EIGENVALUE_LIMIT = 256
"""States up to which the eigenvalues of an array without known modes are computed: a tenth of a
second."""


@dataclass(frozen=True, slots=True, eq=False)
class Spectrum:
    """Eigenvalues of the Jacobian, or points around a region that holds them.

    Attributes
    ----------
    values : (n,) complex
        1/time: of the array while no cell saturates.
    exact : bool
        They are the eigenvalues themselves (of the linear array, none saturated).
    real : bool
        All of them are known to be real, and to cover all of the array's growth.
    reason : str
        How they were found.
    growth : float
        Rate at which a step may let a decaying rate grow: that of the fastest growth of an array
        that saturates, else 0.
    discs : Discs, optional
        A bound on the rates whatever cells saturate, or for the growth that eigenvalues miss.
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
    """Return the eigenvalues of a template's array, or a bound where they are not known.

    Parameters
    ----------
    template : Template
    shape : (rows, cols)

    Notes
    -----
    A symmetric A keeps the eigenvalues of A D between those of A and 0: A D is similar to D^½ A
    D^½, whose Rayleigh quotients are A's, shrunk. So its bound is exact for saturating outputs too.
    Otherwise the array has the rates of no saturation. Where they are not known it has a box around
    its field of values. Gershgorin's discs bound the rest.
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
        return _of_matrix(network)
    return None


def _of_matrix(network: Network) -> Spectrum:
    """Return the eigenvalues of the matrix, with discs where they miss a part of its growth."""
    matrix = network.linear_system().matrix
    found = _exact(np.asarray(np.linalg.eigvals(matrix), dtype=np.complex128), "its matrix")
    if np.allclose(matrix @ matrix.T, matrix.T @ matrix, atol=1e-12):
        return found
    # a matrix that does not commute with its transpose: its powers may grow long before they decay
    return Spectrum(found.values, True, False, "its matrix", discs=discs(network))


def _exact(values: NDArray[np.float64] | NDArray[np.complex128], reason: str) -> Spectrum:
    found = values.astype(np.complex128)
    real = bool(np.all(np.abs(found.imag) <= 1e-9 * np.abs(found).max()))
    return Spectrum(found, exact=True, real=real, reason=reason)


def _torus(template: Template, shape: Shape) -> NDArray[np.complex128]:
    rates = torus_coupling(template, shape) - np.eye(template.layers)
    rates = rates / template.tau[:, np.newaxis]
    return np.asarray(np.linalg.eigvals(rates), dtype=np.complex128).ravel()
