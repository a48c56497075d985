"""The cost of operations and transients: how many evaluations of the rates each will take.

How many evaluations of the rates a method will take for a transient, about.

A step is as long as stability and the tolerance allow, and both change along the way:

* Stability allows a pair its bound, all the time; Chebyshev's stages grow with the root of a step.
* Take a mode e^{−λt} of size 1 and a method of order p with the error estimate c |hλ|^p. Steps are
  then h = (tol/c)^{1/p} e^{λt/p} / λ: fast modes set the steps at first and then die. So a mode
  takes p (c/tol)^{1/p} steps in all, however fast it is. Of many modes the one that asks most
  counts.
* Where an array grows until its cells saturate, cells switch one after the other, at the rate of
  its growth. They do so until a front may have crossed the array. Each cell bends the rates where
  it leaves the linear range: a step across a bend has an error of h², whatever the order. Across a
  jump (of a state that is limited) it is h. A method steps down to it and up again by factors of 5.
  Where bends lie closer, it keeps to the steps that they allow.

The course of a frame is not known beforehand: the last paragraph's constants are those of pictures
that are not at rest. The evaluations of 315 runs were counted with every method. Of those that bend
nowhere, or end at a rest, 99 % took at most 1.3 times the fewest (docs/methods.md).
"""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats, Shape, distinct
from cnnum.graph.nodes import Constant, ConstantMap, Loop, Node, Parameter, Pick, Transient
from cnnum.graph.schedule import node_flops
from cnnum.integrators.estimate import linear_growth
from cnnum.integrators.schemes import AdaptiveSteps, FixedSteps
from cnnum.integrators.solver import Linear, Solver
from cnnum.integrators.spectrum import Spectrum
from cnnum.integrators.tableau import MAX_STAGES, ButcherTableau, chebyshev_method, stages_about
from cnnum.templating.network import bends
from cnnum.templating.template import Template

FREE = (Constant, ConstantMap, Parameter, Pick)
"""Operations that only name a value and do not run."""


@dataclass(frozen=True, slots=True)
class Work:
    """Work of nodes for one frame.

    A loop counts as one operation, and so does each operation in its body. A branch is a loop with
    one iteration. The test for changes that ends a loop is not counted as arithmetic.

    Attributes
    ----------
    ops, flops : int
        Operations and floating-point operations, with every loop body counted once.
    ops_most, flops_most : int
        The same with every loop at its limit; the limits of nested loops multiply.
    """

    ops: int
    ops_most: int
    flops: int
    flops_most: int


def work(nodes: Iterable[Node], solvers: Mapping[int, Solver], shape: Shape) -> Work:
    """Return the work of nodes and of the bodies of their loops for one frame."""
    ops = ops_most = flops = flops_most = 0
    for node in nodes:
        if isinstance(node.operation, FREE):
            continue
        own = operation_flops(node, solvers.get(node.index), shape)
        ops, ops_most = ops + 1, ops_most + 1
        flops, flops_most = flops + own, flops_most + own
        if isinstance(node.operation, Loop):
            body = work(node.operation.nodes, solvers, shape)
            ops, ops_most = ops + body.ops, ops_most + node.operation.limit * body.ops_most
            flops += body.flops
            flops_most += node.operation.limit * body.flops_most
    return Work(ops, ops_most, flops, flops_most)


def operation_flops(node: Node, solver: Solver | None, shape: Shape) -> int:
    """Return the floating-point operations of a node per frame; for a loop, without its body.

    Adaptive steps, and exact solutions of separate cells, count as one Euler step.
    """
    if not isinstance(node.operation, Transient) or solver is None:
        return node_flops(node, shape)
    scheme, template = solver.scheme, node.operation.template
    if isinstance(scheme, Linear):
        cells = shape[0] * shape[1]
        control = 2 * int(np.count_nonzero(template.B)) * cells
        return control + scheme.flops(template.layers * cells, shape)
    return node_flops(node, shape, scheme.count if isinstance(scheme, FixedSteps) else 1)


MODES = 64
"""Number of rates that represent those of an array."""

TIMES = 40
"""Number of times at which the length of a step is evaluated."""

