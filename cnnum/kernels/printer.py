"""Records as text, for every target: OpenCL C and C99."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar

from cnnum import kernels as ir
from cnnum.kernels.expressions import Component, Expression, Load, operand
from cnnum.kernels.number_types import INT32, NumberType, WholeNumbers
from cnnum.kernels.statements import Alias, Array, Store, StripSteps, Swap, Verbatim

CHOICE, UNARY, PRIMARY = 1, 12, 13
RANKS = {
    "||": 2, "&&": 3, "|": 4, "^": 5, "&": 6, "==": 7, "!=": 7, "<": 8, "<=": 8, ">": 8, ">=": 8,
    ">>": 9, "+": 10, "-": 10, "*": 11, "/": 11, "%": 11,
}  # fmt: skip
"""Precedence of operators in C."""

Ranked = tuple[str, int]
"""A text and its precedence."""

_WRITERS: dict[type, str] = {
    ir.Name: "name", ir.Constant: "constant", ir.Integer: "integer", ir.Number: "number",
    ir.Element: "element", ir.Component: "component", ir.Load: "load", ir.Call: "call",
    ir.Binary: "binary", ir.Negative: "negative", ir.Cast: "cast", ir.Choice: "choice",
    ir.Assign: "assign", ir.Declare: "declare", ir.Array: "array", ir.Store: "store",
    ir.Alias: "alias", ir.Swap: "swap", ir.Do: "do",
    ir.Accumulate: "accumulate", ir.Note: "note", ir.StripSteps: "strip_steps",
    ir.Verbatim: "verbatim", ir.Block: "block", ir.Branch: "branch", ir.Case: "case",
    ir.While: "during", ir.Sweep: "sweep", ir.Loop: "loop", ir.Counted: "counted",
}  # fmt: skip
"""The method for each record; a target need not support all of them."""


@dataclass(frozen=True, slots=True)
class Printer:
    """Writes records.

    Attributes
    ----------
    numbers : NumberType
    names : mapping of str to str
        Names, of functions too, that are written as others.
    """

    numbers: NumberType
    names: Mapping[str, str] = field(default_factory=dict[str, str])

    count_type: ClassVar[str] = "int"
    """Type of loop variables."""

    def expression(self, value: ir.Expression) -> str:
        """Return the text of an expression."""
        return self.ranked(value)[0]

    def ranked(self, value: ir.Expression) -> Ranked:
        """Return the text of an expression and its precedence."""
        written: Ranked = getattr(self, _WRITERS[type(value)])(value)
        return written

    def within(self, value: ir.Expression, least: int) -> str:
        """Return the text of an operand, in brackets if its precedence is below `least`."""
        text, rank = self.ranked(value)
        return text if rank >= least else f"({text})"

    def lines(self, statements: Iterable[ir.Statement], depth: int = 0) -> list[str]:
        """Return the lines of statements."""
        pad = "    " * depth
        return [
            pad + line if line and line[0] != "#" else line
            for statement in statements
            for line in getattr(self, _WRITERS[type(statement)])(statement)
        ]

    # expressions

    def name(self, name: ir.Name) -> Ranked:
        """Write a name."""
        return self.names.get(name.text, name.text), PRIMARY

    def constant(self, word: ir.Constant) -> Ranked:
        """Write a word."""
        return word.text, PRIMARY

    def integer(self, number: ir.Integer) -> Ranked:
        """Write a whole number."""
        return str(number.value), UNARY if number.value < 0 else PRIMARY

    def number(self, number: ir.Number) -> Ranked:
        """Write a number of the kernel's type."""
        return self.numbers.literal(number.value), PRIMARY

    def element(self, element: ir.Element) -> Ranked:
        """Write an array element."""
        return f"{self.name(element.array)[0]}[{self.expression(element.at)}]", PRIMARY

    def call(self, call: ir.Call) -> Ranked:
        """Write the result of a function."""
        inner = ", ".join([self.expression(argument) for argument in call.arguments])
        return f"{self.names.get(call.function, call.function)}({inner})", PRIMARY

    def binary(self, both: ir.Binary) -> Ranked:
        """Write a binary operation."""
        rank = RANKS[both.sign]
        left, right = self.within(both.left, rank), self.within(both.right, rank + 1)
        return f"{left} {both.sign} {right}", rank

    def negative(self, negative: ir.Negative) -> Ranked:
        """Write an operand with the other sign."""
        return f"-{self.within(negative.value, PRIMARY)}", UNARY

    def cast(self, cast: ir.Cast) -> Ranked:
        """Write a number of another type."""
        return f"({cast.type}){self.within(cast.value, UNARY)}", UNARY

    def choice(self, choice: ir.Choice) -> Ranked:
        """Write one of two."""
        condition = self.within(choice.condition, CHOICE + 1)
        yes, no = self.expression(choice.yes), self.within(choice.no, CHOICE)
        return f"{condition} ? {yes} : {no}", CHOICE

    # statements

    def assign(self, assign: ir.Assign) -> list[str]:
        """Write an assignment."""
        target, value = self.expression(assign.target), self.expression(assign.value)
        if (assign.sign, value) == ("+=", "1"):
            return [f"++{target};"]
        return [f"{target} {assign.sign} {value};"]

    def declare(self, new: ir.Declare) -> list[str]:
        """Write new variables."""
        parts = [
            name.text if value is None else f"{name.text} = {self.expression(value)}"
            for name, value in new.variables
        ]
        return [f"{'const ' if new.fixed else ''}{new.type} {', '.join(parts)};"]

    def accumulate(self, taken: ir.Accumulate) -> list[str]:
        """Write an accumulation into a variable."""
        target = self.expression(taken.target)
        if taken.how == "+":
            return [f"{target} = {target} + {self.within(taken.value, RANKS['+'] + 1)};"]
        return [f"{target} = {taken.how}({target}, {self.expression(taken.value)});"]

    def do(self, do: ir.Do) -> list[str]:
        """Write a call made for its side effect."""
        return [f"{self.expression(do.call)};"]

    def note(self, note: ir.Note) -> list[str]:
        """Write a comment."""
        return [note.text]

    def block(self, block: ir.Block) -> list[str]:
        """Write a block."""
        return self._body("", block.body)

    def branch(self, branch: ir.Branch) -> list[str]:
        """Write a branch."""
        return self._body(f"if ({self.expression(branch.condition)})", branch.body)

    def case(self, case: ir.Case) -> list[str]:
        """Write one of the cases of a choice."""
        return [f"case {case.number}: {{", *self.lines(case.body, 1), "    break;", "}"]

    def during(self, rounds: ir.While) -> list[str]:
        """Write a loop that runs while a condition holds."""
        return self._body(f"while ({self.expression(rounds.condition)})", rounds.body)

    def sweep(self, sweep: ir.Sweep) -> list[str]:
        """Write a sweep as a loop."""
        v = sweep.variable.text
        head = f"for ({self.count_type} {v} = 0; {v} < {sweep.count}; ++{v})"
        return self._body(head, sweep.body, sweep.hint)

    def loop(self, loop: ir.Loop) -> list[str]:
        """Write a loop over numbers."""
        v = loop.variable.text
        next = f"++{v}" if loop.step == 1 else f"{v} += {loop.step}"
        condition = f"{v} < {self.within(operand(loop.end), RANKS['<'] + 1)}"
        start = self.expression(operand(loop.start))
        head = f"for ({self.count_type} {v} = {start}; {condition}; {next})"
        return self._body(head, loop.body, loop.hint)

    def counted(self, loop: ir.Counted) -> list[str]:
        """Write a counted loop."""
        v, condition = loop.variable.text, self.expression(loop.condition)
        head = f"for ({self.count_type} {v} = {loop.start}; {condition}; ++{v})"
        return self._body(head, loop.body, loop.hint)

    def _body(self, head: str, body: Iterable[ir.Statement], hint: str = "") -> list[str]:
        return [*([hint] if hint else []), f"{head} {{".lstrip(), *self.lines(body, 1), "}"]


