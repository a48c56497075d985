"""Statements of a kernel, as records: lowering's output, the input of passes and printers."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any

from cnnum.kernels.expressions import (
    CELL,
    COL,
    PLACE,
    ROW,
    Call,
    Element,
    Expression,
    Name,
    Operand,
    call,
    operand,
)
from cnnum.kernels.launch_plan import Strips


@dataclass(frozen=True, slots=True)
class Note:
    """A comment on the next statements."""

    text: str


@dataclass(frozen=True, slots=True)
class Declare:
    """New variables of a type, and their first values.

    Attributes
    ----------
    type : str
        `real`, a number of the kernel, in every lane. `int`, a place or a count. `scalar`, a number
        of a buffer's type.
    variables : tuple of (Name, Expression or None)
    fixed : bool
        Nothing assigns to them.
    """

    type: str
    variables: tuple[tuple[Name, Expression | None], ...]
    fixed: bool = False


@dataclass(frozen=True, slots=True)
class Array:
    """A new array: `length` numbers of its own, or those that begin at `start`."""

    name: Name
    length: int
    start: Expression | None


@dataclass(frozen=True, slots=True)
class Alias:
    """A name for the numbers of a private array from a place on; `fixed` if no swap changes it."""

    name: Name
    array: Name
    start: int = 0
    fixed: bool = True


@dataclass(frozen=True, slots=True)
class Swap:
    """Two aliases change places."""

    first: Name
    second: Name


@dataclass(frozen=True, slots=True)
class Do:
    """A call of a function for what it does."""

    call: Call


@dataclass(frozen=True, slots=True)
class Assign:
    """A variable or an element gets a value; with another sign than "=", it is changed by it."""

    target: Name | Element
    value: Expression
    sign: str = "="


@dataclass(frozen=True, slots=True)
class Store:
    """The vector `vec` of numbers that begins at a place of global memory gets a value."""

    place: Expression
    value: Expression


@dataclass(frozen=True, slots=True)
class Accumulate:
    """A variable takes in a value, in any order: pieces of a sweep do it side by side.

    Attributes
    ----------
    target : Name
    how : str
        "+", or the function of two that gives the larger or the smaller one.
    value : Expression
    """

    target: Name
    how: str
    value: Expression


@dataclass(frozen=True, slots=True)
class Block:
    """Statements whose declarations end with them."""

    body: "tuple[Statement, ...]"


@dataclass(frozen=True, slots=True)
class Branch:
    """Statements that run if a condition holds."""

    condition: Expression
    body: "tuple[Statement, ...]"


@dataclass(frozen=True, slots=True)
class Sweep:
    """A loop over `count` values, rows or rims whose iterations are independent.

    Attributes
    ----------
    variable : Name
        `i` of values, `r` of rows, `q` of cells of rims.
    count : int
    body : tuple of Statement
        Rounds write to places of their own; common results are accumulated.
    hint : str
        A request to compilers: a line before it.
    """

    variable: Name
    count: int
    body: "tuple[Statement, ...]"
    hint: str = ""


@dataclass(frozen=True, slots=True)
class Loop:
    """A loop of one work item over numbers from `start` to `end`.

    Attributes
    ----------
    variable : Name
    start, end : int or Expression
    body : tuple of Statement
    step : int
    hint : str
        A request to compilers: a line before it.
    """

    variable: Name
    end: Operand
    body: "tuple[Statement, ...]"
    start: Operand = 0
    step: int = 1
    hint: str = ""


@dataclass(frozen=True, slots=True)
class Counted:
    """Rounds one after the other: `variable` counts from `start` up to `end`.

    Attributes
    ----------
    variable : Name
    start : int
    end : int or Name
        For a name, its value when the loop starts.
    running : Name or None
        A number; the loop ends once it is 0 in all lanes.
    body : tuple of Statement
    hint : str
        A request to compilers: a line before it.
    """

    variable: Name
    start: int
    end: int | Name
    running: Name | None
    body: "tuple[Statement, ...]"
    hint: str = ""

    @property
    def condition(self) -> Expression:
        """The condition before every round."""
        below = self.variable < self.end
        return below if self.running is None else below & call("ANY_LANE", self.running)


@dataclass(frozen=True, slots=True)
class Case:
    """Statements that run where the choice around them is this number."""

    number: int
    body: "tuple[Statement, ...]"


@dataclass(frozen=True, slots=True)
class While:
    """Statements of one work item that run as long as a condition holds."""

    condition: Expression
    body: "tuple[Statement, ...]"


@dataclass(frozen=True, slots=True)
class StripSteps:
    """Steps of a large array that are a kernel of their own.

    Attributes
    ----------
    strips : Strips
    levels : Name or None
        The variable that says how many levels a frame takes.
    """

    strips: Strips
    levels: Name | None = None


@dataclass(frozen=True, slots=True)
class Verbatim:
    """A text that a pass takes as it is, with records in it.

    Attributes
    ----------
    pieces : tuple of str, Expression, or tuple of Statement
        One after the other. All names of the body around it that it uses are in records.
    """

    pieces: "tuple[str | Expression | tuple[Statement, ...], ...]"


Statement = (
    Note | Declare | Array | Alias | Swap | Do | Assign | Store | Accumulate | Block | Branch
    | Case | Sweep | Loop | Counted | While | StripSteps | Verbatim
)  # fmt: skip


def declare(name: Name, value: Operand | None = None, *, of: str = "real") -> Declare:
    """Return the declaration of one variable."""
    return Declare(of, ((name, None if value is None else operand(value)),))


def fixed(name: Name, value: Operand, *, of: str = "real") -> Declare:
    """Return the declaration of a name for one value."""
    return Declare(of, ((name, operand(value)),), fixed=True)


def add(target: Name | Element, value: Expression) -> Assign:
    """Return the statement that adds a value."""
    return Assign(target, value, "+=")


def block(*body: Statement) -> Block:
    """Return a block of statements."""
    return Block(body)


def sweep(variable: Name, count: int, body: Sequence[Statement]) -> Sweep:
    """Return a sweep."""
    return Sweep(variable, count, tuple(body))


def grid(rows: int, cols: int, radius: int, body: Sequence[Statement], hint: str = "") -> Sweep:
    """Return a sweep over cells `i` that stand at `p` in arrays with a rim of a width."""
    place = (ROW + radius) * (cols + 2 * radius) + COL + radius
    places = Declare("int", ((CELL, ROW * cols + COL), (PLACE, place)), fixed=True)
    return Sweep(ROW, rows, (Sweep(COL, cols, (places, *body), hint),))


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
        for part in value:  # pyright: ignore[reportUnknownVariableType]
            yield from _records(part)
    elif is_dataclass(value):
        yield value
        for field in fields(value):
            yield from _records(getattr(value, field.name))


def live(body: Sequence[Statement], needed: set[str]) -> tuple[Statement, ...]:
    """Return statements without variables that nothing reads; `needed` gathers the read ones.

    Numbers of arrays, and variables from outside, are outputs: they are always set.
    """
    return _live(body, needed, names_of_own(tuple(body)))


def _live(body: Sequence[Statement], needed: set[str], own: set[str]) -> tuple[Statement, ...]:
    """Return the live statements of a block; `own` are the variables that the body declares."""
    kept = list[Statement]()
    for statement in reversed(body):
        if isinstance(statement, Sweep | Loop | Counted):
            live_part = _live_block(statement, needed, own)
        elif isinstance(statement, Declare):
            live_part = _live_variables(statement, needed)
        else:
            live_part = statement if _sets(statement, needed, own) else None
        if live_part is not None:
            kept.append(live_part)
    return tuple(kept[::-1])


def _live_variables(new: Declare, needed: set[str]) -> Declare | None:
    variables = list[tuple[Name, Expression | None]]()
    for name, value in reversed(new.variables):
        if name.text in needed:
            needed.discard(name.text)  # another one by that name may stand in another loop
            needed |= names_in(value)
            variables.insert(0, (name, value))
    return replace(new, variables=tuple(variables)) if variables else None


def _sets(statement: Statement, needed: set[str], own: set[str]) -> bool:
    """Return whether a statement has an effect; the names it reads become needed."""
    assert isinstance(statement, Assign | Accumulate)
    target = statement.target
    adds = isinstance(statement, Accumulate) or statement.sign != "="
    if isinstance(target, Name) and target.text not in needed and (adds or target.text in own):
        return False
    needed |= names_in(statement.value)
    if isinstance(target, Element):
        needed |= names_in(target.at)
    return True


def _live_block(
    statement: Sweep | Loop | Counted, needed: set[str], own: set[str]
) -> Statement | None:
    outer = statement.variable.text in needed
    if isinstance(statement, Counted):
        if statement.running is not None:
            needed.add(statement.running.text)
        # a round may read variables that the one before has set, and so on
        known = -1
        while known < len(needed):
            known = len(needed)
            _within(statement.body, needed, own)
    inner = _within(statement.body, needed, own)
    if not outer:  # a loop's own variable: one by that name before the loop is another
        needed.discard(statement.variable.text)
    return replace(statement, body=inner) if inner else None


def _within(body: Sequence[Statement], needed: set[str], own: set[str]) -> tuple[Statement, ...]:
    """Return the live statements of a block, whose own variables are not known outside."""
    inner = set(needed)
    result = _live(body, inner, own)
    needed |= inner
    return result
