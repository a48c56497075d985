"""The parts of a check: a case, the closed form that answers it, its parameters, and the result."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal, Protocol, TypeVar

import numpy as np

from cnnum.arrays import Floats, Shape
from cnnum.errors import TemplateError
from cnnum.templating.template import Duration, Template

T = TypeVar("T")


def has(template: Template, name: str) -> bool:
    """Return whether the template's check has that parameter."""
    return name in _parameters(template)


def number(template: Template, name: str, default: float | None = None) -> float:
    """Return a numeric parameter of the template's check.

    Raises
    ------
    TemplateError
        If it is missing and has no default, or is a text.
    """
    value = _parameters(template).get(name, default)
    if value is None or isinstance(value, str):
        raise _wrong(template, name, "a number", value)
    return value


def text(template: Template, name: str) -> str:
    """Return a textual parameter of the template's check.

    Raises
    ------
    TemplateError
        If it is missing or a number.
    """
    value = _parameters(template).get(name)
    if not isinstance(value, str):
        raise _wrong(template, name, "a text", value)
    return value


def choice(template: Template, name: str, choices: Mapping[str, T]) -> T:
    """Return the value of a textual parameter.

    Raises
    ------
    TemplateError
        If it is none of the choices.
    """
    value = text(template, name)
    if value not in choices:
        raise _wrong(template, name, f"one of {', '.join(map(repr, choices))}", value)
    return choices[value]


def _parameters(template: Template) -> dict[str, float | str]:
    return {} if template.check is None else dict(template.check.parameters)


def _wrong(template: Template, name: str, expected: str, value: object) -> TemplateError:
    return TemplateError(
        f"Template '{template.name}': the parameter '{name}' of its check must be {expected}, "
        f"got {value!r}."
    )


DIGITAL_TOLERANCE = 0.01
"""Tolerance for outputs that should be black or white."""


GIVEN = ("input", "previous", "state", "bias", "mask", "duration")
"""Arguments of a run that a case holds."""


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """The input of an engine, or None if the template has its own.

    Attributes
    ----------
    input, previous, state, bias, mask : (pictures, rows, cols) float or None
        Several inputs or layers come as (pictures, inputs, rows, cols).
    duration : float, "settle" or None
        Time constants.
    """

    input: Floats | None = None
    previous: Floats | None = None
    state: Floats | None = None
    bias: Floats | None = None
    mask: Floats | None = None
    duration: Duration | None = None

    @property
    def given(self) -> dict[str, Any]:
        """The maps and the duration, as an engine's `run` takes them."""
        return {name: getattr(self, name) for name in GIVEN}

    @property
    def pictures(self) -> Floats:
        """The input of a case that has one."""
        assert self.input is not None
        return self.input

    @property
    def before(self) -> Floats:
        """The inputs before the start of a case that has them."""
        assert self.previous is not None
        return self.previous

    @property
    def states(self) -> Floats:
        """The initial state of a case that has one."""
        assert self.state is not None
        return self.state

    def length(self, template: Template) -> float:
        """Return the run time in the unit of τ, infinite where the run is to settle."""
        duration = template.duration if self.duration is None else self.duration
        return np.inf if duration == "settle" else float(duration)

    def time(self, template: Template) -> float:
        """Return the run time in time constants, infinite where the run is to settle.

        Raises
        ------
        TemplateError
            If its layers have time constants of their own.
        """
        return self.length(template) / time_constant(template)

    def start(self, template: Template) -> Floats | float:
        """Return the initial state of a run, of one layer."""
        if self.state is not None:
            return self.state
        return self.pictures if template.initial == "input" else template.initial


def time_constant(template: Template) -> float:
    """Return the time constant of all layers, in which closed forms count time.

    Raises
    ------
    TemplateError
        If layers have time constants of their own.
    """
    if np.ptp(template.tau) > 0.0:
        raise TemplateError(
            f"The closed form of template '{template.name}' assumes layers with one time "
            f"constant, got tau={template.tau.tolist()}."
        )
    return float(template.tau[0])


class Cases(Protocol):
    """Draws pictures that a template's answer is known for."""

    def __call__(self, template: Template, rng: np.random.Generator, shape: Shape) -> Case:
        """Return a case of an array of that shape."""
        ...


@dataclass(frozen=True, slots=True)
class ClosedForm:
    """An exact answer that a template's run is compared with.

    Attributes
    ----------
    name : str
        As the [check] of a template file says it.
    cases : callable
        (template, random generator, (rows, cols)) to a case of several pictures.
    expected : callable
        (template, case) to the answer; it takes the boundary and the duration from the template,
        never its weights: those it knows from its own parameters.
    tolerance : float
        Largest absolute error of a run that passes.
    tolerance_reason : str
        Why it is not smaller.
    summary : str
        Description of the answer.
    needs : tuple of str
        Parameters that a template must give it.
    takes : tuple of str
        Parameters that a template may give it, too.
    compares : "output" or "state"
        The compared parts of a run.
    rtol : float
        Asked of the engine, and a tenth of it as the absolute error of a step. It is smaller than
        an engine's own where the errors of steps are never forgotten and add up.
    """

    name: str
    cases: Cases
    expected: Callable[[Template, Case], Floats]
    tolerance: float
    tolerance_reason: str
    summary: str
    needs: tuple[str, ...] = ()
    takes: tuple[str, ...] = ()
    compares: Literal["output", "state"] = "output"
    rtol: float = 1e-4

    @property
    def digital(self) -> bool:
        """Whether the answer is black and white, so that a cell can flip."""
        return self.compares == "output" and self.tolerance == DIGITAL_TOLERANCE


@dataclass(frozen=True, slots=True)
class CheckResult:
    """How far a template's run on an engine is from its closed form.

    Attributes
    ----------
    template, engine, precision, method, check : str
    error : float
        Largest absolute difference over all cells of all pictures.
    tolerance : float
    seconds : float
        Median wall time of one run of the whole case, s.
    passed : bool
    reason : str
        Why this method.
    margin : float or None
        The bias that may be added or taken with no wrong cell, where it was measured.
    settle : float or None
        Time until the outputs rest, in the unit of τ, on 8×8 cells, where it was measured.
    note : str
        How the run differs from the measured figures; empty if it does not.
    """

    template: str
    engine: str
    precision: str
    method: str
    check: str
    error: float
    tolerance: float
    seconds: float
    passed: bool
    reason: str
    margin: float | None = None
    settle: float | None = None
    note: str = ""
