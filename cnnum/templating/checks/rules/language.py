"""The language of rules: a Boolean expression of a cell's black-and-white neighbourhood.

Names: the eight neighbours `nw n ne e se s sw w` and the cell `c`. The counts of black ones are
`edges`, `corners`, `ring` (all eight) and `ring24` (of the 5×5 neighbourhood). `before` is the cell
in the initial state, and `u` that in the input. `u_ring` is the count of its black neighbours
there. `match("#o#/.#./#o#")` is true where the neighbourhood is the pattern ('#' black, 'o' white,
'.' any). `mismatch` counts the cells that differ, '+' and '-' being black and white of half weight.
Operators: `and or not`, comparisons, `+ - *` and whole numbers.
"""

import ast
import operator
import re
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.errors import TemplateError
from cnnum.templating.boundary import Boundary
from cnnum.templating.checks.parameters import has, text
from cnnum.templating.template import Template

Values = NDArray[Any]

RADIUS = 2
NAMES = {"nw": (-1, -1), "n": (-1, 0), "ne": (-1, 1), "w": (0, -1), "c": (0, 0)} | {
    "e": (0, 1),
    "sw": (1, -1),
    "s": (1, 0),
    "se": (1, 1),
}
EDGES, CORNERS = ("n", "e", "s", "w"), ("nw", "ne", "se", "sw")
WEIGHTS = {"#": 1.0, "o": 1.0, ".": 0.0, "+": 0.5, "-": 0.5}
_COMPARE: Mapping[type[ast.cmpop], Callable[[Any, Any], Any]] = {
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
}
_ARITHMETIC: Mapping[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
}


class Neighbourhood:
    """Black-and-white pictures, and the neighbours of each cell.

    Parameters
    ----------
    black : (pictures, rows, cols) bool
    boundary : Boundary
        White for a constant below 0, black above; a 0 is no colour, and seen as white.
    """

    def __init__(self, black: NDArray[np.bool_], boundary: Boundary) -> None:
        self.shape = black.shape[-2:]
        rim = [(0, 0), (RADIUS, RADIUS), (RADIUS, RADIUS)]
        if boundary.constant is None:
            self.padded = np.pad(black, rim, mode=boundary.pad_mode)
        else:
            self.padded = np.pad(black, rim, constant_values=boundary.constant > 0.0)

    def at(self, down: int, east: int) -> Values:
        """Return each cell's neighbour that lies some rows down and columns east."""
        top, left = RADIUS + down, RADIUS + east
        return self.padded[..., top : top + self.shape[0], left : left + self.shape[1]]

    def named(self, name: str) -> Values:
        """Return a neighbour, or a count of black ones, by its name in a rule."""
        if name in NAMES:
            return self.at(*NAMES[name])
        if name == "ring24":
            every = [self.at(d, e).astype(int) for d in range(-2, 3) for e in range(-2, 3)]
            return np.asarray(sum(every) - self.at(0, 0))
        places = {"edges": EDGES, "corners": CORNERS, "ring": EDGES + CORNERS}[name]
        return np.asarray(sum(self.named(place).astype(int) for place in places))

    def mismatch(self, pattern: str) -> Values:
        """Return by how many cells, weighed, the neighbourhood differs from a pattern."""
        rows = pattern.split("/")
        radius = len(rows) // 2
        if {len(row) for row in rows} != {len(rows)} or len(rows) not in (3, 5):
            raise ValueError(f"a pattern is 3×3 or 5×5, rows parted by '/', got '{pattern}'")
        total = np.zeros(self.at(0, 0).shape)
        for down, row in enumerate(rows):
            for east, sign in enumerate(row):
                if sign not in WEIGHTS:
                    raise ValueError(f"a pattern is of '#', 'o', '.', '+' and '-', got '{sign}'")
                seen = self.at(down - radius, east - radius)
                total += WEIGHTS[sign] * (seen != (sign in "#+"))
        return total


class Rule:
    """A rule as text.

    Parameters
    ----------
    template : str
        The name for error messages.
    text : str

    Raises
    ------
    TemplateError
        If the text is no rule.
    """

    def __init__(self, template: str, text: str) -> None:
        self.template, self.text = template, text
        try:
            self.tree = ast.parse(text, mode="eval").body
        except SyntaxError as error:
            raise self._wrong(error.msg) from None

    def __call__(
        self,
        cells: Neighbourhood,
        before: NDArray[np.bool_],
        inputs: Neighbourhood,
    ) -> NDArray[np.bool_]:
        """Return where the rule holds.

        Raises
        ------
        TemplateError
            If the rule has a name or a sign that is not in the language.
        """
        special = {"before": before, "u": inputs.at(0, 0), "u_ring": inputs.named("ring")}

        def value(node: ast.expr) -> Any:
            match node:
                case ast.Constant(value=bool() | int() | float()):
                    return node.value
                case ast.Name(id=name) if name in special:
                    return special[name]
                case ast.Name(id=name):
                    return cells.named(name)
                case ast.BoolOp(op=op, values=parts):
                    join = np.logical_and if isinstance(op, ast.And) else np.logical_or
                    return join.reduce(np.broadcast_arrays(*[value(part) for part in parts]))
                case ast.UnaryOp(op=ast.Not(), operand=part):
                    return np.logical_not(value(part))
                case ast.BinOp(left=left, op=op, right=right):
                    return _ARITHMETIC[type(op)](_number(value(left)), _number(value(right)))
                case ast.Compare(left=left, ops=[op], comparators=[right]):
                    return _COMPARE[type(op)](_number(value(left)), _number(value(right)))
                case ast.Call(func=ast.Name(id=name), args=[ast.Constant(value=str(text))]):
                    differs = cells.mismatch(text)
                    return {"match": differs == 0.0, "mismatch": differs}[name]
                case _:
                    raise ValueError(f"'{ast.unparse(node)}' is not in the language of rules")

        try:
            holds = value(self.tree)
        except (KeyError, ValueError) as error:
            raise self._wrong(str(error)) from None
        return np.asarray(np.broadcast_to(holds, before.shape), dtype=np.bool_)

    def _wrong(self, why: str) -> TemplateError:
        return TemplateError(
            f"Template '{self.template}': the rule '{self.text}' of its check cannot be read "
            f"({why}); expected an expression such as 'c and ring <= 3'."
        )


def _number(value: Any) -> Any:
    return value.astype(int) if getattr(value, "dtype", None) == np.bool_ else value


def reads_wide(rule: str) -> bool:
    """Return whether a rule reads 5×5 cells, not 3×3."""
    return "ring24" in rule or re.search(r"[\"'](?:[^\"'/]*/){4}", rule) is not None


def is_wide(template: Template) -> bool:
    """Return whether the check of a template, or the template itself, reads more than 3×3 cells."""
    rules = [text(template, name) for name in ("rule", "avoid") if has(template, name)]
    return template.radius > 1 or any(map(reads_wide, rules))


def as_black(pictures: Floats) -> NDArray[np.bool_]:
    """Return which cells are black; a free cell of 0 counts as white."""
    return np.asarray(pictures > 0.0, dtype=np.bool_)
