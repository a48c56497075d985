"""All items and figures, chapter by chapter. A new part is one file and one line here."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from difflib import get_close_matches

from cnnum.errors import MissingExtraError, name_error
from cnnum.lab.reproduce.chapters import (
    bumps,
    capacitive,
    errata,
    error_budget,
    fields,
    flat_models,
    hair,
    heat,
    hyperacuity,
    inverse,
    pads,
    receptive,
    receptor_rows,
    ridge,
    silicon,
    skin,
    texture_rows,
    thick_rubber,
)
from cnnum.lab.reproduce.figure import Figure
from cnnum.lab.reproduce.record import Chapter, Item, Row, not_run

CHAPTERS: tuple[Chapter, ...] = (
    skin.CHAPTER,
    receptor_rows.CHAPTER,
    capacitive.CHAPTER,
    silicon.CHAPTER,
    heat.CHAPTER,
    fields.CHAPTER,
    receptive.CHAPTER,
    thick_rubber.CHAPTER,
    flat_models.CHAPTER,
    inverse.CHAPTER,
    hyperacuity.CHAPTER,
    error_budget.CHAPTER,
    hair.CHAPTER,
    ridge.CHAPTER,
    bumps.CHAPTER,
    pads.CHAPTER,
    bumps.FINGER_CHAPTER,
    texture_rows.CHAPTER,
    errata.CHAPTER,
)
"""In the order of the dissertation."""


def item_names() -> tuple[str, ...]:
    """Return the names of all items."""
    return tuple(item.name for chapter in CHAPTERS for item in chapter.items)


def beginnings() -> tuple[str, ...]:
    """Return the beginnings of names: kinds and chapters, "fig-4"."""
    return tuple(dict.fromkeys(name.split(".")[0] for name in item_names()))


def figure_makers() -> dict[str, Callable[[], Figure]]:
    """Return the maker of each figure, by name."""
    return {name: make for chapter in CHAPTERS for name, make in chapter.figures.items()}


def select(wanted: Sequence[str]) -> tuple[Item, ...]:
    """Return the items of some names, or all.

    Parameters
    ----------
    wanted : sequence of str
        Names of items, beginnings of them, or a figure that shows them: "fig-4.5" is all of
        Fig. 4.5; case does not count. None for all.

    Raises
    ------
    UnknownNameError
        If a name is that of no figure, and the beginning of no item.
    """
    items = [item for chapter in CHAPTERS for item in chapter.items]
    if not wanted:
        return tuple(items)
    for name in wanted:
        if not any(_begins(item, name) for item in items):
            near = get_close_matches(name, (*item_names(), *figure_makers()), n=5)
            raise name_error("item", name, near or beginnings())
    return tuple(item for item in items if any(_begins(item, name) for name in wanted))


def _begins(item: Item, name: str) -> bool:
    """Return whether an item is one of those that a name stands for."""
    whole, start = item.name.casefold(), name.casefold()
    if start == item.figure:
        return True
    ends_a_part = whole == start or not (whole + "-")[len(start) : len(start) + 1].isalnum()
    return whole.startswith(start) and ends_a_part


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
