"""Couplings beyond linear A and B: nonlinear ones, delayed ones, and gains that vary in time."""

import operator
from dataclasses import dataclass, field
from typing import Literal, SupportsIndex, cast

import numpy as np
from numpy.typing import ArrayLike

from cnnum.arrays import Floats, finite, frozen
from cnnum.errors import NotSupportedError, TemplateError
from cnnum.safety.values import expect, is_real
from cnnum.templating.functions import PairFunction, Table

Quantity = Literal["x", "y", "u"]
"""State, output or input of a cell."""


def kernel(name: str, value: ArrayLike) -> Floats:
    """Return a (k, k) kernel with k odd.

    Raises
    ------
    TemplateError
        If it has another shape.
    """
    array = finite(name, value)
    if array.ndim != 2 or array.shape[0] != array.shape[1] or array.shape[0] % 2 == 0:
        raise TemplateError(f"{name} must have the shape (k, k) with k odd, got {np.shape(value)}.")
    return frozen(array)


def place(part: str, value: SupportsIndex) -> int:
    """Return the index of a layer or input.

    Raises
    ------
    TemplateError
        If it is not a whole number.
    """
    try:
        return int(operator.index(value))
    except TypeError:
        raise TemplateError(
            f"'{part}' of a coupling must be the index of a layer or input, got {value!r:.60}."
        ) from None


@dataclass(frozen=True, slots=True, eq=False)
class NonlinearCoupling:
    """Sum of weight · f(argument) over the neighbourhood, added to one layer.

    The argument is the quantity of the neighbour, or centre − neighbour as in the CNN Software
    Library. MatCNN's tables use neighbour − centre (`reversed_sign`).

    Attributes
    ----------
    weights : (k, k) float
        Correlation weights; 1 where a template file has the function's letter.
    function : Table or PairFunction
        A `PairFunction` takes both quantities themselves, so it needs a centre and allows neither
        `times_argument` nor `reversed_sign`.
    neighbour : "x", "y" or "u"
        y for a nonlinear A, u for a nonlinear B; any of them in a generalised D.
    centre : "x", "y", "u" or None
        If None, the argument is the neighbour's quantity alone.
    times_argument : bool
        Multiply f(argument) by the argument (the D form ``x-x#x-x``).
    reversed_sign : bool
        The argument is neighbour − centre.
    to, source : int
        Layer that the coupling acts on, and layer (or input) of the neighbour.
    centre_source : int
        Layer (or input) of the centre's quantity.
    """

    weights: Floats
    function: Table | PairFunction
    neighbour: Quantity
    centre: Quantity | None = None
    times_argument: bool = False
    reversed_sign: bool = False
    to: int = 0
    source: int = 0
    centre_source: int = 0

    def __post_init__(self) -> None:
        object.__setattr__(self, "weights", kernel("Weights of a nonlinear coupling", self.weights))
        for quantity in (self.neighbour, self.centre):
            if not (quantity is None or str(quantity) in ("x", "y", "u")):
                raise TemplateError(f"A coupling must read 'x', 'y' or 'u', got {quantity!r:.60}.")
        for part in ("to", "source", "centre_source"):
            object.__setattr__(self, part, place(part, getattr(self, part)))
        if not isinstance(cast(object, self.function), Table | PairFunction):
            raise TemplateError(
                "The function of a nonlinear coupling must be a Table or a PairFunction, got "
                f"{type(self.function).__name__}."
            )
        flags = self.times_argument or self.reversed_sign
        if isinstance(self.function, PairFunction) and (self.centre is None or flags):
            raise TemplateError(
                f"The function '{self.function.name}' takes the centre and the neighbour "
                "themselves: give the coupling a centre, and neither times_argument nor "
                "reversed_sign."
            )

    @property
    def table(self) -> Table:
        """The function, which must be a table.

        Raises
        ------
        NotSupportedError
            If it is a `PairFunction`, which template files cannot hold.
        """
        if isinstance(self.function, Table):
            return self.function
        raise NotSupportedError(
            f"The function '{self.function.name}' of two cells is not a table, and template "
            "files can hold only tables: keep the template in Python."
        )

    @property
    def sign(self) -> float:
        """+1 for centre − neighbour, −1 for neighbour − centre."""
        return -1.0 if self.reversed_sign else 1.0

    def value(self, centre: Floats, neighbour: Floats) -> Floats:
        """Return f of the argument, times the argument if `times_argument` is set."""
        if isinstance(self.function, PairFunction):
            return self.function.numpy(centre, neighbour)
        argument = neighbour if self.centre is None else self.sign * (centre - neighbour)
        f = self.function(argument)
        return f * argument if self.times_argument else f

    @property
    def physics(self) -> tuple[object, ...]:
        """Everything that affects a run."""
        flags = (self.neighbour, self.centre, self.times_argument, self.reversed_sign)
        function = self.function if isinstance(self.function, Table) else self.function.physics
        return (self.weights, function, flags, self.to, self.source, self.centre_source)

    @property
    def static(self) -> bool:
        """Whether the coupling reads inputs only, so that it is part of the drive."""
        return self.neighbour == "u" and self.centre in ("u", None)

    @property
    def jumps(self) -> bool:
        """Whether the coupling can make the rates of the cells discontinuous."""
        steps = isinstance(self.function, Table) and self.function.interpolation == "constant"
        return steps and not self.static

    @property
    def stiffness(self) -> float:
        """Bound on what the coupling adds to a row of the Jacobian, summed over its cells.

        Piecewise constant tables have no slope; their effect is bounded by their values.
        """
        if self.static:
            return 0.0
        if isinstance(self.function, PairFunction):
            return self.function.slope * float(np.abs(self.weights).sum())
        slope = self.function.steepest
        if self.times_argument:
            reach = max(abs(v) for v, _ in self.function.points)
            slope = slope * reach + self.function.largest
        both = 1.0 if self.centre is None else 2.0
        return both * slope * float(np.abs(self.weights).sum())


