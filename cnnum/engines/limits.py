"""Features that an engine lacks, and why: one table, read by the engines and the tests."""

from collections.abc import Callable
from dataclasses import dataclass

from cnnum.errors import NotSupportedError
from cnnum.graph.nodes import Transient
from cnnum.graph.schedule import Schedule
from cnnum.integrators.choice import Solver
from cnnum.integrators.solver import Solvers


@dataclass(frozen=True, slots=True)
class Limit:
    """Something that an engine does not do.

    Attributes
    ----------
    engine : str
    what, why : str
    applies : callable
        Whether a transient and its solver ask for it.
    """

    engine: str
    what: str
    why: str
    applies: Callable[[Transient, Solver], bool]


LIMITS: tuple[Limit, ...] = ()
"""Every engine runs every template by every method."""


def refuse_beyond(engine: str, schedule: Schedule, solvers: Solvers) -> None:
    """Raise if a schedule asks for something that the engine does not do.

    Raises
    ------
    NotSupportedError
        With the reason.
    """
    for node in schedule.transients:
        assert isinstance(node.operation, Transient)
        solver = solvers[node.index]
        for limit in LIMITS:
            if limit.engine == engine and limit.applies(node.operation, solver):
                raise NotSupportedError(
                    f"The {engine} engine does not do {limit.what} ('{solver.method}' for "
                    f"'{node.operation}'): {limit.why}; use another engine."
                )