@dataclass(frozen=True, slots=True)
class OpenCLPrinter(Printer):
    """Writes records as OpenCL C."""

    def component(self, component: Component) -> Ranked:
        """Write a vector component."""
        return f"{self.name(component.vector)[0]}.s{component.lane:x}", PRIMARY

    def load(self, load: Load) -> Ranked:
        """Write the vector at a place."""
        return f"*(__global const vec *)({self.expression(load.place)})", UNARY

    def array(self, array: Array) -> list[str]:
        """Write a new array."""
        if array.start is None:
            return [f"real {array.name.text}[{array.length}];"]
        return [f"__global real *const {array.name.text} = {self.expression(array.start)};"]

    def alias(self, alias: Alias) -> list[str]:
        """Write a name for numbers of a private array."""
        kept, start = "const " if alias.fixed else "", f" + {alias.start}" if alias.start else ""
        return [f"__private real *{kept}{alias.name.text} = {alias.array.text}{start};"]

    def swap(self, swap: Swap) -> list[str]:
        """Write a swap of two aliases."""
        first, other = swap.first.text, swap.second.text
        return [f"__private real *const swap = {first}; {first} = {other}; {other} = swap;"]

    def store(self, store: Store) -> list[str]:
        """Write a vector store."""
        place, value = self.expression(store.place), self.expression(store.value)
        return [f"*(__global vec *)({place}) = {value};"]

    def strip_steps(self, steps: StripSteps) -> list[str]:
        """Write the call of a large array's steps."""
        levels = None if steps.levels is None else self.expression(steps.levels)
        return [steps.strips.within(levels)]

    def verbatim(self, text: Verbatim) -> list[str]:
        """Write a text with records in it."""
        written = ""
        for piece in text.pieces:
            if isinstance(piece, str):
                written += piece
            elif isinstance(piece, Expression):
                written += self.expression(piece)
            else:
                # statements stand as deep as the line that they begin
                pad = written[written.rfind("\n") + 1 :]
                depth = len(pad) // 4 if not pad.strip() else 0
                written += "\n".join(self.lines(piece, depth))[len(pad) if depth else 0 :]
        return written.splitlines()


