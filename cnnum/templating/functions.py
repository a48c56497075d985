"""Functions of cells as data: tables, outputs y = f(x), and functions of a pair of cells."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import count, pairwise
from typing import Literal, cast

import numpy as np

from cnnum.arrays import Floats, finite
from cnnum.errors import TemplateError, name_error
from cnnum.safety.values import check_expression, checked_name

Interpolation = Literal["constant", "linear"]


@dataclass(frozen=True, slots=True)
class Table:
    """Function given by points (v_k, f_k), as in the CNN Software Library.

    * "constant": f_k for v_{k−1} < v ≤ v_k, constant before the first and after the last point.
    * "linear": straight lines between the points, constant beyond the first and the last.

    Attributes
    ----------
    interpolation : "constant" or "linear"
    points : tuple of (v, f)
        At least one point, with v strictly increasing.

    Raises
    ------
    TemplateError
        If there is no point, or v does not increase.
    """

    interpolation: Interpolation
    points: tuple[tuple[float, float], ...]

    def __post_init__(self) -> None:
        if str(self.interpolation) not in ("constant", "linear"):
            raise TemplateError(
                f"A function table must be 'constant' or 'linear', got {self.interpolation!r:.60}."
            )
        pairs = finite("points of a function table", self.points)
        if pairs.ndim != 2 or pairs.shape[1] != 2:
            raise TemplateError(
                "The points of a function table must be pairs (argument, value), got "
                f"{pairs.shape}."
            )
        object.__setattr__(self, "points", tuple((float(v), float(f)) for v, f in pairs))
        places = pairs[:, 0].tolist()
        if not places or any(b <= a for a, b in pairwise(places)):
            raise TemplateError(
                f"The points of a function table must have increasing arguments, got {places}."
            )

    @classmethod
    def of(cls, interpolation: str, points: Sequence[Sequence[float]]) -> "Table":
        """Return a table with the given points, a sequence of pairs (v, f).

        Raises
        ------
        TemplateError
            If the points are not pairs of numbers.
        """
        array = finite("points of a function table", points)
        if array.ndim != 2 or array.shape[1] != 2:
            raise TemplateError(
                f"The points of a function table must be pairs (argument, value), got {points!r}."
            )
        pairs = tuple((float(v), float(f)) for v, f in array)
        return cls(interpolation, pairs)  # type: ignore[arg-type]

    def __call__(self, v: Floats) -> Floats:
        """Return the function of every element."""
        places = np.array([place for place, _ in self.points])
        values = np.array([value for _, value in self.points])
        if self.interpolation == "linear":
            return np.asarray(np.interp(v, places, values))
        at = np.searchsorted(places, v, side="left")
        return np.asarray(values[np.minimum(at, len(values) - 1)])

    def mean(self, begin: float, end: float) -> float:
        """Return the mean of the function over [begin, end], with begin < end."""
        total = self.points[0][1]
        for (low, before), (high, after) in pairwise(self.points):
            if self.interpolation == "constant":
                share = min(max((end - low) / (end - begin), 0.0), 1.0)
            else:
                first, last = (begin - low) / (high - low), (end - low) / (high - low)
                least, most = min(max(first, 0.0), 1.0), min(max(last, 0.0), 1.0)
                inside = 0.5 * (most - least) * (most + least)
                share = (inside + max(last, 1.0) - max(first, 1.0)) / (last - first)
            total += (after - before) * share
        return total

    @property
    def steepest(self) -> float:
        """The largest magnitude of the slope between points; 0 for a piecewise constant table."""
        if self.interpolation == "constant" or len(self.points) < 2:
            return 0.0
        places, values = np.array(self.points).T
        return float(np.abs(np.diff(values) / np.diff(places)).max())

    @property
    def largest(self) -> float:
        """The largest magnitude of the function's values."""
        return max(abs(f) for _, f in self.points)


_NUMBERS = count()


