"""Which method runs a transient, and why: by exactness first, then by error control."""

import math
from dataclasses import dataclass

from cnnum.errors import MethodError
from cnnum.graph.nodes import RunSpec, Transient
from cnnum.integrators.propagator import DENSE_LIMIT, Decay, Propagator, decay, propagator
from cnnum.integrators.tableau import (
    BOGACKI_SHAMPINE,
    ButcherTableau,
    stable_step,
    tableau,
)
from cnnum.network import Network

MAX_STEPS = 100_000
"""Steps after which an adaptive run gives up and says so."""


@dataclass(frozen=True, slots=True)
class FixedSteps:
    """`count` steps of `step` with an explicit method.

    With `settle` the count is a limit, and the run stops where nothing changes any more.
    """

    tableau: ButcherTableau
    step: float
    count: int
    settle: bool


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
    """

    method: str
    reason: str
    scheme: Scheme
    duration: float
    settle: bool
    rtol: float
    atol: float


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
    stepping, reason = _stepping(transient, network, spec, duration, settle)
    return Solver(stepping.tableau.name, reason, stepping, duration, settle, spec.rtol, spec.atol)


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
    if template.output.limited:
        return None, "its state is limited"
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
    rate = network.fastest_rate()
    name = BOGACKI_SHAMPINE.name if spec.method == "auto" else spec.method
    method = tableau("euler" if spec.dt is not None and spec.method == "auto" else name)
    bound = stable_step(method, rate)
    if spec.dt is None and method.adaptive:
        first = min(0.1 * bound, duration) or 0.1 * bound
        return AdaptiveSteps(method, first, settle), "steps follow the error estimate"
    step = 0.5 * bound if spec.dt is None else spec.dt
    if step > bound:
        raise MethodError(
            f"dt={step:g} is outside the stability bound {bound:.4g} of '{method.name}' for "
            f"template '{template.name}'; take a shorter step or method='auto'."
        )
    count = max(1, math.ceil(duration / step - 1e-9)) if duration > 0 else 0
    even = duration / count if count else step
    reason = "a fixed step was asked for" if spec.dt else "half of the stability bound"
    return FixedSteps(method, even, count, settle), reason
