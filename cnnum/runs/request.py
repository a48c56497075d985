"""What is asked of a run: its maps, checked, and its options; and what is kept for the next."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from threading import RLock
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cnnum.arrays import Shape, as_shape, finite, maps, real_numbers
from cnnum.embedded.formats import is_integer
from cnnum.engines.backend import Backend, EngineRecord
from cnnum.errors import ArrayError, say_once
from cnnum.graph.nodes import RunSpec
from cnnum.integrators.solver import Solver
from cnnum.pictures import looks_coloured
from cnnum.plan import Plan
from cnnum.runs.linear_range import as_linear, stays_linear
from cnnum.runs.planning import graph_of, plan_of
from cnnum.templating.batch import TemplateBatch
from cnnum.templating.template import Duration, Template

if TYPE_CHECKING:
    from cnnum.runs.chip import Chip
    from cnnum.runs.prepared import PreparedRun
    from cnnum.runs.result import Result


PIXELS = 255.0
"""Largest grey level of 8 bits."""

ROLES = ("input", "previous", "state")
"""The maps of a run that can be a picture."""

LEAST_SQUARES = (PIXELS / 2) ** 2
"""Sum of squares below which numbers are no grey levels, for a quick look."""


def refuse_pixels(template: Template, role: str, value: ArrayLike) -> None:
    """Check that an input or a state does not consist of bool or 8-bit pixels.

    Raises
    ------
    ArrayError
        With the function that makes a picture of them.
    """
    kind = getattr(value, "dtype", None)
    if kind is not None and kind in (np.dtype(bool), np.dtype(np.uint8)):
        raise _refusal(template, role, f"an array of {kind}")


def refuse_grey_levels(template: Template, role: str, array: NDArray[np.floating]) -> None:
    """Check that numbers are not 8-bit grey levels, if the cells saturate at −1 and 1.

    Grey levels are whole numbers from 0 to 255, at least one of them 128 or more. Fractions in that
    range, and pictures of 0 and 1, only give a warning, as they may be meant.

    Raises
    ------
    ArrayError
        With the function that makes a picture of them.
    """
    if template.output.linear or not array.size:
        return
    first_row = array[(0,) * (array.ndim - 1)]  # of most pictures this is enough
    if first_row.min() < 0.0:
        return
    low, high = float(array.min()), float(array.max())
    if low >= 0.0 and PIXELS / 2 < high <= PIXELS:
        if bool((array == np.rint(array)).all()):
            raise _refusal(template, role, f"whole numbers of {low:g} to {high:g}")
        if _made_for_pictures(template):
            say_once(
                f"'{role}' of template '{template.name}' reaches from {low:g} to {high:g}, as grey "
                "levels of 8 bits do that were averaged or resized; its cells saturate at −1 and "
                "1. For grey levels, pass 1 - levels / 127.5: black is 1 and white −1."
            )
    elif low == 0.0 and high == 1.0 and _reads_black_and_white(template, array):
        say_once(
            f"'{role}' of template '{template.name}' holds only 0 and 1, and 0 is neither black "
            "nor white here: for a black-and-white picture pass 2 * picture - 1, or a bool array "
            "to cnnum.as_picture."
        )


def _made_for_pictures(template: Template) -> bool:
    """Return whether inputs and outputs within ±1 can outweigh the bias.

    A template whose bias is larger than all its weights together has thresholds among larger
    numbers, such as counts.
    """
    weights = sum(float(np.abs(part).sum()) for part in (template.A, template.B))
    return float(np.abs(template.z).max()) <= weights or bool(template.nonlinear)


FEW = 0.05
"""Share of ones, or of zeros, below which 0 and 1 are a single impulse and no picture."""


def _reads_black_and_white(template: Template, array: NDArray[np.floating]) -> bool:
    """Return whether an array of 0 and 1 is a picture for a template that ends black and white."""
    middle = template.A.shape[-1] // 2
    latched = bool((np.diagonal(template.A[..., middle, middle]) >= 1.0).any())
    white = dict(template.check.parameters).get("white") if template.check else None
    if white == 0.0 or not (latched or template.output.discrete):
        return False
    ones = array == 1.0
    share = float(ones.mean())
    return FEW < share < 1.0 - FEW and bool((ones | (array == 0.0)).all())


def _say_of_colours(template: Template, role: str, array: NDArray[np.floating], count: int) -> None:
    """Say where the last axis looks like colours, or the axes of a sensor, and not like columns."""
    if looks_coloured(array.shape) and array.shape[-3] != count:
        *_, rows, cols, last = array.shape
        say_once(
            f"'{role}' of template '{template.name}' has the shape {array.shape}, and runs as a "
            f"batch of arrays of {cols}×{last} cells. If it is a picture of {rows}×{cols} with "
            f"{last} channels, pass one of them, or their mean: the last two axes are rows and "
            "columns."
        )


def refuse_signed_mask(array: NDArray[np.floating]) -> None:
    """Check that a fixed-state mask has no negative numbers, as in other simulators.

    Raises
    ------
    ArrayError
        With the meaning of the argument here.
    """
    if array.size and float(array.min()) < 0.0:
        raise ArrayError(
            "'mask' fixes the state of the cells where it is not 0, got numbers down to "
            f"{array.min():g}: pass a bool array; for a MatCNN mask, in which −1 marks the fixed "
            "cells, pass mask < 0."
        )


def _refusal(template: Template, role: str, got: str) -> ArrayError:
    return ArrayError(
        f"'{role}' of template '{template.name}' must be a picture with numbers from −1 "
        f"(white) to 1 (black), got {got}: use cnnum.as_picture to convert pixels (True or "
        "level 0 is black)."
    )


def look_at_pictures(template: Template, given: Mapping[str, NDArray[np.floating]]) -> None:
    """Say what is unusual about the maps of a run by role; errors are those for grey levels."""
    if template.needs_state and "state" not in given:
        say_once(template.without_state())
    for role in given.keys() & set(ROLES):
        refuse_grey_levels(template, role, given[role])
        own = template.layers if role == "state" else template.inputs
        _say_of_colours(template, role, given[role], own if own > 1 else 0)


MANY_CELLS = 256 * 256
"""Cells from which an engine may look at maps while it takes them."""


def has_many_cells(shape: Shape) -> bool:
    """Return whether an array is too large to be looked at before it is taken."""
    return shape[0] * shape[1] > MANY_CELLS


def maps_by_role(
    template: Template, values: dict[str, ArrayLike | None]
) -> tuple[dict[str, NDArray[np.floating]], Shape]:
    """Return the maps of a run as (..., maps, rows, cols) by role, in a transient's order.

    Numbers of few cells are finite; those of many are not yet checked.

    Raises
    ------
    ArrayError
        If something is missing or too much, or shapes do not fit. Or if pixels are given where a
        picture is meant, or a mask has numbers below 0.
    """
    if template.inputs == 0 and template.initial == "input" and values["state"] is None:
        values = {**values, "state": values["input"], "input": None}
    if template.inputs == 0 and values["input"] is not None:
        raise ArrayError(
            f"Template '{template.name}' has no control template: leave out the input."
        )
    if template.inputs and values["input"] is None:
        raise ArrayError(f"Template '{template.name}' needs an input.")
    if template.initial == "input" and values["input"] is None and values["state"] is None:
        raise ArrayError(f"Template '{template.name}' starts from its input: give input or state.")
    for role in ROLES:
        if (value := values[role]) is not None:
            refuse_pixels(template, role, value)
    given = {role: real_numbers(role, v) for role, v in values.items() if v is not None}
    look_at_pictures(template, given)
    if "mask" in given:
        refuse_signed_mask(given["mask"])
    shape = _common_shape(list(given.values()))
    counts = {"input": template.inputs, "previous": template.inputs, "mask": 1}
    if not has_many_cells(shape):
        given = {role: finite(role, array) for role, array in given.items()}
    result = {
        role: maps(role, array, shape, counts.get(role, template.layers))
        for role, array in given.items()
    }
    return result, shape


def _common_shape(values: Sequence[NDArray[np.floating]]) -> Shape:
    if not values:
        raise ArrayError(
            "A run needs at least an initial state, which gives the shape of the array."
        )
    for value in values:
        if value.ndim < 2:
            raise ArrayError(
                f"A map has rows and columns, got the shape {value.shape}: a chain of N cells is "
                "an array of 1×N, as in input=[values]."
            )
    shapes = {value.shape[-2:] for value in values}
    if len(shapes) != 1:
        raise ArrayError(
            f"Input, state, bias and mask must share their rows and columns, got {sorted(shapes)}."
        )
    return as_shape(next(iter(shapes)))


def channels_and_lead(
    given: dict[str, NDArray[np.floating]],
) -> tuple[tuple[str, ...], tuple[int, ...]]:
    """Return channel names, and the leading axes that all maps broadcast to.

    Raises
    ------
    ArrayError
        If their batches do not broadcast, or are empty.
    """
    try:
        lead = np.broadcast_shapes(*(array.shape[:-3] for array in given.values()))
    except ValueError:
        shapes = {role: array.shape for role, array in given.items()}
        raise ArrayError(f"The batches of {shapes} do not broadcast.") from None
    if 0 in lead:
        raise ArrayError("A batch needs at least one array, got none.")
    names = [f"{role} {n}" for role, array in given.items() for n in range(array.shape[-3])]
    return tuple(names), lead


def as_frame(
    given: dict[str, NDArray[np.floating]], lead: tuple[int, ...], dtype: np.dtype[np.floating]
) -> NDArray[np.floating]:
    """Return all maps as one frame (..., rows, cols, channels) of finite numbers.

    Raises
    ------
    ArrayError
        If a number is not finite, or too large for the precision.
    """
    shape = as_shape(next(iter(given.values())).shape[-2:])
    # side by side in memory, where they can be copied as they are
    count = sum(array.shape[-3] for array in given.values())
    planes = np.empty((*lead, count, *shape), dtype)
    at = 0
    for role, array in given.items():
        numbers = finite(role, array) if has_many_cells(shape) else array
        _put(role, numbers, planes[..., at : at + array.shape[-3], :, :])
        at += array.shape[-3]
    axes = range(len(lead))
    return planes.transpose(*axes, -2, -1, -3)


def _put(role: str, array: NDArray[np.floating], planes: NDArray[np.floating]) -> None:
    try:
        with np.errstate(over="raise"):
            planes[...] = array
    except FloatingPointError:
        raise ArrayError(
            f"'{role}' reaches {np.abs(array).max():.3g}, more than {planes.dtype} can represent: "
            "scale it down, or use precision='float64'."
        ) from None


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
        Plans, keyed by everything they depend on.
    prepared : dict
        Prepared runs, by form.
    turn : RLock
        Lock for threads that store something.
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
        *rest: object,
    ) -> Plan:
        """Return the plan of a run, which is made once, whichever thread asks first.

        Parameters
        ----------
        template : Template
        shape : (rows, cols)
        names : tuple of str
            Names of its maps: a role, and a number.
        spec : RunSpec
        *rest : hashable
            What else the plan depends on.
        """
        key = (template.digest, shape, names, spec, *rest)
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
        Result of the run to equilibrium, if it is already known.
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
        Result of the run to equilibrium, if it is already known.
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
