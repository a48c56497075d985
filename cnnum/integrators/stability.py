"""How long a step of each method may be for a template on an array of given size."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats, as_shape
from cnnum.errors import name_error
from cnnum.integrators.delays import delayed_rates, delayed_step
from cnnum.integrators.rosenbrock import IMPLICIT_METHODS, may_be_implicit
from cnnum.integrators.schemes import CHEBYSHEV, LAYER_METHODS
from cnnum.integrators.spectrum import Spectrum, spectrum
from cnnum.integrators.tableau import (
    MAX_STAGES,
    TABLEAUX,
    ButcherTableau,
    LayerMethod,
    chebyshev_method,
)
from cnnum.renamed import warn_of
from cnnum.templating.library import as_template
from cnnum.templating.template import Template

METHODS = (*TABLEAUX, CHEBYSHEV, *LAYER_METHODS, *IMPLICIT_METHODS)
"""Names of the methods that take steps."""

SHORTEST = 1e-4
"""Part of the bound of decays alone below which a method is said to have no stable step."""

TOGETHER = 5000
"""Products of steps and rates that are looked at in one go, as they stay in the cache."""

Complexes = NDArray[np.complex128]


@dataclass(frozen=True, slots=True)
class StabilityBound:
    """The longest step at which no mode that decays grows faster than the array itself may.

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


def stability_bound(
    template: Template | str, shape: Sequence[int] = (8, 8), method: str = "euler"
) -> StabilityBound:
    """Return the longest stable step of a method.

    Parameters
    ----------
    template : Template or str
        A template, or the name of one of the library.
    shape : (rows, cols)
    method : str
        One of `METHODS`. Runge–Kutta–Chebyshev is taken with its largest number of stages.

    Raises
    ------
    ArrayError
        If the shape is not that of an array.
    UnknownNameError
        If there is no such method.

    Notes
    -----
    A mode that grows by itself (Re λ > 0) sets no bound. Rates are those of `spectrum`. Of a linear
    array no other mode grows at all: eigenvalues are held to |R| ≤ 1. Where they are not known, so
    is a box around the field of values. It may leave Euler's and Heun's method no step. An array
    that saturates has rates that change with the cells: steps let none of them grow faster than the
    array itself could, e^{max(Re λ, 0) h}. That holds without saturation or, by Gershgorin's discs,
    with any. With a delay, a mode depends on its past, too (`cnnum.integrators.delays`). Steps are
    whole parts of the delay, and only methods whose stages lie at ends of steps have any.
    """
    if isinstance(shape, Template | str):  # the order of version 0.1
        warn_of("stability_bound(method, template, shape)", "(template, shape, method)")
        template, shape, method = cast("tuple[Any, Any, Any]", (shape, method, template))
    shape = as_shape(shape)
    template = as_template(template)
    if not isinstance(cast(object, method), str):
        raise name_error("method", method, METHODS)
    delayed = delayed_rates(template, shape)
    if delayed is not None and method in METHODS:
        tableau = TABLEAUX.get(method)
        step = delayed_step(tableau, delayed) if tableau else 0.0
        return StabilityBound(step, delayed.exact, delayed.reason)
    found = spectrum(template, shape)
    if method in TABLEAUX:
        step = tableau_step(TABLEAUX[method], found)
    elif method == CHEBYSHEV:
        step = chebyshev_step(MAX_STAGES, found)
    elif method in LAYER_METHODS:
        step = _layer_step(LAYER_METHODS[method], found, template)
    elif method in IMPLICIT_METHODS:
        # |R| ≤ 1 on all of the left half-plane
        step = math.inf if may_be_implicit(template) else 0.0
    else:
        raise name_error("method", method, METHODS)
    return StabilityBound(step, found.exact, found.reason)


def tableau_step(method: ButcherTableau, found: Spectrum) -> float:
    """Return the longest stable step of a Runge–Kutta method for a spectrum."""
    values = _decaying(found)
    fastest = float(np.abs(values).max(initial=0.0))
    if found.real:
        return method.real_stability / fastest if fastest else math.inf
    # |R(z)| > 1 beyond |z| = 8 for every method of up to 7 stages here
    longest = 8.0 / fastest if fastest else math.inf
    if found.discs is not None and found.discs.reach:
        longest = min(longest, method.real_stability / found.discs.reach)
    if math.isinf(longest):
        return math.inf

    def growth(steps: Floats, rates: Complexes) -> Complexes:
        return method.growth(steps[:, np.newaxis] * rates)

    step = _first(_Growth(growth, found), longest * np.geomspace(SHORTEST, 1.0, 500))
    return min(step, longest)


def chebyshev_step(stages: int, found: Spectrum) -> float:
    """Return the longest stable step of a Chebyshev method; 0 where the rates are not real.

    Its region of stability is long and thin along the negative real axis.
    """
    if not found.real:
        return 0.0
    values = _decaying(found)
    fastest = float(np.abs(values).max(initial=0.0))
    return chebyshev_method(stages).real_stability / fastest if fastest else math.inf


