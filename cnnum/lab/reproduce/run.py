"""Run items: each gives one row, and none stops the others."""

from collections.abc import Iterable, Iterator

from cnnum.errors import MissingExtraError
from cnnum.lab.reproduce.record import Item, Row, not_run


def run(items: Iterable[Item]) -> Iterator[Row]:
    """Compute items one after the other.

    Parameters
    ----------
    items : iterable of Item

    Yields
    ------
    Row
        One an item; where an optional package is missing, a row that says so.
    """
    for item in items:
        try:
            yield run_item(item)
        except MissingExtraError as missing:
            yield not_run(item, str(missing))


def run_item(item: Item) -> Row:
    """Return the row of an item.

    Raises
    ------
    MissingExtraError
        If it needs a package that is not installed.
    """
    got = float(item.compute())
    error = item.error(got)
    passed = error <= item.tolerance if item.kind == "check" else None
    return Row(item, got, error, passed, item.printed() if item.printed else None)
