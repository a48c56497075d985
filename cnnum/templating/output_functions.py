"""Output functions y = f(x) of a cell: one record each, shared by every engine."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import count
from typing import cast

import numpy as np

from cnnum.arrays import Floats
from cnnum.errors import TemplateError, name_error
from cnnum.safety.expressions import check_expression
from cnnum.safety.names import checked_name

_NUMBERS = count()


@dataclass(frozen=True, slots=True)
class OutputFunction:
    """An output function in the forms that the engines need.

    Attributes
    ----------
    name : str
        As template files say it.
    numpy : callable
        f on an array.
    opencl : str
        f as an OpenCL C expression of `x`; `ONE` is 1 in the kernel's own type, `R(0.5)` another
        number.
    linear : bool
        f(x) = x everywhere, so that the array is a linear system.
    limited : bool
        The state itself is kept within [−1, 1] (full-range model).
    discrete : bool
        The array runs in discrete time, one step a time constant (DT-CNN).
    slope : (float, float)
        The least and the largest f' of a function that runs in continuous time. Bounds of rates,
        steps and errors follow from it.
    smooth : bool
        Whether f' changes steadily, so that no step meets a bend.

    Raises
    ------
    TemplateError
        If the name is not one line of plain signs, or the OpenCL form no expression of x. Or if the
        slopes are no two finite numbers in order.
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
        """Whether f' lies between 0 and 1, as the bounds of symmetric arrays need it."""
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
    """Return the output function of that name, or one of a caller's own.

    Raises
    ------
    UnknownNameError
        If there is no such name.
    TemplateError
        If one of a caller's own has the name of another, by which engines know it.
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
