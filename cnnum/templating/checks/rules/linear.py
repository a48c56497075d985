"""Rules as linear inequalities, and the neighbourhoods that a template decides most narrowly.

Every name of the language of rules is a sum of cells, so that a rule is true where one of several
sets of linear inequalities holds. The neighbourhood of a colour that a weighted sum decides most
narrowly is then a linear program in whole numbers: of 5×5 cells there are 33 million
neighbourhoods, and no random picture shows the narrowest one.
"""

import ast
import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from cnnum.arrays import Floats
from cnnum.errors import TemplateError
from cnnum.templating.checks.neighbourhoods import Bools
from cnnum.templating.checks.parameters import has, text
from cnnum.templating.checks.rules.language import (
    CORNERS,
    EDGES,
    NAMES,
    RADIUS,
    WEIGHTS,
    Rule,
)
from cnnum.templating.template import Template

SIDE = 2 * RADIUS + 1
CELLS = SIDE * SIDE
MIDDLE = CELLS // 2
BEFORE = CELLS
"""The column of the cell in the initial state, after those of the neighbourhood."""

_STRICT = 1e-3
"""By which a sum that must be above another one is above it: weights of rules are far coarser."""

_OTHERS = 6
"""Random weights whose narrowest neighbourhoods are taken, of each colour and own cell."""

_MOST = 4000
"""Sets of inequalities; a rule that needs more is too tangled for this."""


class TooTangledError(TemplateError):
    """A rule that is no small union of linear inequalities of 5×5 cells."""

    def __init__(self) -> None:
        super().__init__(
            "The rule is no small union of linear inequalities of 5×5 cells, so that its narrowest "
            "neighbourhoods cannot be searched: write it with fewer alternatives."
        )


@dataclass(frozen=True, slots=True, eq=False)
class Sum:
    """A weighted sum of black cells: weights·x + constant, x being 1 where a cell is black.

    Attributes
    ----------
    weights : (26,) float
        Weights of the 5×5 cells, row by row, and of the cell before.
    constant : float
    """

    weights: Floats
    constant: float = 0.0

    def __add__(self, other: "Sum") -> "Sum":
        return Sum(self.weights + other.weights, self.constant + other.constant)

    def times(self, factor: float) -> "Sum":
        """Return a multiple."""
        return Sum(factor * self.weights, factor * self.constant)

    @property
    def most(self) -> float:
        """The largest value that it can have."""
        return self.constant + float(np.maximum(self.weights, 0.0).sum())


Case = tuple[Sum, ...]
"""Sums that are all at least 0."""


def narrow_neighbourhoods(template: Template, rng: np.random.Generator) -> Bools:
    """Return 5×5 neighbourhoods that are narrowly decided, of both colours, each once.

    Parameters
    ----------
    template : Template
        Of one input, whose check is a rule of the input's neighbourhood.
    rng : numpy.random.Generator
        Draws weights of others, whose narrowest neighbourhoods are taken too.

    Returns
    -------
    (neighbourhoods, 5, 5) bool
        No neighbourhood where the rule is too tangled, or the template is wider than that.
    """
    try:
        own = colour_weights(template)
        both_colours = [(holds, decided(template, holds=holds)) for holds in (True, False)]
    except TooTangledError:
        return np.zeros((0, SIDE, SIDE), dtype=np.bool_)
    found = list[Floats]()
    for holds, cases in both_colours:
        sign = 1.0 if holds else -1.0
        for black in (False, True):
            fixed = {MIDDLE: black}
            narrow = [narrowest(case, sign * own, fixed) for case in cases]
            for _ in range(_OTHERS if cases else 0):
                case = cases[rng.integers(len(cases))]
                narrow.append(narrowest(case, rng.normal(size=CELLS + 1), fixed))
            found += [each for each in narrow if each is not None]
    if not found:
        return np.zeros((0, SIDE, SIDE), dtype=np.bool_)
    cells = np.unique(np.stack(found)[:, :CELLS], axis=0)
    return cells.reshape(-1, SIDE, SIDE) > 0.5


def colour_weights(template: Template) -> Floats:
    """Return what each black cell of the neighbourhood adds to the drive of a cell.

    Raises
    ------
    TooTangledError
        If the template sees more than 5×5 cells.
    """
    kernel, weights = template.B[0, 0], np.zeros((SIDE, SIDE))
    off = RADIUS - kernel.shape[0] // 2
    if off < 0:
        raise TooTangledError
    weights[off : SIDE - off, off : SIDE - off] = kernel
    return np.append(weights.ravel(), 0.0)


def decided(template: Template, *, holds: bool) -> list[Case]:
    """Return the inequalities of the neighbourhoods that a template must make black, or white.

    Raises
    ------
    TooTangledError
        If there are too many.
    """
    cases = cases_of(Rule(template.name, text(template, "rule")), holds=holds)
    if has(template, "avoid"):
        avoid = Rule(template.name, text(template, "avoid"))
        cases = both(cases, cases_of(avoid, holds=False))
    return cases


def cases_of(rule: Rule, *, holds: bool) -> list[Case]:
    """Return the sets of inequalities of which one is true where a rule holds, or where it fails.

    The rule is one of the input's neighbourhood: `u` is then the cell itself.

    Raises
    ------
    TooTangledError
        If there are too many, or the rule multiplies cells with each other.
    """
    return _cases(rule.tree, holds)


