"""A template: the numbers that govern every cell, and all that travels with them.

State equation (Chua & Yang 1988), per layer l, with ∗ a correlation (no kernel flip):

    τ_l dx_l/dt = −x_l + Σ_m A_lm ∗ f(x_m) + Σ_m B_lm ∗ u_m + z_l,    y = f(x)

and, where a template has them, nonlinear couplings, delayed couplings, and gains on A in time.
"""

from __future__ import annotations  # signatures that `help` shows as they are written

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike

from cnnum import sharing
from cnnum.arrays import Floats, digest, finite, frozen
from cnnum.errors import TemplateError
from cnnum.safety.values import checked_name, expect, is_real
from cnnum.templating.boundary import Boundary, parse_boundary
from cnnum.templating.couplings import DelayedCoupling, Gain, NonlinearCoupling
from cnnum.templating.functions import OutputFunction, output_function

Duration = float | Literal["settle"]
Initial = float | Literal["input"]
Record = TypeVar("Record")


LEAST_TAU = 1e-150
"""Smallest time constant, for which rates up to its inverse and their squares are finite."""


@dataclass(frozen=True, slots=True)
class Check:
    """The check that a template must pass: the name of a closed form and its parameters."""

    name: str
    parameters: tuple[tuple[str, float | str], ...] = ()


