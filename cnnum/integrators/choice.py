"""Which method runs a transient, and why: by exactness first, then by error control."""

import math
from dataclasses import dataclass

from cnnum.errors import MethodError
from cnnum.graph.nodes import RunSpec, Transient
from cnnum.integrators.propagator import DENSE_LIMIT, Decay, Propagator, decay, propagator
from cnnum.integrators.tableau import (
    BOGACKI_SHAMPINE,
    EULER,
    HEUN,
    ButcherTableau,
    stable_step,
    tableau,
)
from cnnum.network import Network
from cnnum.template import Template

MAX_STEPS = 100_000
"""Steps after which an adaptive run gives up and says so."""

DELAY_STEP = 0.05
"""Longest step of a template with a delay, in time constants: Heun's error a step is then about
(0.05)³/12 of the state's third derivative."""

JUMP_STEP = 0.01
"""Step of a template whose rates jump. Its state may slide along a jump and then chatters by a
step's change; MatCNN's own advice for such a template (MEDIAN) is at most 0.02."""


@dataclass(frozen=True, slots=True)
class FixedSteps:
    """`count` steps of `step` with an explicit method.

    With `settle` the count is a limit, and the run stops where nothing changes any more.
    """

    tableau: ButcherTableau
    step: float
    count: int
    settle: bool
    last: float
    """Length of the last step, so that the run ends on time."""
    error: float = math.inf
    """What is known of the error beforehand; infinite where nothing is."""


@dataclass(frozen=True, slots=True)
class AdaptiveSteps:
    """Steps that keep the method's own error estimate within the tolerances."""

    tableau: ButcherTableau
    first_step: float
    settle: bool


Stepping = FixedSteps | AdaptiveSteps
Scheme = Decay | Propagator | FixedSteps | AdaptiveSteps


@dataclass(frozen=True, slots=True, eq=False)
class Solver:
    """How one transient runs.

    Attributes
    ----------
    method : str
        Name of the method, as results report it.
    reason : str
        Why this one.
    scheme : Decay, Propagator, FixedSteps or AdaptiveSteps
    duration : float
        Time at which it ends (the limit where it runs to equilibrium).
    settle : bool
        Whether it runs to equilibrium.
    rtol, atol : float
    asked : bool
        Whether the method or the step was asked for, not chosen.
    """

    method: str
    reason: str
    scheme: Scheme
    duration: float
    settle: bool
    rtol: float
    atol: float
    asked: bool = False


def choose(transient: Transient, shape: tuple[int, int]) -> Solver:
    """Return how a transient runs on an array of that shape.

    Raises
    ------
    MethodError
        If the method asked for can not run this template, or its step is unstable.
    UnknownNameError
        If there is no such method.
    """
    network = Network(transient.template, shape)
    spec = _checked(transient)
    wanted = transient.template.duration if spec.duration is None else spec.duration
    settle = wanted == "settle"
    duration = spec.settle_limit if wanted == "settle" else float(wanted)
    if spec.method in ("auto", "propagator") and spec.dt is None:
        exact, reason = _exact(transient, network, math.inf if settle else duration)
        if exact is not None:
            return Solver("propagator", reason, exact, duration, settle, spec.rtol, spec.atol)
        if spec.method == "propagator":
            raise MethodError(f"Template '{transient.template.name}' has no propagator: {reason}.")
    asked = spec.method != "auto" or spec.dt is not None
    stepping, reason = _stepping(transient, network, spec, duration, settle)
    name = stepping.tableau.name
    return Solver(name, reason, stepping, duration, settle, spec.rtol, spec.atol, asked)


def _checked(transient: Transient) -> RunSpec:
    spec = transient.spec
    if spec.rtol < 0 or spec.atol <= 0:
        raise MethodError(
            f"Tolerances must be rtol ≥ 0 and atol > 0, got rtol={spec.rtol:g}, atol={spec.atol:g}."
        )
    if spec.dt is not None and not (spec.dt > 0 and math.isfinite(spec.dt)):
        raise MethodError(f"A fixed step must be positive, got dt={spec.dt}.")
    return spec


def _exact(
    transient: Transient, network: Network, duration: float
) -> tuple[Decay | Propagator | None, str]:
    template = transient.template
    if template.output.limited or template.output.discrete:
        return None, "its state is limited, or runs in discrete time"
    if not template.plain:
        return None, "it has nonlinear, delayed or time-varying couplings"
    if template.uncoupled:
        return decay(template, duration), "A = 0: every cell decays on its own, exactly"
    if not template.output.linear:
        return None, "its output saturates, so the array is not linear"
    if transient.has_mask:
        return None, "its fixed-state mask is only known at run time"
    if network.states > DENSE_LIMIT:
        return None, f"{network.states} states are more than the {DENSE_LIMIT} of a dense product"
    exact = propagator(network, duration)
    if exact is None:
        return None, "not every mode of the array decays, so it has no equilibrium"
    return exact, "the array is linear: one dense product is exact"


def _stepping(
    transient: Transient, network: Network, spec: RunSpec, duration: float, settle: bool
) -> tuple[Stepping, str]:
    template = transient.template
    if template.output.discrete:
        count = math.ceil(duration - 1e-9)
        return FixedSteps(EULER, 1.0, count, settle, 1.0, error=0.0), "it runs in discrete time"
    method, preset, reason = _preset(template, spec)
    bound = stable_step(method, network.fastest_rate())
    if preset is None and method.adaptive and template.delayed is None:
        first = min(0.1 * bound, duration) or 0.1 * bound
        return AdaptiveSteps(method, first, settle), "steps follow the error estimate"
    step = 0.5 * bound if preset is None else preset
    if step > bound:
        raise MethodError(
            f"dt={step:g} is outside the stability bound {bound:.4g} of '{method.name}' for "
            f"template '{template.name}'; take a shorter step or method='auto'."
        )
    return _fixed(template, method, step, duration, settle), reason


def _preset(template: Template, spec: RunSpec) -> tuple[ButcherTableau, float | None, str]:
    """Return the method, the fixed step where there must be one, and the reason for it."""
    asked = None if spec.method == "auto" else tableau(spec.method)
    if spec.dt is not None:
        return asked or (HEUN if template.delayed else EULER), spec.dt, "a fixed step was asked for"
    if template.delayed is not None:
        return asked or HEUN, DELAY_STEP, "its delay needs outputs of earlier steps"
    if any(coupling.jumps for coupling in template.nonlinear):
        return asked or EULER, JUMP_STEP, "its rates jump, which no error estimate follows"
    return asked or BOGACKI_SHAMPINE, None, "half of the stability bound"


def _fixed(
    template: Template, method: ButcherTableau, step: float, duration: float, settle: bool
) -> FixedSteps:
    """Return steps of that length at most; a delay is a whole number of them."""
    if template.delayed is not None:
        if any(c not in (0, 1) for c in (sum(row) for row in method.a)):
            raise MethodError(
                f"'{method.name}' needs outputs between the steps, which a delay does not keep: "
                "use 'euler' or 'heun'."
            )
        step = template.delayed.delay / math.ceil(template.delayed.delay / step - 1e-9)
        count = max(0, math.ceil(duration / step - 1e-9))
        last = duration - (count - 1) * step
    else:
        count = max(1, math.ceil(duration / step - 1e-9)) if duration > 0 else 0
        step = last = duration / count if count else step
    error = sum(step * coupling.jump for coupling in template.nonlinear if coupling.jumps)
    return FixedSteps(method, step, count, settle, last, error=float(error) or math.inf)
