"""Which method runs a transient, and why: by exactness first, then by error control."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import pairwise, product
from typing import NoReturn

import numpy as np

from cnnum.errors import MethodError, name_error
from cnnum.graph.nodes import (
    Apply,
    Constant,
    ConstantMap,
    Node,
    Pick,
    RunSpec,
    Transient,
    picks_of,
)
from cnnum.integrators.closed_forms import (
    DENSE_LIMIT,
    SHIFTS,
    Separate,
    circulant,
    decay,
    propagator,
    separate,
    shifts_fit,
    spectral,
)
from cnnum.integrators.cost import Effort, chebyshev, effort, motion, pair
from cnnum.integrators.exponential import fixed_step, followed_step
from cnnum.integrators.rosenbrock import IMPLICIT_METHODS, implicit_steps
from cnnum.integrators.schemes import (
    CHEBYSHEV,
    DECISION,
    LAYER_METHODS,
    MAX_STEPS,
    WAVEFRONT,
    AdaptiveSteps,
    ChebyshevSteps,
    FixedSteps,
    Piece,
)
from cnnum.integrators.solver import Exact, Scheme, Solver, Stepping
from cnnum.integrators.spectrum import Spectrum, spectrum
from cnnum.integrators.stability import (
    delayed_rates,
    delayed_step,
    keeps_delays,
    stability_bound,
    tableau_step,
)
from cnnum.integrators.tableau import (
    BOGACKI_SHAMPINE,
    DORMAND_PRINCE,
    EULER,
    HEUN,
    TABLEAUX,
    ButcherTableau,
    LayerMethod,
    followed,
)
from cnnum.safety.values import is_real
from cnnum.templating.network import Network, bends, jumps, turning_points
from cnnum.templating.template import Template


def exact_end(transient: Transient, network: Network, duration: float) -> tuple[Exact | None, str]:
    """Return a scheme that gives the end of a transient without steps, or None, and the reason.

    Parameters
    ----------
    transient : Transient
    network : Network
        Network of the template.
    duration : float
        Infinite for a run to equilibrium.
    """
    template = transient.template
    if template.output.limited or template.output.discrete:
        return None, "its state is limited, or runs in discrete time"
    if not template.plain:
        return None, "it has nonlinear, delayed or time-varying couplings"
    if not duration:
        return decay(template, 0.0), "it takes no time"
    if template.uncoupled:
        return decay(template, duration), "A = 0: every cell decays on its own, exactly"
    pieces = separate(template, duration)
    if pieces is not None:
        return pieces, "no cell sees another: its linear pieces are exact, one after the other"
    if not template.output.linear:
        return None, "its output saturates, so the array is not linear"
    if transient.has_mask:
        return None, "its fixed-state mask is only known at run time"
    modal = spectral(network, duration)
    if modal is not None:
        return modal, "the array is linear, and exact in the modes of its boundary"
    if network.states > DENSE_LIMIT:
        around = circulant(network) if math.isinf(duration) and shifts_fit(network) else None
        if around is not None:
            return around, SHIFTS
        return None, f"{network.states} states are more than the {DENSE_LIMIT} of a dense product"
    exact = propagator(network, duration)
    if exact is None:
        return None, "not every mode of the array decays, so it has no equilibrium"
    return exact, "the array is linear: one dense product is exact"


__all__ = (
    "MAX_STEPS",
    "AdaptiveSteps",
    "ChebyshevSteps",
    "FixedSteps",
    "Scheme",
    "Solver",
    "check_spec",
    "choose",
    "in_one_sum",
    "only_output_matters",
)

SHORTEST = 1e-30
"""Shorter durations count as 0, because devices flush such numbers to zero."""

DELAY_STEP = 0.05
"""Longest step of a template with a delay, in time constants: Heun's error a step is then about
(0.05)³/12 of the state's third derivative."""

LEAST_STEPS = 4
"""Smallest number of steps in a run with a delay: with fewer, halved steps may be the same."""

