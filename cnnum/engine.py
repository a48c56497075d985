"""The engine as users see it: it runs single templates and compiles programs."""

from __future__ import annotations  # signatures that `help` shows as they are written

import logging
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from math import ceil
from typing import Any, cast

from numpy.typing import ArrayLike

from cnnum.engines.fallback import opened
from cnnum.errors import ProgramError
from cnnum.frame import FORCE_AXES
from cnnum.graph.nodes import Graph
from cnnum.plan import Plan
from cnnum.programs import Program
from cnnum.programs.library import get_program
from cnnum.runs.chip import Chip, chip_backend
from cnnum.runs.ladder import run
from cnnum.runs.planning import plan_of
from cnnum.runs.request import Ask, OpenEngine
from cnnum.runs.result import Result
from cnnum.runs.staged import in_stages
from cnnum.templating.batch import TemplateBatch
from cnnum.templating.library import as_template
from cnnum.templating.template import Duration, Template
from cnnum.values import OfThisProcess


class Engine(OfThisProcess):
    """Runs templates and programs on one device.

    Parameters
    ----------
    name : str, optional
        "opencl", "numba" or "reference". The default is "opencl" if a device works, and otherwise
        "numba", which is announced on standard error.
    device : str, optional
        Part of the name of a device or platform. The default is the fastest device.
    precision : str, optional
        "float32" or "float64", or, on the engines "opencl" and "reference", whole numbers: "q15",
        "q7", or "qM.N" of up to 32 bits. The default is that of the engine.
    fallback : str, optional
        "numba" to continue on the host if the device is lost or out of memory; `Result.reason`
        then says so.

    Raises
    ------
    UnknownNameError
        If there is no such engine, precision or fallback.
    DeviceError
        If there is no such device.
    """

    __slots__ = ("_fallback", "_open")

    def __init__(
        self,
        name: str | None = None,
        *,
        device: str | None = None,
        precision: str | None = None,
        fallback: str | None = None,
    ) -> None:
        self._open = OpenEngine(opened(name, device, precision, fallback))
        self._fallback = fallback

    @property
    def name(self) -> str:
        """Name of the engine."""
        return self._open.record.name

    @property
    def device(self) -> str:
        """Description of the device."""
        return self._open.backend.device

    @property
    def precision(self) -> str:
        """One of "float32", "float64", "q15", "q7" and so on."""
        return self._open.precision

    def __repr__(self) -> str:
        return f"Engine('{self.name}', device='{self.device}', precision='{self.precision}')"

    def _elsewhere(self) -> str:
        return f"make one there, by cnnum.Engine('{self.name}', precision='{self.precision}')"

    def with_precision(self, precision: str) -> Engine:
        """Return an engine of the same kind on the same device in another precision.

        Raises
        ------
        DeviceError
            If the device does not support that precision.
        """
        device = self.device if self._open.record.devices else None
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
        """Compile a program into a plan that runs only what the requested outputs need.

        Parameters
        ----------
        program : Program or str
            A function decorated with `cnnum.program`, or the name of a program of the library.
        shape : (rows, cols)
        needs : sequence of str, optional
            Names of the requested outputs. The default is all.
        channels : sequence of str
            Channels of a frame, in the order of its last axis.
        method, rtol, atol, dt : optional
            As in `run`, for every transient of the program. The default is that of each transient.
        like : (frames, ..., rows, cols, channels) float, optional
            Typical streams, on which the range of every value is measured for a precision of
            whole numbers. By default, the range is measured on each batch itself; a stream with
            memories requires `like`.
        chip : Chip, optional
            Emulate an analogue array of limited accuracy (engine "reference" only).

        Raises
        ------
        MethodError
            If a transient cannot run by that method or with that step.
        ProgramError
            If `program` is not a program or cannot be traced, or if `like` is given without a
            precision of whole numbers.
        UnknownNameError
            If `program` or a name in `needs` is unknown.
        NotSupportedError
            If this engine does not support something in the program.
        SizeError
            If the memory of the machine is too small for one frame.
        """
        if isinstance(program, str):
            program = get_program(program)
        if not isinstance(cast(object, program), Program):
            raise ProgramError(
                f"Expected a program to compile, got {type(program).__name__}: decorate the "
                "function with @cnnum.program; templates are run with engine.run."
            )
        given: dict[str, Any] = {"method": method, "rtol": rtol, "atol": atol, "dt": dt}
        options = {name: value for name, value in given.items() if value is not None}
        given = {"channels": channels, "like": like, "chip": chip}
        graph = program.trace(shape, channels)
        plan = self.compile_traced(program, graph, needs, options=options, **given)
        if not graph.timed or graph.rate is not None:
            return plan
        known = program

        def at_rate(rate: float) -> Plan:
            return self.compile(known.bind(rate=rate), shape, needs, **given, **options)

        return replace(plan, at_rate=at_rate)

    def compile_traced(
        self,
        program: Program,
        graph: Graph,
        needs: Sequence[str] | None = None,
        *,
        channels: Sequence[str] = FORCE_AXES,
        options: Mapping[str, object] | None = None,
        like: ArrayLike | None = None,
        chip: Chip | None = None,
    ) -> Plan:
        """Compile the graph of a program; for other parameters and errors see `compile`.

        Parameters
        ----------
        program : Program
        graph : Graph
            As `Program.trace` returns it.
        needs, channels, like, chip : optional
        options : mapping of str to any, optional
            Method, tolerances and step for every transient.
        """
        options = dict(options or {})
        _say_too_slow(program.name, graph, graph.outputs if needs is None else needs)
        backend = self._open.backend
        if chip is not None:
            backend = chip_backend(chip, backend)
        if like is not None:
            from cnnum.engines.fixed_point import measuring  # formats and emulator take their time

            backend = measuring(backend, like, (*graph.shape, len(channels)))
        parts = (program.name, graph, channels, needs)
        plan = plan_of(*parts, self._open.backend, backend=backend, overrides=options)
        return replace(in_stages(plan, options), rate=graph.rate)

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
        """Run the transient of a template.

        If input, initial state and weights keep every cell within the linear range of the standard
        output, the array is treated as linear and may be solved exactly.

        Parameters
        ----------
        template : Template, TemplateBatch or str
            A template, the name of a template in the library, or a batch of templates, whose axes
            come first in the result.
        input : (..., rows, cols) or (..., inputs, rows, cols) float, optional
            Input maps. A template that has no control template and starts from its input takes
            them as its initial state.
        previous : like `input`, optional
            Inputs before the start, for a template with delays. The default is `input`.
        state : (..., rows, cols) or (..., layers, rows, cols) float, optional
            Initial state. The default is that of the template.
        bias : like `state`, optional
            Bias map, added to z.
        mask : (..., rows, cols) bool, optional
            Fixed-state mask: the state keeps its value where it is true.
        duration : float or "settle", optional
            In the unit of `tau`. The default is that of the template.
        method : str
            "auto", "propagator", "decision" (only the outputs, for cells that are not coupled to
            other cells), "wavefront" (only the final state, for arrays in which the order of the
            changes does not matter), or one of `cnnum.integrators.stability.METHODS`.
        rtol, atol : float
            Relative and absolute tolerance of the state.
        dt : float, optional
            Fixed step in the unit of `tau`, by Euler's method unless `method` says otherwise.
        force : bool
            Allow a fixed step outside the stability bound. The result is then not settled and its
            error infinite.
        estimate : bool
            Also estimate the error of fixed steps, which takes at least one more evaluation of the
            rates per step, and a finer run where errors may grow. It allows at most 100,000 steps.
        at : sequence of float, optional
            Increasing times in the unit of `tau`, instead of a duration. A single run to the last
            time returns the state at each of them, with the state and error of a run that ends
            there. Each time costs about as much as one step, and less if the array is linear. In
            a precision of whole numbers, the array runs anew for each time.
        chip : Chip, optional
            Emulate an analogue array of limited accuracy: weights, maps, noise and mismatch.

        Returns
        -------
        Result
            Leading axes are the batch to which the arguments broadcast. With `at`, the times come
            first: (times, ..., rows, cols).

        Raises
        ------
        ArrayError
            If shapes do not fit, or values are not real and finite, or too large for the precision.
        MethodError
            If the duration, a tolerance or the step is out of range, or if the method cannot run
            this template or does not reach the end.
        SizeError
            If the memory of the machine or the device is too small for the array.
        """
        if not isinstance(template, TemplateBatch):
            template = as_template(template)
        arrays = (input, previous, state, bias, mask)
        options = (duration, method, rtol, atol, dt, force, estimate)
        return run(Ask(self._open, template, arrays, options, at, chip))


def _say_too_slow(program: str, graph: Graph, needs: Iterable[str]) -> None:
    """Say which wanted outputs are made for quicker signals than the frames can hold."""
    rate = graph.rate
    if rate is None:
        return
    quick = [name for name in needs if 2.0 * graph.quickest.get(name, 0.0) > rate]
    if quick:
        highest = max(graph.quickest[name] for name in quick)
        logging.getLogger("cnnum").warning(
            "%g frames per second are too few for %s of '%s', which %s up to %.3g Hz: changes "
            "faster than %g Hz are missed or reported late; use at least %.0f frames per second.",
            rate, " and ".join(map(repr, quick)), program,
            "follows changes" if len(quick) == 1 else "follow changes",
            highest, 0.5 * rate, ceil(2.0 * highest),
        )  # fmt: skip
