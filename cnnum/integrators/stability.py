"""How long a step of each method may be for a template on an array, with delays and without.

How long a step may be where an array also sees its outputs a delay ago.

Take steps h = T/m of a Runge–Kutta method whose stages lie at the ends of a step. A mode x' = λ x +
μ x(t − T) then moves by x_{n+1} = P x_n + Q₀ x_{n−m} + Q₁ x_{n+1−m}. It decays if all roots of

    z^{m+1} − P z^m − Q₁ z − Q₀

lie within the unit circle, which Schur's reflections show (Jury, Theory and Application of the
z-Transform Method, 1964). The mode itself moves as e^{σt}, σ = λ + W₀(μ T e^{−λT}) / T (Corless et
al., On the Lambert W function, 1996). Where modes are not known, |P| + |Q₀| + |Q₁| bounds an
error's growth in a step. It is taken over the bounds of the rates. Halanay's ρ = λ + |μ| e^{−ρT}
bounds the array's own growth.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats, Shape, as_shape, distinct
from cnnum.errors import name_error
from cnnum.integrators.closed_forms import diagonal_in_modes, mode_rates
from cnnum.integrators.rosenbrock import IMPLICIT_METHODS, may_be_implicit
from cnnum.integrators.schemes import CHEBYSHEV, LAYER_METHODS
from cnnum.integrators.spectrum import Discs, Spectrum, discs, spectrum, torus_coupling
from cnnum.integrators.tableau import (
    MAX_STAGES,
    TABLEAUX,
    ButcherTableau,
    LayerMethod,
    Row,
    chebyshev_method,
)
from cnnum.renamed import warn_of
from cnnum.templating.library import as_template
from cnnum.templating.network import Network
from cnnum.templating.template import Template

Complexes = NDArray[np.complex128]

MOST_STEPS = 1024
"""Largest number of steps per delay that is tried."""

MODES = 400
"""Largest number of modes that are examined; if there are more, a grid of them is."""

COARSER = (200, 100, 50, 25, 12, 6)
"""Cells a side of the grids over many modes."""

STEEPEST = 600.0
"""Largest exponent in Lambert's function; σ comes out smaller beyond, and the bound shorter."""

LARGEST = 700.0
"""Largest exponent of a growth over a delay."""

ROUNDING = 1e-9
"""The growth allowed to a decaying mode in a step."""

KEPT = 32
"""Answers that are kept: runs in halved steps, and other engines, ask the same of a template."""


MOST_KEPT = 1 << 14
"""Rates of an array whose answer is kept."""


@dataclass(frozen=True, slots=True, eq=False)
class DelayedRates:
    """Rates of an array due to its present outputs and to its delayed ones.

    Attributes
    ----------
    now, late : (n,) complex
        λ and μ of the modes that decay while no cell saturates, 1/time; empty if they are not
        known.
    growth, around_growth : float
        Rates at which a step may let a decaying mode grow, and one within the bound: the fastest
        growth rates of an array that saturates, otherwise 0.
    around : Discs, optional
        Bound on λ, whichever cells saturate; None if the modes suffice.
    reach : float
        Bound on |μ|, 1/time.
    delay : float
    exact : bool
        Whether the rates contain every mode of a linear array.
    """

    now: Complexes
    late: Complexes
    growth: float
    around_growth: float
    around: Discs | None
    reach: float
    delay: float
    exact: bool

    @property
    def reason(self) -> str:
        """Where the rates are from."""
        known = "the modes of its boundary and their delay's" if len(self.now) else ""
        bound = "Gershgorin's discs and those of its delay" if self.around is not None else ""
        return ", and ".join(part for part in (known, bound) if part)


@lru_cache(maxsize=KEPT)
def delayed_rates(template: Template, shape: Shape) -> DelayedRates | None:
    """Return the rates of an array with delayed couplings, or None if it has none."""
    delayed = template.delayed
    if delayed is None or not delayed.A.any():
        return None
    reach = float((np.abs(delayed.A).sum(axis=(1, 2, 3)) / template.tau).max())
    all_now, all_late = _modes(replace(template, delayed=None), delayed.A, shape)
    now, late = _few_modes(all_now, all_late)
    own = now + _lambert(now, late, delayed.delay)
    decays = own.real <= 1e-10 * max(float(np.abs(now).max(initial=0.0)), reach)
    # a mode has many rates with a delay: where its first grows, others decay, and may be too fast
    known = template.output.linear and len(now) > 0 and bool(decays.all())
    exact = known and len(now) == len(all_now)
    around = None if known else discs(Network(template, shape))
    growth = around_growth = 0.0
    if around is not None:
        growth = float(own.real.max(initial=0.0))
        around_growth = max(_halanay(around, reach, delayed.delay), growth)
    return DelayedRates(
        now[decays],
        late[decays],
        growth,
        around_growth,
        around,
        reach,
        delayed.delay,
        exact,
    )


