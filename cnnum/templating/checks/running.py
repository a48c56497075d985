"""An engine as a check uses it, and the run of a case on one."""

from typing import Protocol

from numpy.typing import ArrayLike

from cnnum.arrays import Floats
from cnnum.integrators.schemes import WAVEFRONT
from cnnum.templating.batch import TemplateBatch
from cnnum.templating.checks.records import Case
from cnnum.templating.template import Duration, Template


class Result(Protocol):
    """A run as a check reads it."""

    @property
    def output(self) -> ArrayLike:
        """Outputs of the cells."""
        ...

    @property
    def state(self) -> ArrayLike:
        """States of the cells."""
        ...

    @property
    def time(self) -> ArrayLike:
        """Time constants that each picture took."""
        ...

    @property
    def method(self) -> str:
        """Integration method used."""
        ...

    @property
    def reason(self) -> str:
        """Why this method."""
        ...


class Engine(Protocol):
    """An engine as a check uses it."""

    @property
    def name(self) -> str:
        """As users call it."""
        ...

    @property
    def precision(self) -> str:
        """Of the arithmetic: "float32" or "float64"."""
        ...

    def run(
        self,
        template: Template | TemplateBatch,
        *,
        input: Floats | None = None,
        previous: Floats | None = None,
        state: Floats | None = None,
        bias: Floats | None = None,
        mask: Floats | None = None,
        duration: Duration | None = None,
        method: str = "auto",
        rtol: float = 1e-4,
        atol: float = 1e-5,
    ) -> Result:
        """Run a template, or many at once."""
        ...


WAY = "dormand-prince"
"""The method of runs whose end would be found without the way there."""


def run_way(
    template: Template | TemplateBatch,
    engine: Engine,
    case: Case,
    rtol: float,
    method: str = "auto",
) -> Result:
    """Run templates on a case by their transient, even where `auto` finds its end without it."""
    result = run_case(template, engine, case, rtol, method)
    if result.method != WAVEFRONT or method != "auto":
        return result
    return run_case(template, engine, case, rtol, WAY)


def run_case(
    template: Template | TemplateBatch,
    engine: Engine,
    case: Case,
    rtol: float,
    method: str = "auto",
) -> Result:
    """Run templates on a case, with a tenth of the relative tolerance as the absolute one."""
    return engine.run(
        template,
        **case.given,
        method=method,
        rtol=rtol,
        atol=0.1 * rtol,
    )