@dataclass(frozen=True, slots=True, eq=False, init=False)
class Template:
    """A CNN template with its boundary, initial state and duration.

    Two templates are equal if their names and all numbers that affect a run are equal; `digest`
    identifies these numbers. `dataclasses.replace` returns a copy with some parts replaced.

    Parameters
    ----------
    name : str
        One line of letters, digits and signs such as "shift 1 down, 2 right".
    A : (k, k) or (layers, layers, k, k) float
        Feedback, as [to, from]; k odd. Correlation: element (0, 0) weighs the north-west neighbour.
    B : (k, k) or (layers, inputs, k, k) float, optional
        Control. Without it the template has no input.
    z : float or (layers,) float
        Bias.
    tau : float or (layers,) float
        Time constant of each layer, in a unit of your choice. Durations, steps, delays and the
        tables of gains are in the same unit, that is, in time constants if tau is 1.
    boundary : float, "zero-flux" or "periodic"
        State of the virtual cells beyond the rim.
    input_boundary : float, "zero-flux" or "periodic", optional
        Input of the virtual cells. The default is the boundary of the state.
    initial : float or "input"
        Default initial state; "input" copies the input, layer by layer.
    duration : float or "settle"
        Run time in the unit of tau, or until nothing changes any more.
    output : str
        Output function: "standard", "linear", "tanh", "full-range", or "sign", with which the
        array runs in discrete time (DT-CNN): x ← Σ A ∗ sgn(x) + Σ B ∗ u + z, one step per unit of
        time. A step that has begun is taken as a whole.
    nonlinear : sequence of NonlinearCoupling
    delayed : DelayedCoupling, optional
    gains : sequence of Gain
    description, source : str
        Purpose of the template, and source of its numbers.
    check : Check, optional
        The closed form that the template is checked against.
    needs_state : bool
        Whether the initial state is a picture that a run should be given, such as the second
        operand of LOGAND: a run without one then warns. It does not affect the result.

    Raises
    ------
    TemplateError
        If the parts do not fit together, or one has the wrong type.
    UnknownNameError
        If there is no such output function.
    """

    name: str
    A: Floats
    B: Floats
    z: Floats
    tau: Floats
    boundary: Boundary
    input_boundary: Boundary
    initial: Initial
    duration: Duration
    output: OutputFunction
    nonlinear: tuple[NonlinearCoupling, ...]
    delayed: DelayedCoupling | None
    gains: tuple[Gain, ...]
    description: str
    source: str
    check: Check | None
    needs_state: bool
    digest: str = field(init=False)

    def __init__(
        self,
        name: str,
        A: ArrayLike,
        B: ArrayLike | None = None,
        z: float | Sequence[float] = 0.0,
        *,
        tau: float | Sequence[float] = 1.0,
        boundary: float | str | Boundary = 0.0,
        input_boundary: float | str | Boundary | None = None,
        initial: Initial = 0.0,
        duration: Duration = "settle",
        output: str | OutputFunction = "standard",
        nonlinear: Sequence[NonlinearCoupling] = (),
        delayed: DelayedCoupling | None = None,
        gains: Sequence[Gain] = (),
        description: str = "",
        source: str = "",
        check: Check | None = None,
        needs_state: bool = False,
    ) -> None:
        checked_name("a template", name, TemplateError)
        feedback = _couplings(name, "A", A)
        layers = feedback.shape[0]
        if feedback.shape[1] != layers:
            raise TemplateError(
                f"Template '{name}': A couples layers to layers, got {feedback.shape[1]} "
                f"columns for {layers} layers."
            )
        state_boundary = parse_boundary(boundary)
        coupled = _records(name, "nonlinear", nonlinear, NonlinearCoupling)
        parts: dict[str, object] = {
            "name": name,
            "A": feedback,
            "B": _control(name, _all_inputs(B, layers, coupled), layers),
            "z": _per_layer(name, "z", z, layers),
            "tau": _positive(name, _per_layer(name, "tau", tau, layers)),
            "boundary": state_boundary,
            "input_boundary": (
                state_boundary if input_boundary is None else parse_boundary(input_boundary)
            ),
            "initial": _initial(name, initial),
            "duration": _duration(name, duration),
            "output": output_function(output),
            "nonlinear": coupled,
            "delayed": delayed,
            "gains": _records(name, "gains", gains, Gain),
            "description": description,
            "source": source,
            "check": check,
            "needs_state": needs_state,
        }
        kinds = {
            "delayed": DelayedCoupling,
            "description": str,
            "source": str,
            "check": Check,
            "needs_state": bool,
        }
        for key, kind in kinds.items():
            if not (parts[key] is None and key in ("delayed", "check")):
                expect(key, parts[key], kind, TemplateError)
        for key, value in parts.items():
            object.__setattr__(self, key, value)
        object.__setattr__(self, "delayed", self._with_zeros(delayed))
        self._check_couplings()
        self._check_initial()
        object.__setattr__(self, "digest", digest(*self._physics()))

    def _check_initial(self) -> None:
        if self.output.discrete and (self.tau != 1.0).any():
            raise TemplateError(
                f"Template '{self.name}' runs in discrete time, where each step is the whole "
                f"change: tau must be 1, got {self.tau.tolist()}."
            )
        if self.initial == "input":
            if self.inputs not in (0, self.layers):
                raise TemplateError(
                    f"Template '{self.name}': initial = 'input' needs one input per layer, "
                    f"got {self.inputs} inputs for {self.layers} layers."
                )
        elif self.output.limited and abs(self.initial) > 1.0:
            raise TemplateError(
                f"Template '{self.name}': its state is limited to [-1, 1], got initial = "
                f"{self.initial:g}."
            )

    def _with_zeros(self, delayed: DelayedCoupling | None) -> DelayedCoupling | None:
        """Return a delayed coupling with zeros for the weights that it was not given."""
        if delayed is None:
            return None
        sources = {"A": self.layers, "B": self.inputs}
        missing = [part for part in sources if not len(getattr(delayed, part))]
        zeros: dict[str, Any] = {p: np.zeros((self.layers, sources[p], 1, 1)) for p in missing}
        return replace(delayed, **zeros) if zeros else delayed

    def _check_couplings(self) -> None:
        sizes = {"x": self.layers, "y": self.layers, "u": self.inputs, None: 1}
        for item in self.nonlinear:
            fits = 0 <= item.to < self.layers and 0 <= item.source < sizes[item.neighbour]
            if not (fits and 0 <= item.centre_source < sizes[item.centre]):
                raise TemplateError(
                    f"Template '{self.name}': a nonlinear coupling refers to a layer or input "
                    f"that does not exist ({self.layers} layers, {self.inputs} inputs)."
                )
        delayed = self.delayed
        if delayed is not None and (
            delayed.A.shape[:2] != (self.layers, self.layers)
            or delayed.B.shape[:2] != (self.layers, self.inputs)
        ):
            raise TemplateError(
                f"Template '{self.name}': delayed A and B must couple its {self.layers} layers "
                f"and {self.inputs} inputs."
            )
        if any(not (0 <= g.to < self.layers and 0 <= g.source < self.layers) for g in self.gains):
            raise TemplateError(
                f"Template '{self.name}': a gain refers to a layer that does not exist."
            )
        if len({(gain.to, gain.source) for gain in self.gains}) < len(self.gains):
            raise TemplateError(
                f"Template '{self.name}': the couplings from one layer to another can have "
                "only one gain, got two: multiply their tables."
            )

    def _physics(self) -> tuple[object, ...]:
        """Return all that changes a run; two templates with the same of it are the same."""
        return (
            self.A,
            self.B,
            self.z,
            self.tau,
            self.boundary,
            self.input_boundary,
            self.initial,
            self.duration,
            *self.output.physics,
            *(part for coupling in self.nonlinear for part in coupling.physics),
            *(self.delayed.physics if self.delayed else ()),
            self.gains,
        )

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Template):
            return NotImplemented
        return self.digest == other.digest and self.name == other.name

    def __hash__(self) -> int:
        return hash((self.name, self.digest))

    @property
    def layers(self) -> int:
        """Number of layers."""
        return int(self.A.shape[0])

    @property
    def inputs(self) -> int:
        """Number of inputs; 0 where there is no control template."""
        return int(self.B.shape[1])

    @property
    def radius(self) -> int:
        """Largest neighbourhood radius of its couplings."""
        kernels = [self.A, self.B, *(coupling.weights for coupling in self.nonlinear)]
        kernels += [self.delayed.A, self.delayed.B] if self.delayed else []
        return max(int(kernel.shape[-1]) for kernel in kernels) // 2

    @property
    def uncoupled(self) -> bool:
        """Whether every cell decays on its own towards its drive (A = 0)."""
        return not self.A.any() and self.plain

    @property
    def plain(self) -> bool:
        """Whether all couplings are linear, without delay and constant in time."""
        return not self.nonlinear and self.delayed is None and not self.gains

    def without_state(self) -> str:
        """Return the warning for a run without the initial state that the template needs."""
        start = (
            "from its input" if self.initial == "input" else f"at {self.initial:g} in every cell"
        )
        return (
            f"Template '{self.name}' works on two pictures, an input and an initial state, but no "
            f"state is given: it starts {start}. Pass the second picture as 'state'."
        )

    def timed(self, time: float, digits: int = 6) -> str:
        """Return a time as text, in units of τ if every time constant is 1.

        Parameters
        ----------
        time : float
            In the unit of `tau`.
        digits : int
            Number of significant digits.
        """
        return f"{time:.{digits}g} {self.unit_of_time}"

    @property
    def unit_of_time(self) -> str:
        """Unit of durations, steps and delays as text: τ if every time constant is 1."""
        return "τ" if (self.tau == 1.0).all() else "(unit of τ)"

    def _repr_html_(self) -> str:
        pairs = [
            ("z", ", ".join(f"{z:g}" for z in self.z.tolist())),
            ("boundary", f"{self.boundary} (state), {self.input_boundary} (input)"),
            ("duration", self.duration if self.duration == "settle" else self.timed(self.duration)),
            ("output", self.output.name),
            ("source", self.source or "not given"),
        ]
        shown = [sharing.picture(name, kernel) for name, kernel in kernels_of(self).items()]
        return sharing.facts(self.name, pairs, shown)

    def plot(self, ax: object = None) -> object:
        """Draw the kernels of A and B with Matplotlib, and return the axes."""
        from cnnum import sharing

        return sharing.maps(kernels_of(self), ax)

    def __repr__(self) -> str:
        return (
            f"Template('{self.name}', layers={self.layers}, inputs={self.inputs}, "
            f"radius={self.radius}, boundary={self.boundary}, duration={self.duration})"
        )