@lru_cache(maxsize=KEPT)
def delayed_step(method: ButcherTableau, rates: DelayedRates) -> float:
    """Return the longest step of a Runge–Kutta method with which no decaying mode grows.

    Parameters
    ----------
    method : ButcherTableau
    rates : DelayedRates

    Returns
    -------
    float
        An integer fraction of the delay, like all steps. Infinite if no step is too long; 0 if no
        stable step is found, or the method needs outputs between the steps.
    """
    if not keeps_delays(method):
        return 0.0
    ladder = sorted(
        {round(float(count)) for count in np.geomspace(1.0, MOST_STEPS, 41)}, reverse=True
    )
    place = next((k for k, count in enumerate(ladder) if _grows(method, rates, count)), None)
    if place is None:
        return math.inf
    if not place:
        return 0.0
    stable, grows = ladder[place - 1], ladder[place]
    while stable - grows > 1:
        middle = (stable + grows) // 2
        if _grows(method, rates, middle):
            grows = middle
        else:
            stable = middle
    return rates.delay / stable


def keeps_delays(method: ButcherTableau) -> bool:
    """Return whether all stages of a method lie at ends of steps, whose outputs are kept."""
    return all(sum(row) in (0, 1) for row in method.a)


def _modes(template: Template, late: Floats, shape: Shape) -> tuple[Complexes, Complexes]:
    """Return λ and μ of an array's modes, of one layer whose couplings share them."""
    none = np.zeros(0, dtype=np.complex128)
    if template.layers > 1 or not template.plain or template.output.limited:
        return none, none
    other = replace(template, A=late)
    tau = float(template.tau[0])
    if diagonal_in_modes(template) and diagonal_in_modes(other):
        result = [
            mode_rates(form, shape).ravel().astype(np.complex128) for form in (template, other)
        ]
    elif template.boundary.pad_mode == "wrap":
        result = [(torus_coupling(form, shape).ravel() - 1.0) / tau for form in (template, other)]
    else:
        return none, none
    return result[0], result[1] + 1.0 / tau


def _few_modes(now: Complexes, late: Complexes) -> tuple[Complexes, Complexes]:
    """Return modes; of many one for each cell of a grid over them, and the outermost."""
    if len(now) <= MODES:
        return now, late
    size = max(float(np.abs(now).max()), float(np.abs(late).max()))
    both = np.stack([now.real, now.imag, late.real, late.imag]) / size
    at = np.zeros(0, dtype=np.intp)
    for cells in COARSER:
        keys = np.ravel_multi_index(
            list(np.rint((both + 1.0) * cells).astype(int)), 4 * [2 * cells + 1]
        )
        at = np.unique(keys, return_index=True)[1]
        if len(at) <= MODES:
            break
    chosen = distinct(np.concatenate([at, both.argmin(axis=1), both.argmax(axis=1)]))
    return now[chosen], late[chosen]


def _grows(method: ButcherTableau, rates: DelayedRates, count: int) -> bool:
    """Return whether a rate that decays grows in steps of a delay over `count`."""
    step, around = rates.delay / count, rates.around
    size = _exponential(rates.growth * step, count) * (1.0 + ROUNDING)
    if _beyond(_parts(method, step * rates.now, step * rates.late), count, size):
        return True
    if around is None:
        return False
    size = _allowed(method, rates, around, count) * (1.0 + ROUNDING)
    parts = _parts(method, step * around.points, np.full(1, step * rates.reach + 0j))
    return bool(np.any(_bound(parts, count, size) > size))


def _exponential(growth: float, count: int) -> float:
    return math.exp(min(growth, LARGEST / (count + 1)))


def _allowed(method: ButcherTableau, rates: DelayedRates, around: Discs, count: int) -> float:
    """Return how much a bound may grow in a step: as the array itself may, exactly or in steps."""
    from scipy.optimize import brentq  # imported late: it takes longer than all of the engine

    step = rates.delay / count
    # a decay within a step is no excuse for a step that is too long
    rightmost = max(float(around.points.real.max()), -1.0 / step)
    parts = _parts(method, np.full(1, step * rightmost + 0j), np.full(1, step * rates.reach + 0j))

    def left(size: float) -> float:
        return size - float(_bound(parts, count, size)[0])

    longest = float(_bound(parts, count, 1.0)[0])
    in_steps = float(brentq(left, 1.0, longest)) if longest > 1.0 else 1.0
    return max(_exponential(rates.around_growth * step, count), in_steps)


