"""Statements of a kernel, as records: lowering's output, the input of passes and printers."""

from collections.abc import Sequence
from dataclasses import dataclass

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

    one: Name
    other: Name


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
    """A loop over `count` values, rows or rims whose rounds may run side by side.

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
        Of a name, its value when the rounds begin.
    running : Name or None
        A number; rounds end where it is 0, in all lanes.
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