SIZE = 0.5
"""Typical magnitude of a state, for relative tolerances."""

SWITCHES = 8
"""Kinks of the rates per cell along the path of a front, in arrays that grow."""

WAITING = 1.4
"""Time to rest of an array that grows, over that of its decay alone: cells switch before."""

STILL = 1e-6
"""Share of the fastest rate below which a mode counts as stationary."""


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """Properties of a transient that determine its number of steps.

    Attributes
    ----------
    rates : (n,) complex
        Rates of its modes, 1/time; growing modes count by their magnitude.
    growth : float
        Rate at which its cells run into saturation; 0 if none does.
    duration : float
        Time until it ends, or comes to rest.
    busy : float
        Time during which cells saturate.
    tolerance : float
    bends : float
        Number of kinks or jumps of the rates.
    jumps : bool
        Whether the rates jump.
    """

    rates: NDArray[np.complex128]
    growth: float
    duration: float
    busy: float
    tolerance: float
    bends: float
    jumps: bool

    def times(self) -> Floats:
        """Return instants from the start to the end, closer at the start."""
        first = min(self.duration, 1.0 / float(np.abs(self.rates).max()))
        later = np.geomspace(1e-3 * first, self.duration, TIMES)
        return distinct(np.concatenate([[0.0], later, [self.busy]]))

    def wanted(self, times: Floats, order: int) -> Floats:
        """Return the rate that sets the steps of a method of that order at each instant."""
        decays = np.minimum(self.rates.real, 0.0) / order
        left = np.exp(np.maximum(decays * times[:, np.newaxis], -200.0))
        modes = np.asarray((np.abs(self.rates) * left).max(axis=1), dtype=np.float64)
        return np.maximum(modes, np.where(times <= self.busy, self.growth, 0.0))


@dataclass(frozen=True, slots=True, eq=False)
class Stepper:
    """Properties of a method that determine its number of evaluations.

    Attributes
    ----------
    name : str
    order : int
        Order of its error estimate.
    smooth, bent, jumped : float
        Its error estimate over |hλ|^order, over h² at a kink of the rate, over h at a jump.
    safety : float
        Share of the step length permitted by the estimate that is taken.
    longest : float
        Longest step.
    stages : function of (n,) float
        Number of evaluations in steps of given lengths.
    """

    name: str
    order: int
    smooth: float
    bent: float
    jumped: float
    safety: float
    longest: float
    stages: Callable[[Floats], Floats]


@dataclass(frozen=True, slots=True)
class Effort:
    """The effort of a method for a transient.

    Attributes
    ----------
    name : str
        Name of the method.
    evaluations : float
        Of the rates, about.
    stable : bool
        Whether stability sets more than half of its steps, not the tolerance.
    """

    name: str
    evaluations: float
    stable: bool


def pair(method: ButcherTableau, steps: AdaptiveSteps) -> Stepper:
    """Return an embedded pair in these steps."""

    def stages(steps: Floats) -> Floats:
        return np.full_like(steps, method.stages - 1)  # the last is the first of the next step

    bent, jumped = method.estimate_bent, method.estimate_jumped
    if steps.bends:
        bent, jumped = max(bent, method.truncation_bent), max(jumped, method.truncation_jumped)
    errors = (method.estimate_smooth, bent, jumped)
    return Stepper(method.name, method.order, *errors, 0.9, steps.longest, stages)


def chebyshev(name: str, fastest: float) -> Stepper:
    """Return the Runge–Kutta–Chebyshev method for real rates.

    Its error estimate is 0.8 (x − x⁺) + 0.4 h (k₀ + k₁). With P(z) = 1 + z + z²/2 + c z³, this is
    (0.2 − 0.8 c) |z|³, where c = 0 for two stages and 1/10 for many. If the rate has a kink at θ,
    it is 0.4 θ (1 − θ) h², and if the rate jumps there, |0.8 θ − 0.4| h.
    """
    longest = chebyshev_method(MAX_STAGES).real_stability / fastest

    def stages(steps: Floats) -> Floats:
        return stages_about(steps * fastest)

    return Stepper(name, 3, 0.2, 0.4 / 6.0, 0.2, 0.8, longest, stages)


