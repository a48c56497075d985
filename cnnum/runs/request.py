"""What is asked of a run, and what an engine keeps from one run to the next."""

from __future__ import annotations

from collections.abc import Sequence
from threading import RLock
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cnnum.arrays import Shape
from cnnum.embedded.formats import is_integer
from cnnum.engines.backend import Backend, EngineRecord
from cnnum.graph.nodes import RunSpec
from cnnum.integrators.solver import Solver
from cnnum.plan import Plan
from cnnum.runs.arguments import channels_and_lead
from cnnum.runs.linear_range import as_linear, stays_linear
from cnnum.runs.planning import graph_of, plan_of
from cnnum.templating.batch import TemplateBatch
from cnnum.templating.template import Duration, Template

if TYPE_CHECKING:
    from cnnum.runs.chip import Chip
    from cnnum.runs.prepared import PreparedRun
    from cnnum.runs.result import Result

Form = tuple[object, ...]
"""All that runs share which differ in their numbers alone."""

Arrays = tuple[ArrayLike | None, ...]
"""Input, previous, state, bias and mask."""

Given = dict[str, NDArray[np.floating]]
"""Maps by role, (..., maps, rows, cols), in a transient's order."""


class OpenEngine:
    """An open engine with the plans and prepared runs that it keeps.

    Attributes
    ----------
    backend : Backend
    plans : dict
        By all that a plan depends on.
    prepared : dict
        By form.
    turn : RLock
        Of the threads that keep something.
    """

    __slots__ = ("backend", "plans", "precision", "prepared", "record", "turn", "whole")

    def __init__(self, backend: Backend) -> None:
        self.backend = backend
        self.record: EngineRecord = backend.record
        self.precision = backend.precision
        self.whole = is_integer(backend.precision)
        self.plans: dict[tuple[object, ...], Plan] = {}
        self.prepared: dict[Form, PreparedRun] = {}
        self.turn = RLock()

    def plan_for(
        self,
        template: Template,
        shape: Shape,
        names: tuple[str, ...],
        spec: RunSpec,
        *about: object,
    ) -> Plan:
        """Return the plan of a run, which is made once, whichever thread asks first.

        Parameters
        ----------
        template : Template
        shape : (rows, cols)
        names : tuple of str
            Names of its maps: a role, and a number.
        spec : RunSpec
        *about : hashable
            What else the plan depends on.
        """
        key = (template.digest, shape, names, spec, *about)
        plan = self.plans.get(key)
        if plan is None:
            with self.turn:
                plan = self.plans.get(key)
                if plan is None:
                    graph = graph_of(template, shape, names, spec)
                    plan = plan_of(template.name, graph, names, None, self.backend)
                    self.plans[key] = plan
        return plan


class Ask:
    """A run as it is asked for: nothing of its arrays is checked yet.

    Attributes
    ----------
    engine : OpenEngine
    template : Template or TemplateBatch
    arrays : tuple of array or None
        Input, previous, state, bias and mask.
    options : tuple
        Duration, method, rtol, atol, dt, force and estimate, as `Engine.run` takes them.
    at : sequence of float or None
    chip : Chip or None
    form : tuple or None
        All but the numbers, where the run may be prepared.
    kept : PreparedRun or None
        The run of that form which is kept ready.
    ready : Result or None
        Of the way to a rest, where it is known already.
    """

    __slots__ = ("arrays", "at", "chip", "engine", "form", "kept", "options", "ready", "template")

    def __init__(
        self,
        engine: OpenEngine,
        template: Any,
        arrays: Arrays,
        options: tuple[Any, ...],
        at: ArrayLike | None = None,
        chip: Chip | None = None,
    ) -> None:
        self.engine, self.template, self.arrays, self.options = engine, template, arrays, options
        self.at, self.chip = at, chip
        self.form: Form | None = None
        self.kept: PreparedRun | None = None
        self.ready: Result | None = None

    def of(self, template: Template, arrays: Sequence[ArrayLike | None]) -> Ask:
        """Return the same of another template on other arrays, without a chip."""
        return Ask(self.engine, template, tuple(arrays), self.options, self.at)

    def until(self, duration: float) -> Ask:
        """Return the same for a time, at its end alone."""
        return Ask(self.engine, self.template, self.arrays, (duration, *self.options[1:]))

    @property
    def duration(self) -> Duration:
        """In the unit of τ; the template's own unless one was asked for."""
        duration: Duration | None = self.options[0]
        if duration is not None:
            return duration
        own: Template | TemplateBatch = self.template
        return (own.template if isinstance(own, TemplateBatch) else own).duration

    @property
    def spec(self) -> RunSpec:
        """The options, as a transient has them."""
        duration, method, rtol, atol, dt, force, estimate = self.options
        return RunSpec(duration, method, rtol, atol, dt, force=force, estimate=estimate)


class Request:
    """A run whose maps are checked, with its plan.

    Attributes
    ----------
    engine : OpenEngine
    template : Template
    given : dict of str to (..., maps, rows, cols) float
    shape : (rows, cols)
    spec : RunSpec
    form : tuple or None
        Under which the run is kept ready, if it can be.
    ready : Result or None
        Of the way to a rest, where it is known already.
    names : tuple of str
        Names of its maps: a role, and a number.
    lead : tuple of int
        Leading axes that all maps broadcast to.
    settles : bool
        Whether it runs to equilibrium.
    exact : bool
        Whether an exact answer is taken where there is one.
    """

    __slots__ = (
        *("_linear", "_plan", "engine", "exact", "form", "given", "lead", "names", "ready"),
        *("settles", "shape", "spec", "template"),
    )

    def __init__(
        self,
        engine: OpenEngine,
        template: Template,
        given: Given,
        shape: Shape,
        spec: RunSpec,
        form: Form | None = None,
        ready: Result | None = None,
    ) -> None:
        self.engine, self.template, self.given = engine, template, given
        self.shape, self.spec, self.form, self.ready = shape, spec, form, ready
        self.names, self.lead = channels_and_lead(given)
        duration = spec.duration
        self.settles = (template.duration if duration is None else duration) == "settle"
        self.exact = spec.dt is None and spec.method in ("auto", "propagator")
        self._linear: bool | None = None
        self._plan: Plan | None = None

    @property
    def linear(self) -> bool:
        """Whether the array stays where it is linear."""
        if self._linear is None:
            self._linear = self.exact and stays_linear(self.template, self.given)
        return self._linear

    @property
    def ran(self) -> Template:
        """The template that runs: the linear one where the array stays linear."""
        return as_linear(self.template) if self.linear else self.template

    @property
    def plan(self) -> Plan:
        """Made where a way first needs it."""
        if self._plan is None:
            self._plan = self.engine.plan_for(self.ran, self.shape, self.names, self.spec)
        return self._plan

    @property
    def solver(self) -> Solver:
        """How it runs."""
        return next(iter(self.plan.solvers.values()))

    def by(self, spec: RunSpec, given: Given | None = None) -> Request:
        """Return the same run by other options, perhaps of other frames."""
        maps = self.given if given is None else given
        return Request(self.engine, self.template, maps, self.shape, spec)

    def frames(self, frames: NDArray[np.intp]) -> Given:
        """Return the maps of some frames of the batch, (frames, maps, rows, cols) by role."""
        lead = self.lead
        return {
            role: np.broadcast_to(maps, (*lead, *maps.shape[-3:])).reshape(-1, *maps.shape[-3:])[
                frames
            ]
            for role, maps in self.given.items()
        }
