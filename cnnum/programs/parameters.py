"""The parameters of a program, checked by annotations, and physical ones with units and ranges."""

import inspect
import math
import re
import types
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from numbers import Integral, Real
from typing import Any, Literal, Union, get_args, get_origin

from cnnum.errors import ProgramError
from cnnum.safety.values import shown

METRES = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "μm": 1e-6}
HERTZ = {"Hz": 1.0, "kHz": 1e3}
NEWTONS = {"N": 1.0, "mN": 1e-3, "kN": 1e3}
PASCALS = {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6, "GPa": 1e9}

PER_TEN_MINUTES = {"/10min": 1.0, "/min": 10.0, "/h": 1.0 / 6.0}

PITCH = "pitch"
"""The distance of the taxels: the divisor of lengths where a program counts in pitches."""

_TEXT = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([A-Za-zµμ]+|/\d*[a-z]+)\s*")


@dataclass(frozen=True, slots=True)
class Quantity:
    """A physical parameter that several programs share.

    Attributes
    ----------
    meaning : str
        The unit of a plain number, for the sentence of an error.
    least, most : float
        Range of its magnitude.
    units : mapping of str to float
        Unit to its size in SI.
    example : str
        As a user may write it.
    signed : bool
        Whether it may be negative; never 0.
    in_pitches : bool
        Whether a plain number counts pitches of the array.
    """

    meaning: str
    least: float
    most: float
    units: Mapping[str, float]
    example: str
    signed: bool = False
    in_pitches: bool = False


QUANTITIES: Mapping[str, Quantity] = {
    "depth": Quantity("pitches of the array", 0.02, 50.0, METRES, "1 mm", in_pitches=True),
    "rate": Quantity("frames a second (Hz)", 1e-3, 1e6, HERTZ, "100 Hz"),
    "unit": Quantity("newtons, or another unit of load,", 1e-30, 1e30, NEWTONS, "1.3 N"),
    # rest and noise are not scaled with it: thresholds hold for 1 and -1 alone
    "push": Quantity("sign of a push", 1.0, 1.0, {}, "", signed=True),
    "thickness": Quantity("metres", 1e-7, 10.0, METRES, "1 mm"),  # 10: a pitch of 1 for theory
    PITCH: Quantity("metres", 1e-7, 10.0, METRES, "1.5 mm"),
    "youngs_modulus": Quantity("pascals", 1e-9, 1e15, PASCALS, "870 kPa"),
    **dict.fromkeys(
        ("sa1_field", "ra1_field", "pc_field", "sa2_field"),
        Quantity("pitches of the array", 0.0, 1e3, METRES, "2 mm", in_pitches=True),
    ),
    **dict.fromkeys(
        ("sa_to", "ra1_from", "ra1_to", "pc_from", "pc_to"),
        Quantity("cycles a second (Hz)", 1e-3, 1e6, HERTZ, "50 Hz"),
    ),
    **dict.fromkeys(
        ("false_reports", "slip_false_reports", "twist_false_reports"),
        Quantity("false reports in ten minutes", 1e-3, 1e3, PER_TEN_MINUTES, "6 /h"),
    ),
}
"""By the parameter's name, in every program that has it."""


def in_own_units(
    program: str, parameters: Mapping[str, object], known: Mapping[str, object]
) -> dict[str, object]:
    """Return parameters with plain numbers for texts such as "1 mm".

    Parameters
    ----------
    program : str
        Its name, for the sentence of an error.
    parameters : mapping of str to object
    known : mapping of str to object
        Parameters that the program has.

    Raises
    ------
    ProgramError
        If a text is not a number with a unit that fits. Or if a length is given where pitches are
        meant, and no pitch is known.
    """
    result = dict(parameters)
    pitch = result.get(PITCH)
    if pitch is not None:
        pitch = result[PITCH] = _number(program, PITCH, pitch)
        refuse_out_of_range(program, {PITCH: pitch})
    if PITCH not in known and takes_pitch(known):
        result.pop(PITCH, None)
    for name in result.keys() & QUANTITIES.keys() & known.keys():
        value = result[name]
        if isinstance(value, str) and QUANTITIES[name].units:
            result[name] = _number(program, name, value, pitch)
    return result


def takes_pitch(known: Mapping[str, object]) -> bool:
    """Return whether a program has a parameter that counts pitches."""
    return any(QUANTITIES[name].in_pitches for name in QUANTITIES.keys() & known.keys())


def refuse_out_of_range(program: str, parameters: Mapping[str, object]) -> None:
    """Check that physical parameters are plausible for an array.

    Raises
    ------
    ProgramError
        With the parameter, its range, and how to give it with a unit.
    """
    for name, value in parameters.items():
        quantity = QUANTITIES.get(name)
        if quantity is None or not isinstance(value, int | float):
            continue
        size = abs(value) if quantity.signed else value
        if not quantity.least <= size <= quantity.most:
            raise ProgramError(_outside(program, name, quantity, value))


def _outside(program: str, name: str, quantity: Quantity, value: float) -> str:
    begin = f"The parameter '{name}' of program '{program}'"
    if quantity.signed:
        return (
            f"{begin} must be −1 where a push lowers the values, or +1 where it raises them, got "
            f"{shown(value)}."
        )
    hint = ""
    if quantity.in_pitches:
        hint = f"; for a length give its unit, as in {name} = '{quantity.example}'"
    return (
        f"{begin} counts {quantity.meaning} and must be {quantity.least:g} to {quantity.most:g}, "
        f"got {shown(value)}{hint}."
    )


def _number(program: str, name: str, value: object, pitch: object = None) -> object:
    """Return a text as the number that it stands for; anything else as it is."""
    quantity, text = QUANTITIES[name], value
    if not isinstance(text, str):
        return value
    match = _TEXT.fullmatch(text[:64])
    if match is None or match[2] not in quantity.units:
        units = ", ".join(f"'{unit}'" for unit in quantity.units if unit.isascii())
        raise ProgramError(
            f"The parameter '{name}' of program '{program}' must be a number ({quantity.meaning}), "
            f"or a text with a unit of {units}, as in '{quantity.example}', got {shown(text)}."
        )
    number = float(match[1]) * quantity.units[match[2]]
    if not quantity.in_pitches:
        return number
    if not isinstance(pitch, int | float):
        raise ProgramError(
            f"The parameter '{name}' of program '{program}' is measured in pitches of the array: "
            f"with {shown(text)}, also give 'pitch', the distance between taxels, as in pitch = "
            "'1.5 mm'."
        )
    return number / pitch


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
            choices = ", ".join(f"'{kind}'" for kind in kinds) or "none"
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
    """Check that parameters are within the range that a program can compute with.

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
        wrong = [_expected(type_, value) for type_ in get_args(kind)]
        return None if None in wrong else " or ".join(sentence for sentence in wrong if sentence)
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
