"""The engine as users see it: it runs single templates and compiles programs."""

from __future__ import annotations  # signatures that `help` shows as they are written

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from threading import RLock
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cnnum.arrays import Shape
from cnnum.embedded.formats import is_integer
from cnnum.engines.fallback import opened
from cnnum.engines.whole.ranges import measuring
from cnnum.errors import MethodError, ProgramError
from cnnum.frame import FORCE_AXES
from cnnum.graph.nodes import RunSpec
from cnnum.integrators.choice import check_spec
from cnnum.integrators.estimate import delayed_growth
from cnnum.integrators.schemes import FixedSteps
from cnnum.integrators.solver import Solver, Stepping
from cnnum.plan import Plan
from cnnum.programs import Program
from cnnum.programs.library import get_program
from cnnum.runs.arguments import channels_and_lead, maps_by_role
from cnnum.runs.chip import Chip, run_on_chip
from cnnum.runs.delays import by_differences, by_halving, delay_of, frames_of, halved
from cnnum.runs.growth import compared, may_grow
from cnnum.runs.linear_range import as_linear, stays_linear
from cnnum.runs.many.batches import run_batch
from cnnum.runs.planning import graph_of, plan_of
from cnnum.runs.prepared import Form, PreparedRuns, form_of, prepared_run
from cnnum.runs.result import ROLES, Proof, Result
from cnnum.runs.settling import at_rest, saturated
from cnnum.runs.single import finished, outputs_of, with_fallback
from cnnum.runs.stiff import implicit_spec, refuse_hopeless, stiffly
from cnnum.runs.times import checked_times, ended, looked_at, stacked
from cnnum.templating.batch import TemplateBatch
from cnnum.templating.library import as_template
from cnnum.templating.reads import turning_points
from cnnum.templating.template import Duration, Template
from cnnum.values import OfThisProcess


