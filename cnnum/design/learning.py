"""Learning templates from examples: gradients by the adjoint, and the search along them.

Gradients where outputs are smooth: the adjoint of a run of fixed steps, exact but for rounding.

A step is k_i = F(x_i), x_i = x + h Σ_j a_ij k_j, x⁺ = x + h Σ_i b_i k_i. Its adjoint goes from the
last stage to the first (Hager 2000):

    κ_i = h (b_i λ + Σ_j a_ji μ_j),   μ_i = F'(x_i)ᵀ κ_i,   λ ← λ + Σ_i μ_i

Weights from labelled pictures, by gradients: L-BFGS over the adjoint of a run.

The form gives the pattern of weights as it does for a search: zeros stay zeros, and equal numbers
of a matrix stay equal. Nothing else of its numbers is used, but by the first start if asked.

A cell that rests beyond ±1 has no slope. So every second start goes down with tanh first.
"""

import contextlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar, cast

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import minimize

from cnnum.arrays import Floats, Shape, finite
from cnnum.design.search import Advance, Group, Watch, go_on, groups_of, with_weights
from cnnum.errors import SizeError, TemplateError
from cnnum.integrators.tableau import EULER, HEUN, RK4, ButcherTableau
from cnnum.templating.boundary import Boundary, rim_copies
from cnnum.templating.functions import output_function
from cnnum.templating.template import Template

Function = TypeVar("Function", bound=Callable[..., Any])

STANDARD, LINEAR, TANH = range(3)


def _compiled(function: Function) -> Function:
    options: dict[str, Any] = {"cache": True, "nogil": True, "error_model": "numpy"}
    options["fastmath"] = {"reassoc", "nsz"}  # sums of a row in the lanes of a vector
    return cast(Function, numba.njit(**options)(function))


@_compiled
def fill(y: Any, value: float) -> None:
    """Fill maps with one number."""
    flat = y.reshape(-1)
    for n in range(len(flat)):
        flat[n] = value


@_compiled
def outputs(kind: int, x: Any, count: int, y: Any) -> None:
    """Write f(x) of `count` pictures into all but the virtual cells."""
    layers, rows, width = x.shape
    radius = (y.shape[1] - rows) // 2
    for layer in range(layers):
        for row in range(rows):
            at = x[layer, row]
            to = y[layer, radius + row, radius * count : radius * count + width]
            for n in range(width):
                value = at[n]
                if kind == STANDARD:
                    value = min(max(value, -1.0), 1.0)
                elif kind == TANH:
                    value = np.tanh(value)
                to[n] = value


@_compiled
def add(total: Any, factor: float, other: Any) -> None:
    """Add factor · other to a row in place."""
    for n in range(len(total)):
        total[n] += factor * other[n]


@_compiled
def spread(rim: Any, count: int, y: Any) -> None:
    """Copy cells to the virtual cells beyond the rim."""
    for cells in y.reshape((len(y), -1, count)):
        for virtual, cell in rim:
            cells[virtual] = cells[cell]


@_compiled
def folded(rim: Any, count: int, y: Any) -> None:
    """Add virtual cells to those that they copy: the adjoint of `spread`."""
    for cells in y.reshape((len(y), -1, count)):
        for virtual, cell in rim:
            add(cells[cell], 1.0, cells[virtual])


@_compiled
def dot(this: Any, other: Any) -> float:
    """Return the sum of products of two rows."""
    result = 0.0
    for n in range(len(this)):
        result += this[n] * other[n]
    return result


@_compiled
def couple(kernels: Any, y: Any, count: int, sums: Any, back: bool) -> None:
    """Add to `sums` those over neighbours; or `back` to y, with virtual cells, the adjoint."""
    rows, width = sums.shape[1:]
    for layer, source, r, c in np.ndindex(kernels.shape):
        weight = kernels[layer, source, r, c]
        if weight != 0.0:
            for row in range(rows):
                near = y[source, row + r, c * count : c * count + width]
                if back:
                    add(near, weight, sums[layer, row])
                else:
                    add(sums[layer, row], weight, near)