COMPARISONS = ("==", ">", ">=")
BITS = ("&", "|", "^")


@dataclass(frozen=True, slots=True)
class C99Printer(Printer):
    """Writes records as C99, without a warning of strict compilers.

    Operands of signs are in brackets, since compilers warn of some that C does not need.

    Attributes
    ----------
    elements : mapping of str to str
        The type of the numbers of an array, by its name.
    functions : collection of str
        The functions at hand; their names end with the width of their numbers.
    whole : WholeNumbers
    """

    elements: Mapping[str, str] = field(default_factory=dict[str, str])
    functions: Collection[str] = ()
    whole: WholeNumbers = INT32

    count_type: ClassVar[str] = "int32_t"

    # expressions

    def integer(self, number: ir.Integer) -> Ranked:
        """Write a whole number."""
        return self.whole.literal(number.value), PRIMARY

    def number(self, number: ir.Number) -> Ranked:
        """Write a number of single precision."""
        text = self.numbers.digits(number.value)
        return (f"({text})" if text[0] == "-" else text), PRIMARY

    def call(self, call: ir.Call) -> Ranked:
        """Write the result of a function of the width that its numbers need."""
        result = [bounds for bounds in (call.within, call.bounds) if bounds is not None]
        wide = self._wide(call.arguments, result)
        name = self._function(call.function, call.arguments, wide=wide)
        inner = ", ".join(
            self._widened(argument, 0) if wide else self.expression(argument)
            for argument in call.arguments
        )
        return self._narrowed((f"{name}({inner})", PRIMARY), call, wide=wide)

    def binary(self, both: ir.Binary) -> Ranked:
        """Write a binary operation."""
        logic = both.sign in COMPARISONS or both.sign in BITS
        operands = both.left, both.right
        wide = self._wide(operands, [] if logic or both.bounds is None else [both.bounds])
        left, right = (
            self._widened(argument, UNARY) if wide else self.within(argument, UNARY)
            for argument in operands
        )
        text = f"{left} {both.sign} {right}", RANKS[both.sign]
        return text if logic else self._narrowed(text, both, wide=wide)

    def negative(self, negative: ir.Negative) -> Ranked:
        """Write an operand with the other sign."""
        wide = self._wide([negative.value], [negative.bounds] if negative.bounds else [])
        inner = self._widened(negative.value, PRIMARY) if wide else None
        text = f"-({inner})" if inner else f"-{self.within(negative.value, PRIMARY)}"
        return self._narrowed((text, UNARY), negative, wide=wide)

    def cast(self, cast: ir.Cast) -> Ranked:
        """Write a whole number as a real one."""
        return f"({self.numbers.scalar}){self.within(cast.value, UNARY)}", UNARY

    def choice(self, choice: ir.Choice) -> Ranked:
        """Write one of two."""
        both = choice.yes, choice.no
        wide = self._wide(both, [choice.bounds] if choice.bounds else [])
        yes, no = (
            self._widened(argument, UNARY) if wide else self.within(argument, UNARY)
            for argument in both
        )
        condition = self.within(choice.condition, UNARY)
        return self._narrowed((f"{condition} ? {yes} : {no}", CHOICE), choice, wide=wide)

    def _wide(self, operands: Sequence[ir.Expression], others: Sequence[ir.Bounds]) -> bool:
        """Return whether an operation takes the wider type: any of its whole numbers needs it."""
        known = [argument.bounds for argument in operands if argument.bounds is not None]
        whole = len(known) == len(operands)
        return whole and any(self.whole.needs_wide(bounds) for bounds in (*known, *others))

    def _widened(self, expression: ir.Expression, least: int) -> str:
        """Return the text of an operand of the wider type."""
        fits = expression.bounds is not None and not self.whole.needs_wide(expression.bounds)
        if not fits or isinstance(expression, ir.Integer):
            return self.within(expression, least)
        return f"({self.whole.wide}){self.within(expression, UNARY)}"

    def _narrowed(self, text: Ranked, value: ir.Expression, *, wide: bool) -> Ranked:
        """Return the result of an operation as the type that its bounds allow."""
        if not wide or value.bounds is None or self.whole.needs_wide(value.bounds):
            return text
        inner = text[0] if text[1] >= UNARY else f"({text[0]})"
        return f"({self.whole.narrow}){inner}", UNARY

    def _function(self, name: str, arguments: Sequence[ir.Expression], *, wide: bool) -> str:
        """Return the name of a function for these arguments, which may have one width alone."""
        real = any(argument.bounds is None for argument in arguments)
        width = "_real" if real else "64" if wide else "32"
        names = (f"{name}{width}", f"{name}64")
        return next((known_name for known_name in names if known_name in self.functions), name)

    # statements

    def assign(self, assign: ir.Assign) -> list[str]:
        """Write an assignment; numbers of arrays have types of their own."""
        target = assign.target
        array = target.array if isinstance(target, ir.Element) else target
        kind = self.elements.get(array.text, "")
        if kind in ("", self.whole.narrow, self.numbers.scalar):
            return Printer.assign(self, assign)
        return [f"{self.expression(target)} = ({kind}){self.within(assign.value, PRIMARY)};"]

    def declare(self, new: ir.Declare) -> list[str]:
        """Write new variables: their bounds give the type."""
        lines = list[str]()
        for name, value in new.variables:
            assert value is not None
            kind = self.count_type if new.type == "int" else self.type_of(name.bounds)
            constant = "const " if new.fixed else ""
            lines.append(f"{constant}{kind} {name.text} = {self.expression(value)};")
        return lines

    def type_of(self, bounds: ir.Bounds | None) -> str:
        """Return the type of a variable."""
        return self.numbers.scalar if bounds is None else self.whole.type_of(bounds)

    def accumulate(self, taken: ir.Accumulate) -> list[str]:
        """Write an accumulation into a variable."""
        if taken.how == "+":
            return Printer.accumulate(self, taken)
        value, target = taken.value, self.expression(taken.target)
        how = self._function(taken.how, [value], wide=self._wide([value], []))
        return [f"{target} = {how}({target}, {self.expression(value)});"]

    def counted(self, loop: ir.Counted) -> list[str]:
        """Write a counted loop."""
        v = loop.variable.text
        goes_on = f"{v} < {loop.end}" + (
            f" && {self.expression(loop.running)}" if loop.running else ""
        )
        head = f"for ({self.count_type} {v} = {loop.start}; {goes_on}; ++{v})"
        return self._body(head, loop.body)