def _halanay(around: Discs, reach: float, delay: float) -> float:
    """Return the fastest growth ρ = λ + |μ| e^{−ρT} that the bounds allow, 0 where there is none.

    Halanay, Differential Equations: Stability, Oscillations, Time Lags (1966), ch. 4.
    """
    from scipy.optimize import brentq

    now = float(around.points.real.max())
    if now + reach <= 0.0:
        return 0.0
    return float(brentq(lambda r: now + reach * math.exp(-r * delay) - r, 0.0, now + reach))


def _lambert(now: Complexes, late: Complexes, delay: float) -> Complexes:
    """Return σ − λ."""
    from scipy.special import lambertw

    exponent = np.minimum(-now.real * delay, STEEPEST) - 1j * now.imag * delay
    argument = np.asarray(late * delay * np.exp(exponent), dtype=np.complex128)
    return lambertw(argument, 0, 1e-14) / delay


@dataclass(frozen=True, slots=True)
class _Parts:
    """The parts of the state, and of delayed ones at a step's start and end, in a value."""

    state: Complexes
    before: Complexes
    after: Complexes

    def plus(self, weight: float, other: "_Parts") -> "_Parts":
        return _Parts(
            self.state + weight * other.state,
            self.before + weight * other.before,
            self.after + weight * other.after,
        )


def _parts(method: ButcherTableau, now: Complexes, late: Complexes) -> _Parts:
    """Return P, Q₀ and Q₁ of steps of hλ and hμ."""
    none = np.zeros(np.broadcast(now, late).shape, dtype=np.complex128)
    start, slopes = _Parts(none + 1.0, none, none), list[_Parts]()
    for row in method.a:
        seen, ended = _moved(start, row, slopes), float(sum(row))
        before, after = late * (1.0 - ended), late * ended
        slopes.append(
            _Parts(now * seen.state, now * seen.before + before, now * seen.after + after)
        )
    return _moved(start, method.b, slopes)


def _moved(start: _Parts, weights: Row, slopes: list[_Parts]) -> _Parts:
    for weight, slope in zip(weights, slopes, strict=False):
        start = start.plus(float(weight), slope)
    return start


def _bound(parts: _Parts, count: int, size: float) -> Floats:
    """Return a bound on |z| where |z| ≥ size: no root lies beyond where it is less."""
    late = np.abs(parts.before) * size**-count + np.abs(parts.after) * size ** (1 - count)
    return np.asarray(np.abs(parts.state) + late, dtype=np.float64)


def _beyond(parts: _Parts, count: int, size: float) -> bool:
    """Return whether a root of any mode lies outside a circle of that size."""
    unsure = _bound(parts, count, size) > size
    polynomial = np.zeros((count + 2, int(unsure.sum())), dtype=np.complex128)
    polynomial[-1] = 1.0
    polynomial[-2] -= parts.state[unsure] / size
    polynomial[1] -= parts.after[unsure] * size**-count
    polynomial[0] -= parts.before[unsure] * size ** (-count - 1)
    for _ in range(count + 1):
        reflected = polynomial[0] / polynomial[-1]
        if np.any(np.abs(reflected) >= 1.0):
            return True
        polynomial = polynomial[1:] - reflected * np.conj(polynomial[-2::-1])
    return False


METHODS = (*TABLEAUX, CHEBYSHEV, *LAYER_METHODS, *IMPLICIT_METHODS)
"""Names of the methods that take steps."""

SHORTEST = 1e-4
"""Part of the bound of decays alone below which a method is said to have no stable step."""

TOGETHER = 5000
"""Products of steps and rates that are evaluated together, so that they stay in the cache."""


