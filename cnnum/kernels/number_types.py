"""The number types of kernels: their names, and how their literals are written."""

import math
from dataclasses import dataclass, replace
from functools import cache, lru_cache

import numpy as np

from cnnum.errors import ArrayError


@dataclass(frozen=True, slots=True, eq=False)
class NumberType:
    """A type of numbers in buffers and registers.

    Attributes
    ----------
    dtype : dtype
        Data type of host arrays.
    scalar : str
        Its name in OpenCL C.
    bits : str
        The integer of the same size.
    mask, infinite : str
        All bits but the sign, and those of infinity.
    huge : str
        The largest number.
    suffix : str
        The suffix of literals.
    pragma : str
        The line of a kernel before it uses the type.
    register : str
        The code that brings a literal into a register.
    """

    dtype: np.dtype[np.floating]
    scalar: str
    bits: str
    mask: str
    infinite: str
    huge: str
    suffix: str
    pragma: str = ""
    register: str = "R"

    def literal(self, value: float) -> str:
        """Return a number of the kernel's registers."""
        return f"{self.register}({self.digits(value)})"

    def digits(self, value: float) -> str:
        """Return the shortest literal that is exactly the value rounded to the type.

        Raises
        ------
        ArrayError
            If the value is not finite, or too large for the type.
        """
        return _digits(self, float(value), math.copysign(1.0, value))


@lru_cache(maxsize=4096)
def _digits(numbers: NumberType, value: float, sign: float) -> str:
    """Return a literal; 0 and −0 are the same key but for the sign."""
    del sign
    with np.errstate(over="ignore"):
        rounded = numbers.dtype.type(value)
    if not np.isfinite(rounded):
        raise ArrayError(
            f"A kernel needs finite numbers in {numbers.dtype.name}, got {value:g}: rescale the "
            "quantity, or use precision='float64'."
        )
    digits = repr(value) if numbers.dtype == np.float64 else repr(float(str(rounded)))
    if "." not in digits and "e" not in digits:
        digits += ".0"
    return digits + numbers.suffix


FLOAT32 = NumberType(
    np.dtype(np.float32), "float", "int", "0x7fffffff", "0x7f800000", "FLT_MAX", "f"
)
FLOAT64 = NumberType(
    np.dtype(np.float64),
    "double",
    "long",
    "0x7fffffffffffffffL",
    "0x7ff0000000000000L",
    "DBL_MAX",
    "",
    "#pragma OPENCL EXTENSION cl_khr_fp64 : enable",
)


@cache
def in_vectors(numbers: NumberType) -> NumberType:
    """Return the type of registers that hold neighbours of large arrays: vectors `vec`."""
    return replace(numbers, register="(vec)")


def number_type(dtype: np.dtype[np.floating]) -> NumberType:
    """Return the type of kernels whose arrays on the host have this one."""
    return FLOAT64 if dtype == np.float64 else FLOAT32


@dataclass(frozen=True, slots=True)
class WholeNumbers:
    """Whole numbers of two widths: a value has the narrower one where its interval allows.

    Attributes
    ----------
    narrow, wide : str
        Names of the types.
    bits : int
        Bits of the narrow one.
    macro : str
        The macro that makes a literal of the wide one.
    """

    narrow: str
    wide: str
    bits: int
    macro: str

    def needs_wide(self, bounds: tuple[int, int]) -> bool:
        """Return whether an interval needs more than the narrow type."""
        return bounds[0] < -1 << (self.bits - 1) or bounds[1] >= 1 << (self.bits - 1)

    def type_of(self, bounds: tuple[int, int]) -> str:
        """Return the type of a variable that stays within an interval."""
        return self.wide if self.needs_wide(bounds) else self.narrow

    def literal(self, value: int) -> str:
        """Return an integer as C text; C has no negative literals, so those are in parentheses."""
        if value == -1 << (self.bits - 1):
            return f"({value + 1} - 1)"
        text = str(abs(value))
        text = f"{self.macro}({text})" if self.needs_wide((value, value)) else text
        return text if value >= 0 else f"(-{text})"


INT32 = WholeNumbers("int32_t", "int64_t", 32, "INT64_C")
"""The 32-bit integer type of C99."""
