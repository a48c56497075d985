"""Local rules as tables: the cells that one sees, as signs, and the colour it must become."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.errors import TemplateError
from cnnum.templating.boundary import parse_boundary
from cnnum.templating.checks.records import Case
from cnnum.templating.checks.registry import form_of
from cnnum.templating.checks.rules import (
    CELLS,
    SIDE,
    LinearCase,
    Neighbourhood,
    Rule,
    TooTangledError,
    both,
    cases_of,
    narrowest,
    reads_wide,
)
from cnnum.templating.template import Check, Template

Source = Literal["u", "y", "before"]

WHITE = parse_boundary(-1.0)
NINE = tuple((down, east) for down in (-1, 0, 1) for east in (-1, 0, 1))
FIVE = tuple((down, east) for down in range(-2, 3) for east in range(-2, 3))

DRAWN = 150
"""Neighbourhoods of 5×5 cells that the table of a rule begins with, before mirrors and turns."""


@dataclass(frozen=True, slots=True)
class Seen:
    """One value that a cell reads.

    Attributes
    ----------
    source : "u", "y" or "before"
        Input, output, or initial state.
    down, east : int
        Offset of the neighbour.
    """

    source: Source
    down: int = 0
    east: int = 0

    def __str__(self) -> str:
        return f"{self.source}[{self.down:+d}, {self.east:+d}]"


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """A local rule: every configuration that counts, and its colour.

    Attributes
    ----------
    seen : tuple of Seen
        The cell of each column.
    signs : (configurations, columns) float, ±1
        Free cells of an example may be gray.
    colours : (configurations,) float, ±1

    Raises
    ------
    TemplateError
        If no configuration is black, none is white, or one is both.
    """

    seen: tuple[Seen, ...]
    signs: Floats
    colours: Floats

    def __post_init__(self) -> None:
        if len(set(self.colours.tolist())) < 2:
            raise TemplateError(
                "A rule must make some cells black and others white, got one colour for all: use "
                "a template that fills the picture."
            )

    def without_idle(self) -> "Table":
        """Return the rule without columns that never decide, and without repeated rows.

        Such a column has both signs beside each configuration of the others. Where some are left
        out, a weight for it may widen the margin, although the others alone tell the colours.
        """
        table = _distinct(self)
        for column in range(len(self.seen) - 1, -1, -1):
            kept = [k for k in range(len(table.seen)) if k != column]
            fewer = Table(tuple(table.seen[k] for k in kept), table.signs[:, kept], table.colours)
            distinct = _distinct(fewer)
            if 2 * len(distinct.signs) == len(table.signs) and not _contradictions(fewer):
                table = distinct
        return table

    def refuse_contradictions(self) -> None:
        """Raise TemplateError if one configuration has both colours."""
        if wrong := _contradictions(self):
            raise TemplateError(
                f"{wrong} neighbourhoods are black in one example and white in another, so no "
                "local rule fits: use a larger neighbourhood, or correct the examples."
            )


def rule_table(
    rule: str,
    *,
    still: bool = False,
    avoid: str = "",
    name: str = "design",
    whole: bool = False,
) -> Table:
    """Return the table of a rule in the language of checks.

    Parameters
    ----------
    rule : str
        Of the input's neighbourhood and `before`; with `still`, of the outputs' and `u`.
    still : bool
        Whether the rule is applied repeatedly until nothing changes.
    avoid : str
        Another rule. Where it holds, any colour is allowed.
    name : str
        For error messages.
    whole : bool
        Whether to keep cells that have no influence.

    Raises
    ------
    TemplateError
        If the text is not a rule, holds everywhere or nowhere, or reads too many cells.
    """
    if reads_wide(rule) or reads_wide(avoid):
        raise TemplateError(
            f"The rule '{rule}' reads 5×5 cells, whose neighbourhoods are too many for a table: "
            "a single template is designed for it, by a rule that is applied once."
        )
    if "u_ring" in rule:
        raise TemplateError(
            f"The rule '{rule}' counts black input cells in the neighbourhood, but a design "
            "can read only the cell 'u' itself, apart from the outputs."
        )
    cells: Source = "y" if still else "u"
    second = Seen("u" if still else "before")
    seen = (*(Seen(cells, *place) for place in NINE), second)
    signs = np.array(list(itertools.product((-1.0, 1.0), repeat=len(seen))))
    black = signs[:, :9].reshape(-1, 3, 3) > 0.0
    other = np.broadcast_to(signs[:, 9, np.newaxis, np.newaxis] > 0.0, black.shape)
    near, own = Neighbourhood(black, WHITE), Neighbourhood(other, WHITE)
    inputs = own if still else near

    def held(text: str) -> NDArray[np.bool_]:
        return Rule(name, text)(near, other, inputs)[:, 1, 1]

    free = held(avoid) if avoid else np.zeros(len(signs), dtype=bool)
    colours = np.where(held(rule), 1.0, -1.0)
    table = Table(seen, signs[~free], colours[~free])
    return table if whole else table.without_idle()


class WideRule:
    """A rule of 5×5 cells, whose 2²⁵ neighbourhoods are drawn and searched, not listed.

    Parameters
    ----------
    rule, avoid, name : str
        As `rule_table` takes them.

    Raises
    ------
    TemplateError
        If the text is no rule, or is not made of sums of cells that are compared.
    """

    def __init__(self, rule: str, avoid: str = "", name: str = "design") -> None:
        self._rule, self._avoid = Rule(name, rule), Rule(name, avoid) if avoid else None
        before = [Seen("before")] * ("before" in rule + avoid)
        self.seen = (*(Seen("u", *place) for place in FIVE), *before)
        self._colours(np.ones((1, len(self.seen))))  # refuses names that the language lacks
        try:
            self._cases = {colour: self._cases_of(colour) for colour in (-1.0, 1.0)}
        except TooTangledError:
            raise TemplateError(
                f"The rule '{rule}' of 5×5 cells cannot be searched for its narrowest "
                "neighbourhood: write it as a few comparisons of sums, such as c and ring24 > 5."
            ) from None

    def _cases_of(self, colour: float) -> list[LinearCase]:
        cases = cases_of(self._rule, holds=colour > 0.0)
        return both(cases, cases_of(self._avoid, holds=False)) if self._avoid else cases

    def drawn(self, rng: np.random.Generator) -> Table:
        """Return the table of neighbourhoods of all densities, and their mirrors and turns.

        Others are added that each set of inequalities of the rule has, however rare it is.
        """
        share = rng.random((DRAWN, 1))
        drawn = np.where(rng.random((DRAWN, len(self.seen))) < share, 1.0, -1.0)
        rare = [self.narrowest(rng.normal(size=len(self.seen))) for _ in range(4)]
        return self.table(np.concatenate([drawn, *rare]))

    def table(self, signs: Floats) -> Table:
        """Return the table of some neighbourhoods, their mirrors and turns, each once."""
        cells = signs[:, :CELLS].reshape(-1, SIDE, SIDE)
        turned = [np.rot90(side, n, (1, 2)) for side in (cells, cells[..., ::-1]) for n in range(4)]
        images = np.concatenate([image.reshape(-1, CELLS) for image in turned])
        rows = np.unique(np.column_stack([images, np.tile(signs[:, CELLS:], (8, 1))]), axis=0)
        colours = self._colours(rows)
        return Table(self.seen, rows[colours != 0.0], colours[colours != 0.0])

    def _colours(self, signs: Floats) -> Floats:
        black = signs[:, :CELLS].reshape(-1, SIDE, SIDE) > 0.0
        state = signs[:, -1] > 0.0 if len(self.seen) > CELLS else np.zeros(len(signs), np.bool_)
        before = np.broadcast_to(state[:, np.newaxis, np.newaxis], black.shape)
        cells = Neighbourhood(black, WHITE)
        middle = SIDE // 2
        held, free = (
            np.broadcast_to(rule(cells, before, cells), black.shape)[:, middle, middle]
            if rule
            else np.zeros(len(signs), np.bool_)
            for rule in (self._rule, self._avoid)
        )
        return np.where(free, 0.0, np.where(held, 1.0, -1.0))

    def narrowest(self, values: Floats) -> Floats:
        """Return for each colour and set of inequalities the row of the smallest sum towards it.

        Parameters
        ----------
        values : (columns,) float
            Weights of what is seen.

        Returns
        -------
        (rows, columns) float, ±1
        """
        weights = np.zeros(CELLS + 1)
        weights[: len(values)] = values
        rows = [
            row
            for colour, cases in self._cases.items()
            for case in cases
            if (row := narrowest(case, colour * weights, {})) is not None
        ]
        return 2.0 * np.array(rows).reshape(-1, CELLS + 1)[:, : len(values)] - 1.0


def table_of(template: Template, *, whole: bool = False) -> Table:
    """Return the local rule of a template's check, which is its output for every neighbourhood.

    The weights of the template and the engine are not involved.

    Parameters
    ----------
    template : Template
    whole : bool
        Whether to keep all nine cells and the previous one, even if they have no influence.

    Raises
    ------
    TemplateError
        If the check does not depend on the 3×3 neighbourhood alone.
    """
    form = form_of(template)
    check = template.check
    assert check is not None
    words = dict(check.parameters)
    if form.name in ("rule", "rule-until-still"):
        still = form.name != "rule"
        avoid = str(words.get("avoid", ""))
        name = template.name
        return rule_table(str(words["rule"]), still=still, avoid=avoid, name=name, whole=whole)
    if form.name not in LOCAL:
        raise TemplateError(
            f"Template '{template.name}': the check '{form.name}' is not a local rule on 3×3 "
            f"cells; expected one of {', '.join(LOCAL)}."
        )
    signs = np.array(list(itertools.product((-1.0, 1.0), repeat=10)))
    pictures = signs[:, :9].reshape(-1, 3, 3)
    states = np.broadcast_to(signs[:, 9, np.newaxis, np.newaxis], pictures.shape)
    # the check needs black or white cells around, which the middle does not see
    plain = Template(template.name, template.A, template.B, boundary=-1.0, check=check)
    colours = form.expected(plain, Case(input=pictures, state=states))[:, 1, 1]
    seen = (*(Seen("u", *place) for place in NINE), Seen("before"))
    table = Table(seen, signs, colours)
    return table if whole else table.without_idle()


LOCAL = (
    *("edge", "erosion", "dilation", "thinning", "hit-or-miss", "neighbour-count"),
    *("logic", "shift", "rule", "rule-until-still"),
)
"""Checks that are local rules."""


def example_table(
    examples: Sequence[tuple[Floats, Floats | None, Floats]], boundary: float | str
) -> Table:
    """Return the table of the neighbourhoods of example pictures.

    Parameters
    ----------
    examples : sequence of (input, state or None, output), each (rows, cols) float
        An output of 0 is free.
    boundary : float or str
        Boundary of the pictures: a number, "zero-flux" or "periodic".

    Raises
    ------
    TemplateError
        If one neighbourhood has both colours.
    """
    edge = parse_boundary(boundary)
    rows, colours = list[Floats](), list[Floats]()
    for picture, state, output in examples:
        padded = (
            np.pad(picture, 1, constant_values=edge.constant)
            if edge.constant is not None
            else np.pad(picture, 1, mode=edge.pad_mode)
        )
        height, width = picture.shape
        columns = [padded[1 + d : 1 + d + height, 1 + e : 1 + e + width] for d, e in NINE]
        before = np.zeros_like(picture) if state is None else state
        wanted = output.ravel() != 0.0
        rows.append(np.stack([c.ravel() for c in (*columns, before)], axis=1)[wanted])
        colours.append(output.ravel()[wanted])
    seen = (*(Seen("u", *place) for place in NINE), Seen("before"))
    table = Table(seen, np.concatenate(rows), np.concatenate(colours))
    table.refuse_contradictions()
    return _distinct(table) if any(s is not None for _, s, _ in examples) else _inputs(table)


def check_of(rule: str, *, still: bool, avoid: str, state: str) -> Check:
    """Return the check of a template that follows a rule."""
    words = {"rule": rule, "avoid": avoid, "state": state}
    given = tuple((key, text) for key, text in words.items() if text)
    return Check("rule-until-still" if still else "rule", given)


def _inputs(table: Table) -> Table:
    return _distinct(Table(table.seen[:9], table.signs[:, :9], table.colours))


def _distinct(table: Table) -> Table:
    both = np.column_stack([table.signs, table.colours])
    rows = np.unique(both, axis=0)
    return Table(table.seen, rows[:, :-1], rows[:, -1])


def _contradictions(table: Table) -> int:
    both = np.unique(np.column_stack([table.signs, table.colours]), axis=0)
    return len(both) - len(np.unique(both[:, :-1], axis=0))
