"""The ways to bring a transient to its end, as records in an order: the first that fits runs."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from cnnum import kernels as ir
from cnnum.engines.opencl.large_arrays.strip_adaptive import pair_attempts
from cnnum.engines.opencl.large_arrays.strip_steps import (
    state_strips,
    states_suffice,
    strip_steps,
    strips_fit,
)
from cnnum.engines.opencl.transients.builder import TransientBuilder
from cnnum.engines.opencl.transients.chebyshev_steps import chebyshev, chebyshev_in_strips
from cnnum.engines.opencl.transients.closed_form import exact
from cnnum.engines.opencl.transients.euler_in_registers import fits_rows, row_steps
from cnnum.engines.opencl.transients.feedforward import drive
from cnnum.engines.opencl.transients.fused_euler import fused_euler, fuses
from cnnum.engines.opencl.transients.initial_state import X, start
from cnnum.engines.opencl.transients.runge_kutta_steps import adaptive, fixed_steps
from cnnum.engines.opencl.transients.stage_loop import rolled, rolls
from cnnum.engines.opencl.transients.state_equation import (
    CHANGE,
    Instant,
    declare_outputs,
    rates_once,
    watch_change,
)
from cnnum.engines.opencl.transients.step_control import Figures
from cnnum.engines.opencl.transients.uncoupled_cells import separate
from cnnum.integrators.estimate import LOST
from cnnum.integrators.propagator import Decay, Propagator
from cnnum.integrators.schemes import AdaptiveSteps, ChebyshevSteps, FixedSteps
from cnnum.integrators.separate import Separate
from cnnum.integrators.spectral import Spectral


def _always(text: TransientBuilder, scheme: Any) -> bool:
    del text, scheme
    return True


@dataclass(frozen=True, slots=True)
class Strategy:
    """A way to run a transient.

    Attributes
    ----------
    name : str
    reason : str
        Why it is taken where it fits.
    schemes : tuple of type
        The schemes that a solver may ask for.
    lower : callable
        Appends the statements of a scheme, from and to the states `x`, and returns the figures.
    fits : callable
        Whether a scheme of these can run so.
    own_weights : bool
        Whether frames can have weights of their own.
    starts : bool
        Whether the states `x` stand at their start before.
    pads : bool
        Whether padded arrays of outputs are declared before.
    """

    name: str
    reason: str
    schemes: tuple[type, ...]
    lower: Callable[[TransientBuilder, Any], Figures]
    fits: Callable[[TransientBuilder, Any], bool] = _always
    starts: bool = True
    own_weights: bool = False
    pads: bool = True


STRATEGIES = (
    Strategy(
        "closed form",
        "the array is linear, and its end a product",
        (Decay, Propagator, Spectral),
        exact,
        starts=False,
        pads=False,
    ),
    Strategy(
        "cell by cell",
        "no cell sees another, so its way is known in pieces",
        (Separate,),
        separate,
        starts=False,
        pads=False,
    ),
    Strategy(
        "strips of states",
        "an output costs less to make again than to keep",
        (FixedSteps,),
        lambda text, scheme: state_strips(text, scheme),
        lambda text, scheme: strips_fit(text, scheme) and states_suffice(text, scheme),
        pads=False,
    ),
    Strategy(
        "strips",
        "several steps of a few rows stay in the cache",
        (FixedSteps,),
        lambda text, scheme: strip_steps(text, scheme),
        lambda text, scheme: strips_fit(text, scheme),
        pads=False,
    ),
    Strategy(
        "strips",
        "all stages of a few rows stay in the cache",
        (ChebyshevSteps,),
        chebyshev_in_strips,
        lambda text, scheme: strips_fit(text, scheme),
    ),
    Strategy(
        "strips",
        "all stages of a few rows stay in the cache",
        (AdaptiveSteps,),
        lambda text, scheme: adaptive(text, scheme, pair_attempts),
        lambda text, scheme: strips_fit(text, scheme),
    ),
    Strategy(
        "rows in registers",
        "a row of a single frame fits a vector, and all rows fit the registers",
        (FixedSteps,),
        row_steps,
        lambda text, scheme: fuses(text, scheme) and fits_rows(text, scheme),
    ),
    Strategy(
        "fused sweeps",
        "a step of linear couplings is one sweep with the step in its weights",
        (FixedSteps,),
        fused_euler,
        lambda text, scheme: text.tables.lanes > 1 and fuses(text, scheme),
        own_weights=True,
    ),
    Strategy(
        "rolled stages",
        "a loop over the stages of a single small frame is built quickly",
        (AdaptiveSteps,),
        lambda text, scheme: adaptive(text, scheme, rolled),
        lambda text, _: rolls(text),
    ),
    Strategy("sweeps", "every scheme runs so", (FixedSteps,), fixed_steps, own_weights=True),
    Strategy("sweeps", "every scheme runs so", (ChebyshevSteps,), chebyshev),
    Strategy("sweeps", "every scheme runs so", (AdaptiveSteps,), adaptive, own_weights=True),
)


def strategy_of(text: TransientBuilder) -> Strategy:
    """Return the first strategy that fits."""
    scheme, own = text.solver.scheme, text.operands.own is not None
    return next(
        each
        for each in STRATEGIES
        if isinstance(scheme, each.schemes)
        and (each.own_weights or not own)
        and each.fits(text, scheme)
    )


def run(text: TransientBuilder, strategy: Strategy) -> Figures:
    """Append statements that bring the state `x` to its end; return the figures of the run.

    A step that was forced upon a run leaves nothing known of its answer.
    """
    drive(text)
    if strategy.starts:
        start(text)
    if strategy.pads:
        declare_outputs(text)
    figures = strategy.lower(text, text.solver.scheme)
    if text.solver.forced:
        figures |= {"settled": ir.ZERO, "error": ir.Number(LOST)}
    return figures


def settled_now(text: TransientBuilder, strategy: Strategy) -> None:
    """Append statements that find in `change` whether the state `x` is at equilibrium.

    Delayed outputs are taken as those of now, as they are once nothing changes.
    """
    text.body.append(ir.declare(CHANGE, ir.ZERO))
    if not strategy.pads:
        declare_outputs(text)
    instant = Instant(ir.Number(text.solver.duration), lambda at: text.output(X[at]))
    rates_once(text, X, lambda at, _: [watch_change(text, X[at])], instant)
