"""The printer of C99: whole numbers in the narrower of two types, and single precision."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar

from cnnum import kernels as ir
from cnnum.kernels.number_types import INT32, WholeNumbers
from cnnum.kernels.printer import CHOICE, PRIMARY, RANKS, UNARY, Printer, Ranked

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
            self._widened(one, 0) if wide else self.expression(one) for one in call.arguments
        )
        return self._narrowed((f"{name}({inner})", PRIMARY), call, wide=wide)

    def binary(self, both: ir.Binary) -> Ranked:
        """Write two operands and their sign."""
        logic = both.sign in COMPARISONS or both.sign in BITS
        operands = both.left, both.right
        wide = self._wide(operands, [] if logic or both.bounds is None else [both.bounds])
        left, right = (
            self._widened(one, UNARY) if wide else self.within(one, UNARY) for one in operands
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
        yes, no = (self._widened(one, UNARY) if wide else self.within(one, UNARY) for one in both)
        condition = self.within(choice.condition, UNARY)
        return self._narrowed((f"{condition} ? {yes} : {no}", CHOICE), choice, wide=wide)

    def _wide(self, operands: Sequence[ir.Expression], others: Sequence[ir.Bounds]) -> bool:
        """Return whether an operation takes the wider type: any of its whole numbers needs it."""
        known = [one.bounds for one in operands if one.bounds is not None]
        whole = len(known) == len(operands)
        return whole and any(self.whole.needs_wide(bounds) for bounds in (*known, *others))

    def _widened(self, one: ir.Expression, least: int) -> str:
        """Return the text of an operand of the wider type."""
        fits = one.bounds is not None and not self.whole.needs_wide(one.bounds)
        if not fits or isinstance(one, ir.Integer):
            return self.within(one, least)
        return f"({self.whole.wide}){self.within(one, UNARY)}"

    def _narrowed(self, text: Ranked, value: ir.Expression, *, wide: bool) -> Ranked:
        """Return the result of an operation as the type that its bounds allow."""
        if not wide or value.bounds is None or self.whole.needs_wide(value.bounds):
            return text
        inner = text[0] if text[1] >= UNARY else f"({text[0]})"
        return f"({self.whole.narrow}){inner}", UNARY

    def _function(self, name: str, arguments: Sequence[ir.Expression], *, wide: bool) -> str:
        """Return the name of a function for these arguments, which may have one width alone."""
        real = any(one.bounds is None for one in arguments)
        width = "_real" if real else "64" if wide else "32"
        names = (f"{name}{width}", f"{name}64")
        return next((one for one in names if one in self.functions), name)

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
        """Write that a variable takes in a value."""
        if taken.how == "+":
            return Printer.accumulate(self, taken)
        value, target = taken.value, self.expression(taken.target)
        how = self._function(taken.how, [value], wide=self._wide([value], []))
        return [f"{target} = {how}({target}, {self.expression(value)});"]

    def counted(self, loop: ir.Counted) -> list[str]:
        """Write rounds one after the other."""
        v = loop.variable.text
        goes_on = f"{v} < {loop.end}" + (
            f" && {self.expression(loop.running)}" if loop.running else ""
        )
        head = f"for ({self.count_type} {v} = {loop.start}; {goes_on}; ++{v})"
        return self._body(head, loop.body)
