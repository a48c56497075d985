"""Rules that no plane separates, as a sequence of templates on the same input.

Each template starts from the picture of the one before, and either overrules it or keeps it: a
decision list of planes (Rivest 1987; Marchand & Golea 1993). The last one is found first: a plane
with cells of one colour alone beyond it. The rest is left to those before.
"""

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.design.linear_program import Conflict, Weights, equalities, separate
from cnnum.design.local_rules import Seen, Table
from cnnum.errors import TemplateError

MOST = 12
"""Templates of a sequence; a longer one says that the rule is none for this machine."""

BEYOND = 1e-6


def sequence(table: Table) -> tuple[tuple[Weights, Table], ...]:
    """Return the weights of templates that together obey a rule, in their order.

    The number of templates is not proved to be the least.

    Parameters
    ----------
    table : Table
        Of the input alone.

    Raises
    ------
    TemplateError
        If the rule reads more than the input, or takes more than twelve templates.
    """
    if any(seen.source != "u" for seen in table.seen):
        raise TemplateError(
            "A rule of the outputs or of the state before cannot be split: its templates would "
            "need the state to carry their results; write it as rules of the input."
        )
    # a rule that a turn leaves as it is may need planes that it does not
    ways = [way for even in (True, False) if (way := _peeled(table, symmetric=even)) is not None]
    if not ways:
        raise TemplateError(
            f"The rule takes more than {MOST} templates: look for steps of it by hand."
        )
    return min(ways, key=len)


def _peeled(table: Table, *, symmetric: bool) -> tuple[tuple[Weights, Table], ...] | None:
    found = list[tuple[Weights, Table]]()
    left = table
    while isinstance(weights := separate(left, symmetric=symmetric), Conflict):
        if len(found) == MOST - 1:
            return None
        step, left = _last(left, symmetric=symmetric)
        last = separate(step, symmetric=symmetric)
        assert isinstance(last, Weights)
        found.append((last, step))
    return ((weights, left), *reversed(found))


def answers(steps: tuple[tuple[Weights, Table], ...], table: Table) -> Floats:
    """Return the colours that a sequence gives to every configuration of a rule."""
    first, *others = steps
    colours = np.sign(first[0].sums(table))
    for weights, _ in others:
        carried = Table(
            (*table.seen, BEFORE), np.column_stack([table.signs, colours]), table.colours
        )
        colours = np.sign(weights.sums(carried))
    return np.asarray(colours, dtype=np.float64)


BEFORE = Seen("before")


def _last(table: Table, *, symmetric: bool) -> tuple[Table, Table]:
    """Return the rule of the last template, and the rest for those before it."""
    beyond = max(
        (_one_sided(table, colour, symmetric=symmetric) for colour in (-1.0, 1.0)),
        key=lambda cut: int(cut.sum()),
    )
    rest = Table(table.seen, table.signs[~beyond], table.colours[~beyond])
    # a cell beyond the plane has its colour, black or white before
    signs = np.vstack([table.signs[beyond], table.signs[beyond], rest.signs])
    count = int(beyond.sum())
    before = np.concatenate([np.ones(count), -np.ones(count), rest.colours])
    colours = np.concatenate([table.colours[beyond], table.colours[beyond], rest.colours])
    return Table((*table.seen, BEFORE), np.column_stack([signs, before]), colours), rest


def _one_sided(table: Table, colour: float, *, symmetric: bool) -> NDArray[np.bool_]:
    """Return the configurations of one colour that a plane cuts off from all of the other."""
    from scipy.optimize import linprog

    rows = np.column_stack([table.signs, np.ones(len(table.signs))])
    own, other = rows[table.colours == colour], rows[table.colours != colour]
    count, columns = own.shape
    equal = equalities(table, columns)[::2, :columns] if symmetric else np.zeros((0, columns))
    found = linprog(
        np.concatenate([np.zeros(columns), np.ones(count)]),
        A_ub=np.vstack(
            [
                np.column_stack([-own, -np.eye(count)]),
                np.column_stack([other, np.zeros((len(other), count))]),
            ]
        ),
        b_ub=-np.ones(count + len(other)),
        A_eq=np.column_stack([equal, np.zeros((len(equal), count))]) if len(equal) else None,
        b_eq=np.zeros(len(equal)) if len(equal) else None,
        bounds=[(None, None)] * columns + [(0.0, None)] * count,
        method="highs",
    )
    sums = rows @ np.asarray(found.x)[:columns]
    cut = sums > sums[table.colours != colour].max() + BEYOND
    return cut if cut.any() else _corner(table, colour)


def _corner(table: Table, colour: float) -> NDArray[np.bool_]:
    """Return one configuration of a colour: a corner of the cube, which a plane always cuts off."""
    cut = np.zeros(len(table.signs), dtype=bool)
    cut[np.flatnonzero(table.colours == colour)[0]] = True
    return cut
