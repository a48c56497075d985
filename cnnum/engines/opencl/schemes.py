"""The kernel text of each way to bring a transient to its end."""

from cnnum.engines.opencl.chebyshev import chebyshev
from cnnum.engines.opencl.drive import drive
from cnnum.engines.opencl.exact import exact
from cnnum.engines.opencl.exponential import exponential
from cnnum.engines.opencl.fused import fused_euler, fuses
from cnnum.engines.opencl.rates import (
    Instant,
    declare_outputs,
    once_by_rows,
    rates_once,
    watch_change,
)
from cnnum.engines.opencl.rolled import rolled, rolls
from cnnum.engines.opencl.separate import separate
from cnnum.engines.opencl.start import start
from cnnum.engines.opencl.stepping import adaptive, fixed, sweeps
from cnnum.engines.opencl.strip_attempts import pair_attempts
from cnnum.engines.opencl.strips import strip_steps, strips_fit
from cnnum.engines.opencl.text import rename
from cnnum.engines.opencl.transients import TransientText
from cnnum.integrators.choice import FixedSteps
from cnnum.integrators.estimate import LOST
from cnnum.integrators.propagator import Decay, Propagator
from cnnum.integrators.schemes import ChebyshevSteps, ExponentialSteps
from cnnum.integrators.separate import Separate
from cnnum.integrators.spectral import Spectral

Figures = dict[str, str]
"""Expressions for the figures of a run: time, steps, settled, error."""


def run(text: TransientText) -> Figures:
    """Append the text that brings the state `x` to its end and return its figures.

    A step that was forced upon a run leaves nothing known of its answer.
    """
    figures = _run(text)
    if text.solver.forced:
        figures |= {"settled": "ZERO", "error": text.number(LOST)}
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
        error = text.number(LOST)
        if scheme.settle:
            time = f"fmin(steps * {text.number(scheme.step)}, {text.number(text.solver.duration)})"
            return {"time": time, "steps": "steps", "settled": "settled", "error": error}
        time = text.number(text.solver.duration)
        return {"time": time, "steps": text.number(scheme.count), "error": error}
    if not (strips_fit(text, scheme) and once_by_rows(text)):
        declare_outputs(text)
    if isinstance(scheme, ChebyshevSteps):
        return chebyshev(text, scheme, by_strips=strips_fit(text, scheme))
    if isinstance(scheme, ExponentialSteps):
        return exponential(text, scheme)
    if isinstance(scheme, FixedSteps):
        return fused_euler(text, scheme) if fuses(text, scheme) else fixed(text, scheme)
    if strips_fit(text, scheme):
        return adaptive(text, scheme, pair_attempts)
    return adaptive(text, scheme, rolled if rolls(text) else sweeps)


def settled_now(text: TransientText) -> None:
    """Append the text that finds in `change` whether the state `x` is at equilibrium.

    Delayed outputs are taken as those of now, as they are once nothing changes.
    """
    text.lines.append("real change = ZERO;")
    if not once_by_rows(text) and not _declares_outputs(text):
        declare_outputs(text)
    instant = Instant(text.number(text.solver.duration), _outputs_now(text))
    rates_once(text, "x", watch_change(text, "x"), instant)


def _declares_outputs(text: TransientText) -> bool:
    """Return whether the steps have declared the arrays of outputs."""
    scheme = text.solver.scheme
    if isinstance(scheme, Decay | Propagator | Spectral | Separate):
        return False
    return not (isinstance(scheme, FixedSteps | ExponentialSteps) and strips_fit(text, scheme))


def _outputs_now(text: TransientText) -> str:
    return rename(text.template.output.opencl, {"x": "x[{at}]"})