@_compiled
def products(sums: Any, y: Any, count: int, total: Any) -> None:
    """Add to `total`, (layers, sources, k, k), the adjoints of the kernels of sums."""
    rows, width = sums.shape[1:]
    for layer, source, r, c in np.ndindex(total.shape):
        product = 0.0
        for row in range(rows):
            near = y[source, row + r, c * count : c * count + width]
            product += dot(sums[layer, row], near)
        total[layer, source, r, c] += product


@_compiled
def combined(x: Any, part: float, y: Any, factor: float) -> None:
    """Write part · x + factor · y into x, both (layers, rows, width)."""
    to, of = x.reshape(-1), y.reshape(-1)
    if part == 0.0:  # x may be anything then
        for n in range(len(to)):
            to[n] = factor * of[n]
    else:
        for n in range(len(to)):
            to[n] = part * to[n] + factor * of[n]


@_compiled
def divided(x: Any, tau: Any) -> None:
    """Divide layers by their time constants."""
    for layer in range(len(x)):
        own = x[layer].reshape(-1)
        for n in range(len(own)):
            own[n] /= tau[layer]


@_compiled
def march(
    kind: int, h: float, a: Any, b: Any, kernels: Any, rim: Any, count: int, edge: float, w: Any,
    tau: Any, states: Any, rates: Any, x: Any,
) -> None:  # fmt: skip
    """Run all steps from x, keep states and rates of stages, and leave the end in x."""
    steps, stages, layers, rows, width = states.shape
    halo = kernels.shape[-1] - 1
    y = np.empty((layers, rows + halo, width + halo * count))
    fill(y, edge)
    for step in range(steps):
        for i in range(stages):
            at, rate = states[step, i], rates[step, i]
            combined(at, 0.0, x, 1.0)
            for j in range(i):
                if a[i, j] != 0.0:
                    combined(at, 1.0, rates[step, j], h * a[i, j])
            outputs(kind, at, count, y)
            spread(rim, count, y)
            combined(rate, 0.0, w, 1.0)
            combined(rate, 1.0, at, -1.0)
            couple(kernels, y, count, rate, False)
            divided(rate, tau)
        for i in range(stages):
            combined(x, 1.0, rates[step, i], h * b[i])


@_compiled
def slope(kind: int, x: float, y: float) -> float:
    """Return f'(x), of y = f(x)."""
    if kind == TANH:
        return 1.0 - y * y
    return 1.0 if kind == LINEAR or (x > -1.0 and x < 1.0) else 0.0


@_compiled
def step_back(kind: int, at: Any, y: Any, fed: Any, v: Any, count: int, pulled: Any) -> None:
    """Write μ = f'(x) Aᵀv − v."""
    layers, rows, width = v.shape
    radius = (y.shape[1] - rows) // 2
    begin = radius * count
    for layer in range(layers):
        for row in range(rows):
            x, own, to = at[layer, row], v[layer, row], pulled[layer, row]
            out = y[layer, radius + row, begin : begin + width]
            back = fed[layer, radius + row, begin : begin + width]
            for n in range(width):
                to[n] = slope(kind, x[n], out[n]) * back[n] - own[n]


@_compiled
def by_time(v: Any, rate: Any, total: Any) -> None:
    """Add a stage's adjoint of the time constants."""
    for layer in range(len(v)):
        total[layer] -= dot(v[layer].reshape(-1), rate[layer].reshape(-1))


