"""Statements as C text."""

from collections.abc import Sequence
from dataclasses import dataclass

from cnnum.embedded.c.expressions import CExpressions, element_type, real, type_of, wide
from cnnum.embedded.ir.expressions import Call, Expression, Item, Name
from cnnum.embedded.ir.statements import (
    Cells,
    Fold,
    Let,
    Repeat,
    Rounds,
    Set,
    Statement,
    Store,
    Total,
)

WHOLE = {"i": "int32_t", "p": "int32_t"}


def names_in(value: Expression) -> set[str]:
    """Return the variables and arrays that an expression reads."""
    if isinstance(value, Name):
        return {value.text}
    if isinstance(value, Item):
        return {value.array, *names_in(value.at)}
    if isinstance(value, Call):
        return {name for one in value.arguments for name in names_in(one)}
    return set()


def live(body: Sequence[Statement], needed: set[str]) -> list[Statement]:
    """Return statements without variables that nothing reads; `needed` gathers the read ones."""
    kept = list[Statement]()
    for statement in reversed(body):
        found: Statement | None = statement
        if isinstance(statement, Let | Total):
            if statement.name not in needed:
                continue
            value = statement.value if isinstance(statement, Let) else statement.term
            needed.discard(statement.name)  # another one by that name may stand in another loop
            needed |= names_in(value)
        elif isinstance(statement, Cells | Repeat | Rounds):
            found = _live_block(statement, needed)
        elif isinstance(statement, Fold):
            if statement.name not in needed:
                continue
            needed |= names_in(statement.value)
        else:
            needed |= names_in(statement.value)
            if isinstance(statement, Store):
                needed |= names_in(statement.at)
        if found is not None:
            kept.append(found)
    return kept[::-1]


def _live_block(statement: Cells | Repeat | Rounds, needed: set[str]) -> Statement | None:
    if isinstance(statement, Rounds):
        needed.add(statement.running)
    if isinstance(statement, Repeat | Rounds):
        # a round may read variables that the one before has set
        _within(statement.body, needed)
    inner = tuple(_within(statement.body, needed))
    if not inner:
        return None
    if isinstance(statement, Cells):
        return Cells(statement.count, inner, statement.cols, statement.halo)
    if isinstance(statement, Repeat):
        return Repeat(statement.count, inner)
    return Rounds(statement.running, statement.limit, inner)


def _within(body: Sequence[Statement], needed: set[str]) -> list[Statement]:
    """Return the live statements of a block, whose own variables are not known outside."""
    inner = set(needed)
    found = live(body, inner)
    needed |= inner
    return found


@dataclass(frozen=True, slots=True)
class CStatements:
    """Writes statements.

    Attributes
    ----------
    write : CExpressions
    changed : set of str
        Variables that are set again after they are made.
    """

    write: CExpressions
    changed: set[str]

    def lines(self, body: Sequence[Statement], depth: int = 1) -> list[str]:
        """Return the lines of statements."""
        pad = "    " * depth
        return [f"{pad}{line}" for statement in body for line in self._written(statement)]

    def _written(self, statement: Statement) -> list[str]:
        text = self.write.text
        if isinstance(statement, Let):
            bounds = statement.value.bounds if statement.bounds is None else statement.bounds
            fixed = "" if statement.name in self.changed else "const "
            return [f"{fixed}{type_of(bounds)} {statement.name} = {text(statement.value)};"]
        if isinstance(statement, Set):
            return [self._set(statement)]
        if isinstance(statement, Store):
            target = f"{self.write.name(statement.array)}[{text(statement.at)}]"
            return [f"{target} = {self._cast(statement.array, statement.value)};"]
        if isinstance(statement, Fold):
            return [f"{statement.name} = {self._folded(statement)};"]
        if isinstance(statement, Total):
            return self._total(statement)
        if isinstance(statement, Cells):
            return self._cells(statement)
        if isinstance(statement, Rounds):
            return self._rounds(statement)
        head = f"for (int32_t n = 0; n < {statement.count}; ++n) {{"
        return [head, *self.lines(statement.body), "}"]

    def _set(self, statement: Set) -> str:
        if statement.name in self.write.arrays:
            value = self._cast(statement.name, statement.value)
        else:
            value = self.write.text(statement.value)
        return f"{self.write.name(statement.name)} = {value};"

    def _cast(self, array: str, value: Expression) -> str:
        kind, text = element_type(self.write.arrays[array]), self.write.text(value)
        if kind in ("int32_t", "float"):
            return text
        return f"({kind}){text}" if text[0] == "(" or text.isalnum() else f"({kind})({text})"

    def _folded(self, statement: Fold) -> str:
        value, bounds = self.write.text(statement.value), statement.value.bounds
        if statement.how == "add":
            return f"{statement.name} + {value}"
        width = "_real" if bounds is None else "64" if wide(bounds) else "32"
        self.write.used.add(f"{statement.how}{width}")
        return f"{statement.how}{width}({statement.name}, {value})"

    def _total(self, statement: Total) -> list[str]:
        j, kind = statement.variable, type_of(statement.bounds)
        start = real(0.0) if statement.bounds is None else "0"
        return [
            f"{kind} {statement.name} = {start};",
            f"for (int32_t {j} = 0; {j} < {statement.count}; ++{j}) {{",
            f"    {statement.name} += {self.write.text(statement.term)};",
            "}",
        ]

    def _cells(self, statement: Cells) -> list[str]:
        self.write.used.difference_update({"i", "p", "r", "c"})
        body = self.lines(statement.body, 2 if statement.cols else 1)
        if not statement.cols:
            return [f"for (int32_t i = 0; i < {statement.count}; ++i) {{", *body, "}"]
        cols, halo = statement.cols, statement.halo
        places = list[str]()
        if "i" in self.write.used:
            places.append(f"        const int32_t i = r * {cols} + c;")
        if "p" in self.write.used:
            places.append(
                f"        const int32_t p = (r + {halo}) * {cols + 2 * halo} + c + {halo};"
            )
        return [
            f"for (int32_t r = 0; r < {statement.count // cols}; ++r) {{",
            f"    for (int32_t c = 0; c < {cols}; ++c) {{",
            *places,
            *body,
            "    }",
            "}",
        ]

    def _rounds(self, statement: Rounds) -> list[str]:
        head = f"for (int32_t n = 0; n < {statement.limit} && {statement.running}; ++n) {{"
        return [head, *self.lines(statement.body), "}"]


def changed_in(body: Sequence[Statement]) -> set[str]:
    """Return the variables that are set or folded."""
    found = set[str]()
    for statement in body:
        if isinstance(statement, Set | Fold):
            found.add(statement.name)
        elif isinstance(statement, Cells | Repeat | Rounds):
            found |= changed_in(statement.body)
    return found
