"""The strategies for running a transient, as an ordered list: the first that fits is used."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from cnnum import kernels as ir
from cnnum.engines.opencl.large_arrays.strip_attempts import chebyshev_attempts, pair_attempts
from cnnum.engines.opencl.large_arrays.strip_steps import (
    state_strips,
    states_suffice,
    strip_steps,
    strips_fit,
)
from cnnum.engines.opencl.transients.builder import CHANGE, TransientBuilder, X
from cnnum.engines.opencl.transients.closed_form import exact
from cnnum.engines.opencl.transients.couplings import drive
from cnnum.engines.opencl.transients.euler_steps import fits_rows, fused_euler, fuses, row_steps
from cnnum.engines.opencl.transients.fixed_steps import chebyshev_sweeps, fixed_steps
from cnnum.engines.opencl.transients.pair_steps import rolled, rolls, sweeps
from cnnum.engines.opencl.transients.state_equation import (
    Instant,
    declare_outputs,
    rates_once,
    watched,
)
from cnnum.engines.opencl.transients.step_control import Attempt, Figures, controlled
from cnnum.integrators.closed_forms import Circulant, Decay, Propagator, Separate, Spectral
from cnnum.integrators.estimate import LOST
from cnnum.integrators.schemes import AdaptiveSteps, ChebyshevSteps, FixedSteps

Lower = Callable[[TransientBuilder, Any], Figures]
"""Appends the statements of a scheme, which update the states `x`, and returns the results."""

Fits = Callable[[TransientBuilder, Any], bool]
"""Whether a scheme can run this way."""


@dataclass(frozen=True, slots=True)
class Strategy:
    """A way to run a transient.

    Attributes
    ----------
    name : str
    reason : str
        Why it is used if it fits.
    schemes : tuple of type
        The solver schemes that it implements.
    lower : Lower
    fits : Fits
    own_weights : bool
        Whether weights can differ between frames.
    starts : bool
        Whether the states `x` must be initialised first.
    pads : bool
        Whether padded arrays of outputs must be declared first.
    """

    name: str
    reason: str
    schemes: tuple[type, ...]
    lower: Lower
    fits: Fits = lambda text, scheme: True
    starts: bool = True
    own_weights: bool = False
    pads: bool = True


def _followed(attempts: Callable[[TransientBuilder, Any], Attempt]) -> Lower:
    """Return the lowering of steps that may be rejected."""
    return lambda text, scheme: controlled(text, scheme, attempts)


STAGES_STAY = "all stages of a few rows stay in the cache"
LAST = "every scheme runs so"

STRATEGIES = (
    Strategy("closed form", "the array is linear, and its end a product",
             (Decay, Propagator, Spectral, Circulant), exact, starts=False, pads=False),
    Strategy("sums", "the state of no cell is read, and its output is known without it",
             (Separate,), exact, lambda text, scheme: scheme.ends, starts=False, pads=False),
    Strategy("cell by cell", "no cell sees another, so its way is known in pieces",
             (Separate,), exact, starts=False, pads=False),
    Strategy("strips of states", "an output costs less to make again than to keep",
             (FixedSteps,), state_strips,
             lambda text, scheme: strips_fit(text, scheme) and states_suffice(text, scheme),
             pads=False),
    Strategy("strips", "several steps of a few rows stay in the cache",
             (FixedSteps,), strip_steps, strips_fit, pads=False),
    Strategy("strips", STAGES_STAY, (ChebyshevSteps,), _followed(chebyshev_attempts), strips_fit),
    Strategy("strips", STAGES_STAY, (AdaptiveSteps,), _followed(pair_attempts), strips_fit),
    Strategy("rows in registers",
             "a row of a single frame fits a vector, and all rows fit the registers",
             (FixedSteps,), row_steps,
             lambda text, scheme: fuses(text, scheme) and fits_rows(text)),
    Strategy("fused sweeps", "a step of linear couplings is one sweep with the step in its weights",
             (FixedSteps,), fused_euler,
             lambda text, scheme: (
                 (text.tables.lanes > 1 or not text.tables.vectors) and fuses(text, scheme)
             ),
             own_weights=True),
    Strategy("rolled stages", "a loop over the stages of a single small frame is built quickly",
             (AdaptiveSteps,), _followed(rolled), lambda text, _: rolls(text)),
    Strategy("sweeps", LAST, (FixedSteps,), fixed_steps, own_weights=True),
    Strategy("sweeps", LAST, (ChebyshevSteps,), _followed(chebyshev_sweeps)),
    Strategy("sweeps", LAST, (AdaptiveSteps,), _followed(sweeps), own_weights=True),
)  # fmt: skip
"""In order of preference: the first that fits is used."""


def strategy_of(text: TransientBuilder) -> Strategy:
    """Return the first strategy that fits."""
    scheme, own = text.solver.scheme, text.operands.own is not None
    return next(
        strategy
        for strategy in STRATEGIES
        if isinstance(scheme, strategy.schemes)
        and (strategy.own_weights or not own)
        and strategy.fits(text, scheme)
    )


def run(text: TransientBuilder, strategy: Strategy) -> Figures:
    """Append statements that bring the state `x` to its end; return the results of the run.

    If a step length was forced on the run, its error is unknown.
    """
    drive(text)
    if strategy.starts:
        text.start()
    if strategy.pads:
        declare_outputs(text)
    figures = strategy.lower(text, text.solver.scheme)
    if text.solver.forced:
        figures |= {"settled": ir.ZERO, "error": ir.Number(LOST)}
    return figures


def settled_now(text: TransientBuilder, strategy: Strategy) -> None:
    """Append statements that set `change`, which tells whether the state `x` is at equilibrium.

    Delayed outputs are taken to equal the current ones, as they do at equilibrium.
    """
    text.body.append(ir.declare(CHANGE, ir.ZERO))
    if not strategy.pads:
        declare_outputs(text)
    end = ir.Number(text.solver.duration)
    instant = Instant(end, end, lambda at: text.output(X[at]))
    rates_once(text, lambda at, _: [watched(text, X[at])], instant)
