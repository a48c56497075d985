"""Several fields at once: their sum, mean and length, and the largest of some."""

from collections.abc import Iterable, Sequence
from functools import reduce
from operator import add

from cnnum.programs.fields import Field, sqrt, square, where


def total(fields: Iterable[Field]) -> Field:
    """Return the sum of one field or more."""
    return reduce(add, fields)


def mean(fields: Sequence[Field]) -> Field:
    """Return the mean of one field or more."""
    return total(fields) / len(fields)


def length(fields: Iterable[Field]) -> Field:
    """Return the root of the sum of the squares: the length of a vector of one field an axis."""
    return sqrt(total(map(square, fields)))


def most(rows: Sequence[Sequence[Field]]) -> Sequence[Field]:
    """Return the row whose first number is the largest; of equal ones the first."""
    best = rows[0]
    for row in rows[1:]:
        best = [where(row[0] > best[0], new, old) for new, old in zip(row, best, strict=True)]
    return best
