"""Runs whose steps do not show their error, or its growth: a finer run says how far off they are.

An error that is followed grows as the rates do. Where all of an array is small at first, its rates
may show the growth late: the part of the state that grows fastest is hidden behind others. And
steps that are within the tolerance of a large state may be long for a small one, so that they
grow it by too little. Gains in time move the rates by themselves, and couplings by tables have
slopes of their own. And what a step's rates show is the error of a linear array: where the output
is curved, as tanh is, it may vanish by chance while the step is as far off as its tolerance allows.
An array may also shrink before it grows: while its rates fall, errors rise unseen in the part that
grows later.
In these cases the first run is compared with one whose tolerances are a tenth, and
relative to the start, and whose order is no less than 5. The true error is below the distance of
the two and the error of the second.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.errors import MethodError
from cnnum.graph.nodes import RunSpec
from cnnum.integrators.estimate import FLOOR, error_growth
from cnnum.integrators.schemes import AdaptiveSteps, ChebyshevSteps
from cnnum.integrators.solver import Solver
from cnnum.integrators.tableau import BOGACKI_SHAMPINE, DORMAND_PRINCE
from cnnum.runs.request import Request
from cnnum.runs.result import Result
from cnnum.templating.functions import PairFunction
from cnnum.templating.template import Template

FAR = 3.0
"""States that grow by more than this are compared with a finer run: those of pictures grow to twice
of what they begin with."""

AMPLIFIED = 100.0
"""An error of more tolerances than this has grown on the way, perhaps where the rates showed less
of it. One that is larger than the state says nothing, and another run would not change that."""

FINER = 0.1
"""Share of the tolerances in those of the finer run."""

SAFETY = 1.5
"""Of the distance of two runs."""

SMALLEST = 1e-30
"""Of a tolerance: devices flush numbers not much smaller."""

Maps = Mapping[str, NDArray[np.floating]]
Again = Callable[[RunSpec, NDArray[np.intp]], Result]
"""Runs some of a batch's frames otherwise; results have one axis of frames, the last of `time`."""


def may_grow(template: Template, solver: Solver) -> bool:
    """Return whether a run is one whose followed error may miss something."""
    scheme = solver.scheme
    if solver.settle or not isinstance(scheme, AdaptiveSteps | ChebyshevSteps):
        return False
    return error_growth(template) > 0.0 or hides_errors(template, solver)


def hides_errors(template: Template, solver: Solver) -> bool:
    """Return whether every run takes another one to say how far off it is.

    Steps of a fixed length are no longer than their stages show.
    """
    if _even(solver):
        return False
    straight = template.output.linear or template.output.name in ("standard", "full-range")
    moving = any(not coupling.static for coupling in template.nonlinear)
    return not straight or bool(template.gains) or moving


def follows(request: Request) -> bool:
    """Return whether the engine takes the chosen steps, whose error may miss a growth."""
    if request.engine.whole or request.settles:
        return False
    solver = request.solver
    steps = solver.asked or request.engine.record.takes_steps
    return steps and may_grow(request.ran, solver)


def followed(request: Request, down: Callable[[Request], Result]) -> Result:
    """Take a run whose error holds where its state has grown far, too."""
    result = down(request)
    if result.method != request.solver.method:  # implicit steps, whose error misses none
        return result

    def again(finer: RunSpec, frames: NDArray[np.intp]) -> Result:
        return down(request.by(finer, request.frames(frames)))

    return compared(result, request.ran, request.solver, request.given, request.spec, again)


def looks_again(
    solver: Solver, begun: Floats | float, ended: Floats | float, error: Floats | float
) -> NDArray[np.bool_]:
    """Return whether a run's own error is not enough, by its sizes at the start and at the end."""
    tolerance = solver.atol + solver.rtol * np.asarray(ended)
    amplified = (error > AMPLIFIED * tolerance) & (error < FAR * np.asarray(ended))
    return np.asarray((np.asarray(ended) > FAR * begun) | amplified)


def _even(solver: Solver) -> bool:
    """Return whether steps are of one length, whatever their error."""
    return isinstance(solver.scheme, AdaptiveSteps) and not any(solver.scheme.tableau.error)


