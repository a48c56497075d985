"""How long a step may be where an array also sees its outputs a delay ago.

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
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats, Shape, distinct
from cnnum.integrators.exact_ends import diagonal_in_modes, mode_rates
from cnnum.integrators.spectrum import Discs, discs, torus_coupling
from cnnum.integrators.tableau import ButcherTableau, Row
from cnnum.templating.network import Network
from cnnum.templating.template import Template

Complexes = NDArray[np.complex128]

MOST_STEPS = 1024
"""Steps in a delay beyond which none is looked for."""

MODES = 400
"""Modes that are looked at: beyond this number, those of a grid over them."""

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


@dataclass(frozen=True, slots=True, eq=False)
class DelayedRates:
    """How fast an array moves by its present outputs, and by its delayed ones.

    Attributes
    ----------
    now, late : (n,) complex
        λ and μ of its modes that decay while no cell saturates, 1/time; empty where they are not
        known.
    growth, around_growth : float
        Rates at which a step may let a decaying mode grow, and one within the bound: those of the
        fastest growth of an array that saturates, else 0.
    around : Discs, optional
        Bound on λ whatever cells saturate; None where the modes decide.
    reach : float
        Bound on |μ|, 1/time.
    delay : float
    exact : bool
        Every mode of a linear array is among them.
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
    """Return the rates of an array that sees its outputs a delay ago, None where it does not."""
    delayed = template.delayed
    if delayed is None or not delayed.A.any():
        return None
    reach = float((np.abs(delayed.A).sum(axis=(1, 2, 3)) / template.tau).max())
    all_now, all_late = _modes(replace(template, delayed=None), delayed.A, shape)
    now, late = _few(all_now, all_late)
    own = now + _lambert(now, late, delayed.delay)
    decays = own.real <= 1e-10 * max(float(np.abs(now).max(initial=0.0)), reach)
    known = template.output.linear and len(now) > 0
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
    """Return the longest step of a Runge–Kutta method in which no mode that decays grows.

    Parameters
    ----------
    method : ButcherTableau
    rates : DelayedRates

    Returns
    -------
    float
        A whole part of the delay, as steps are. It is infinite where no step is too long. It is 0
        where none is found, or the method needs outputs between the steps.
    """
    if not keeps_delays(method):
        return 0.0
    ladder = sorted(
        {round(float(count)) for count in np.geomspace(1.0, MOST_STEPS, 41)}, reverse=True
    )
    found = next((k for k, count in enumerate(ladder) if _grows(method, rates, count)), None)
    if found is None:
        return math.inf
    if not found:
        return 0.0
    stable, grows = ladder[found - 1], ladder[found]
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
        found = [mode_rates(one, shape).ravel().astype(np.complex128) for one in (template, other)]
    elif template.boundary.pad_mode == "wrap":
        found = [(torus_coupling(one, shape).ravel() - 1.0) / tau for one in (template, other)]
    else:
        return none, none
    return found[0], found[1] + 1.0 / tau


def _few(now: Complexes, late: Complexes) -> tuple[Complexes, Complexes]:
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
