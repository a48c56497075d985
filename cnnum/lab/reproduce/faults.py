"""Faults put into the library one at a time: a check that passes with its subject broken is none.

Every check of the table names at least one. `mutants` puts each into the function that the check is
about, computes the row again, and says whether the row fell.
"""

import sys
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import lru_cache, wraps
from math import inf
from types import FunctionType
from typing import TYPE_CHECKING, Any

import numpy as np

from cnnum.errors import MissingExtraError
from cnnum.programs.fields import Field

if TYPE_CHECKING:
    from cnnum.lab.reproduce.record import Item

Remembered = type(lru_cache(len))
"""Type of functions with cached results."""

CACHED = ("cnnum.lab.reproduce", "cnnum.tactile", "cnnum.templates")
"""Packages whose remembered results a fault would not reach."""


@dataclass(frozen=True, slots=True, eq=False)
class Fault:
    """A function or property of the library that gives something else than it should.

    Attributes
    ----------
    subject : function or property
    what : str
        The fault, in a few words: "× 1.01", "sign of T_y".
    breaks : callable
        Makes a wrong function of the right one.
    share : float
        Relative size of the error that it makes: 0.01 of "× 1.01"; infinite where it has none, as
        of a sign or of a count.
    """

    subject: Any
    what: str
    breaks: Callable[[Callable[..., Any]], Callable[..., Any]]
    share: float = inf

    @property
    def target(self) -> str:
        """The subject's name in its module, such as "tactile.taxel.bridge:Bridge.voltages"."""
        function = self._function
        return f"{function.__module__.removeprefix('cnnum.')}:{function.__qualname__}"

    @property
    def _function(self) -> FunctionType:
        function_type: Any = (
            self.subject.fget if isinstance(self.subject, property) else self.subject
        )
        return function_type  # type: ignore[no-any-return]

    def _wrong(self) -> Any:
        wrong = wraps(self._function)(self.breaks(self._function))
        return property(wrong) if isinstance(self.subject, property) else wrong

    def places(self) -> list[tuple[Any, str]]:
        """Return every owner and name under which the library finds the subject.

        A method belongs to its class. A function may have been imported by name into any module.
        """
        function = self._function
        path, _, name = function.__qualname__.rpartition(".")
        if path:
            owner: Any = sys.modules[function.__module__]
            for part in path.split("."):
                owner = getattr(owner, part)
            return [(owner, name)]
        return _places_of(self.subject)

    @contextmanager
    def applied(self) -> Generator[None]:
        """Have the library compute with the fault; modules that are imported meanwhile lose it."""
        wrong, places = self._wrong(), self.places()
        kept: list[Any] = [vars(owner)[name] for owner, name in places]
        _forget()
        for owner, name in places:
            setattr(owner, name, wrong)
        try:
            yield
        finally:
            for (owner, name), right in zip(places, kept, strict=True):
                setattr(owner, name, right)
            for owner, name in _places_of(wrong):
                setattr(owner, name, self.subject)
            _forget()


def scaled(
    subject: Any, factor: float, *, part: str = "", entry: int | tuple[int, ...] = ()
) -> Fault:
    """Return a fault that multiplies a result, or a part of it.

    Parameters
    ----------
    subject : function or property
    factor : float
    part : str
        A field of the record that it returns; the whole unless given.
    entry : int or tuple of int
        An entry along the last axes of the array, such as 1 or (0, 2); all unless given.
    """

    def change(result: Any) -> Any:
        if part:
            return replace(result, **{part: _times(getattr(result, part), factor, entry)})
        return _times(result, factor, entry)

    indices = _place(entry)
    names = part + (f"[{', '.join(map(str, indices))}]" if indices else "")
    return changed(subject, f"{names} × {factor:g}".strip(), change, share=abs(factor - 1.0))


def changed(subject: Any, what: str, change: Callable[[Any], Any], *, share: float = inf) -> Fault:
    """Return a fault that makes another result of the right one, by a share of it."""

    def breaks(function: Callable[..., Any]) -> Callable[..., Any]:
        return lambda *args, **options: change(function(*args, **options))

    return Fault(subject, what, breaks, share)