@_compiled
def back(
    kind: int, h: float, a: Any, b: Any, kernels: Any, rim: Any, count: int, edge: float, tau: Any,
    states: Any, rates: Any, lam: Any, by_kernels: Any, by_tau: Any, by_drive: Any,
) -> None:  # fmt: skip
    """Leave λ of the start in `lam`, and add the gradients to the last three."""
    steps, stages, layers, rows, width = states.shape
    halo = kernels.shape[-1] - 1
    y = np.empty((layers, rows + halo, width + halo * count))
    fill(y, edge)
    fed, v = np.empty(y.shape), np.empty((layers, rows, width))
    pulled = np.empty((stages, layers, rows, width))
    for step in range(steps - 1, -1, -1):
        for i in range(stages - 1, -1, -1):
            combined(v, 0.0, lam, h * b[i])
            for j in range(i + 1, stages):
                if a[j, i] != 0.0:
                    combined(v, 1.0, pulled[j], h * a[j, i])
            divided(v, tau)
            by_time(v, rates[step, i], by_tau)
            outputs(kind, states[step, i], count, y)
            spread(rim, count, y)
            products(v, y, count, by_kernels)
            combined(by_drive, 1.0, v, 1.0)
            fill(fed, 0.0)
            couple(kernels, fed, count, v, True)
            folded(rim, count, fed)
            step_back(kind, states[step, i], y, fed, v, count, pulled[i])
        for i in range(stages):
            combined(lam, 1.0, pulled[i], 1.0)


KINDS: Mapping[str, int] = {"standard": STANDARD, "linear": LINEAR, "tanh": TANH}
"""Outputs that have a slope almost everywhere."""

METHODS: Mapping[str, ButcherTableau] = {t.name: t for t in (EULER, HEUN, RK4)}
STEP = 0.05
"""Longest step in time constants: the classic method is off by some 1e-7 of it where |λ| is 4."""

MOST = 1 << 28
"""Numbers that a run keeps for its adjoint: 2 GiB."""


@dataclass(frozen=True, slots=True, eq=False)
class Gradients:
    """Derivatives of a loss by the numbers of a template, and by the start.

    Attributes
    ----------
    A, B, z, tau
        Of the shapes of `Numbers`.
    state : (..., layers, rows, cols) float
    """

    A: Floats
    B: Floats
    z: Floats
    tau: Floats
    state: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Numbers:
    """The numbers of a template, as a run takes them.

    Attributes
    ----------
    A : (layers, layers, k, k) float
    B : (layers, inputs, k, k) float
    z, tau : (layers,) float
    """

    A: Floats
    B: Floats
    z: Floats
    tau: Floats

    def __post_init__(self) -> None:
        object.__setattr__(self, "tau", np.array(self.tau, dtype=np.float64))

    @classmethod
    def of(cls, template: Template) -> "Numbers":
        """Return those of a template."""
        return cls(template.A, template.B, template.z, template.tau)