def both(first: list[Case], second: list[Case]) -> list[Case]:
    """Return the sets of inequalities that are true where both are, without impossible ones."""
    if len(first) * len(second) > _MOST:
        raise TooTangledError
    joined = (one + other for one, other in itertools.product(first, second))
    return [case for case in joined if all(each.most >= 0.0 for each in case)]


def narrowest(case: Case, weights: Floats, fixed: dict[int, bool]) -> Floats | None:
    """Return the neighbourhood of a case with the smallest weighted sum, None where there is none.

    Parameters
    ----------
    case : tuple of Sum
    weights : (26,) float
    fixed : dict of int to bool
        Cells whose colour is given.

    Returns
    -------
    (26,) float, 0 or 1
    """
    from scipy.optimize import Bounds, LinearConstraint, milp

    low, high = np.zeros(CELLS + 1), np.ones(CELLS + 1)
    for cell, black in fixed.items():
        low[cell] = high[cell] = float(black)
    held = [
        LinearConstraint(np.stack([each.weights for each in case]), [-s.constant for s in case])
    ]
    found = milp(
        weights,
        integrality=np.ones(CELLS + 1, dtype=np.int64),
        bounds=Bounds(low, high),
        constraints=held if case else (),
    )
    return None if found.x is None else np.asarray(np.rint(found.x), dtype=np.float64)


def _cases(node: ast.expr, holds: bool) -> list[Case]:
    match node:
        case ast.BoolOp(op=op, values=parts):
            found = [_cases(part, holds) for part in parts]
            if isinstance(op, ast.And) != holds:
                return list(itertools.chain.from_iterable(found))
            joined: list[Case] = [()]
            for each in found:
                joined = both(joined, each)
            return joined
        case ast.UnaryOp(op=ast.Not(), operand=part):
            return _cases(part, not holds)
        case ast.Compare(left=left, ops=[op], comparators=[right]):
            return _compared(_sum(left) + _sum(right).times(-1.0), op, holds)
        case ast.Call(func=ast.Name(id="match"), args=[ast.Constant(value=str(text))]):
            return _compared(_mismatch(text), ast.LtE(), holds)
        case ast.Constant(value=bool(value)):
            return [()] if value == holds else []
        case _:
            return _compared(_sum(node), ast.Gt(), holds)


_OPPOSITE: dict[type[ast.cmpop], ast.cmpop] = {
    ast.Eq: ast.NotEq(),
    ast.NotEq: ast.Eq(),
    ast.Lt: ast.GtE(),
    ast.LtE: ast.Gt(),
    ast.Gt: ast.LtE(),
    ast.GtE: ast.Lt(),
}


def _compared(left: Sum, op: ast.cmpop, holds: bool) -> list[Case]:
    """Return where a sum compares with 0 as it should."""
    if not holds:
        op = _OPPOSITE[type(op)]
    above, below = Sum(left.weights, left.constant - _STRICT), left.times(-1.0)
    strictly = Sum(below.weights, below.constant - _STRICT)
    cases: dict[type[ast.cmpop], list[Case]] = {
        ast.Eq: [(left, below)],
        ast.NotEq: [(above,), (strictly,)],
        ast.Lt: [(strictly,)],
        ast.LtE: [(below,)],
        ast.Gt: [(above,)],
        ast.GtE: [(left,)],
    }
    return [case for case in cases[type(op)] if all(each.most >= 0.0 for each in case)]


def _sum(node: ast.expr) -> Sum:
    match node:
        case ast.Constant(value=int() | float() as value):
            return Sum(np.zeros(CELLS + 1), float(value))
        case ast.Name(id=name):
            return _named(name)
        case ast.BinOp(left=left, op=ast.Add(), right=right):
            return _sum(left) + _sum(right)
        case ast.BinOp(left=left, op=ast.Sub(), right=right):
            return _sum(left) + _sum(right).times(-1.0)
        case ast.BinOp(left=left, op=ast.Mult(), right=right):
            one, other = _sum(left), _sum(right)
            if other.weights.any():
                one, other = other, one
            if other.weights.any():
                raise TooTangledError
            return one.times(other.constant)
        case ast.Call(func=ast.Name(id="mismatch"), args=[ast.Constant(value=str(text))]):
            return _mismatch(text)
        case _:
            raise TooTangledError


def _cell(down: int, east: int) -> int:
    return SIDE * (RADIUS + down) + RADIUS + east


def _of(cells: Iterator[int]) -> Sum:
    weights = np.zeros(CELLS + 1)
    weights[list(cells)] = 1.0
    return Sum(weights)


def _named(name: str) -> Sum:
    counted = {"edges": EDGES, "corners": CORNERS, "ring": EDGES + CORNERS}
    counted["u_ring"] = counted["ring"]
    if name == "ring24":
        return _of(cell for cell in range(CELLS) if cell != MIDDLE)
    if name in counted:
        return _of(_cell(*NAMES[place]) for place in counted[name])
    if name == "before":
        return _of(iter([BEFORE]))
    return _of(iter([_cell(*NAMES["c" if name == "u" else name])]))


def _mismatch(pattern: str) -> Sum:
    rows = pattern.split("/")
    radius, weights, constant = len(rows) // 2, np.zeros(CELLS + 1), 0.0
    for down, row in enumerate(rows):
        for east, sign in enumerate(row):
            black = sign in "#+"
            weights[_cell(down - radius, east - radius)] += WEIGHTS[sign] * (-1.0 if black else 1.0)
            constant += WEIGHTS[sign] if black else 0.0
    return Sum(weights, constant)