MOST_COUNTED = 2**31 - 1
"""Largest number of steps in a run, as kernels count them in 32 bits."""

JUMP_STEP = 0.01
"""Step of a template whose rates jump, in time constants. Its state may slide along a jump and then
chatters by a step's change. MatCNN's own advice for such a template (MEDIAN) is at most 0.02."""


def choose(transient: Transient, shape: tuple[int, int]) -> Solver:
    """Choose the solver of a transient on an array of a given shape.

    Parameters
    ----------
    transient : Transient
    shape : (rows, cols)

    Raises
    ------
    MethodError
        If the requested method cannot run this template, or its step is unstable.
    UnknownNameError
        If there is no such method.
    """
    network = Network(transient.template, shape)
    spec = transient.spec
    check_spec(spec)
    wanted = transient.template.duration if spec.duration is None else spec.duration
    settle = wanted == "settle"
    slowest = float(transient.template.tau.max())
    duration = spec.settle_limit * slowest if wanted == "settle" else float(wanted)
    if duration < SHORTEST:
        duration = 0.0
    if transient.template.output.discrete:
        duration = float(_count(duration, 1.0))  # a step that has begun is taken as a whole
    if spec.method in ("auto", "propagator") and spec.dt is None:
        exact, reason = exact_end(transient, network, math.inf if settle else duration)
        if exact is not None:
            return Solver("propagator", reason, exact, duration, settle, spec.rtol, spec.atol)
        if spec.method == "propagator":
            raise MethodError(f"Template '{transient.template.name}' has no propagator: {reason}.")
    if spec.method in (WAVEFRONT, DECISION):
        raise MethodError(
            f"The method '{spec.method}' gives only the end of a single run, without times in "
            "between: leave out the method."
        )
    if spec.method == "propagator":
        raise MethodError("A propagator takes no steps: leave dt out.")
    chosen = spec.method != "auto" or spec.dt is not None
    choice = _Choice(transient.template, shape, spec, duration, settle)
    stepping, reason, forced = choice.stepping()
    parts = (stepping.name, reason, stepping, duration, settle)
    return Solver(*parts, spec.rtol, spec.atol, chosen, forced)


def check_spec(spec: RunSpec) -> None:
    """Check the duration, the tolerances and the step of a run.

    Raises
    ------
    MethodError
        If one of them is not a number, or is out of range.
    """
    duration = spec.duration
    if not (
        duration is None
        or _none_or_more(duration)
        or (isinstance(duration, str) and duration == "settle")
    ):
        raise MethodError(
            "A duration must be a finite number of at least 0, in the unit of tau, or 'settle', "
            f"got duration={duration!r}."
        )
    if not (_none_or_more(spec.rtol) and _none_or_more(spec.atol) and spec.atol > 0):
        raise MethodError(
            "Tolerances must be finite numbers, rtol ≥ 0 and atol > 0, got "
            f"rtol={spec.rtol!r}, atol={spec.atol!r}."
        )
    if spec.dt is not None and not (_none_or_more(spec.dt) and spec.dt > 0):
        raise MethodError(f"A fixed step must be positive and finite, got dt={spec.dt!r}.")


def _none_or_more(value: object) -> bool:
    """Return whether a value is one real, finite number from 0 up."""
    return is_real(value) and value >= 0.0


PAIRS = (BOGACKI_SHAMPINE, DORMAND_PRINCE)
"""Pairs among which the number of evaluations decides."""


