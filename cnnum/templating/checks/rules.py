"""Rules of a neighbourhood in words, and the linear threshold templates that follow them.

The language of rules: a Boolean expression of a cell's black-and-white neighbourhood.

Names: the eight neighbours `nw n ne e se s sw w` and the cell `c`. The counts of black ones are
`edges`, `corners`, `ring` (all eight) and `ring24` (of the 5×5 neighbourhood). `before` is the cell
in the initial state, and `u` that in the input. `u_ring` is the count of its black neighbours
there. `match("#o#/.#./#o#")` is true where the neighbourhood is the pattern ('#' black, 'o' white,
'.' any). `mismatch` counts the cells that differ, '+' and '-' being black and white of half weight.
Operators: `and or not`, comparisons, `+ - *` and whole numbers.

Rules as linear inequalities, and the neighbourhoods that a template decides most narrowly.

Every name of the language of rules is a sum of cells, so that a rule is true where one of several
sets of linear inequalities holds. The neighbourhood of a colour that a weighted sum decides most
narrowly is then a linear program in whole numbers: of 5×5 cells there are 33 million
neighbourhoods, and no random picture shows the narrowest one.
"""

import ast
import itertools
import operator
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from cnnum.arrays import Floats, Shape
from cnnum.errors import TemplateError
from cnnum.templating.boundary import Boundary
from cnnum.templating.checks.digital.neighbourhood import SETTLED, digital_form
from cnnum.templating.checks.pictures import Bools, Held, as_picture, binary, covering, steered
from cnnum.templating.checks.records import Case, choice, has, number, text
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
            raise ValueError(
                f"a pattern is 3×3 or 5×5, with rows separated by '/', got '{pattern}'"
            )
        total = np.zeros(self.at(0, 0).shape)
        for down, row in enumerate(rows):
            for east, sign in enumerate(row):
                if sign not in WEIGHTS:
                    raise ValueError(
                        f"a pattern consists of '#', 'o', '.', '+' and '-', got '{sign}'"
                    )
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
                    raise ValueError(f"'{ast.unparse(node)}' is not part of the language of rules")

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


LinearCase = tuple[Sum, ...]
"""Sums that are all at least 0."""


def narrow_neighbourhoods(template: Template, rng: np.random.Generator) -> Bools:
    """Return 5×5 neighbourhoods that are narrowly decided, of both colours, each once.

    Parameters
    ----------
    template : Template
        A template with one input whose check is a rule on the input's neighbourhood.
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
    result = list[Floats]()
    for holds, cases in both_colours:
        sign = 1.0 if holds else -1.0
        for black in (False, True):
            fixed = {MIDDLE: black}
            narrow = [narrowest(case, sign * own, fixed) for case in cases]
            for _ in range(_OTHERS if cases else 0):
                case = cases[rng.integers(len(cases))]
                narrow.append(narrowest(case, rng.normal(size=CELLS + 1), fixed))
            result += [pattern for pattern in narrow if pattern is not None]
    if not result:
        return np.zeros((0, SIDE, SIDE), dtype=np.bool_)
    cells = np.unique(np.stack(result)[:, :CELLS], axis=0)
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


def decided(template: Template, *, holds: bool) -> list[LinearCase]:
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


def cases_of(rule: Rule, *, holds: bool) -> list[LinearCase]:
    """Return the sets of inequalities of which one is true where a rule holds, or where it fails.

    The rule is one of the input's neighbourhood: `u` is then the cell itself.

    Raises
    ------
    TooTangledError
        If there are too many, or the rule multiplies cells with each other.
    """
    return _cases(rule.tree, holds)


def both(first: list[LinearCase], second: list[LinearCase]) -> list[LinearCase]:
    """Return the sets of inequalities that are true where both are, without impossible ones."""
    if len(first) * len(second) > _MOST:
        raise TooTangledError
    joined = (this + other for this, other in itertools.product(first, second))
    return [case for case in joined if all(term.most >= 0.0 for term in case)]


def narrowest(case: LinearCase, weights: Floats, fixed: dict[int, bool]) -> Floats | None:
    """Return the neighbourhood of a case with the smallest weighted sum, None if there is none.

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
        LinearConstraint(np.stack([term.weights for term in case]), [-s.constant for s in case])
    ]
    result = milp(
        weights,
        integrality=np.ones(CELLS + 1, dtype=np.int64),
        bounds=Bounds(low, high),
        constraints=held if case else (),
        options={"mip_rel_gap": 0.0},  # the default leaves 1e-4
    )
    return None if result.x is None else np.asarray(np.rint(result.x), dtype=np.float64)