def motion(
    template: Template,
    shape: Shape,
    spectrum: Spectrum,
    duration: float,
    tolerances: tuple[float, float],
    *,
    settle: bool,
) -> Motion:
    """Return the properties of a transient that are known before it runs.

    Parameters
    ----------
    template : Template
    shape : (rows, cols)
    spectrum : Spectrum
    duration : float
        Above 0; the time limit for a run to equilibrium.
    tolerances : (rtol, atol)
    settle : bool
    """
    tolerance = SIZE * tolerances[0] + tolerances[1]
    growth = _growth(template, spectrum)
    rates = _rates(template, spectrum)
    if settle:
        duration = min(
            duration, max(math.log(1.0 / tolerance), 1.0) * _rest(template, rates, growth)
        )
    length = max(shape)
    busy = min(duration, length / growth) if growth else 0.0
    bent = SWITCHES * length * template.layers if growth and bends(template) else 0.0
    return Motion(rates, growth, duration, busy, tolerance, bent, template.output.limited)


def effort(method: Stepper, known: Motion) -> Effort:
    """Return the approximate number of evaluations that a method needs for a transient."""
    times = known.times()
    share = (method.smooth / known.tolerance) ** (1.0 / method.order) / method.safety
    wanted = 1.0 / (share * known.wanted(times, method.order))
    steps = np.minimum(wanted, method.longest)
    smooth = float(np.trapezoid(1.0 / steps, times))
    held = float(np.trapezoid((wanted >= method.longest) / steps, times))
    bends = _around_bends(method, known, share)
    # the first and the last step are shorter than they could be; the first rates come before it
    short = 1.0 + (1.0 + bends) * float(method.stages(np.zeros(1))[0])
    count = float(np.trapezoid(method.stages(steps) / steps, times)) + short
    return Effort(method.name, count, stable=held > 0.5 * (smooth + bends))


def _around_bends(method: Stepper, known: Motion, share: float) -> float:
    """Return how many steps more a method takes where the rates bend or jump."""
    if not known.bends:
        return 0.0
    usual = min(1.0 / (share * known.growth), method.longest)
    if known.jumps:
        short = known.tolerance / method.jumped / known.growth
    else:
        short = math.sqrt(known.tolerance / method.bent) / known.growth
    if short >= usual:
        return 0.0
    apart = known.bends * 2.0 * math.log(usual / short, 5.0)
    close = known.busy / short
    return 1.0 / (1.0 / apart + 1.0 / close)


def _rest(template: Template, rates: NDArray[np.complex128], growth: float) -> float:
    """Return the time in which an array comes nearer to rest by a factor of e."""
    if growth:
        return WAITING * float(template.tau.max())
    decays = -rates.real[rates.real < -STILL * np.abs(rates).max()]
    return 1.0 / float(decays.min()) if len(decays) else math.inf


def _growth(template: Template, spectrum: Spectrum) -> float:
    """Return the rate at which cells run into saturation, of couplings that are not plain apart."""
    if template.output.linear:
        return 0.0
    if not len(spectrum.values):
        return max(linear_growth(template), 0.0)
    fastest = float(spectrum.values.real.max())
    return fastest if fastest > STILL * spectrum.fastest else 0.0


def _rates(template: Template, spectrum: Spectrum) -> NDArray[np.complex128]:
    """Return rates that stand for all of them, and those of cells that saturate.

    Relative to itself, a state that grows without end never gets slower: it counts as if it turned.
    """
    rates = spectrum.values
    if len(rates) > MODES:
        ends = [int(np.abs(rates).argmax()), int(rates.real.argmax()), int(rates.real.argmin())]
        rates = np.concatenate([rates[:: -(-len(rates) // MODES)], rates[ends]])
    growing = rates.real > STILL * spectrum.fastest
    others = rates[~growing]
    if template.output.linear:
        others = np.concatenate([others, 1j * np.abs(rates[growing])])
    if not len(spectrum.values):
        others = np.array([-spectrum.fastest], dtype=np.complex128)
    if not template.output.linear or not np.any(others):
        others = np.concatenate([others, -1.0 / template.tau])
    return np.asarray(others, dtype=np.complex128)
