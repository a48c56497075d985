"""Weights by CMA-ES (extra `search`): the fewest flips under mismatch, in many lanes at once.

A form says which weights there are, and which are equal: its zeros stay zeros (locality), and
equal numbers of one matrix stay equal (symmetry). Nothing else of its numbers is used. Restarts
run side by side: a generation of all of them is one launch.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from typing import Any

import numpy as np

from cnnum.arrays import Floats
from cnnum.errors import TemplateError, missing_extra
from cnnum.templating.checks.robustness import Judge, flips, mismatched
from cnnum.templating.checks.running import Engine
from cnnum.templating.numbers import weights_of, with_numbers
from cnnum.templating.template import Duration, Template

LONGEST = 60.0
"""Time constants of a run while weights are looked for: no run waits for oscillations."""

SPREAD = 1.0
"""First standard deviation of a weight."""

CONFIRMED = 100
"""Draws on which templates that flip nowhere are tried again."""

Group = tuple[str, tuple[tuple[int, ...], ...]]
"""A matrix, and the places of its weights that are equal."""


@dataclass(frozen=True, slots=True)
class Search:
    """Goal and limits of a search.

    Attributes
    ----------
    form : Template
        Provides the pattern of weights, everything other than weights, and the check.
    mismatch : float
    draws : int
        Number of draws of the mismatch, which are the same for all candidates.
    population, generations, restarts : int
        Restarts run side by side, each with a population of its own. The first template that flips
        nowhere, not on 100 more draws either, ends the search.
    seed : int
    """

    form: Template
    mismatch: float = 0.05
    draws: int = 12
    population: int = 16
    generations: int = 25
    restarts: int = 3
    seed: int = 0


@dataclass(frozen=True, slots=True)
class Advance:
    """How far a long design has come.

    Attributes
    ----------
    done : int
    of : int or None
        None where it is not known.
    step : str
        Name of what is counted.
    best : float
        Of the best so far.
    figure : str
        Name of that.
    """

    done: int
    of: int | None
    step: str
    best: float
    figure: str

    def __str__(self) -> str:
        limit = "" if self.of is None else f" of {self.of}"
        return f"{self.step} {self.done}{limit}, {self.figure} {self.best:.3g}"


Watch = Callable[[Advance], bool]
"""Is given an advance, and returns whether the work goes on."""


def go_on(_: Advance) -> bool:
    """Let work go on to its end."""
    return True


@dataclass(frozen=True, slots=True)
class Found:
    """The best template of a search.

    Attributes
    ----------
    template : Template
    loss : float
        Share of draws with a wrong cell, and the share of wrong cells. Of templates that flip on
        the further draws alone, those over the number of first ones.
    evaluations : int
        Number of templates that were run.
    """

    template: Template
    loss: float
    evaluations: int


def groups_of(form: Template) -> tuple[Group, ...]:
    """Return the free weights of a form, grouped if equal; z is free if it is not 0."""
    result, weights = list[Group](), weights_of(form)
    for part in sorted(weights):
        array = weights[part]
        equal = dict[float, list[tuple[int, ...]]]()
        for place in np.argwhere(array != 0.0).tolist():
            equal.setdefault(float(array[tuple(place)]), []).append(tuple(place))
        result += [(part, tuple(equal[value])) for value in sorted(equal)]
    return tuple(result)


def with_weights(form: Template, groups: Sequence[Group], weights: Floats) -> Template:
    """Return a form with other weights."""
    parts = {part: array.copy() for part, array in weights_of(form).items()}
    for (part, places), weight in zip(groups, weights, strict=True):
        for place in places:
            parts[part][place] = weight
    return with_numbers(form, parts)


def search(wanted: Search, engine: Engine, watch: Watch = go_on) -> Found:
    """Return the best template that CMA-ES finds from a start that knows no weights.

    The own feedback starts at 2, other weights at 0. `watch` is given each generation.

    Raises
    ------
    MissingExtraError
        If cma is not installed.
    TemplateError
        If the form has no weights.
    """
    cma = _library()
    groups = groups_of(wanted.form)
    if not groups:
        raise TemplateError(f"A search needs a form with weights, got '{wanted.form.name}'.")
    limit: Duration = LONGEST if wanted.form.duration == "settle" else wanted.form.duration
    judge = Judge(replace(wanted.form, duration=limit), engine)
    start = [_start(wanted.form, group) for group in groups]
    strategies = list[Any]()
    for restart in range(wanted.restarts):
        options = {"seed": wanted.seed + restart + 1, "popsize": wanted.population, "verbose": -9}
        strategies.append(cma.CMAEvolutionStrategy(start, SPREAD, options))
    best, evaluations = Found(wanted.form, math.inf, 0), 0
    for generation in range(1, wanted.generations + 1):
        proposals = [strategy.ask() for strategy in strategies]
        flat = [np.asarray(x) for points in proposals for x in points]
        made = [with_weights(judge.template, groups, x) for x in flat]
        losses = _losses(wanted, judge, made)
        evaluations += len(made) * (wanted.draws + 1)
        if sound := [n for n, loss in enumerate(losses) if loss == 0.0]:
            more = replace(wanted, draws=CONFIRMED, seed=wanted.seed + 1)
            for n, loss in zip(sound, _losses(more, judge, [made[n] for n in sound]), strict=True):
                losses[n] = loss / (wanted.draws + 1)  # less than that of a single flip
            evaluations += len(sound) * (CONFIRMED + 1)
        for number, (strategy, points) in enumerate(zip(strategies, proposals, strict=True)):
            first = number * wanted.population
            strategy.tell(points, losses[first : first + wanted.population])
        least = int(np.argmin(losses))
        if losses[least] < best.loss:
            best = Found(with_weights(wanted.form, groups, flat[least]), losses[least], 0)
        advance = Advance(generation, wanted.generations, "generation", best.loss, "best loss")
        if best.loss == 0.0 or not watch(advance):
            break
    return replace(best, evaluations=evaluations)


def compared(
    form: Template, template: Template, engine: Engine, *, mismatch: float, draws: int
) -> tuple[float, float]:
    """Return the flip rates of two templates under the same draws that no search has seen."""
    rates = [
        flips(candidate, engine, seed=12345, mismatches=(mismatch,), bits=(), draws=draws)[
            0
        ].flipped
        for candidate in (form, template)
    ]
    return rates[0], rates[1]


def _losses(wanted: Search, judge: Judge, made: Sequence[Template]) -> list[float]:
    """Return for each template how often it flips, and by how much; itself is drawn too."""
    drawn = list[Template]()
    for template in made:
        rng = np.random.default_rng(wanted.seed)
        drawn.append(template)
        drawn += [mismatched(template, rng, wanted.mismatch) for _ in range(wanted.draws)]
    shares = np.array(judge.shares(drawn)).reshape(len(made), -1)
    shares = np.where(np.isnan(shares), 1.0, shares)  # what no method runs is no design
    losses = (shares > 0.0).mean(axis=1) + shares.mean(axis=1)
    return [float(loss) for loss in losses]


def _start(form: Template, group: Group) -> float:
    part, places = group
    middle = form.A.shape[-1] // 2
    own = {(layer, layer, middle, middle) for layer in range(form.layers)}
    return 2.0 if part == "A" and own & set(places) else 0.0


def _library() -> Any:
    try:
        return import_module("cma")
    except ImportError:
        raise missing_extra("a search", "cma", "search") from None