def _no_weights() -> Floats:
    """Return delayed weights that are not given: a template has zeros for its layers and inputs."""
    return np.zeros((0, 0, 1, 1))


@dataclass(frozen=True, slots=True, eq=False)
class DelayedCoupling:
    """Linear couplings that read outputs and inputs with a delay.

    Attributes
    ----------
    delay : float
        In the unit of tau.
    A : (k, k) or (layers, layers, k, k) float, optional
        Weights of y(t − delay). Before the start, outputs are those of the initial state.
    B : (k, k) or (layers, inputs, k, k) float, optional
        Weights of u(t − delay). Before the start, inputs are the `previous` ones of the run.

    Raises
    ------
    TemplateError
        If the delay is not positive, or A or B has another shape.
    ArrayError
        If A or B is not finite.
    """

    delay: float
    A: Floats = field(default_factory=_no_weights)
    B: Floats = field(default_factory=_no_weights)

    def __post_init__(self) -> None:
        if not (is_real(self.delay) and self.delay > 0):
            raise TemplateError(f"A delay must be above 0, in the unit of tau, got {self.delay}.")
        for part in ("A", "B"):
            object.__setattr__(self, part, _delayed(part, getattr(self, part)))

    @property
    def physics(self) -> tuple[object, ...]:
        """Everything that affects a run."""
        return (self.delay, self.A, self.B)


def _delayed(part: str, value: ArrayLike) -> Floats:
    weights = finite(f"delayed {part}", value)
    weights = weights[np.newaxis, np.newaxis] if weights.ndim == 2 else weights
    shape = weights.shape
    if len(shape) != 4 or shape[2] != shape[3] or shape[3] % 2 == 0:
        raise TemplateError(
            f"Delayed {part} must have the shape (k, k) or (to, from, k, k) with k odd, got "
            f"{np.shape(value)}."
        )
    return frozen(weights)


@dataclass(frozen=True, slots=True)
class Gain:
    """A factor on the linear couplings from one layer to another that varies in time.

    Attributes
    ----------
    to, source : int
        Layers of the couplings A[to, source] that are scaled.
    table : Table
        Factor over the time since the start, in the unit of tau.
    """

    to: int
    source: int
    table: Table

    def __post_init__(self) -> None:
        expect("table", self.table, Table, TemplateError)
        for part in ("to", "source"):
            object.__setattr__(self, part, place(part, getattr(self, part)))