class Engine(OfThisProcess):
    """Runs templates and programs on one device.

    Parameters
    ----------
    name : str, optional
        "opencl", "numba" or "reference". Unless given, "opencl" where a device works; else "numba",
        with one sentence on standard error.
    device : str, optional
        Part of a device's or platform's name; the fastest unless given.
    precision : str, optional
        "float32" or "float64"; or whole numbers: "q15", "q7", or "qM.N" of up to 32 bits, on the
        engines "opencl" and "reference". The engine's own unless given.
    fallback : str, optional
        "numba" goes on where a device is lost or out of memory; `Result.reason` says so.

    Raises
    ------
    UnknownNameError
        If there is no such engine, precision or fallback.
    DeviceError
        If there is no such device.
    """

    __slots__ = ("_backend", "_fallback", "_plans", "_prepared", "_turn")

    def __init__(
        self,
        name: str | None = None,
        *,
        device: str | None = None,
        precision: str | None = None,
        fallback: str | None = None,
    ) -> None:
        self._backend = opened(name, device, precision, fallback)
        self._fallback = fallback
        self._plans: dict[tuple[object, ...], Plan] = {}
        self._prepared = PreparedRuns()
        self._turn = RLock()

    @property
    def name(self) -> str:
        """Name of the engine."""
        return self._backend.record.name

    @property
    def device(self) -> str:
        """The device in words."""
        return self._backend.device

    @property
    def precision(self) -> str:
        """One of "float32", "float64", "q15", "q7" and so on."""
        return self._backend.precision

    def __repr__(self) -> str:
        return f"Engine('{self.name}', device='{self.device}', precision='{self.precision}')"

    def _elsewhere(self) -> str:
        return f"make one there, by cnnum.Engine('{self.name}', precision='{self.precision}')"

    def with_precision(self, precision: str) -> Engine:
        """Return an engine of the same kind on the same device in another precision.

        Raises
        ------
        DeviceError
            If the device does not have it.
        """
        device = self.device if self._backend.record.devices else None
        return Engine(self.name, device=device, precision=precision, fallback=self._fallback)

    def compile(
        self,
        program: Program | str,
        shape: Sequence[int],
        needs: Sequence[str] | None = None,
        *,
        channels: Sequence[str] = FORCE_AXES,
        method: str | None = None,
        rtol: float | None = None,
        atol: float | None = None,
        dt: float | None = None,
        like: ArrayLike | None = None,
        chip: Chip | None = None,
    ) -> Plan:
        """Return a plan that runs the operations of the wanted outputs alone.

        Parameters
        ----------
        program : Program or str
            A function decorated with `cnnum.program`, or one of the library's by its name.
        shape : (rows, cols)
        needs : sequence of str, optional
            Names of wanted outputs; all unless given.
        channels : sequence of str
            Channels of a frame, in the order of its last axis.
        method, rtol, atol, dt : optional
            As in `run`, for every transient of the program; each one's own unless given.
        like : (frames, ..., rows, cols, channels) float, optional
            Of whole numbers: streams like those to come, on which the range of every value is
            measured. Those of each batch itself unless given; a stream with memories needs it.
        chip : Chip, optional
            As on an analogue array of that accuracy; on the engine "reference".

        Raises
        ------
        MethodError
            If a transient cannot run by that method, or not in such steps.
        ProgramError
            If it is no program, or cannot be traced; or if `like` is given to real numbers.
        UnknownNameError
            If a need is not among its outputs.
        NotSupportedError
            If this engine does not do something in it.
        SizeError
            If the machine has less memory than one frame needs.
        """
        if isinstance(program, str):
            program = get_program(program)
        if not isinstance(cast(object, program), Program):
            raise ProgramError(
                f"An engine compiles a program, got {type(program).__name__}: put @cnnum.program "
                "above the function, and run a template with engine.run."
            )
        asked: dict[str, Any] = {"method": method, "rtol": rtol, "atol": atol, "dt": dt}
        asked = {name: value for name, value in asked.items() if value is not None}
        graph = program.trace(shape, channels)
        backend = self._backend
        if chip is not None:
            from cnnum.runs.chip_programs import chip_backend  # with SciPy, which takes its time

            backend = chip_backend(chip, backend)
        if like is not None:
            backend = measuring(backend, like, (*graph.shape, len(channels)))
        about = (program.name, graph, channels, needs)
        return plan_of(*about, self._backend, backend=backend, asked=asked)

    def run(
        self,
        template: Template | TemplateBatch | str,
        *,
        input: ArrayLike | None = None,
        previous: ArrayLike | None = None,
        state: ArrayLike | None = None,
        bias: ArrayLike | None = None,
        mask: ArrayLike | None = None,
        duration: Duration | None = None,
        method: str = "auto",
        rtol: float = 1e-4,
        atol: float = 1e-5,
        dt: float | None = None,
        force: bool = False,
        estimate: bool = False,
        at: ArrayLike | None = None,
        chip: Chip | None = None,
    ) -> Result:
        """Run one template's transient.

        Input, start and weights may keep every cell within the linear range of the standard output.
        The array then counts as linear, and may be exact.

        Parameters
        ----------
        template : Template, TemplateBatch or str
            One of the library's by its name, one of your own, or many that share a launch: they
            are the first axis of the batch.
        input : (..., rows, cols) or (..., inputs, rows, cols) float, optional
            Where the template has no control template and starts from its input, this is the
            initial state.
        previous : like `input`, optional
            The inputs before the start, which a template with delays sees; `input` unless given.
        state : (..., rows, cols) or (..., layers, rows, cols) float, optional
            Initial state; the template's own unless given.
        bias : like `state`, optional
            Space-variant bias map, added to z.
        mask : (..., rows, cols) bool, optional
            Fixed-state mask: the state keeps its value where it is true.
        duration : float or "settle", optional
            In the unit of time in which the template's `tau` is; its own unless given.
        method : str
            "auto", "propagator", or one of `cnnum.integrators.stability.METHODS`.
        rtol, atol : float
            Wanted error of the state.
        dt : float, optional
            Fixed step, in that unit; Euler's method unless `method` says otherwise.
        force : bool
            Take a fixed step outside the stability bound all the same. The result is marked: not
            settled, error infinite.
        estimate : bool
            Follow the error of fixed steps as that of others is: a step takes at least one more
            evaluation of the rates, and there are at most 100,000.
        at : sequence of float, optional
            Times in that unit, each after the one before, instead of a duration: one run to the
            last of them, looked at on its way. State and error are those of a run which ends there,
            and the times change nothing else. The engine "reference", implicit steps and whole
            numbers run anew to each time.
        chip : Chip, optional
            As on an analogue array of that accuracy: weights, maps, noise and mismatch.

        Returns
        -------
        Result
            Leading axes are the batch that the arguments broadcast to; with `at`, the times come
            first: (times, ..., rows, cols).

        Raises
        ------
        ArrayError
            If shapes do not fit, or values are not real and finite, or too large for the precision.
        MethodError
            If the duration, a tolerance or the step is not a number of its range. Or if the method
            cannot run this template, or does not reach the end.
        SizeError
            If the machine or the device has less memory than the array needs.
        """
        arrays = (input, previous, state, bias, mask)
        if chip is not None or isinstance(template, TemplateBatch):
            options: dict[str, Any] = {
                "duration": duration, "method": method, "rtol": rtol, "atol": atol, "dt": dt,
                "force": force, "estimate": estimate, "at": at}  # fmt: skip
            if chip is not None or not isinstance(template, TemplateBatch):
                return run_on_chip(cast(Chip, chip), template, arrays, partial(self.run, **options))
            how = (self._backend.record, self.precision, self._plan_for, self.run)
            return run_batch(*how, template, arrays, options)
        template = as_template(template)
        if at is not None:
            times = checked_times(at, duration)
            spec = RunSpec(times[-1], method, rtol, atol, dt, force=force, estimate=estimate)
            return self._at_times(template, arrays, times, spec)
        asked = (duration, method, rtol, atol, dt, force, estimate)
        form = form_of(template, arrays, asked)
        prepared = None if form is None else self._prepared.get(form)
        settles = (template.duration if duration is None else duration) == "settle"
        result = None
        if prepared is not None:
            with suppress(MethodError):  # its steps are too many: below, others are looked for
                result = prepared.run(arrays)
        ready = result
        if settles and result is not None:
            ready = saturated(result, template, rtol, atol, self.precision)
        if ready is not None:
            # prepared runs take arrays alone, which their caller may change before a proof is read
            own = [None if one is None else cast(np.ndarray, one).copy() for one in arrays]
            return self._with_proof(ready, template, own, asked)
        given, shape = maps_by_role(template, dict(zip(ROLES, arrays, strict=True)))
        spec = RunSpec(duration, method, rtol, atol, dt, force=force, estimate=estimate)
        if result is None:
            result = self._run(template, given, shape, spec, form if prepared is None else None)
        if settles:
            result = self._at_rest(result, template, given, shape, spec)
        kept = {role: np.array(maps) for role, maps in given.items()}
        return self._with_proof(result, template, kept, asked)

    def _with_proof(
        self,
        result: Result,
        template: Template,
        given: dict[str, NDArray[np.floating]] | list[NDArray[np.floating] | None],
        asked: tuple[Any, ...],
    ) -> Result:
        """Return a result that knows what its proof takes; maps are its own."""
        if is_integer(self.precision):
            return result
        duration = template.duration if asked[0] is None else asked[0]
        proof = Proof(template, given, duration, asked[2:4], result.state, result.error)
        object.__setattr__(result, "proof", proof)
        return result

    def _at_times(
        self,
        template: Template,
        arrays: tuple[ArrayLike | None, ...],
        times: tuple[float, ...],
        spec: RunSpec,
    ) -> Result:
        """Return the results of a run at times on its way and at its end."""
        maps: dict[str, Any] = dict(zip(ROLES, arrays, strict=True))
        how: dict[str, Any] = {
            "method": spec.method, "rtol": spec.rtol, "atol": spec.atol, "dt": spec.dt,
            "force": spec.force, "estimate": spec.estimate}  # fmt: skip

        def up_to(time: float) -> Result:
            return self.run(template, **maps, duration=time, **how)

        end = up_to(times[-1])
        looks = None
        if len(times) > 1 and not is_integer(self.precision):
            given, shape = maps_by_role(template, maps)
            looks = self._looks(template, given, shape, spec, times[:-1], end)
        if looks is None:
            return stacked([*map(up_to, times[:-1]), end], times)
        return ended(looks, end)

    def _looks(
        self,
        template: Template,
        given: dict[str, NDArray[np.floating]],
        shape: Shape,
        spec: RunSpec,
        times: tuple[float, ...],
        end: Result,
    ) -> Result | None:
        """Return what a run passes through at times; None where each is a run of its own."""
        names, lead = channels_and_lead(given)
        exact = spec.dt is None and spec.method in ("auto", "propagator")
        ran = as_linear(template) if exact and stays_linear(template, given) else template
        plan = self._plan_for((ran.digest, shape, names, spec), ran, shape, names, spec)
        (solver,) = plan.solvers.values()
        steps = isinstance(solver.scheme, Stepping)
        finely = not self._backend.record.takes_steps and not (
            solver.asked or template.output.discrete
        )
        if finely or (steps and end.method != solver.method):
            return None
        if steps and by_halving(ran, dt=spec.dt, settle=False):
            return self._halved_looks(ran, given, shape, spec, times, end)
        looks = looked_at(plan, given, lead, times, self.precision)
        if looks is None or not self._follows(solver, ran):
            return looks

        def again(finer: RunSpec, frames: NDArray[np.intp]) -> Result:
            some = frames_of(given, lead, frames)
            names, lead_of_some = channels_and_lead(some)
            plan = self._plan_for((ran.digest, shape, names, finer), ran, shape, names, finer)
            found = looked_at(plan, some, lead_of_some, times, self.precision)
            if found is None:  # its steps are implicit: nothing is known of the error
                raise MethodError("Implicit steps are not looked at on their way.")
            return found

        return compared(looks, ran, given, spec, again)

    def _halved_looks(
        self,
        template: Template,
        given: dict[str, NDArray[np.floating]],
        shape: Shape,
        spec: RunSpec,
        times: tuple[float, ...],
        end: Result,
    ) -> Result | None:
        """Return the looks at a run with a delay: in the steps of its end, twice and four times."""
        names, lead = channels_and_lead(given)
        step = float(np.max(end.time)) / max(int(np.max(end.steps)), 1)
        delay = delay_of(template)
        parts = 4 * max(1, math.ceil(delay / step / 4.0 - 1e-9)) if step else 4
        found: list[Result] = []
        for coarser in (4, 2, 1):
            dt = coarser * delay / parts
            fixed = replace(spec, dt=dt, method=end.method)
            key = (template.digest, shape, names, fixed)
            plan = self._plan_for(key, template, shape, names, fixed)
            # before the first step ends, runs would be the same one but for these
            one = looked_at(plan, given, lead, times, self.precision, cuts=4 // coarser)
            if one is None:
                return None
            found.append(one)
        turns = bool(turning_points(template, times[-1]))
        return by_differences(found, (spec.rtol, spec.atol), self.precision, turns=turns)

    def _at_rest(
        self,
        result: Result,
        template: Template,
        given: dict[str, NDArray[np.floating]],
        shape: Shape,
        spec: RunSpec,
    ) -> Result:
        """Return the result of a run to equilibrium, which runs on where there is none yet."""
        exact = result.method == "propagator" and self._backend.record.takes_steps
        if exact or is_integer(self.precision):
            # whole numbers rest where a step moves none of them
            known = np.isfinite(result.error) | is_integer(self.precision)
            settled = result.settled & known
            return replace(result, settled=settled, error=np.where(settled, result.error, np.inf))

        def again(given: dict[str, NDArray[np.floating]], duration: float) -> Result:
            longer = replace(spec, duration=duration)
            return self._run(template, given, shape, longer, None, plainly=True)

        return at_rest(result, template, given, again, spec, self.precision)

    def _run(
        self,
        template: Template,
        given: dict[str, NDArray[np.floating]],
        shape: Shape,
        spec: RunSpec,
        form: Form | None,
        *,
        plainly: bool = False,
    ) -> Result:
        """Run maps by role; a run of a form that is given is kept ready, if there is anything.

        Plain runs leave it to others to look how far their frames have grown.
        """
        names, lead = channels_and_lead(given)
        check_spec(spec)
        exact = spec.dt is None and spec.method in ("auto", "propagator")
        ran = as_linear(template) if exact and stays_linear(template, given) else template
        plan = self._plan_for((ran.digest, shape, names, spec), ran, shape, names, spec)
        (solver,) = plan.solvers.values()
        try:
            refuse_hopeless(self._backend.record, solver, float(ran.tau.min()))
            outputs = outputs_of(plan, given, lead)
        except MethodError:
            implicit = implicit_spec(self._backend.record, ran, shape, spec)
            if implicit is None or is_integer(self.precision):
                raise
            return stiffly(self._run(template, given, shape, implicit, None))
        result = finished(outputs, solver, template, linear=ran is not template)
        result = with_fallback(result, plan)
        halves = by_halving(ran, dt=spec.dt, settle=solver.settle)
        halves = halves and self._backend.record.takes_steps
        if isinstance(solver.scheme, FixedSteps) and halves and not is_integer(self.precision):

            def finer(step: float, frames: NDArray[np.intp]) -> Result:
                some = frames_of(given, lead, frames)
                return self._run(template, some, shape, replace(spec, dt=step), None)

            about = (delay_of(ran), (spec.rtol, spec.atol), self.precision, solver.scheme.step)
            turns = bool(turning_points(ran, solver.duration))
            return halved(result, finer, *about, growth=delayed_growth(ran), turns=turns)
        if not plainly and self._follows(solver, ran):

            def again(finer: RunSpec, frames: NDArray[np.intp]) -> Result:
                some = frames_of(given, lead, frames)
                return self._run(template, some, shape, finer, None, plainly=True)

            result = compared(result, ran, given, spec, again)
        if form is not None:
            prepared = prepared_run(template, plan, given, exact=exact)
            if prepared is not None:
                with self._turn:
                    self._prepared.keep(form, prepared)
        return result

    def _follows(self, solver: Solver, template: Template) -> bool:
        """Return whether the engine takes the solver's own steps, whose error may miss a growth."""
        steps = solver.asked or self._backend.record.takes_steps
        return steps and may_grow(template, solver) and not is_integer(self.precision)

    def _plan_for(
        self,
        key: tuple[object, ...],
        template: Template,
        shape: Shape,
        names: tuple[str, ...],
        spec: RunSpec,
    ) -> Plan:
        """Return the plan of a run, which is made once, whichever thread asks first."""
        plan = self._plans.get(key)
        if plan is None:
            with self._turn:
                plan = self._plans.get(key)
                if plan is None:
                    graph = graph_of(template, shape, names, spec)
                    plan = plan_of(template.name, graph, names, None, self._backend)
                    self._plans[key] = plan
        return plan