def _cases(node: ast.expr, holds: bool) -> list[LinearCase]:
    match node:
        case ast.BoolOp(op=op, values=parts):
            result = [_cases(part, holds) for part in parts]
            if isinstance(op, ast.And) != holds:
                return list(itertools.chain.from_iterable(result))
            joined: list[LinearCase] = [()]
            for case in result:
                joined = both(joined, case)
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


def _compared(left: Sum, op: ast.cmpop, holds: bool) -> list[LinearCase]:
    """Return where a sum compares with 0 as it should."""
    if not holds:
        op = _OPPOSITE[type(op)]
    above, below = Sum(left.weights, left.constant - _STRICT), left.times(-1.0)
    strictly = Sum(below.weights, below.constant - _STRICT)
    cases: dict[type[ast.cmpop], list[LinearCase]] = {
        ast.Eq: [(left, below)],
        ast.NotEq: [(above,), (strictly,)],
        ast.Lt: [(strictly,)],
        ast.LtE: [(below,)],
        ast.Gt: [(above,)],
        ast.GtE: [(left,)],
    }
    return [case for case in cases[type(op)] if all(term.most >= 0.0 for term in case)]


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
            this, other = _sum(left), _sum(right)
            if other.weights.any():
                this, other = other, this
            if other.weights.any():
                raise TooTangledError
            return this.times(other.constant)
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


_TAKES = ("state", "white", "avoid", "pictures")
_EIGHT = ndimage.generate_binary_structure(2, 2)


def rectangles(rng: np.random.Generator, shape: Shape) -> Floats:
    """Return pictures of black rectangles at least two cells apart, many of them at the frame.

    The first picture is empty, and the second one a single rectangle, as large as the array has
    room for without its rim: what takes small things away leaves some of it.
    """
    pictures = np.zeros((12, *shape), dtype=np.bool_)
    pictures[(1, *(slice(1, -1) if n > 2 else slice(None) for n in shape))] = True
    for black in pictures[2:]:
        for _ in range(rng.integers(2, 9)):
            # Single cells up to squares that outlast a template which removes small things.
            height, width = (int(rng.integers(1, max(n - 1, 2))) for n in shape)
            top, left = (int(rng.integers(0, n)) for n in shape)
            block = np.zeros(shape, dtype=np.bool_)
            block[top : top + height, left : left + width] = True
            near = ndimage.binary_dilation(block, _EIGHT, iterations=2)
            if not (near & black).any():
                black |= block
    return as_picture(pictures)


_PICTURES = {"any": binary, "rectangles": rectangles}


def _draw(template: Template, rng: np.random.Generator, shape: Shape) -> Floats:
    drawn = choice(template, "pictures", _PICTURES) if has(template, "pictures") else binary
    return drawn(rng, shape)


def _states(
    template: Template, black: Bools, other: Bools, rng: np.random.Generator
) -> Floats | None:
    """Return initial states: none where the template has its own, another picture, or a part.

    "other" is unrelated to the input, and "part" is a part of its black cells. "outside" is black
    cells that the input leaves white, "changed" the input with a few black cells turned white.
    """
    if not has(template, "state"):
        return None
    kinds: Mapping[str, Bools] = {
        "other": other,
        "part": black & (rng.random(black.shape) < 0.6),
        "outside": ~black & other,
        "changed": black & (rng.random(black.shape) < 0.95),
    }
    return as_picture(choice(template, "state", kinds))


