"""Records as text: the part that all targets share, which write C in their own dialects."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import ClassVar

from cnnum import kernels as ir
from cnnum.kernels.expressions import operand
from cnnum.kernels.number_types import NumberType

CHOICE, UNARY, PRIMARY = 1, 12, 13
RANKS = {
    "||": 2, "&&": 3, "|": 4, "^": 5, "&": 6, "==": 7, "!=": 7, "<": 8, "<=": 8, ">": 8, ">=": 8,
    ">>": 9, "+": 10, "-": 10, "*": 11, "/": 11, "%": 11,
}  # fmt: skip
"""How tightly signs bind in C."""

Ranked = tuple[str, int]
"""A text, and how tightly it binds."""

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
"""The method of each record; a target need not have all of them."""


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
    """Of variables of loops."""

    def expression(self, value: ir.Expression) -> str:
        """Return the text of an expression."""
        return self.ranked(value)[0]

    def ranked(self, value: ir.Expression) -> Ranked:
        """Return the text of an expression, and how tightly it binds."""
        written: Ranked = getattr(self, _WRITERS[type(value)])(value)
        return written

    def within(self, value: ir.Expression, least: int) -> str:
        """Return the text of an operand of a sign that binds so tightly."""
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
        """Write a number of an array."""
        return f"{self.name(element.array)[0]}[{self.expression(element.at)}]", PRIMARY

    def call(self, call: ir.Call) -> Ranked:
        """Write the result of a function."""
        inner = ", ".join([self.expression(argument) for argument in call.arguments])
        return f"{self.names.get(call.function, call.function)}({inner})", PRIMARY

    def binary(self, both: ir.Binary) -> Ranked:
        """Write two operands and their sign."""
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
        """Write that a variable takes in a value."""
        target = self.expression(taken.target)
        if taken.how == "+":
            return [f"{target} = {target} + {self.within(taken.value, RANKS['+'] + 1)};"]
        return [f"{target} = {taken.how}({target}, {self.expression(taken.value)});"]

    def do(self, do: ir.Do) -> list[str]:
        """Write a call that is made for what it does."""
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
        """Write rounds as long as a condition holds."""
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
        """Write rounds one after the other."""
        v, condition = loop.variable.text, self.expression(loop.condition)
        head = f"for ({self.count_type} {v} = {loop.start}; {condition}; ++{v})"
        return self._body(head, loop.body, loop.hint)

    def _body(self, head: str, body: Iterable[ir.Statement], hint: str = "") -> list[str]:
        return [*([hint] if hint else []), f"{head} {{".lstrip(), *self.lines(body, 1), "}"]
