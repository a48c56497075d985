"""The reads, declarations and common results of statements."""

from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

from cnnum.kernels.expressions import Name
from cnnum.kernels.statements import (
    Accumulate,
    Alias,
    Array,
    Assign,
    Counted,
    Declare,
    Loop,
    Statement,
    Sweep,
)


@dataclass(frozen=True, slots=True)
class Uses:
    """The use of outer names by statements.

    Attributes
    ----------
    names : tuple of str
        All of them, in the order of their first use.
    taken_in : dict of str to str
        Those that values are taken into, and how: "+", or a function's name.
    changed : frozenset of str
        Those that get other values.
    """

    names: tuple[str, ...]
    taken_in: dict[str, str]
    changed: frozenset[str]


def uses(statements: tuple[Statement, ...]) -> Uses:
    """Return the use of outer names by statements."""
    everything = list(_records(statements))
    own = set(declared(everything))
    names = (record.text for record in everything if isinstance(record, Name))
    taken_in = {
        record.target.text: record.how for record in everything if isinstance(record, Accumulate)
    }
    changed = {
        record.target.text
        for record in everything
        if isinstance(record, Assign) and isinstance(record.target, Name)
    }
    return Uses(
        tuple(dict.fromkeys(name for name in names if name not in own)),
        {name: how for name, how in taken_in.items() if name not in own},
        frozenset(changed - own),
    )


def names_in(value: Any) -> set[str]:
    """Return all variables and arrays of a record, or of a tuple of them."""
    return {record.text for record in _records(value) if isinstance(record, Name)}


def names_of_own(body: tuple[Statement, ...]) -> set[str]:
    """Return the names that statements, and those within them, declare themselves."""
    return set(declared(_records(body)))


def declared(records: Any) -> Iterator[str]:
    """Yield the names that statements declare themselves."""
    for record in records:
        if isinstance(record, Declare):
            yield from (name.text for name, _ in record.variables)
        elif isinstance(record, Array | Alias):
            yield record.name.text
        elif isinstance(record, Sweep | Loop | Counted):
            yield record.variable.text


def _records(value: Any) -> Iterator[Any]:
    """Yield a record and all in it, in the order in which they are written."""
    if isinstance(value, tuple):
        for each in value:  # pyright: ignore[reportUnknownVariableType]
            yield from _records(each)
    elif is_dataclass(value):
        yield value
        for field in fields(value):
            yield from _records(getattr(value, field.name))