def _layer_step(method: LayerMethod, found: Spectrum, template: Template) -> float:
    if np.ptp(template.tau) > 0.0:
        # several decays: the couplings of the fastest layer, as if all decayed like Euler's
        return tableau_step(TABLEAUX["euler"], found)
    tau = float(template.tau[0])

    def growth(steps: Floats, rates: Complexes) -> Complexes:
        return method.growth(steps / tau, rates * tau)

    steps = tau * np.geomspace(1e-4, 60.0, 500)
    step = _first(_Growth(growth, found), steps)
    if found.discs is None:
        return step
    slowest = np.array([-found.discs.reach], dtype=np.complex128)
    ends = Spectrum(slowest, exact=False, real=True, reason=found.reason)
    return min(step, _first(_Growth(growth, ends), steps))


def _decaying(found: Spectrum) -> Complexes:
    """Return the values that decay or only turn, one of each conjugate pair."""
    values = found.values[found.values.real <= 1e-10 * found.fastest]
    return np.asarray(values.real + 1j * np.abs(values.imag), dtype=np.complex128)


def _few(values: Complexes) -> Complexes:
    """Return one value of each cell of a grid of 1/2000 of the fastest.

    Thousands of modes of a large array become a few; the others are looked at in the end.
    """
    size = float(np.abs(values).max(initial=0.0))
    if not size:
        return values[:1]
    return values[np.unique(np.round(values * (2000.0 / size)), return_index=True)[1]]


class _Growth:
    """Which steps let a rate grow by more than it may."""

    __slots__ = ("_all", "_few", "_growth")

    def __init__(self, growth: Callable[[Floats, Complexes], Complexes], found: Spectrum) -> None:
        self._growth = growth
        self._all = [(_decaying(found), found.growth)]
        self._few = [(_few(self._all[0][0]), found.growth)]
        if found.discs is not None:
            around = (found.discs.points, found.discs.growth)
            self._few.append((around[0][::16], around[1]))
            self._all.append(around)

    @property
    def few(self) -> int:
        """How many rates are looked at first."""
        return sum(len(rates) for rates, _ in self._few)

    @property
    def all(self) -> int:
        """How many rates there are."""
        return sum(len(rates) for rates, _ in self._all)

    def of_few(self, steps: Floats) -> NDArray[np.bool_]:
        """Look at one rate of each kind, and one of many points around the discs."""
        return self._grows(steps, self._few)

    def of_all(self, steps: Floats) -> NDArray[np.bool_]:
        """Look at every rate."""
        return self._grows(steps, self._all)

    def _grows(self, steps: Floats, parts: list[tuple[Complexes, float]]) -> NDArray[np.bool_]:
        found = np.zeros(len(steps), dtype=bool)
        for rates, allowed in parts:
            sizes = np.abs(self._growth(steps, rates))
            found |= (sizes > self._limits(steps, allowed)[:, np.newaxis]).any(axis=1)
        return found

    def _limits(self, steps: Floats, allowed: float) -> Floats:
        """Return how much a rate may grow: as the array itself may, exactly or in such steps."""
        if not allowed:
            return np.full(len(steps), 1.0 + 1e-9)
        own = np.abs(self._growth(steps, np.array([allowed + 0j])))[:, 0]
        return np.maximum(own, np.exp(np.minimum(steps * allowed, 700.0))) * (1.0 + 1e-9)


Grows = Callable[[Floats], NDArray[np.bool_]]


def _first(growth: _Growth, steps: Floats) -> float:
    """Return the longest step before the first that lets a rate grow; infinite if none does."""
    step = _before(growth.of_few, steps, growth.few)
    tried = float(steps[-1]) if math.isinf(step) else step
    if not _at(growth.of_all, tried):
        return step
    for share in (0.999, 0.99, 0.9):
        if not _at(growth.of_all, share * tried):
            return _bisect(growth.of_all, share * tried, tried)
    return _before(growth.of_all, tried * np.geomspace(SHORTEST, 1.0, 100), growth.all)


def _at(grows: Grows, step: float) -> bool:
    return bool(grows(np.array([step]))[0])


def _before(grows: Grows, steps: Floats, rates: int) -> float:
    """Return the longest step before the first that lets one of these rates grow."""
    count = max(1, TOGETHER // max(rates, 1))
    for start in range(0, len(steps), count):
        found = grows(steps[start : start + count])
        if found.any():
            at = start + int(found.argmax())
            return _bisect(grows, float(steps[at - 1]), float(steps[at])) if at else 0.0
    return math.inf


def _bisect(grows: Grows, low: float, high: float) -> float:
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if _at(grows, middle) else (middle, high)
    return low
