"""The parameters of a program, checked by the annotations of its function."""

import inspect
import math
import types
from collections.abc import Callable, Mapping
from numbers import Integral, Real
from typing import Any, Literal, Union, get_args, get_origin

from cnnum.errors import ProgramError
from cnnum.programs.quantities import in_own_units, refuse_out_of_range
from cnnum.safety.names import shown

LARGEST = 2**63 - 1
"""The largest whole number."""

RATE = "rate"
"""Parameter of every program: the frames a second of its stream, `FrameFields.rate`."""


def checked_parameters(
    name: str, function: Callable[..., object], parameters: Mapping[str, object]
) -> dict[str, object]:
    """Return parameters as plain numbers, texts and flags that a program takes.

    A parameter takes anything without an annotation. So it does with one of another kind than a
    number, a text, true or false, and a choice.

    Raises
    ------
    ProgramError
        With the parameter's name, and the expected values: if the program has no such parameter, it
        is of another type, or a physical one is out of range.
    """
    known = list(inspect.signature(function).parameters.values())[1:]  # the first is the frame
    rate = inspect.Parameter(RATE, inspect.Parameter.KEYWORD_ONLY, annotation=float)
    kinds = {RATE: rate} | {parameter.name: parameter for parameter in known}
    parameters = in_own_units(name, parameters, kinds)
    anything = any(parameter.kind is parameter.VAR_KEYWORD for parameter in kinds.values())
    for key, value in parameters.items():
        if key not in kinds:
            if anything:
                continue
            choices = ", ".join(f"'{each}'" for each in kinds) or "none"
            raise ProgramError(
                f"Program '{name}' has no parameter {shown(key)}: expected one of {choices}."
            )
        expected = _expected(kinds[key].annotation, value)
        if expected is not None:
            raise ProgramError(
                f"The parameter '{key}' of program '{name}' must be {expected}, got {shown(value)}."
            )
    refuse_out_of_range(name, {key: parameters[key] for key in parameters.keys() & kinds.keys()})
    return parameters


def refuse_outside(**ranges: tuple[float, float, float]) -> None:
    """Refuse parameters outside the range that a program can compute with.

    Parameters
    ----------
    **ranges : (value, least, most)
        By the parameter's name.

    Raises
    ------
    ProgramError
        With the name and the range of the first one.
    """
    for name, (value, least, most) in ranges.items():
        if not least <= value <= most:
            raise ProgramError(
                f"'{name}': expected {least:g} to {most:g}, got {shown(value)}; the program "
                "cannot compute with other numbers."
            )


def _expected(kind: Any, value: object) -> str | None:
    """Return the type that a value should have had, None where it has it."""
    if get_origin(kind) is Literal:
        return _text(value)  # the program itself refuses a text that is none of its choices
    if get_origin(kind) in (Union, types.UnionType):
        wrong = [_expected(each, value) for each in get_args(kind)]
        return None if None in wrong else " or ".join(each for each in wrong if each)
    if kind in (None, type(None)):
        return None if value is None else "nothing"
    return _CHECKS[kind](value) if kind in _SIMPLE else None


def _float(value: object) -> str | None:
    if isinstance(value, bool) or not isinstance(value, Real):
        return "a number"
    return "a number other than NaN, of at most 63 bits if whole" if _odd(value) else None


def _int(value: object) -> str | None:
    fits = not isinstance(value, bool) and isinstance(value, Integral) and not _odd(value)
    return None if fits else "a whole number of at most 63 bits"


def _odd(value: Real) -> bool:
    return abs(int(value)) > LARGEST if isinstance(value, Integral) else math.isnan(value)


def _text(value: object) -> str | None:
    return None if isinstance(value, str) else "a text"


def _flag(value: object) -> str | None:
    return None if isinstance(value, bool) else "true or false"


_CHECKS: Mapping[Any, Callable[[object], str | None]] = {
    float: _float,
    int: _int,
    str: _text,
    bool: _flag,
}
_SIMPLE = (float, int, str, bool)
