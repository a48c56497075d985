"""Where the eigenvalues of an array's Jacobian lie: exactly where modes are known, else a bound.

J = S(A D − 1) with D = diag f'(x), 0 ≤ f' ≤ 1, whatever cells saturate.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Shape
from cnnum.integrators.spectral import diagonal_in_modes, mode_rates
from cnnum.network import Network
from cnnum.template import Template

EIGENVALUE_LIMIT = 400
"""States up to which the eigenvalues of a linear array without known modes are computed."""


@dataclass(frozen=True, slots=True, eq=False)
class Spectrum:
    """Eigenvalues of the Jacobian, or points that stand for a bound on them.

    Attributes
    ----------
    values : (n,) complex
        1/time.
    exact : bool
        They are the eigenvalues themselves (of the linear array, none saturated).
    real : bool
        All of them are known to be real.
    reason : str
        How they were found.
    """

    values: NDArray[np.complex128]
    exact: bool
    real: bool
    reason: str

    @property
    def fastest(self) -> float:
        """The largest |λ|, 1/time."""
        return float(np.abs(self.values).max())


def spectrum(template: Template, shape: Shape) -> Spectrum:
    """Return the eigenvalues of a template's array, or a bound where they are not known.

    Parameters
    ----------
    template : Template
    shape : (rows, cols)

    Notes
    -----
    A symmetric A keeps the eigenvalues of A D between those of A and 0 (A D is similar to
    D^½ A D^½, whose Rayleigh quotients are A's, shrunk), so its bound is exact for saturating
    outputs too. Otherwise Gershgorin's row sums bound |λ|.
    """
    network = Network(template, shape)
    if template.plain and not template.output.limited:
        linear = _linear(network)
        if linear is not None and template.output.linear:
            return linear
        if linear is not None and _symmetric(template):
            ends = np.array([min(float(linear.values.real.min()), _decay(template)), 0.0])
            ends[1] = max(float(linear.values.real.max()), float(-1.0 / template.tau.max()))
            reason = f"{linear.reason}, A being symmetric"
            return Spectrum(ends.astype(complex), exact=False, real=True, reason=reason)
    rate = np.array([-network.fastest_rate()], dtype=complex)
    return Spectrum(rate, exact=False, real=False, reason="Gershgorin's row sums")


def _decay(template: Template) -> float:
    return float(-1.0 / template.tau.min())


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
    if template.output.linear and network.states <= EIGENVALUE_LIMIT and _normal(network):
        matrix = network.linear_system().matrix
        return _exact(np.asarray(np.linalg.eigvals(matrix), dtype=np.complex128), "its matrix")
    return None


def _exact(values: NDArray[np.float64] | NDArray[np.complex128], reason: str) -> Spectrum:
    found = values.astype(np.complex128)
    real = bool(np.all(np.abs(found.imag) <= 1e-9 * np.abs(found).max()))
    return Spectrum(found, exact=True, real=real, reason=reason)


def _normal(network: Network) -> bool:
    """Whether the matrix commutes with its transpose: then eigenvalues tell all of its growth."""
    matrix = network.linear_system().matrix
    return bool(np.allclose(matrix @ matrix.T, matrix.T @ matrix, atol=1e-12))


def _torus(template: Template, shape: Shape) -> NDArray[np.complex128]:
    kernels = template.A
    radius = int(kernels.shape[-1]) // 2
    offsets = np.arange(-radius, radius + 1)
    waves = [2j * np.pi * np.outer(np.arange(n) / n, offsets) for n in shape]
    coupling = np.einsum(
        "ri,tfij,cj->rctf", np.exp(waves[0]), kernels, np.exp(waves[1]), optimize=True
    )
    rates = (coupling - np.eye(template.layers)) / template.tau[:, np.newaxis]
    return np.asarray(np.linalg.eigvals(rates), dtype=np.complex128).ravel()