class Pictures:
    """Pictures on which templates of one form run, in fixed steps.

    Parameters
    ----------
    form : Template
        A template with linear couplings and a differentiable output function.
    input : (..., rows, cols) or (..., inputs, rows, cols) float, optional
    state : (..., rows, cols) or (..., layers, rows, cols) float, optional
    bias : like `state`, optional
    duration : float, optional
        In time constants. The default is that of the form.
    step : float
        Longest step, in time constants.
    method : "euler", "heun" or "rk4"

    Raises
    ------
    TemplateError
        If the form has no gradient or no duration, or an input or a state is missing.
    ArrayError
        If an array contains NaN or infinity.
    SizeError
        If a run would store more than 2 GiB.
    """

    def __init__(
        self,
        form: Template,
        *,
        input: ArrayLike | None = None,
        state: ArrayLike | None = None,
        bias: ArrayLike | None = None,
        duration: float | None = None,
        step: float = STEP,
        method: str = "rk4",
    ) -> None:
        time = _refused(form, form.duration if duration is None else duration, step, method)
        if form.inputs and input is None:
            raise TemplateError(f"A gradient of '{form.name}' needs an input, got none.")
        self.form, tableau = form, METHODS[method]
        begin = input if form.initial == "input" and state is None else state
        given = [
            (finite(name, maps), sources)
            for name, maps, sources in (
                ("input", input if form.inputs else None, form.inputs),
                ("state", begin, form.layers),
                ("bias", bias, form.layers),
            )
            if maps is not None
        ]
        if not given:
            raise TemplateError(f"A gradient of '{form.name}' needs a state, got none.")
        leads = [maps.shape[: -2 if sources == 1 else -3] for maps, sources in given]
        self.lead, self.shape = np.broadcast_shapes(*leads), given[0][0].shape[-2:]
        self.steps = max(1, int(np.ceil(time / step - 1e-9)))
        self.h = time / self.steps
        stages = tableau.stages
        self.a, self.b = np.zeros((stages, stages)), np.array([float(b) for b in tableau.b])
        for i, row in enumerate(tableau.a):
            self.a[i, : len(row)] = [float(a) for a in row]
        rim, fed = form.boundary, form.input_boundary
        self.edge = float(form.output.numpy(np.array(rim.constant or 0.0)))
        self.rim = _rim(rim, self.shape, form.A.shape[-1] // 2)
        self.start = self.flat(form.initial if begin is None else begin, form.layers)
        self.bias = None if bias is None else self.flat(bias, form.layers)
        kept = 2 * self.steps * stages * self.start.size
        if kept > MOST:
            raise SizeError(
                f"A gradient would store {8 * kept / 2**30:.1f} GiB of states, expected at most "
                f"{8 * MOST / 2**30:.0f}: take fewer pictures, or longer steps."
            )
        self.input: Floats | None = None
        self.count = self.start.shape[-1] // self.shape[1]
        if input is not None and form.inputs:
            self.input = self._rimmed(self.flat(input, form.inputs), fed, form.B.shape[-1] // 2)

    def flat(self, maps: ArrayLike, sources: int) -> Floats:
        """Return maps as (sources, rows, cols·pictures)."""
        values = finite("maps of a gradient", maps)
        if sources == 1 and values.ndim:
            values = values[..., np.newaxis, :, :]
        full = np.broadcast_to(values, (*self.lead, sources, *self.shape))
        side = full.reshape(-1, sources, *self.shape).transpose(1, 2, 3, 0)
        return np.array(side.reshape(sources, self.shape[0], -1), order="C")

    def shaped(self, flat: Floats) -> Floats:
        """Return maps of layers as they were given."""
        layers = self.form.layers
        own = () if layers == 1 else (layers,)
        side = flat.reshape(layers, *self.shape, -1).transpose(3, 0, 1, 2)
        return side.reshape(*self.lead, *own, *self.shape)

    def _rimmed(self, flat: Floats, boundary: Boundary, radius: int) -> Floats:
        side = flat.reshape(len(flat), *self.shape, -1)
        wide = ((0, 0), (radius, radius), (radius, radius), (0, 0))
        full = np.pad(side, wide, constant_values=boundary.constant or 0.0)
        full = full.reshape(len(flat), full.shape[1], -1)
        spread(_rim(boundary, self.shape, radius), self.count, full)
        return full

    def run(self, numbers: Numbers) -> "Adjoint":
        """Return the run of these numbers.

        Raises
        ------
        TemplateError
            If it diverges.
        """
        return Adjoint(self, numbers)


class Adjoint:
    """A run that gradients can be pulled back through; `adjoint` makes one of a template."""

    def __init__(self, pictures: Pictures, numbers: Numbers) -> None:
        self._of, self._numbers = pictures, numbers
        form, start = pictures.form, pictures.start
        self._kind = KINDS[form.output.name]
        drive = np.zeros_like(start) + numbers.z[:, np.newaxis, np.newaxis]
        if pictures.bias is not None:
            drive += pictures.bias
        if pictures.input is not None:
            couple(_own(numbers.B), pictures.input, pictures.count, drive, False)
        kept = (pictures.steps, len(pictures.b), *start.shape)
        self._states, self._rates = np.empty(kept), np.empty(kept)
        self._end = start.copy()
        march(
            self._kind, pictures.h, pictures.a, pictures.b, _own(numbers.A), pictures.rim,
            pictures.count, pictures.edge, drive, numbers.tau, self._states, self._rates, self._end,
        )  # fmt: skip
        if not np.isfinite(self._end).all():
            raise TemplateError(
                f"'{form.name}' diverges within {pictures.steps} steps of {pictures.h:g} time "
                "constants, so it has no gradient: use shorter steps, or smaller weights."
            )

    @property
    def state(self) -> Floats:
        """The state at the end."""
        return self._of.shaped(self._end)

    @property
    def output(self) -> Floats:
        """The output at the end."""
        return self._of.shaped(self._of.form.output.numpy(self._end))

    @property
    def times(self) -> tuple[int, float]:
        """Number of steps, and their length in the unit of τ."""
        return self._of.steps, self._of.h

    def pull(self, loss: ArrayLike) -> Gradients:
        """Return the gradients of a loss from its derivatives by the output at the end.

        Parameters
        ----------
        loss : shape of `output`
        """
        pictures, numbers, end = self._of, self._numbers, self._end
        lam = pictures.flat(np.asarray(loss, dtype=np.float64), pictures.form.layers)
        if self._kind == TANH:
            lam *= 1.0 - np.tanh(end) ** 2
        elif self._kind == STANDARD:
            lam *= np.abs(end) < 1.0
        by_a, by_b = np.zeros(numbers.A.shape), np.zeros(numbers.B.shape)
        tau, drive = np.zeros(numbers.tau.shape), np.zeros_like(pictures.start)
        back(
            self._kind, pictures.h, pictures.a, pictures.b, _own(numbers.A), pictures.rim,
            pictures.count, pictures.edge, numbers.tau, self._states, self._rates, lam, by_a, tau,
            drive,
        )  # fmt: skip
        if pictures.input is not None:
            products(drive, pictures.input, pictures.count, by_b)
        return Gradients(
            by_a,
            by_b,
            drive.sum(axis=(1, 2)),
            tau,
            pictures.shaped(lam),
        )


def adjoint(
    template: Template,
    *,
    input: ArrayLike | None = None,
    state: ArrayLike | None = None,
    bias: ArrayLike | None = None,
    duration: float | None = None,
    step: float = STEP,
    method: str = "rk4",
) -> Adjoint:
    """Return the run of a template, which gradients can be pulled back through.

    Parameters and errors are those of `Pictures`, and it raises where the run diverges.
    """
    maps = {"input": input, "state": state, "bias": bias}
    pictures = Pictures(template, **maps, duration=duration, step=step, method=method)
    return pictures.run(Numbers.of(template))


def _own(kernels: Floats) -> Floats:
    # a copy that may be written: compiled loops know no other arrays
    return np.array(kernels, dtype=np.float64)


def _rim(boundary: Boundary, shape: Shape, radius: int) -> NDArray[np.int64]:
    """Return virtual cells and the cells that they copy, (count, 2), counted with the rim."""
    copies = np.zeros((2, 0), np.int64)
    if boundary.constant is None:
        copies = rim_copies(boundary, shape, radius)
    return np.ascontiguousarray(copies.T)


def _refused(form: Template, duration: object, step: float, method: str) -> float:
    if not form.plain or form.output.name not in KINDS:
        raise TemplateError(
            f"'{form.name}' has no gradient: expected linear couplings without delay that are "
            f"constant in time, and an output function out of {', '.join(KINDS)}; use [search] to "
            "find its weights."
        )
    if method not in METHODS:
        raise TemplateError(
            f"Gradients exist for the methods {', '.join(METHODS)}, got {method!r:.40}."
        )
    if not isinstance(duration, int | float) or not 0.0 < duration < np.inf or not step > 0.0:
        raise TemplateError(
            f"A gradient of '{form.name}' needs a duration and a step above 0 in the unit of τ, "
            f"got {duration!r:.40} and {step:g}: give duration=…"
        )
    return float(duration)


LARGEST = 1e6
"""The loss of weights whose run diverges."""


@dataclass(frozen=True, slots=True, eq=False)
class Lesson:
    """Training pictures, and the form of the template to learn from them.

    Attributes
    ----------
    form : Template
    target : (..., rows, cols) float
        Desired outputs.
    input, state : as in `Engine.run`, optional
    counts : (..., rows, cols) float, optional
        Weight of every cell in the loss. By default, all weights are equal.
    duration : float, optional
        In time constants. The default is that of the form.
    step : float
        Step of the run, in time constants.
    method : str
        Method of the run.
    shrink : float
        Factor on the sum of squares of all weights, which is added to the mean squared error.
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
    """Mean squared error of weights on training pictures, with its gradient.

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
    stopped : bool
        Whether it was stopped before its end.
    """

    template: Template
    loss: float
    evaluations: int
    stopped: bool = False


def learn(
    lesson: Lesson,
    *,
    restarts: int = 4,
    iterations: int = 200,
    enough: float = 0.0,
    seed: int = 0,
    from_form: bool = False,
    watch: Watch = go_on,
) -> Learned:
    """Return the template with the smallest loss that gradient descent finds.

    Parameters
    ----------
    lesson : Lesson
    restarts : int
        Number of starts from normal random weights with standard deviation 0.5, including the
        self-feedback.
    iterations : int
        Largest number of iterations per start.
    enough : float
        Loss at which the search ends.
    seed : int
    from_form : bool
        Whether the first start uses the numbers of the form.
    watch : callable
        Is given each run, and ends the lesson by False.

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
    stopped = False

    def watched(loss: float) -> bool:
        nonlocal stopped
        least = min(best[0], loss)
        stopped = not watch(Advance(restart + 1, restarts, "start", least, "least error"))
        return not stopped

    for restart in range(restarts):
        start = 0.5 * rng.normal(size=len(loss.groups))
        if from_form and restart == 0:
            start = numbers_of(lesson.form, loss.groups)
        if hard and restart % 2:
            if soft is None:
                smooth = replace(lesson.form, output=output_function("tanh"))
                soft = Loss(replace(lesson, form=smooth))
            _, start, count = _descended(soft, start, iterations, 0.0, lambda _: watched(np.inf))
            evaluations += count
        least, weights, count = _descended(loss, start, iterations, enough, watched)
        evaluations += count
        if least < best[0]:
            best = (least, weights)
        if best[0] <= enough or stopped:
            break
    if best[0] >= LARGEST:
        raise TemplateError(
            f"Every start of '{lesson.form.name}' diverges: use a shorter duration or step."
        )
    return Learned(with_weights(lesson.form, loss.groups, best[1]), best[0], evaluations, stopped)


def _descended(
    loss: Loss, start: Floats, iterations: int, enough: float, watched: Callable[[float], bool]
) -> tuple[float, Floats, int]:
    """Return the least loss from a start, its weights, and how often it was asked."""
    best, count = (np.inf, start), 0

    def asked(weights: Floats) -> tuple[float, Floats]:
        nonlocal best, count
        count += 1
        result, slopes = loss(weights)
        if result < best[0]:
            best = (result, weights.copy())
        if result <= enough or not watched(best[0]):
            raise StopIteration
        return result, slopes

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
    """Return a form with one layer whose weights are all free and independent.

    Parameters
    ----------
    name : str
    inputs : int
    size : int
        Size of the kernels; odd.
    feedback : bool
        Whether A reads neighbours; if false, a cell reads only its own output.
    rows : bool
        Whether a cell reads only its own row, as for one-dimensional signals.
    **rest
        Further parameters of `cnnum.Template`.
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