@dataclass(frozen=True, slots=True)
class _Choice:
    """Chooses how a transient without an exact answer steps."""

    template: Template
    shape: tuple[int, int]
    spec: RunSpec
    duration: float
    settle: bool

    def stepping(self) -> tuple[Stepping, str, bool]:
        """Return the steps, why they are taken, and whether they were forced."""
        template = self.template
        if template.output.discrete:
            if self.spec.estimate:
                self._refuse("discrete time, where a rounding may turn a sign,")
            count = _count(self.duration, 1.0)
            whole = FixedSteps((EULER,), 1.0, count, self.settle, 1.0)
            return whole, "it runs in discrete time", False
        if self.spec.method in IMPLICIT_METHODS:
            given = (template, self.shape, self.spec, self.duration)
            return implicit_steps(*given, settle=self.settle), "it was asked for", False
        result = spectrum(template, self.shape)
        if self.spec.method == CHEBYSHEV:
            return self._chebyshev(result)
        if self.spec.method in LAYER_METHODS:
            return self._by_layer(LAYER_METHODS[self.spec.method])
        method, preset, reason = _preset(template, self.spec)
        if method is None:
            return self._cheapest(result)
        bound, why = tableau_step(method, result), result.reason
        delayed = delayed_rates(template, self.shape)
        if delayed is not None and keeps_delays(method):
            bound, why = delayed_step(method, delayed), delayed.reason
        if preset is None and method.adaptive and template.delayed is None:
            return self._adaptive(method, bound, result), "steps follow the error estimate", False
        if preset is not None and self.spec.dt is None and preset > 0.5 * bound > 0.0:
            preset, reason = None, f"{reason}, in steps of half its stability bound"
        step, forced = self._bounded(method.name, bound, why, preset)
        own = self.spec.dt is not None
        fixed = _fixed(template, method, step, self.duration, self.settle, given=own)
        if forced:
            return fixed, f"{reason}, outside its stability bound", True
        if self.spec.estimate:
            return self._followed(method, fixed), reason, False
        return fixed, reason, False

    def _followed(self, method: ButcherTableau, fixed: FixedSteps) -> Stepping:
        """Return the same steps with an estimate of their error."""
        if self.template.delayed is not None:
            self._refuse("steps with a delay")
        if jumps(self.template):
            self._refuse("rates that jump")
        self._refuse_many(fixed.count)
        steps = followed(method)
        if not steps.truncation:
            self._refuse(f"'{steps.name}', whose stages do not show it,")
        stops = turning_points(self.template, self.duration)
        return AdaptiveSteps((steps,), fixed.step, self.settle, fixed.step, stops=stops)

    def _refuse(self, steps: str) -> NoReturn:
        raise MethodError(
            f"The error of {steps} cannot be estimated: run template '{self.template.name}' "
            "without estimate=True."
        )

    def _refuse_many(self, count: int) -> None:
        if count > MAX_STEPS and not self.settle:
            raise MethodError(
                f"The error of at most {MAX_STEPS} steps can be estimated, got {count}: use "
                "longer steps, or leave out estimate=True."
            )

    def _bounded(
        self, method: str, bound: float, reason: str, preset: float | None
    ) -> tuple[float, bool]:
        """Return the step, refused where it is unstable unless that is insisted on."""
        step = (0.5 * bound if math.isfinite(bound) else 1.0) if preset is None else preset
        if step <= bound * (1.0 + 1e-12):
            if step > 0.0:
                return step, False
        elif self.spec.force:
            return step, True
        if bound == 0.0:
            raise MethodError(
                f"No step of '{method}' is known to be stable for template '{self.template.name}' "
                f"({reason}): use method='auto', or force=True with a step."
            )
        raise MethodError(
            f"dt={step:g} is outside the stability bound {bound:.4g} of '{method}' for template "
            f"'{self.template.name}' ({reason}): take a shorter step, method='auto', or force=True."
        )

    def _cheapest(self, spectrum: Spectrum) -> tuple[Stepping, str, bool]:
        """Return the method that takes the fewest evaluations of the rates, as far as is known."""
        bounds = {method: tableau_step(method, spectrum) for method in PAIRS}
        steps = {method.name: self._adaptive(method, bounds[method], spectrum) for method in PAIRS}
        # a pair without a stable step is taken where no other has one either
        stable = [m for m in PAIRS if bounds[m] > 0.0] or [*PAIRS]
        methods = [pair(method, steps[method.name]) for method in stable]
        if self._has_stages(spectrum):
            methods.append(chebyshev(CHEBYSHEV, spectrum.fastest))
        if not self.duration:
            return steps[methods[0].name], "it takes no time", False
        tolerances = (self.spec.rtol, self.spec.atol)
        known = motion(
            self.template, self.shape, spectrum, self.duration, tolerances, settle=self.settle
        )
        efforts = [effort(method, known) for method in methods]
        best = min(efforts, key=lambda candidate: candidate.evaluations)
        reason = _against(best, efforts)
        surest = next(
            (candidate for candidate in efforts if candidate.name == DORMAND_PRINCE.name), best
        )
        if known.bends and not self.settle and not surest.stable and best is not surest:
            best, reason = surest, _against(surest, efforts)
            reason += ", which are less sensitive to kinks in the rates"
        if best.name == CHEBYSHEV:
            stages, why, _ = self._chebyshev(spectrum)
            return stages, f"{reason}; {why}", False
        return steps[best.name], reason, False

    def _adaptive(self, method: ButcherTableau, bound: float, spectrum: Spectrum) -> AdaptiveSteps:
        """Return steps of a pair within its stability bound."""
        longest = min(bound, self.duration or bound)
        first = 0.1 * min(longest, 1.0 / spectrum.fastest) if spectrum.fastest else 0.1 * longest
        share = 0.8 if self.settle else 1.0
        safe = share * bound if 0.0 < bound < math.inf else self.duration
        # at a rest the errors of the way have decayed
        bent = bends(self.template) and not self.settle
        stops = turning_points(self.template, self.duration)
        longest = min(safe, self.duration)
        return AdaptiveSteps((method,), first, self.settle, longest, bent, stops)

    def _has_stages(self, spectrum: Spectrum) -> bool:
        steady = self.template.plain and not self.template.output.limited
        moving = spectrum.real and spectrum.fastest > 0.0
        return steady and moving

    def _chebyshev(self, spectrum: Spectrum) -> tuple[ChebyshevSteps, str, bool]:
        if not self._has_stages(spectrum):
            raise MethodError(
                f"'{CHEBYSHEV}' needs rates that are known to be real ({spectrum.reason}) and "
                f"linear couplings: run template '{self.template.name}' with method='auto'."
            )
        if self.spec.dt is not None:
            raise MethodError(f"'{CHEBYSHEV}' chooses its own steps: leave dt out.")
        first = min(0.5 / spectrum.fastest, self.duration or 1.0)
        reason = (
            f"rates up to {spectrum.fastest:.3g} ({spectrum.reason}) are real, so that stages grow "
            "with the root of a step's length"
        )
        return ChebyshevSteps(spectrum.fastest, first, self.settle), reason, False

    def _by_layer(self, method: LayerMethod) -> tuple[Stepping, str, bool]:
        if not self.template.plain:
            raise MethodError(
                f"'{method.name}' supports only linear couplings: run template "
                f"'{self.template.name}' with method='auto'."
            )
        bound = stability_bound(self.template, self.shape, method.name)
        step, forced = self._bounded(method.name, bound.step, bound.reason, self.spec.dt)
        count = max(1, _count(self.duration, step)) if self.duration > 0 else 0
        even = self.duration / count if count else step
        reason = "a fixed step was asked for" if self.spec.dt else "half of the stability bound"
        taus = self.template.tau.tolist()
        if not self.spec.estimate or forced:
            steps = tuple(fixed_step(method, even, tau) for tau in taus)
            return FixedSteps(steps, even, count, self.settle, even), reason, forced
        self._refuse_many(count)
        if method.order > 1 and self.template.output.limited:
            self._refuse(f"'{method.name}' with a limited state")
        rows = tuple(followed_step(method, even, tau) for tau in taus)
        return AdaptiveSteps(rows, even, self.settle, even), reason, forced