def kernels_of(template: Template) -> dict[str, Floats]:
    """Return each (k, k) kernel of A and B by its name; a single one needs no indices."""
    result: dict[str, Floats] = {}
    for part in ("A", "B"):
        couplings: Floats = getattr(template, part)
        layers, sources = couplings.shape[:2]
        for to in range(layers):
            for source in range(sources):
                name = part if layers * sources == 1 else f"{part}[{to}, {source}]"
                result[name] = couplings[to, source]
    return result


def _couplings(template: str, part: str, value: ArrayLike) -> Floats:
    kernel = finite(f"{part} of template '{template}'", value)
    if kernel.ndim == 2:
        kernel = kernel[np.newaxis, np.newaxis]
    if kernel.ndim != 4 or kernel.shape[-1] != kernel.shape[-2] or kernel.shape[-1] % 2 == 0:
        raise TemplateError(
            f"Template '{template}': {part} must have the shape (k, k) or (layers, from, k, k) "
            f"with k odd, got {np.shape(value)}."
        )
    return frozen(kernel)


def _all_inputs(
    value: ArrayLike | None, layers: int, nonlinear: Sequence[NonlinearCoupling]
) -> ArrayLike | None:
    """Return B, or zeros for the inputs that only nonlinear couplings read."""
    read = [c.source for c in nonlinear if c.neighbour == "u"]
    read += [c.centre_source for c in nonlinear if c.centre == "u"]
    if value is not None or not read:
        return value
    return np.zeros((layers, max(read) + 1, 1, 1))


