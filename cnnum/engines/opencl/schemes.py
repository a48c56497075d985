"""Each way to bring a transient to its end."""

from cnnum.engines.opencl.chebyshev import chebyshev
from cnnum.engines.opencl.drive import drive
from cnnum.engines.opencl.exact import exact
from cnnum.engines.opencl.exponential import exponential
from cnnum.engines.opencl.fixed_steps import fixed_figures
from cnnum.engines.opencl.fused import fused_euler, fuses
from cnnum.engines.opencl.ir.expressions import ZERO, Number, call
from cnnum.engines.opencl.ir.statements import declare
from cnnum.engines.opencl.rates import (
    CHANGE,
    Instant,
    declare_outputs,
    once_by_rows,
    rates_once,
    watch_change,
)
from cnnum.engines.opencl.rolled import rolled, rolls
from cnnum.engines.opencl.separate import separate
from cnnum.engines.opencl.start import X, start
from cnnum.engines.opencl.step_control import STEPS, Figures
from cnnum.engines.opencl.stepping import adaptive, fixed_steps, sweeps
from cnnum.engines.opencl.strip_attempts import pair_attempts
from cnnum.engines.opencl.strips import strip_steps, strips_fit
from cnnum.engines.opencl.transients import TransientText
from cnnum.integrators.choice import FixedSteps
from cnnum.integrators.estimate import LOST
from cnnum.integrators.propagator import Decay, Propagator
from cnnum.integrators.schemes import ChebyshevSteps, ExponentialSteps
from cnnum.integrators.separate import Separate
from cnnum.integrators.spectral import Spectral


def run(text: TransientText) -> Figures:
    """Append what brings the state `x` to its end and return the figures of the run.

    A step that was forced upon a run leaves nothing known of its answer.
    """
    figures = _run(text)
    if text.solver.forced:
        figures |= {"settled": ZERO, "error": Number(LOST)}
    return figures


def _run(text: TransientText) -> Figures:
    drive(text)
    scheme = text.solver.scheme
    if isinstance(scheme, Decay | Propagator | Spectral):
        return exact(text, scheme)
    if isinstance(scheme, Separate):
        return separate(text, scheme)
    start(text)
    if isinstance(scheme, FixedSteps | ExponentialSteps) and strips_fit(text, scheme):
        strip_steps(text, scheme)
        return _strip_figures(text, scheme)
    if not (strips_fit(text, scheme) and once_by_rows(text)):
        declare_outputs(text)
    if isinstance(scheme, ChebyshevSteps):
        return chebyshev(text, scheme, by_strips=strips_fit(text, scheme))
    if isinstance(scheme, ExponentialSteps):
        return exponential(text, scheme)
    if isinstance(scheme, FixedSteps):
        return fused_euler(text, scheme) if fuses(text, scheme) else fixed_steps(text, scheme)
    if strips_fit(text, scheme):
        return adaptive(text, scheme, pair_attempts)
    return adaptive(text, scheme, rolled if rolls(text) else sweeps)


def _strip_figures(text: TransientText, scheme: FixedSteps | ExponentialSteps) -> Figures:
    figures = fixed_figures(text, scheme.count, settle=scheme.settle)
    if scheme.settle:
        time = call("fmin", STEPS * Number(scheme.step), Number(text.solver.duration))
        figures["time"] = time
    return figures


def settled_now(text: TransientText) -> None:
    """Append what finds in `change` whether the state `x` is at equilibrium.

    Delayed outputs are taken as those of now, as they are once nothing changes.
    """
    text.body.append(declare(CHANGE, ZERO))
    if not once_by_rows(text) and not _declares_outputs(text):
        declare_outputs(text)
    instant = Instant(Number(text.solver.duration), lambda at: text.output(X[at]))
    rates_once(text, X, lambda at, _: [watch_change(text, X[at])], instant)


def _declares_outputs(text: TransientText) -> bool:
    """Return whether the steps have declared the arrays of outputs."""
    scheme = text.solver.scheme
    if isinstance(scheme, Decay | Propagator | Spectral | Separate):
        return False
    return not (isinstance(scheme, FixedSteps | ExponentialSteps) and strips_fit(text, scheme))
