"""Functions of a cell and its neighbour, for couplings of a kind of their own: one record each."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import count

from cnnum.arrays import Floats
from cnnum.errors import TemplateError
from cnnum.safety.expressions import check_expression
from cnnum.safety.names import checked_name

_NUMBERS = count()


@dataclass(frozen=True, slots=True)
class PairFunction:
    """A function of the centre's quantity c and the neighbour's n, in the forms engines need.

    Attributes
    ----------
    name : str
    numpy : callable
        f(c, n) on arrays that broadcast.
    opencl : str
        f as an OpenCL C expression of `c` and `n`, with the words of an `OutputFunction`'s.
    slope : float
        A bound on |∂f/∂c| + |∂f/∂n| over the values that the two quantities take. Bounds of steps
        and of errors follow from it.

    Raises
    ------
    TemplateError
        If the name is not one line of plain signs, or the OpenCL form no expression of `c` and
        `n`. Or if the slope is no finite number from 0 up.
    """

    name: str
    numpy: Callable[[Floats, Floats], Floats]
    opencl: str
    slope: float
    # functions of one name may have the same OpenCL form, and differ here
    _number: int = field(default_factory=_NUMBERS.__next__, init=False, repr=False, compare=False)

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