def _against(best: Effort, efforts: list[Effort]) -> str:
    """Return the limit of the steps, and the evaluations of this and the other methods."""
    limit = "stability" if best.stable else "the error estimate"
    text = f"{limit} sets most steps: about {_rounded(best)} evaluations of the rates"
    others = sorted(efforts, key=lambda effort: effort.evaluations)
    listed = [f"{_rounded(other)} of {other.name}" for other in others if other is not best]
    return f"{text}, against {' and '.join(listed)}" if listed else text


def _rounded(effort: Effort) -> float:
    rounded = float(f"{effort.evaluations:.2g}")
    return int(rounded) if math.isfinite(rounded) else rounded


def _preset(template: Template, spec: RunSpec) -> tuple[ButcherTableau | None, float | None, str]:
    """Return the method where it is given, the fixed step where it must be, and the reason."""
    if spec.method not in ("auto", *TABLEAUX):
        steps = (*TABLEAUX, CHEBYSHEV, *LAYER_METHODS, *IMPLICIT_METHODS)
        known = ("auto", "propagator", *steps)
        raise name_error("method", spec.method, known)
    tableau = TABLEAUX.get(spec.method)
    if spec.dt is not None:
        return (
            tableau or (HEUN if template.delayed else EULER),
            spec.dt,
            "a fixed step was asked for",
        )
    if template.delayed is not None:
        step = DELAY_STEP * float(template.tau.min())
        return tableau or HEUN, step, "its delay needs outputs of earlier steps"
    if jumps(template):
        step = JUMP_STEP * float(template.tau.min())
        return tableau or EULER, step, "its rates jump, which no error estimate follows"
    return tableau, None, "half of the stability bound"


