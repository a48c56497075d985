"""Errors of cnnum: one sentence says what was expected, what was given and what to do.

Each class is also the builtin error that a caller would expect, so ``except ValueError`` works.
"""

import errno
import logging
from collections.abc import Iterable
from difflib import get_close_matches
from functools import cache
from typing import Any, cast

MOST_LISTED, FIRST_LISTED = 40, 8
"""Names that an error lists, and those of a longer list."""

LONGEST_GUESSED = 80
"""Signs of a name for which near ones are looked for: longer ones would take their time."""


LONGEST_SENTENCE = 1500
"""Signs of an error's sentence: a longer one loses its middle, and keeps the remedy at its end."""


class CnnumError(Exception):
    """Base of all errors of this package."""

    def __str__(self) -> str:
        said = super().__str__()
        if "\n" in said:  # an array that came has lines
            said = " ".join(said.split())
        if len(said) <= LONGEST_SENTENCE:
            return said
        return f"{said[: LONGEST_SENTENCE // 2]}…{said[1 - LONGEST_SENTENCE // 2 :]}"


def unreadable(kind: type[CnnumError], what: str, reason: OSError, advice: str = "") -> CnnumError:
    """Return the error of a file that cannot be read: of `kind`, and what `reason` is of these.

    `FileNotFoundError`, `IsADirectoryError` or `PermissionError`; `errno` is that of the reason.
    """
    builtin = next((error for error in _OF_FILES if isinstance(reason, error)), OSError)
    why = str(reason.strerror or reason).rstrip(".")
    return _of_file(kind, builtin, (f"{what} cannot be read: {why}{advice}.",), reason.errno)


def missing_file(kind: type[CnnumError], sentence: str) -> CnnumError:
    """Return the error of a file that is not there: of `kind` and a `FileNotFoundError`."""
    return _of_file(kind, FileNotFoundError, (sentence,), errno.ENOENT)


_OF_FILES = (FileNotFoundError, IsADirectoryError, PermissionError)


def _of_file(
    kind: type[CnnumError], builtin: type[OSError], args: tuple[str, ...], number: int | None
) -> CnnumError:
    both: Any = _both  # mypy takes classes of errors for no keys
    error = both(kind, builtin)(*args)
    error.errno = number
    return cast(CnnumError, error)


@cache
def _both(kind: Any, builtin: Any) -> type:
    """Return the class of both, under the name of the first; another process makes it anew."""

    def reduced(error: Any) -> tuple[Any, ...]:
        return _of_file, (kind, builtin, error.args, error.errno)

    parts = (kind,) if issubclass(kind, builtin) else (kind, builtin)
    named = {"__module__": kind.__module__, "__doc__": kind.__doc__, "__reduce__": reduced}
    return type(kind.__name__, parts, named)


class ArrayError(CnnumError, ValueError):
    """An array has the wrong shape, type or content (NaN, infinity)."""


class FrameError(ArrayError):
    """A frame cannot be used: a value is out of range, or the program cannot work with it.

    Attributes
    ----------
    cells : tuple of (row, column)
        Taxels whose values are wrong, if known.
    """

    cells: tuple[tuple[int, int], ...] = ()


class SizeError(CnnumError, MemoryError):
    """An array needs more memory than the machine or the device has."""


class TemplateError(CnnumError, ValueError):
    """A template is not well formed."""


class OneColourError(TemplateError):
    """All correct outputs of a check have the same colour, so the check shows nothing."""


class TemplateFileError(CnnumError, OSError):
    """A template file cannot be opened or written."""


class ProgramError(CnnumError, ValueError):
    """An analogic program cannot be traced or compiled."""


class SceneError(CnnumError, ValueError):
    """A scene file is not well formed."""


class UnknownNameError(CnnumError, LookupError):
    """A name (template, method, engine, driver, need…) is not among the known ones."""


class MethodError(CnnumError, ValueError):
    """An integration method cannot be used as requested (step outside its stability bound…)."""


class DeviceError(CnnumError, RuntimeError):
    """There is no compute device, or not the requested one."""


class NoOpenCLError(DeviceError):
    """No working OpenCL device was found.

    Attributes
    ----------
    reason, advice : str
        Why, and how to get OpenCL here.
    """

    def __init__(self, reason: str, advice: str) -> None:
        super().__init__(
            f"OpenCL cannot be used because {reason}; {advice}; the engine 'numba' runs without it."
        )
        self.reason, self.advice = reason, advice

    def __reduce__(self) -> tuple[type["NoOpenCLError"], tuple[str, str]]:
        return type(self), (self.reason, self.advice)


class NotSupportedError(CnnumError, RuntimeError):
    """An engine lacks the requested feature; the sentence says why."""


class OtherProcessError(CnnumError, TypeError):
    """An object of this process cannot be pickled or copied; the sentence says what to do."""


class CodecError(CnnumError, ValueError):
    """Bytes or text from an array or a recording cannot be decoded."""


class PortError(CnnumError, OSError):
    """A port cannot be opened, or has disappeared."""


class OtherArrayError(PortError):
    """A different array than before answers at a port."""


class RecordingError(CnnumError, OSError):
    """A recording cannot be read or written."""


class RecordingWarning(UserWarning):
    """Only part of a recording can be read; the sentence counts the lost parts."""


class ReportError(CnnumError, OSError):
    """A report cannot be written."""


class PictureError(CnnumError, OSError):
    """A picture file cannot be read or written."""


class PhysicsError(CnnumError, ValueError):
    """A physical parameter is outside the range of its closed form."""


class CalibrationError(CnnumError, ValueError):
    """A calibration (or its file) is not well formed, or cannot be fitted from a scan."""


class MissingExtraError(CnnumError, ImportError):
    """An optional dependency is not installed; the sentence names the extra."""


def missing_extra(purpose: str, library: str, extra: str, instead: str = "") -> MissingExtraError:
    """Return the error for an optional library that is not installed, with the cure in it.

    cnnum is on no package index, where its name is another project's, so the cure is a command for
    a checkout.

    Parameters
    ----------
    purpose : str
        What needs the library: "The live view", "HDF5 files"…
    library, extra : str
        The library, and the extra of cnnum that brings it.
    instead : str
        Another way out, as a clause.
    """
    other = f", {instead}" if instead else ""
    return MissingExtraError(
        f"For {purpose}, cnnum needs the library '{library}', which its extra '{extra}' brings: "
        f"run pip install '.[{extra}]' in a checkout of cnnum{other}."
    )


@cache
def say_once(sentence: str) -> None:
    """Say once a process what is no error, but should not be missed.

    It goes to the logger "cnnum", which writes to standard error unless a program says otherwise.
    """
    logging.getLogger("cnnum").warning(sentence)


def name_error(kind: str, name: object, known: Iterable[str]) -> UnknownNameError:
    """Return the error for an unknown name, with the valid choices in it.

    Parameters
    ----------
    kind : str
        Kind of the named thing: "template", "method"…
    name : object
        The name that came, or another value in its place.
    known : iterable of str
        The valid names.
    """
    names = list(known)
    near = get_close_matches(name[:LONGEST_GUESSED], names, n=3) if isinstance(name, str) else []
    shown = names if len(names) <= MOST_LISTED else names[:FIRST_LISTED]
    choices, guess = (", ".join(f"'{item}'" for item in some) for some in (shown, near))
    hint = f" (did you mean {guess}?)" if near else ""
    more = f" and {len(names) - len(shown)} more" if len(shown) < len(names) else ""
    return UnknownNameError(f"Unknown {kind} {name!r:.60}{hint}: expected one of {choices}{more}.")
