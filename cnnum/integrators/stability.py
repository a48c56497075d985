"""How long a step of each method may be for a template on an array of given size."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Shape
from cnnum.errors import name_error
from cnnum.integrators.chebyshev import MAX_STAGES, chebyshev_method
from cnnum.integrators.exponential import EXPONENTIAL_METHODS, ExponentialMethod
from cnnum.integrators.spectrum import Spectrum, spectrum
from cnnum.integrators.tableau import TABLEAUX, ButcherTableau
from cnnum.template import Template

CHEBYSHEV = "runge-kutta-chebyshev"

METHODS = (*TABLEAUX, CHEBYSHEV, *EXPONENTIAL_METHODS)
"""Names of the methods that take steps."""

Complexes = NDArray[np.complex128]


@dataclass(frozen=True, slots=True)
class StabilityBound:
    """The longest step at which no mode that decays grows.

    Attributes
    ----------
    step : float
        Time constants' unit; infinite where no step is too long, 0 where every step is.
    exact : bool
        It is that of the linear array itself, not of a bound on its rates.
    reason : str
        Where the rates are from.
    """

    step: float
    exact: bool
    reason: str


def stability_bound(method: str, template: Template, shape: Shape) -> StabilityBound:
    """Return the longest stable step of a method.

    Parameters
    ----------
    method : str
        One of `METHODS`. Runge–Kutta–Chebyshev is taken at its most stages.
    template : Template
    shape : (rows, cols)

    Raises
    ------
    UnknownNameError
        If there is no such method.

    Notes
    -----
    A mode that grows by itself (Re λ > 0) sets no bound. Rates are those of `spectrum`: exact
    where the array is linear and its modes are known, else Gershgorin's row sums, taken as real.
    """
    found = spectrum(template, shape)
    if method in TABLEAUX:
        step = tableau_step(TABLEAUX[method], found)
    elif method == CHEBYSHEV:
        step = chebyshev_step(MAX_STAGES, found)
    elif method in EXPONENTIAL_METHODS:
        step = _exponential_step(EXPONENTIAL_METHODS[method], found, template)
    else:
        raise name_error("method", method, METHODS)
    return StabilityBound(step, found.exact, found.reason)


def tableau_step(method: ButcherTableau, found: Spectrum) -> float:
    """Return the longest stable step of a Runge–Kutta method for a spectrum."""
    values = _decaying(found)
    if not len(values):
        return math.inf
    fastest = float(np.abs(values).max())
    if fastest == 0.0:
        return math.inf
    if found.real or not found.exact:
        return method.real_stability / fastest
    # |R(z)| > 1 beyond |z| = 8 for every method of up to 7 stages here
    return _first_growth(method.growth, values, 8.0 / fastest)


def chebyshev_step(stages: int, found: Spectrum) -> float:
    """Return the longest stable step of a Chebyshev method; 0 where the rates are not real.

    Its region of stability is long and thin along the negative real axis.
    """
    if not found.real:
        return 0.0
    values = _decaying(found)
    fastest = float(np.abs(values).max(initial=0.0))
    return chebyshev_method(stages).real_stability / fastest if fastest else math.inf


def _exponential_step(method: ExponentialMethod, found: Spectrum, template: Template) -> float:
    if np.ptp(template.tau) > 0.0:
        # several decays: the couplings of the fastest layer, as if all decayed like Euler's
        return tableau_step(TABLEAUX["euler"], found)
    tau = float(template.tau[0])
    values = _decaying(found) * tau
    if not len(values):
        return math.inf

    def grows(step: float) -> bool:
        return bool((np.abs(method.growth(step, values)) > 1.0 + 1e-9).any())

    return tau * _first(grows, np.geomspace(1e-4, 60.0, 600))


def _decaying(found: Spectrum) -> Complexes:
    """Return the distinct values that decay or only turn, one of each conjugate pair."""
    size = found.fastest
    values = found.values[found.values.real <= 1e-9 * size]
    folded = values.real + 1j * np.abs(values.imag)
    # to 1/2000 of the fastest: thousands of modes of a large array become a few
    return np.unique(np.round(folded * (2000.0 / size))) * (size / 2000.0) if size else folded


def _first_growth(
    growth: Callable[[Complexes], Complexes], values: Complexes, longest: float
) -> float:
    def grows(step: float) -> bool:
        return bool((np.abs(growth(step * values)) > 1.0 + 1e-9).any())

    return _first(grows, longest * np.geomspace(1e-5, 1.0, 800))


def _first(grows: Callable[[float], bool], steps: NDArray[np.float64]) -> float:
    """Return the longest step before the first that grows, by bisection; infinite if none does."""
    low = 0.0
    for high in steps:
        if grows(float(high)):
            return _bisect(grows, low, float(high)) if low else 0.0
        low = float(high)
    return math.inf


def _bisect(grows: Callable[[float], bool], low: float, high: float) -> float:
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if grows(middle) else (middle, high)
    return low