def _records(template: str, part: str, value: object, kind: type[Record]) -> tuple[Record, ...]:
    if not isinstance(value, Sequence):
        raise TemplateError(
            f"Template '{template}': {part} must be a sequence of {kind.__name__}, got "
            f"{type(value).__name__}."
        )
    for item in cast("Sequence[object]", value):
        expect(part, item, kind, TemplateError)
    return tuple(cast("Sequence[Record]", value))


def _control(template: str, value: ArrayLike | None, layers: int) -> Floats:
    if value is None:
        return frozen(np.zeros((layers, 0, 1, 1)))
    control = _couplings(template, "B", value)
    if control.shape[0] != layers:
        raise TemplateError(
            f"Template '{template}': B must have as many layers as A, {layers}, got "
            f"{control.shape[0]}."
        )
    return control


def _per_layer(template: str, part: str, value: float | Sequence[float], layers: int) -> Floats:
    numbers = finite(f"{part} of template '{template}'", value)
    if numbers.ndim > 1 or numbers.size not in (1, layers):
        raise TemplateError(
            f"Template '{template}': {part} must be one number or one per layer ({layers}), "
            f"got the shape {numbers.shape}."
        )
    return frozen(np.broadcast_to(numbers, (layers,)))


def _positive(template: str, tau: Floats) -> Floats:
    if not (tau > LEAST_TAU).all():
        raise TemplateError(
            f"Template '{template}': tau must be positive, above {LEAST_TAU:g}, got {tau.tolist()}."
        )
    return tau


def _initial(template: str, value: Initial) -> Initial:
    if isinstance(value, str) and value == "input":
        return "input"
    if not is_real(value):
        raise TemplateError(
            f"Template '{template}': initial must be a finite number or 'input', got {value!r:.60}."
        )
    return float(value)


def _duration(template: str, value: Duration) -> Duration:
    if isinstance(value, str) and value == "settle":
        return "settle"
    if not is_real(value) or value < 0.0:
        raise TemplateError(
            f"Template '{template}': duration must be a number of at least 0, in the unit of "
            f"tau, or 'settle', got {value!r}."
        )
    return float(value)
