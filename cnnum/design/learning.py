"""Weights from labelled pictures, by gradients: L-BFGS over the adjoint of a run.

The form gives the pattern of weights as it does for a search: zeros stay zeros, and equal numbers
of a matrix stay equal. Nothing else of its numbers is used, but by the first start if asked.

A cell that rests beyond ±1 has no slope. So every second start goes down with tanh first.
"""

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import minimize

from cnnum.arrays import Floats, finite
from cnnum.design.adjoint import STEP, Numbers, Pictures
from cnnum.design.search import Group, groups_of, with_weights
from cnnum.errors import TemplateError
from cnnum.templating.functions import output_function
from cnnum.templating.template import Template

LARGEST = 1e6
"""The loss of weights whose run diverges."""


@dataclass(frozen=True, slots=True, eq=False)
class Lesson:
    """Labelled pictures, and the form of the template that is to learn them.

    Attributes
    ----------
    form : Template
    target : (..., rows, cols) float
        Wanted outputs.
    input, state : as `Engine.run` takes them, optional
    counts : (..., rows, cols) float, optional
        Weight of every cell in the loss; all alike unless given.
    duration : float, optional
        Time constants; the form's unless given.
    step : float
        Step of the run, in time constants.
    method : str
        Method of the run.
    shrink : float
        Of the sum of squares of all weights, which is added to the mean squared error.
    """

    form: Template
    target: ArrayLike
    input: ArrayLike | None = None
    state: ArrayLike | None = None
    counts: ArrayLike | None = None
    duration: float | None = None
    step: float = STEP
    method: str = "rk4"
    shrink: float = 0.0

    def pictures(self) -> Pictures:
        """Return the pictures, ready for runs.

        Raises
        ------
        TemplateError
            If the form has no gradient.
        """
        return Pictures(
            self.form,
            input=self.input,
            state=self.state,
            duration=self.duration,
            step=self.step,
            method=self.method,
        )


class Loss:
    """The mean squared error of weights on a lesson, with its gradient.

    Parameters
    ----------
    lesson : Lesson

    Raises
    ------
    TemplateError
        If the form has no weights, or no gradient.
    """

    def __init__(self, lesson: Lesson) -> None:
        self.form, self.groups = lesson.form, groups_of(lesson.form)
        if not self.groups:
            raise TemplateError(f"'{lesson.form.name}' has no weights to learn: give it some.")
        self._pictures, self._shrink = lesson.pictures(), lesson.shrink
        self._target = finite("the target of a lesson", lesson.target)
        shape = self._pictures.shaped(self._pictures.start).shape
        counts = np.ones(()) if lesson.counts is None else finite("counts", lesson.counts)
        self._counts = np.broadcast_to(counts, shape)
        self._counts = self._counts / max(float(self._counts.sum()), 1e-300)

    def __call__(self, weights: Floats) -> tuple[float, Floats]:
        """Return the loss of the groups' weights, and its gradient by each."""
        numbers = self._numbers(weights)
        penalty = self._shrink * float(weights @ weights)
        try:
            run = self._pictures.run(numbers)
        except TemplateError:
            return LARGEST + penalty, 2.0 * weights  # back to smaller ones
        off = run.output - self._target
        pulled = self._counts * off
        made = run.pull(2.0 * pulled)
        slopes = [sum(getattr(made, part)[at] for at in places) for part, places in self.groups]
        loss = float((pulled * off).sum()) + penalty
        return loss, np.array(slopes, dtype=np.float64) + 2.0 * self._shrink * weights

    def _numbers(self, weights: Floats) -> Numbers:
        form = self.form
        parts = {part: np.zeros_like(getattr(form, part)) for part in ("A", "B", "z")}
        for (part, places), weight in zip(self.groups, weights.tolist(), strict=True):
            for at in places:
                parts[part][at] = weight
        return Numbers(**parts, tau=form.tau)


@dataclass(frozen=True, slots=True)
class Learned:
    """The best template of all starts.

    Attributes
    ----------
    template : Template
    loss : float
        Mean squared error, and the term that shrinks weights.
    evaluations : int
        Runs with their gradients.
    """

    template: Template
    loss: float
    evaluations: int