def misled(
    subject: Any,
    argument: int,
    name: str,
    *,
    factor: float = 1.0,
    shift: float = 0.0,
    of: float = 0.0,
) -> Fault:
    """Return a fault that takes one of the function's arguments for another.

    Parameters
    ----------
    subject : function
    argument : int
        Which of the positional arguments.
    name : str
        Its name, to be read.
    factor, shift : float
        It is multiplied, then moved, by these.
    of : float
        A usual size of the argument: a shift is a share of it.
    """

    def breaks(function: Callable[..., Any]) -> Callable[..., Any]:
        def wrong(*args: Any, **options: Any) -> Any:
            value = factor * np.asarray(args[argument]) + shift
            return function(*args[:argument], value, *args[argument + 1 :], **options)

        return wrong

    said = (f" × {factor:g}" if factor != 1.0 else "") + (f" + {shift:g}" if shift else "")
    moved = abs(shift) / of if of else inf if shift else 0.0
    return Fault(subject, f"with {name}{said}", breaks, abs(factor - 1.0) + moved)


def _times(values: Any, factor: float, entry: int | tuple[int, ...]) -> Any:
    if isinstance(values, Field) or np.ndim(values) == 0:
        return factor * values
    wrong = np.array(values, dtype=np.float64)
    place: Any = (..., *_place(entry))
    wrong[place] *= factor
    return wrong


def _place(entry: int | tuple[int, ...]) -> tuple[int, ...]:
    return entry if isinstance(entry, tuple) else (entry,)


@dataclass(frozen=True, slots=True)
class Mutant:
    """A check that was computed with one of its faults.

    Attributes
    ----------
    item : Item
    fault : Fault
    got : float
        NaN where the library refused to compute.
    fell : bool
        Whether the check failed, as it must.
    missing : str
        Why it was not run; "" where it was.
    """

    item: "Item"
    fault: Fault
    got: float
    fell: bool
    missing: str = ""

    @property
    def passed(self) -> bool:
        """Whether the check was run and did not notice the fault."""
        return not self.fell and not self.missing

    def record(self) -> dict[str, object]:
        """Return the mutant as `cnnum reproduce --mutants --json` writes it."""
        item = self.item
        return {
            "item": item.name,
            "target": self.fault.target,
            "fault": self.fault.what,
            "expected": item.expected,
            "got": self.got,
            "tolerance": item.tolerance,
            "fell": self.fell,
            "missing": self.missing,
        }


def mutants(items: "Iterable[Item]") -> "Iterator[Mutant]":
    """Compute every check with each of its faults.

    Yields
    ------
    Mutant
        One a fault; comparisons have none. Those of a check that needs a package which is not
        installed are not run.
    """
    for item in items:
        for fault in item.faults:
            yield mutant(item, fault)


def mutant(item: "Item", fault: Fault) -> Mutant:
    """Return a check as it is with one fault."""
    with fault.applied():
        try:
            got = float(item.compute())
        except MissingExtraError as error:
            return Mutant(item, fault, float("nan"), fell=False, missing=str(error))
        except Exception:  # the library itself noticed, or NumPy did: the check gave no number
            got = float("nan")
    return Mutant(item, fault, got, not item.error(got) <= item.tolerance)


def _places_of(thing: Any) -> list[tuple[Any, str]]:
    """Return every module of the library that holds a thing, and under which name."""
    modules = [module for key, module in sys.modules.items() if key.split(".")[0] == "cnnum"]
    return [
        (module, key) for module in modules for key, held in vars(module).items() if held is thing
    ]


def _forget() -> None:
    """Forget what the table and the closed forms remember."""
    for key, module in list(sys.modules.items()):
        if key.startswith(CACHED):
            values: list[Any] = list(vars(module).values())
            for value in values:
                if isinstance(value, Remembered):
                    value.cache_clear()
