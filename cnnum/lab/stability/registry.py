"""All cases, by family."""

from collections.abc import Sequence
from functools import cache

from cnnum.errors import name_error
from cnnum.lab.stability.cases import closed_forms, extreme, marginal, precision, programs, stiff
from cnnum.lab.stability.record import Case

ROOMS = (stiff, marginal, extreme, precision, programs, closed_forms)


@cache
def all_cases() -> tuple[Case, ...]:
    """Return every case of the suite."""
    return tuple(case for room in ROOMS for case in room.cases())


def by_name(name: str) -> Case:
    """Return a case."""
    return next(case for case in all_cases() if case.name == name)


def select(names: Sequence[str]) -> tuple[Case, ...]:
    """Return the cases whose name begins with one of these, or of that family; all without any.

    Raises
    ------
    UnknownNameError
        If a name is the beginning of none.
    """
    for name in names:
        if not any(_meant(case, name) for case in all_cases()):
            families = dict.fromkeys(case.family for case in all_cases())
            raise name_error("case", name, [*families, *(case.name for case in all_cases())])
    return tuple(
        case for case in all_cases() if not names or any(_meant(case, name) for name in names)
    )


def _meant(case: Case, name: str) -> bool:
    return case.name.startswith(name) or case.family == name