def learn(
    lesson: Lesson,
    *,
    restarts: int = 4,
    iterations: int = 200,
    enough: float = 0.0,
    seed: int = 0,
    from_form: bool = False,
) -> Learned:
    """Return the template of the least loss that gradients lead to.

    Parameters
    ----------
    lesson : Lesson
    restarts : int
        Starts from normal numbers of width 0.5, the own feedback among them.
    iterations : int
        Iterations of each start, at most.
    enough : float
        A loss up to it ends all.
    seed : int
    from_form : bool
        The first start is from the form's own numbers.

    Raises
    ------
    TemplateError
        If the form has no weights, or no gradient, or every start diverges.
    """
    if restarts < 1:
        raise TemplateError(f"Learning needs at least one start, got {restarts}.")
    loss, hard = Loss(lesson), lesson.form.output.name == "standard"
    soft: Loss | None = None  # made for the second start, which few lessons come to
    rng, best, evaluations = np.random.default_rng(seed), (np.inf, np.zeros(0)), 0
    for restart in range(restarts):
        start = 0.5 * rng.normal(size=len(loss.groups))
        if from_form and restart == 0:
            start = numbers_of(lesson.form, loss.groups)
        if hard and restart % 2:
            if soft is None:
                smooth = replace(lesson.form, output=output_function("tanh"))
                soft = Loss(replace(lesson, form=smooth))
            _, start, count = _descended(soft, start, iterations, 0.0)
            evaluations += count
        least, weights, count = _descended(loss, start, iterations, enough)
        evaluations += count
        if least < best[0]:
            best = (least, weights)
        if best[0] <= enough:
            break
    if best[0] >= LARGEST:
        raise TemplateError(
            f"Every start of '{lesson.form.name}' diverges: use a shorter duration or step."
        )
    return Learned(with_weights(lesson.form, loss.groups, best[1]), best[0], evaluations)


def _descended(
    loss: Loss, start: Floats, iterations: int, enough: float
) -> tuple[float, Floats, int]:
    """Return the least loss from a start, its weights, and how often it was asked."""
    best, count = (np.inf, start), 0

    def asked(weights: Floats) -> tuple[float, Floats]:
        nonlocal best, count
        count += 1
        found, slopes = loss(weights)
        if found < best[0]:
            best = (found, weights.copy())
        if found <= enough:
            raise StopIteration
        return found, slopes

    descend: Any = minimize  # its stubs know no name for an option that all methods share
    with contextlib.suppress(StopIteration):
        descend(asked, start, jac=True, method="L-BFGS-B", options={"maxiter": iterations})
    return best[0], best[1], count


def numbers_of(form: Template, groups: Sequence[Group]) -> Floats:
    """Return the numbers that a form has for its weights."""
    return np.array([getattr(form, part)[places[0]] for part, places in groups], dtype=np.float64)


def untied(
    name: str,
    *,
    inputs: int = 1,
    size: int = 3,
    feedback: bool = True,
    rows: bool = False,
    **rest: Any,
) -> Template:
    """Return a form of one layer whose weights are all free and all different.

    Parameters
    ----------
    name : str
    inputs : int
    size : int
        Size of the kernels; odd.
    feedback : bool
        Whether A has neighbours; else the cell sees its own output alone.
    rows : bool
        Whether a cell sees its own row alone, as in a signal of one dimension.
    **rest
        Of `cnnum.Template`.
    """
    count, middle = size * size, size // 2
    every = 0.1 + np.arange(max(inputs, 1) * count).reshape(-1, size, size) / count
    if rows:
        every[:, np.arange(size) != middle] = 0.0
    A = every[0].copy()
    if not feedback:
        A[:] = 0.0
        A[middle, middle] = 0.5
    return Template(name, A, every[np.newaxis] if inputs else None, 0.5, **rest)


__all__ = ["Learned", "Lesson", "Loss", "learn", "numbers_of", "untied"]