def _avoided(template: Template) -> Held | None:
    """Return what says where a template stands on the fence, None if it never does."""
    if not has(template, "avoid"):
        return None
    rule = Rule(template.name, text(template, "avoid"))

    def held(black: Bools) -> Bools:
        seen = Neighbourhood(black, template.input_boundary)
        return rule(seen, black, seen)

    return held


def _wave_case(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    """Draw pictures of several kinds for a rule that hands something on from cell to cell."""
    black = steered(rng, as_black(_draw(template, rng, shape)), _avoided(template))
    state = _states(template, black, rng.permutation(black), rng)
    white = number(template, "white") if has(template, "white") else -1.0
    return Case(input=np.where(black, 1.0, white), state=state)


def _local_case(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    """Draw every neighbourhood of 3×3 cells, under both states; of 5×5 the narrowest ones."""
    if is_wide(template):
        black = steered(rng, as_black(_draw(template, rng, shape)), _avoided(template))
        black = np.concatenate([black, _planted(template, rng, shape)])
    else:
        avoided = _avoided(template)
        black = as_black(covering(rng, shape, template.input_boundary, avoided))
    if not has(template, "state"):
        return Case(input=as_picture(black))
    other = rng.random(black.shape) < 0.5
    twice, others = np.concatenate([black, black]), np.concatenate([other, ~other])
    return Case(input=as_picture(twice), state=_states(template, twice, others, rng))


def _planted(template: Template, rng: np.random.Generator, shape: Shape) -> Bools:
    """Return pictures with a narrow decision each, of either colour, in the middle.

    Of each colour there are those that the template itself decides most narrowly, and those that
    random weights do. An array that holds no 5×5 cells, or a rule that is too tangled, has none.
    """
    if min(shape) < SIDE or template.inputs != 1:
        return np.zeros((0, *shape), dtype=np.bool_)
    narrow = narrow_neighbourhoods(template, rng)
    top, left = (shape[0] - SIDE) // 2, (shape[1] - SIDE) // 2
    at = np.s_[:, top : top + SIDE, left : left + SIDE]
    black, fixed = np.zeros((2, len(narrow), *shape), dtype=np.bool_)
    black[at], fixed[at] = narrow, True
    crowded = black | ((rng.random(black.shape) < 0.4) & ~fixed)
    avoided = _avoided(template)
    pictures = np.concatenate(
        [steered(rng, picture, avoided, fixed) for picture in (black, crowded)]
    )
    return pictures[np.any(pictures, axis=(-2, -1))]


def _once(template: Template, case: Case) -> Floats:
    rule = Rule(template.name, text(template, "rule"))
    inputs = Neighbourhood(as_black(case.pictures), template.input_boundary)
    before = inputs.at(0, 0) if case.state is None else as_black(case.state)
    return as_picture(rule(inputs, before, inputs))


def until_still(
    rule: Rule, start: NDArray[np.bool_], inputs: Neighbourhood, template: Template
) -> NDArray[np.bool_]:
    """Return cells to which a rule was applied, to all at once, until none changed.

    Raises
    ------
    RuntimeError
        If they never come to rest.
    """
    cells = start
    for _ in range(start.size + 1):
        following = rule(Neighbourhood(cells, template.boundary), start, inputs)
        if (following == cells).all():
            return cells
        cells = following
    raise RuntimeError(f"The rule '{rule.text}' never comes to rest.")


def _still(template: Template, case: Case) -> Floats:
    rule = Rule(template.name, text(template, "rule"))
    inputs = Neighbourhood(as_black(case.pictures), template.input_boundary)
    start = np.asarray(case.start(template), dtype=np.float64)
    black = np.broadcast_to(as_black(start), case.pictures.shape)
    return as_picture(until_still(rule, black, inputs, template))


FORMS = (
    digital_form(
        "rule",
        _local_case,
        _once,
        "cells whose neighbourhood in the input obeys a rule",
        needs=("rule",),
        takes=_TAKES,
    ),
    digital_form(
        "rule-until-still",
        _wave_case,
        _still,
        "a rule applied to the state again and again until nothing changes",
        needs=("rule",),
        takes=_TAKES,
        reason=SETTLED,
    ),
)