def _fixed(
    template: Template,
    method: ButcherTableau,
    step: float,
    duration: float,
    settle: bool,
    *,
    given: bool = False,
) -> FixedSteps:
    """Return steps of that length at most; a delay is a whole number of them.

    `given` is a length that was asked for.
    """
    if template.delayed is not None:
        if not keeps_delays(method):
            raise MethodError(
                f"'{method.name}' needs outputs between the steps, which are not kept for a "
                "delay: use 'euler' or 'heun'."
            )
        # a delay is a whole number of steps, which cannot end at the points of a gain, too: in a
        # step with such a point gains count by their means
        if duration and not given:  # of a delay beyond the end, too, steps are halved
            step = min(step, duration / LEAST_STEPS)
        step = template.delayed.delay / math.ceil(template.delayed.delay / step - 1e-9)
        count = _count(duration, step)
        last = duration - (count - 1) * step
    elif template.gains and turning_points(template, duration):
        return _in_pieces(template, method, step, duration, settle)
    else:
        count = max(1, _count(duration, step)) if duration > 0 else 0
        step = last = duration / count if count else step
    return FixedSteps((method,), step, count, settle, last)


def _in_pieces(
    template: Template, method: ButcherTableau, step: float, duration: float, settle: bool
) -> FixedSteps:
    """Return steps of that length at most that end where a gain in time jumps or bends."""
    pieces: list[Piece] = []
    taken = 0
    for start, end in pairwise((0.0, *turning_points(template, duration), duration)):
        count = max(1, _count(end - start, step))
        pieces.append(Piece(taken, start, (end - start) / count))
        taken += count
    _count(float(taken), 1.0)
    longest = max(piece.step for piece in pieces)
    return FixedSteps((method,), longest, taken, settle, pieces[-1].step, tuple(pieces))


def _count(duration: float, step: float) -> int:
    """Return how many steps a duration takes.

    Raises
    ------
    MethodError
        If kernels cannot count them.
    """
    steps = duration / step if step else math.inf
    if not steps < MOST_COUNTED:
        raise MethodError(
            f"A duration of {duration:g} in steps of {step:g} takes more than {MOST_COUNTED:,} "
            "steps: take a shorter duration, or longer steps."
        )
    return max(0, math.ceil(steps - 1e-9))


