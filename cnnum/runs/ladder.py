"""The ways to take a run, as records in an order: the first that fits takes it.

A way takes the run by itself, or asks the ways below for runs that are simpler: of other maps, for
another time, in other steps. Nothing calls up. `Result.ways` names those that had a part in it.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from cnnum.integrators.choice import check_spec
from cnnum.runs.arguments import maps_by_role
from cnnum.runs.batches import as_batch
from cnnum.runs.chip import on_chip
from cnnum.runs.delays import halves, in_halves
from cnnum.runs.growth import followed, follows
from cnnum.runs.prepared import as_prepared, is_prepared
from cnnum.runs.request import Ask, Request
from cnnum.runs.result import ROLES, Result, with_proof
from cnnum.runs.settling import to_rest
from cnnum.runs.single import by_implicit_steps, linearly, may_be_stiff, plainly
from cnnum.runs.times import at_times
from cnnum.runs.wavefront import skips, without_way
from cnnum.templating.batch import TemplateBatch

Down = Callable[[Any], Result]
"""Takes a run by the ways below."""


@dataclass(frozen=True, slots=True)
class Way:
    """A way to take a run.

    Attributes
    ----------
    name : str
    reason : str
        Why it is taken where it fits.
    fits : callable
        Whether it takes an `Ask`, or a `Request` below "checked".
    run : callable
        Takes that and the ways below it, and returns the result.
    """

    name: str
    reason: str
    fits: Callable[[Any], bool]
    run: Callable[[Any, Down], Result]


def _checked(ask: Ask, down: Down) -> Result:
    """Run maps that are checked first; the result keeps copies of them for its proof."""
    given, shape = maps_by_role(ask.template, dict(zip(ROLES, ask.arrays, strict=True)))
    spec = ask.spec
    check_spec(spec)
    result = down(Request(ask.engine, ask.template, given, shape, spec, ask.form, ask.ready))
    if ask.engine.whole or result.proof is not None:
        return result
    kept = {role: np.array(maps) for role, maps in given.items()}
    return with_proof(result, ask.template, kept, ask.duration, (spec.rtol, spec.atol))


LADDER = (
    Way("chip", "an analogue array stores and reads coarsely what another run computes",
        lambda ask: ask.chip is not None, on_chip),
    Way("batch", "templates of a batch run side by side, or one by one",
        lambda ask: isinstance(ask.template, TemplateBatch), as_batch),
    Way("times", "a run is looked at on its way, or taken to each time",
        lambda ask: ask.at is not None, at_times),
    Way("prepared", "a run that differs in its numbers alone was taken before",
        is_prepared, as_prepared),
    Way("checked", "arrays are looked at before they run", lambda ask: True, _checked),
    Way("wavefront", "the order of events cannot change where a monotone array ends",
        skips, without_way),
    Way("compared", "a state that grows far needs a finer run to know its error",
        follows, followed),
    Way("settling", "a run to equilibrium goes on until it is shown to rest",
        lambda request: request.settles, to_rest),
    Way("halved", "steps with a delay are halved until two runs agree", halves, in_halves),
    Way("implicit", "where explicit steps do not reach the end, implicit ones may",
        may_be_stiff, by_implicit_steps),
    Way("linear", "no cell leaves the linear range, so that the array is linear",
        lambda request: request.linear, linearly),
    Way("plain", "a plan runs as it is", lambda request: True, plainly),
)  # fmt: skip
"""In their order: the first that fits is taken."""


class _Below:
    """The ways from a place on, and the last result that they gave."""

    __slots__ = ("_first", "last")

    def __init__(self, first: int) -> None:
        self._first = first
        self.last: Result | None = None

    def __call__(self, ask: Ask | Request) -> Result:
        self.last = run(ask, self._first)
        return self.last


def run(ask: Ask | Request, first: int = 0) -> Result:
    """Take a run by the first way that fits, from one on.

    Parameters
    ----------
    ask : Ask or Request
    first : int
        Place of the first way that is tried.
    """
    place = first
    while not LADDER[place].fits(ask):
        place += 1
    way, below = LADDER[place], _Below(place + 1)
    result = way.run(ask, below)
    if result is not below.last:
        object.__setattr__(result, "ways", (way.name, *result.ways))
    return result
