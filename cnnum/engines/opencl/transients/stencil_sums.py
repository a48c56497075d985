"""Weighted sums with one product for all neighbours whose weights are equal.

Neighbours of a column are added first: the cells left and right of it want that sum, too, with the
same weight or another. Compilers then find it once.
"""

from collections.abc import Callable, Iterable
from itertools import groupby

from cnnum import kernels as ir
from cnnum.templating.network import Tap


def shared_products(found: Iterable[Tap], least: int = 2) -> list[tuple[Tap, ...]]:
    """Return the taps in groups whose weights are equal but for their signs, column by column.

    Parameters
    ----------
    found : iterable of Tap
    least : int
        Taps of a group; fewer stay alone.
    """
    equal: dict[float, list[Tap]] = {}
    for tap in found:
        equal.setdefault(abs(tap.weight), []).append(tap)
    groups: list[tuple[Tap, ...]] = []
    for group in equal.values():
        many = len(group) >= least
        groups += [tuple(sorted(group, key=_column))] if many else [(tap,) for tap in group]
    return groups


def shares_products(found: Iterable[Tap]) -> bool:
    """Return whether any two weights are equal but for their signs."""
    return any(len(group) > 1 for group in shared_products(found))


def weighted_terms(
    found: Iterable[Tap],
    number: Callable[[float], ir.Expression],
    value: Callable[[Tap], ir.Expression],
    least: int = 2,
) -> list[ir.Expression]:
    """Return the terms of Σ weight · value, one a group of equal weights.

    Parameters
    ----------
    found : iterable of Tap
    number : callable
        The literal of a weight.
    value : callable
        The expression of the value at a tap.
    least : int
        Taps of a group; fewer stay alone.
    """
    return [_term(group, number, value) for group in shared_products(found, least)]


def _column(tap: Tap) -> tuple[int, int, int]:
    return tap.source, tap.col, tap.row


def _term(
    group: tuple[Tap, ...],
    number: Callable[[float], ir.Expression],
    value: Callable[[Tap], ir.Expression],
) -> ir.Expression:
    weight, total = group[0].weight, None
    for _, column in groupby(group, key=lambda tap: (tap.source, tap.col)):
        first, *others = column
        # within a column the first is added, so that the sum is the same wherever it is wanted
        inner = value(first)
        for tap in others:
            inner = _added(inner, value(tap), tap.weight == first.weight)
        total = inner if total is None else _added(total, inner, first.weight == weight)
    assert total is not None
    return number(weight) * total


def _added(total: ir.Expression, value: ir.Expression, same: bool) -> ir.Expression:
    return total + value if same else total - value