WITHIN_ONE = ("standard", "full-range", "sign", "tanh")
"""Output functions whose values are within ±1."""


ONE_SUM = "no cell sees another, and of a cell only its output is read, which is one weighted sum"


def in_one_sum(solver: Solver) -> Solver:
    """Return a solver that gives only the outputs of uncoupled cells, each by one sum, if it can.

    It cannot where cells leave an unstable rest for ever. Starts are as `only_output_matters` says.
    """
    scheme = solver.scheme
    if not isinstance(scheme, Separate) or (solver.settle and (scheme.own > 1.0).any()):
        return solver
    return replace(solver, scheme=replace(scheme, ends=True), reason=ONE_SUM)


def only_output_matters(node: Node, nodes: Iterable[Node]) -> bool:
    """Return whether nothing but outputs is read of a transient, and its starts are within ±1.

    Starts beyond are let in where they stay there: with |w| ≤ a − 1 the equilibria of a cell beyond
    ±1 are beyond ±1, too.

    Parameters
    ----------
    node : Node
        A transient.
    nodes : iterable of Node
        All nodes of its program, those in loops among them.
    """
    operation = node.operation
    assert isinstance(operation, Transient)
    template, by_role = operation.template, operation.by_role(node.arguments)
    if operation.weight_maps or any(p.what != "output" for _, p in picks_of(node, nodes)):
        return False
    starts = by_role["state"] or (by_role["input"] if template.initial == "input" else ())
    if not starts:
        return abs(float(template.initial)) <= 1.0
    if all(_size(start) <= 1.0 for start in starts):
        return True
    if not template.plain or operation.has_bias:
        return False
    edge = abs(template.input_boundary.constant or 0.0)
    sizes = [max(_size(given), edge) for given in by_role["input"]]
    weights = np.abs(template.B).sum(axis=(2, 3))
    for layer, own in enumerate(np.einsum("nn...->n...", template.A)):
        seen = [size * weight for size, weight in zip(sizes, weights[layer], strict=True) if weight]
        if abs(float(template.z[layer])) + sum(seen) > float(own.flat[own.size // 2]) - 1.0:
            return False
    return True


ANY = -math.inf, math.inf
"""The range of a value of which nothing is known."""

DEEPEST = 8
"""Operations that are looked at, one after the other, to find a range."""

AT_CORNERS = ("add", "subtract", "multiply", "negate", "minimum", "maximum")
"""Operations whose extremes are at those of their arguments."""


def _size(node: Node) -> float:
    """Return a bound on the magnitude of a node's values; infinite where none is known."""
    return max(map(abs, _range(node, DEEPEST)))


def _range(node: Node, depth: int) -> tuple[float, float]:
    """Return the least and the largest value of a node, as far as the program says them."""
    operation = node.operation
    if node.logic:
        return 0.0, 1.0
    if isinstance(operation, Constant):
        return operation.value, operation.value
    if isinstance(operation, ConstantMap):
        return float(operation.values.min()), float(operation.values.max())
    if isinstance(operation, Pick) and operation.what == "output":
        source = node.arguments[0].operation
        bounded = isinstance(source, Transient) and source.template.output.name in WITHIN_ONE
        return (-1.0, 1.0) if bounded else ANY
    if not isinstance(operation, Apply) or not depth:
        return ANY
    name, given = (
        operation.function.name,
        [_range(argument, depth - 1) for argument in node.arguments],
    )
    if name == "select":
        values = [*given[1], *given[2]]
    elif name in AT_CORNERS:
        with np.errstate(invalid="ignore"):
            values = [float(operation.function.numpy(*corner)) for corner in product(*given)]
    else:
        return ANY
    return ANY if any(map(math.isnan, values)) else (min(values), max(values))