def scale(template: Template, sizes: Mapping[str, Floats]) -> Floats:
    """Return a bound on the size of all that a run begins with: start, drive and rims.

    Parameters
    ----------
    template : Template
    sizes : mapping of str to (..., maps) float
        The largest number in each map of the run, by role.
    """
    output, A = template.output, np.abs(template.A).sum(axis=(2, 3))
    total: Floats = np.asarray(np.abs(template.z), dtype=np.float64)
    rim = template.boundary.constant or 0.0
    still = abs(float(output.numpy(np.asarray(0.0)))) + abs(float(output.numpy(np.asarray(rim))))
    total = total + A.sum(axis=1) * still
    for coupling in template.nonlinear:
        none = np.zeros(1)
        value = abs(float(coupling.value(none, none)[0]))
        if not isinstance(coupling.function, PairFunction):
            value += coupling.function.steepest * abs(rim)
        total[coupling.to] += value * float(np.abs(coupling.weights).sum())
    if "input" in sizes and template.inputs:
        edge = abs(template.input_boundary.constant or 0.0)
        seen = np.maximum(sizes["input"], edge)
        total = total + seen @ np.abs(template.B).sum(axis=(2, 3)).T
    if "bias" in sizes:
        total = total + sizes["bias"]
    if "state" in sizes:
        total = total + sizes["state"]
    elif template.initial == "input":
        total = total + sizes["input"]
    else:
        total = total + abs(float(template.initial))
    return np.asarray(total.max(axis=-1), dtype=np.float64)


def compared(
    result: Result, template: Template, solver: Solver, given: Maps, spec: RunSpec, again: Again
) -> Result:
    """Return a result whose errors hold where its own steps do not show them, too.

    Parameters
    ----------
    result : Result
        Result of a batch, perhaps at several times.
    template : Template
    solver : Solver
        That took its steps.
    given : mapping of str to (..., maps, rows, cols) float
        The maps of its frames.
    spec : RunSpec
        How it was run.
    again : callable
    """
    lead = np.shape(result.time)
    inner = tuple(range(len(lead), result.state.ndim))
    sizes = {role: np.abs(maps).max(axis=(-2, -1)) for role, maps in given.items()}
    begun = np.broadcast_to(scale(template, sizes), lead)
    ended = np.abs(result.state).max(axis=inner, initial=0.0)
    again_by_size = looks_again(solver, begun, ended, np.asarray(result.error, dtype=np.float64))
    grew = (again_by_size | hides_errors(template, solver)) & np.isfinite(result.error)
    times = len(result.times) if result.times else 1
    frames = np.flatnonzero(grew.reshape(times, -1).any(axis=0))
    if not len(frames):
        return result
    smallest = float(begun.reshape(times, -1)[0, frames].min())
    state = np.asarray(result.state, dtype=np.float64).reshape(times, -1, *_inner(result))
    error = np.array(result.error, dtype=np.float64).reshape(times, -1)
    try:
        finer = again(_finer(spec, smallest, solver), frames)
    except MethodError:  # it would take too many steps
        error[:, frames] = math.inf
    else:
        apart = finer.state.reshape(times, len(frames), *_inner(result)) - state[:, frames]
        off = np.abs(apart).reshape(times, len(frames), -1).max(axis=2)
        found = SAFETY * off + np.asarray(finer.error).reshape(times, -1)
        # both may miss a corner, as any run by steps does
        taken = np.asarray(finer.steps).reshape(times, -1) > 0
        error[:, frames] = np.maximum(found, np.where(taken, FLOOR * spec.atol, 0.0))
    return replace(result, error=error.reshape(lead))


def _inner(result: Result) -> tuple[int, ...]:
    return result.state.shape[np.ndim(result.time) :]


def _finer(spec: RunSpec, begun: float, solver: Solver) -> RunSpec:
    """Return a finer run: its tolerances are powers of 10, so that few plans are made of them.

    Where stability sets the steps, a finer run of the same method takes the same ones, and agrees.
    """
    atol = FINER * min(spec.atol, max(spec.rtol, spec.atol) * begun)
    exponent = math.floor(math.log10(max(atol, SMALLEST)))
    coarse = solver.method == BOGACKI_SHAMPINE.name or _even(solver)
    method = DORMAND_PRINCE.name if coarse else spec.method
    return replace(
        spec, method=method, dt=None, estimate=False, rtol=FINER * spec.rtol, atol=10.0**exponent
    )