@dataclass(frozen=True, slots=True)
class StabilityBound:
    """Longest step at which no decaying mode grows faster than the array itself may.

    Attributes
    ----------
    step : float
        In the unit of the time constants; infinite if no step is too long, 0 if every step is.
    exact : bool
        Whether it is that of the linear array itself, and not of a bound on its rates.
    reason : str
        Source of the rates.
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
    The rates are those of `spectrum`, and a mode that grows by itself (Re λ > 0) sets no bound. For
    a linear array, the bound keeps |R| ≤ 1 for all other eigenvalues or, if these are not known,
    for a box around the field of values, in which Euler's and Heun's methods may have no stable
    step.
    The rates of an array that saturates change with the cells. The bound lets no mode grow faster
    than the array itself could, e^{max(Re λ, 0) h}, without saturation or, by Gershgorin's discs,
    whichever cells saturate. With a delay, a mode also depends on its past. The step then divides
    the delay, and only methods whose stages lie at the ends of steps have a bound.
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
    result = spectrum(template, shape)
    if method in TABLEAUX:
        step = tableau_step(TABLEAUX[method], result)
    elif method == CHEBYSHEV:
        step = chebyshev_step(MAX_STAGES, result)
    elif method in LAYER_METHODS:
        step = _layer_step(LAYER_METHODS[method], result, template)
    elif method in IMPLICIT_METHODS:
        # |R| ≤ 1 on all of the left half-plane
        step = math.inf if may_be_implicit(template) else 0.0
    else:
        raise name_error("method", method, METHODS)
    return StabilityBound(step, result.exact, result.reason)


def tableau_step(method: ButcherTableau, spectrum: Spectrum) -> float:
    """Return the longest stable step of a Runge–Kutta method for a spectrum."""
    values = _decaying(spectrum)
    fastest = float(np.abs(values).max(initial=0.0))
    if spectrum.real:
        return method.real_stability / fastest if fastest else math.inf
    few = len(spectrum.values) <= MOST_KEPT
    return _scanned(method, spectrum) if few else _scanned.__wrapped__(method, spectrum)


@lru_cache(maxsize=KEPT)
def _scanned(method: ButcherTableau, spectrum: Spectrum) -> float:
    """Return the longest stable step where rates turn; it does not change with the bias."""
    fastest = float(np.abs(_decaying(spectrum)).max(initial=0.0))
    # |R(z)| > 1 beyond |z| = 8 for every method of up to 7 stages here
    longest = 8.0 / fastest if fastest else math.inf
    if spectrum.discs is not None and spectrum.discs.reach:
        longest = min(longest, method.real_stability / spectrum.discs.reach)
    if math.isinf(longest):
        return math.inf

    def growth(steps: Floats, rates: Complexes) -> Complexes:
        return method.growth(steps[:, np.newaxis] * rates)

    step = _first(_Growth(growth, spectrum), longest * np.geomspace(SHORTEST, 1.0, 500))
    return min(step, longest)


def chebyshev_step(stages: int, spectrum: Spectrum) -> float:
    """Return the longest stable step of a Chebyshev method; 0 where the rates are not real.

    Its region of stability is long and thin along the negative real axis.
    """
    if not spectrum.real:
        return 0.0
    values = _decaying(spectrum)
    fastest = float(np.abs(values).max(initial=0.0))
    return chebyshev_method(stages).real_stability / fastest if fastest else math.inf


def _layer_step(method: LayerMethod, spectrum: Spectrum, template: Template) -> float:
    if np.ptp(template.tau) > 0.0:
        # several decays: the couplings of the fastest layer, as if all decayed like Euler's
        return tableau_step(TABLEAUX["euler"], spectrum)
    tau = float(template.tau[0])

    def growth(steps: Floats, rates: Complexes) -> Complexes:
        return method.growth(steps / tau, rates * tau)

    steps = tau * np.geomspace(1e-4, 60.0, 500)
    step = _first(_Growth(growth, spectrum), steps)
    if spectrum.discs is None:
        return step
    slowest = np.array([-spectrum.discs.reach], dtype=np.complex128)
    ends = Spectrum(slowest, exact=False, real=True, reason=spectrum.reason)
    return min(step, _first(_Growth(growth, ends), steps))


def _decaying(spectrum: Spectrum) -> Complexes:
    """Return the values that decay or only turn, one of each conjugate pair."""
    values = spectrum.values[spectrum.values.real <= 1e-10 * spectrum.fastest]
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

    def __init__(
        self, growth: Callable[[Floats, Complexes], Complexes], spectrum: Spectrum
    ) -> None:
        self._growth = growth
        self._all = [(_decaying(spectrum), spectrum.growth)]
        self._few = [(_few(self._all[0][0]), spectrum.growth)]
        if spectrum.discs is not None:
            around = (spectrum.discs.points, spectrum.discs.growth)
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
        result = np.zeros(len(steps), dtype=bool)
        for rates, allowed in parts:
            sizes = np.abs(self._growth(steps, rates))
            result |= (sizes > self._limits(steps, allowed)[:, np.newaxis]).any(axis=1)
        return result

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
        growing = grows(steps[start : start + count])
        if growing.any():
            at = start + int(growing.argmax())
            return _bisect(grows, float(steps[at - 1]), float(steps[at])) if at else 0.0
    return math.inf


def _bisect(grows: Grows, low: float, high: float) -> float:
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if _at(grows, middle) else (middle, high)
    return low