@dataclass(frozen=True, slots=True)
class OutputFunction:
    """An output function in the forms that the engines need.

    Attributes
    ----------
    name : str
        Name in template files.
    numpy : callable
        f on an array.
    opencl : str
        f as an OpenCL C expression of `x`. `ONE` is 1 in the kernel's own type, and `R(0.5)` is
        how other constants are written.
    linear : bool
        f(x) = x everywhere, so that the array is a linear system.
    limited : bool
        The state itself is kept within [−1, 1] (full-range model).
    discrete : bool
        The array runs in discrete time, one step per time constant (DT-CNN).
    slope : (float, float)
        The smallest and the largest f' of a function that runs in continuous time, from which the
        bounds on rates, steps and errors are derived.
    smooth : bool
        Whether f' is continuous, so that no step meets a kink.

    Raises
    ------
    TemplateError
        If the name is not one line of letters, digits and common signs, the OpenCL form is not an
        expression of x, or the slopes are not two finite numbers in order.
    """

    name: str
    numpy: Callable[[Floats], Floats]
    opencl: str
    linear: bool = False
    limited: bool = False
    discrete: bool = False
    slope: tuple[float, float] = (0.0, 1.0)
    smooth: bool = False
    # functions of one name may have the same OpenCL form, and differ here
    _number: int = field(default_factory=_NUMBERS.__next__, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        checked_name("an output function", self.name, TemplateError)
        what = f"The OpenCL form of the output function '{self.name}'"
        check_expression(what, self.opencl, ("x",), TemplateError)
        low, high = (float(slope) for slope in self.slope)
        if not (math.isfinite(low) and math.isfinite(high) and low <= high):
            raise TemplateError(
                f"The output function '{self.name}' needs a smallest and a largest slope, two "
                f"finite numbers in order, got slope={self.slope!r:.60}."
            )

    def __reduce__(self) -> tuple[object, ...]:
        """Pickle and copy a built-in function by its name, since engines compare identities."""
        if OUTPUT_FUNCTIONS.get(self.name) is self:
            return output_function, (self.name,)
        return object.__new__, (type(self),), self.__getstate__()

    @property
    def saturates(self) -> bool:
        """Whether f' lies between 0 and 1, as the bounds for symmetric arrays require."""
        return self.slope[0] >= 0.0 and self.slope[1] <= 1.0

    @property
    def steepest(self) -> float:
        """The largest |f'|."""
        return max(abs(self.slope[0]), abs(self.slope[1]))

    @property
    def physics(self) -> tuple[object, ...]:
        """Everything that affects a run. For the built-in functions, the name is enough."""
        if OUTPUT_FUNCTIONS.get(self.name) is self:
            return (self.name,)
        kind = (self.linear, self.limited, self.discrete, self.slope, self.smooth)
        return (self.name, self.opencl, self._number, *kind)


def _clip(x: Floats) -> Floats:
    return np.minimum(np.maximum(x, -1.0), 1.0)  # less than half of np.clip's time


def _identity(x: Floats) -> Floats:
    return x


def _sign(x: Floats) -> Floats:
    return np.where(x >= 0.0, 1.0, -1.0)


_ALL = (
    # Chua & Yang 1988: f(x) = (|x + 1| − |x − 1|)/2
    OutputFunction("standard", _clip, "clamp(x, -ONE, ONE)"),
    OutputFunction("linear", _identity, "x", linear=True, slope=(1.0, 1.0), smooth=True),
    OutputFunction("tanh", np.tanh, "tanh(x)", smooth=True),
    # Espejo et al. 1996: the state is limited, the output is the state
    OutputFunction("full-range", _clip, "clamp(x, -ONE, ONE)", limited=True),
    # Harrer & Nossek 1992: discrete-time CNN
    OutputFunction("sign", _sign, "PICK(x >= ZERO, ONE, -ONE)", discrete=True),
)

OUTPUT_FUNCTIONS = {function.name: function for function in _ALL}


def output_function(value: str | OutputFunction) -> OutputFunction:
    """Return the output function of that name, or a user-defined one unchanged.

    Raises
    ------
    UnknownNameError
        If there is no such name.
    TemplateError
        If a user-defined function has the name of another, by which engines identify it.
    """
    if isinstance(value, OutputFunction):
        if OUTPUT_FUNCTIONS.get(value.name, value) != value:
            raise TemplateError(
                f"There is already an output function '{value.name}': give yours another name."
            )
        return OUTPUT_FUNCTIONS.get(value.name, value)
    if not isinstance(cast(object, value), str) or value not in OUTPUT_FUNCTIONS:
        raise name_error("output function", value, OUTPUT_FUNCTIONS)
    return OUTPUT_FUNCTIONS[value]


_PAIR_NUMBERS = count()


@dataclass(frozen=True, slots=True)
class PairFunction:
    """Function of the centre's quantity c and the neighbour's n, in the forms that engines need.

    Attributes
    ----------
    name : str
    numpy : callable
        f(c, n) on arrays that broadcast.
    opencl : str
        f as an OpenCL C expression of `c` and `n`, written as for an `OutputFunction`.
    slope : float
        Bound on |∂f/∂c| + |∂f/∂n| over the values that the two quantities take, from which the
        bounds on steps and errors are derived.

    Raises
    ------
    TemplateError
        If the name is not one line of letters, digits and common signs, the OpenCL form is not an
        expression of `c` and `n`, or the slope is not a finite number of at least 0.
    """

    name: str
    numpy: Callable[[Floats, Floats], Floats]
    opencl: str
    slope: float
    # functions of one name may have the same OpenCL form, and differ here
    _number: int = field(
        default_factory=_PAIR_NUMBERS.__next__, init=False, repr=False, compare=False
    )

    def __post_init__(self) -> None:
        checked_name("a function of two cells", self.name, TemplateError)
        form = f"The OpenCL form of the function '{self.name}'"
        check_expression(form, self.opencl, ("c", "n"), TemplateError)
        if not (math.isfinite(self.slope) and self.slope >= 0.0):
            raise TemplateError(
                f"The function '{self.name}' needs a bound on its slopes, a finite number of "
                f"at least 0, got slope={self.slope!r:.60}."
            )

    @property
    def physics(self) -> tuple[object, ...]:
        """Everything that affects a run."""
        return (self.name, self.opencl, self._number, self.slope)
