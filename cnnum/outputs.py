"""Output functions y = f(x) of a cell: one record each, shared by every engine."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cnnum.arrays import Floats
from cnnum.errors import name_error


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
        f as an OpenCL C expression of `x`; `ONE` is 1 in the kernel's own type.
    linear : bool
        f(x) = x everywhere, so that the array is a linear system.
    limited : bool
        The state itself is kept within [−1, 1] (full-range model).
    discrete : bool
        The array runs in discrete time, one step a time constant (DT-CNN).
    """

    name: str
    numpy: Callable[[Floats], Floats]
    opencl: str
    linear: bool = False
    limited: bool = False
    discrete: bool = False

    def __post_init__(self) -> None:
        if "x" not in self.opencl:
            raise ValueError(f"The OpenCL form of '{self.name}' must be an expression of x.")


def _clip(x: Floats) -> Floats:
    return np.minimum(np.maximum(x, -1.0), 1.0)  # less than half of np.clip's time


def _identity(x: Floats) -> Floats:
    return x


def _sign(x: Floats) -> Floats:
    return np.where(x >= 0.0, 1.0, -1.0)


_ALL = (
    # Chua & Yang 1988: f(x) = (|x + 1| − |x − 1|)/2
    OutputFunction("standard", _clip, "clamp(x, -ONE, ONE)"),
    OutputFunction("linear", _identity, "x", linear=True),
    OutputFunction("tanh", np.tanh, "tanh(x)"),
    # Espejo et al. 1996: the state is limited, the output is the state
    OutputFunction("full-range", _clip, "clamp(x, -ONE, ONE)", limited=True),
    # Harrer & Nossek 1992: discrete-time CNN
    OutputFunction("sign", _sign, "PICK(x >= ZERO, ONE, -ONE)", discrete=True),
)

OUTPUT_FUNCTIONS = {function.name: function for function in _ALL}


def output_function(name: str) -> OutputFunction:
    """Return the output function of that name.

    Raises
    ------
    UnknownNameError
        If there is none.
    """
    if name not in OUTPUT_FUNCTIONS:
        raise name_error("output function", name, OUTPUT_FUNCTIONS)
    return OUTPUT_FUNCTIONS[name]
