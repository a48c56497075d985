"""Courses in time: single cells, ramps, and runs that are refined until they agree.

Linear arrays with a delay, exact by the method of steps, mode by mode.

x' = ax + bx(t − T) has a constant past. On the n-th stretch of length T it is a constant plus a
polynomial of degree n − 1 times e^{as}: each stretch integrates the polynomial before it (Bellman &
Cooke 1963, Differential-Difference Equations, ch. 3).

One uncoupled cell, x' = −x + a f(x) + b: piecewise linear, so exact at any time.

Such an equation of one variable moves one way only. So a cell visits each of the three linear
pieces of f at most once. Its crossing times are logarithms (Chua & Yang 1988).

A chain of leaky cells behind a signal that rises steadily: exact, by partial fractions.

The first layer is the signal itself, u = u₀ + v t. Each of `stages` layers follows what the one
before it leaves, with the time constant `slow`, and takes it off: a high-pass. The last layer
follows the rest with `quick`: a low-pass.

Linear courses of any symmetric coupling, mode by mode, exact at any time.

A symmetric kernel is given by its south-east quadrant, the cell itself first: "1 0.2/0.2 0.1" is 1
for the cell, 0.2 for the four edge neighbours and 0.1 for the corners.

A refined solution of a template's own equation: it shows that an engine runs it right, no more.

This is the weaker kind of check, for templates whose answer nothing else defines: unlike every
other it is computed from the template's weights, by its own sums and SciPy's integrator.
"""

from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp

from cnnum.arrays import Floats, Shape
from cnnum.errors import TemplateError
from cnnum.tactile.receptors import ramp
from cnnum.templating.boundary import Boundary
from cnnum.templating.checks.analytic.linear import ANALOG_REASON, ANALOG_TOLERANCE, Modes, modes
from cnnum.templating.checks.pictures import gray, with_even
from cnnum.templating.checks.records import Case, ClosedForm, has, number, text, time_constant
from cnnum.templating.network import jumps
from cnnum.templating.template import Template


def by_steps(rate: Floats, delayed: Floats, delay: float, time: float) -> Floats:
    """Return x(t) of x' = rate·x + delayed·x(t − delay) with x = 1 up to t = 0.

    Parameters
    ----------
    rate, delayed : (...) float
        The rate is not 0.
    delay, time : float
    """
    constant, polynomial = np.ones_like(rate), [np.zeros_like(rate)]
    value, begin = np.ones_like(rate), 0.0
    while begin < time:
        length = min(delay, time - begin)
        constant = -delayed * constant / rate
        powers = [delayed * p / (n + 1) for n, p in enumerate(polynomial)]
        polynomial = [value - constant, *powers]
        value = constant + np.exp(rate * length) * _at(polynomial, length)
        begin += delay
    return value


def _at(polynomial: list[Floats], s: float) -> Floats:
    return np.asarray(sum(p * s**n for n, p in enumerate(polynomial)), dtype=np.float64)


def _delays_case(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    return Case(input=gray(rng, shape))


def _delayed(template: Template, case: Case) -> Floats:
    result = modes(template.boundary, (case.pictures.shape[-2], case.pictures.shape[-1]))
    edge, late_edge = number(template, "edge", 0.0), number(template, "delayed_edge", 0.0)
    rate = number(template, "centre", 0.0) - 1.0 + result.symbol(edge)
    late = number(template, "delayed_centre", 0.0) + result.symbol(late_edge)
    delay = number(template, "delay") / time_constant(template)
    return result.apply(case.pictures, by_steps(rate, late, delay, case.time(template)))


DELAYS_FORMS = (
    ClosedForm(
        "delayed-coupling",
        _delays_case,
        _delayed,
        ANALOG_TOLERANCE,
        ANALOG_REASON,
        "a linear array that sees itself a delay ago, by the method of steps",
        needs=("delay",),
        takes=("centre", "edge", "delayed_centre", "delayed_edge"),
    ),
)


PRECISION = 1e-10


def refined(
    slope: Callable[[Floats], Floats], start: Floats, time: float, precision: float = PRECISION
) -> Floats:
    """Return the solution of x' = slope(x) at a time; x has any shape."""
    solution = solve_ivp(
        lambda _, flat: slope(flat.reshape(start.shape)).ravel(),
        (0.0, time),
        start.ravel(),
        method="DOP853",
        rtol=precision,
        atol=precision,
    )
    return np.asarray(solution.y[:, -1]).reshape(start.shape)


def state_after(start: Floats, feedback: float, bias: float, time: float) -> Floats:
    """Return the state of uncoupled cells after a time.

    Parameters
    ----------
    start : (...) float
    feedback, bias : float
        a and b of x' = −x + a f(x) + b.
    time : float
        Time constants.
    """
    state, left = start, np.full_like(start, time)
    for _ in range(3):
        state, left = _through_piece(state, left, feedback, bias)
    return state


def switching_time(start: Floats, feedback: float, bias: float) -> Floats:
    """Return the time until a cell from within (−1, 1) saturates; infinite where it never does."""
    rate, drift = feedback - 1.0, np.full_like(start, bias)
    return _time_to(np.sign(rate * start + drift), start, rate, drift)


def _through_piece(
    state: Floats, left: Floats, feedback: float, bias: float
) -> tuple[Floats, Floats]:
    slope = -state + feedback * np.clip(state, -1.0, 1.0) + bias
    # A cell on a corner of f belongs to the piece that it moves into.
    outward = state * slope > 0.0
    side = np.sign(state) * ((np.abs(state) > 1.0) | ((np.abs(state) == 1.0) & outward))
    rate = np.where(side == 0.0, feedback - 1.0, -1.0)
    drift = side * feedback + bias
    inward = np.where(side * slope < 0.0, side, np.inf)
    border = np.where(side == 0.0, np.sign(slope), inward)
    spent = np.minimum(left, _time_to(border, state, rate, drift))
    moved = np.where(spent < left, border, _move(state, rate, drift, spent))
    return moved, left - spent


def _time_to(goal: Floats, state: Floats, rate: Floats | float, drift: Floats) -> Floats:
    """Return when x' = rate·x + drift reaches the goal, infinite where it does not."""
    speed = rate * state + drift
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        # log1p, because a rate near 0 leaves only roundings of the quotient of the speeds
        curved = np.log1p(rate * (goal - state) / speed) / rate
        time = np.where(np.equal(rate, 0.0), (goal - state) / speed, curved)
    return np.where(np.isfinite(time) & (time >= 0.0), time, np.inf)


def _move(state: Floats, rate: Floats, drift: Floats, time: Floats) -> Floats:
    still = rate == 0.0
    growth = np.where(still, time, np.expm1(rate * time) / np.where(still, 1.0, rate))
    return state + (rate * state + drift) * growth


def _cell_case(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    """Draw states on all three pieces of f, and stop while some cells are still on their way."""
    states = with_even(rng.uniform(-1.6, 1.6, (4, *shape)), -1.5)
    return Case(state=states, duration=number(template, "time") * time_constant(template))


def _cells(template: Template, case: Case) -> Floats:
    return state_after(
        case.states, number(template, "feedback"), number(template, "bias"), case.time(template)
    )


CELL_FORMS = (
    ClosedForm(
        "uncoupled-cell",
        _cell_case,
        _cells,
        ANALOG_TOLERANCE,
        ANALOG_REASON,
        "x(t) of a piecewise linear cell, through its crossings of -1 and 1",
        needs=("feedback", "bias", "time"),
        compares="state",
    ),
)


RAMPS_TOLERANCE = 1e-5
"""Tolerance for layers that are differences of signals of order 1 in single precision."""


def changes(time: float, stages: int, slow: float, quick: float) -> Floats:
    """Return what each layer has changed by, under a ramp of slope 1 that began at rest.

    Returns
    -------
    (2 + stages,) float, s
        The signal, the layers that adapt, and the output.
    """
    follows = ramp(time, stages=0, slow=slow, quick=slow)
    # the second one adapts to what is left of a ramp: to a step of `slow` that comes up slowly
    again = slow * (1.0 - np.exp(-time / slow) * (1.0 + time / slow))
    adapting = [follows, again][:stages]
    return np.array([time, *adapting, ramp(time, stages=stages, slow=slow, quick=quick)])


def _ramp(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    """Start every cell at rest at a level of its own, and let it rise for a few time constants."""
    stages = round(number(template, "stages"))
    longest = number(template, "slow") if stages else number(template, "quick")
    level = with_even(rng.uniform(-1.0, 1.0, (2, *shape)), 0.5)
    state = np.zeros((len(level), 2 + stages, *shape))
    # at rest the signal is the first layer's, and that of the one that follows it
    state[:, 0] = state[:, 1] = level
    slope = with_even(rng.uniform(-1.0, 1.0, (2, *shape)), 0.5) / longest
    return Case(input=slope, state=state, duration=1.5 * longest)


def _risen(template: Template, case: Case) -> Floats:
    stages = round(number(template, "stages"))
    slow = number(template, "slow") if stages else 1.0
    change = changes(case.length(template), stages, slow, number(template, "quick"))
    slope = case.pictures / template.tau[0]  # of the layer that is the signal
    return np.asarray(case.states + slope[:, None] * change[:, None, None])


RAMPS_FORMS = (
    ClosedForm(
        "ramp",
        _ramp,
        _risen,
        RAMPS_TOLERANCE,
        "layers are differences of signals of order 1, in single precision",
        "leaky cells in a row behind a signal that rises steadily, by partial fractions",
        needs=("stages", "quick"),
        takes=("slow",),
        compares="state",
    ),
)


def symbol(template: Template, name: str, modes: Modes) -> Floats:
    """Return the eigenvalues of the kernel that a parameter gives by its quadrant; 0 without it.

    Raises
    ------
    TemplateError
        If the parameter is not rows of numbers.
    """
    if not has(template, name):
        return np.zeros((modes.cos_rows.size, modes.cos_cols.size))
    try:
        rows = [[float(v) for v in row.split()] for row in text(template, name).split("/")]
    except ValueError:
        raise TemplateError(
            f"Template '{template.name}': the parameter '{name}' of its check must be rows of "
            f"numbers separated by '/', got '{text(template, name)}'."
        ) from None
    total = np.zeros((modes.cos_rows.size, modes.cos_cols.size))
    for down, row in enumerate(rows):
        for east, weight in enumerate(row):
            both = (1.0 if down == 0 else 2.0) * (1.0 if east == 0 else 2.0)
            total += both * weight * _cosine(modes.cos_rows, down) * _cosine(modes.cos_cols, east)
    return total


def _cosine(cosine: Floats, times: int) -> Floats:
    """Return cos nk of cos k."""
    return np.asarray(np.cos(times * np.arccos(np.clip(cosine, -1.0, 1.0))), dtype=np.float64)


def _modes(template: Template, pictures: Floats) -> Modes:
    return modes(template.boundary, (pictures.shape[-2], pictures.shape[-1]))


def _case(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    """Draw pictures of that amplitude, small enough that no cell leaves the linear range."""
    pictures = gray(rng, shape, number(template, "amplitude", 0.5))
    time = number(template, "time", 0.0)
    bias = rng.permutation(pictures) if has(template, "bias") else None
    duration = time * time_constant(template) if time > 0.0 else None
    return Case(input=pictures, bias=bias, duration=duration)


def _grown(rate: Floats, time: float) -> Floats:
    """Return (e^{λt} − 1)/λ, which is t where λ is 0."""
    safe = np.where(np.abs(rate) < 1e-12, 1.0, rate)
    return np.asarray(np.where(safe == rate, np.expm1(rate * time) / safe, time))


def _course(template: Template, case: Case) -> Floats:
    modes, time = _modes(template, case.pictures), case.time(template)
    rate = symbol(template, "feedback", modes) - 1.0
    start = np.broadcast_to(case.start(template), case.pictures.shape)
    answer = modes.apply(np.asarray(start), np.exp(rate * time))
    answer = answer + modes.apply(
        case.pictures, symbol(template, "control", modes) * _grown(rate, time)
    )
    if case.bias is not None:
        answer = answer + modes.apply(case.bias, _grown(rate, time))
    return answer


def _late(template: Template, case: Case) -> Floats:
    """Follow x' = −x + w + K∗y(t − T) from x = 0: what is left to its rest has a constant past."""
    result = _modes(template, case.pictures)
    late = symbol(template, "late", result)
    apart = np.where(np.abs(1.0 - late) < 1e-9, 1e-9, 1.0 - late)
    delay = number(template, "delay") / time_constant(template)
    left = by_steps(-np.ones_like(late), late, delay, case.time(template))
    return result.apply(case.pictures, symbol(template, "control", result) * (1.0 - left) / apart)


def _pair(template: Template, case: Case) -> Floats:
    """Follow x' = −x + C∗u + K∗y, y' = x from rest: y'' + y' − Ky = Cu."""
    modes, time = _modes(template, case.pictures), case.time(template)
    drive = symbol(template, "control", modes)
    back = symbol(template, "back", modes).astype(complex)
    root = np.sqrt(0.25 + back + 0j)
    root = np.where(np.abs(root) < 1e-9, 1e-9, root)
    fast, slow = -0.5 - root, -0.5 + root
    # of y'' + y' − Ky = 1: x = y' is (e^{slow t} − e^{fast t})/(slow − fast)
    speed = (np.exp(slow * time) - np.exp(fast * time)) / (slow - fast)
    place = (_rise(slow, time) - _rise(fast, time)) / (slow - fast)
    both = [modes.apply(case.pictures, drive * factor.real) for factor in (speed, place)]
    return np.stack(both, axis=1)


def _rise(rate: Floats, time: float) -> Floats:
    safe = np.where(np.abs(rate) < 1e-12, 1.0, rate)
    return np.asarray(np.where(safe == rate, np.expm1(rate * time) / safe, time))


_TAKES = ("feedback", "control", "amplitude", "time", "bias")

COURSES_FORMS = (
    ClosedForm(
        "symmetric-course",
        _case,
        _course,
        ANALOG_TOLERANCE,
        ANALOG_REASON,
        "a symmetric coupling to neighbours and inputs in the linear range, mode by mode",
        takes=_TAKES,
        compares="state",
    ),
    ClosedForm(
        "late-inhibition",
        _case,
        _late,
        ANALOG_TOLERANCE,
        ANALOG_REASON,
        "a filter whose answer comes back a delay later, by the method of steps",
        needs=("control", "late", "delay"),
        takes=("amplitude", "time"),
        compares="state",
    ),
    ClosedForm(
        "layer-pair",
        _case,
        _pair,
        ANALOG_TOLERANCE,
        ANALOG_REASON,
        "a filter and the layer that sums its answer and inhibits it, mode by mode",
        needs=("control", "back"),
        takes=("amplitude", "time"),
        compares="state",
    ),
)


REFERENCE_RUN_TOLERANCE = 0.02
REASON = (
    "states may grow as e^7 on the way, and errors of 1e-5 of a step with them; templates that "
    "only decay come within 1e-4"
)
JUMP_TOLERANCE = 0.1
JUMP_REASON = (
    "where tables jump, an engine's steps of 0.01 leave a cell a few steps late, at rates up to 3"
)
_STEP = 0.002


def _reference_run_case(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    pictures = gray(rng, shape, 0.9)
    state = np.repeat(pictures[:, np.newaxis], template.layers, axis=1)
    single = template.layers == 1
    return Case(
        input=pictures if template.inputs else None,
        state=0.5 * (state[:, 0] if single else state),
        duration=number(template, "time") * float(template.tau.max()),
    )


def _seen(maps: Floats, boundary: Boundary, radius: int) -> Floats:
    """Return every cell's neighbourhood: (..., k, k) views of (..., rows, cols)."""
    rim = [(0, 0)] * (maps.ndim - 2) + [(radius, radius)] * 2
    if boundary.constant is None:
        padded = np.pad(maps, rim, mode=boundary.pad_mode)
    else:
        padded = np.pad(maps, rim, constant_values=boundary.constant)
    size = 2 * radius + 1
    return np.lib.stride_tricks.sliding_window_view(padded, (size, size), (-2, -1))


def _sum(kernels: Floats, maps: Floats, boundary: Boundary) -> Floats:
    """Sum kernels (to, from, k, k) over maps (pictures, from, rows, cols)."""
    if not kernels.any():
        return np.zeros((len(maps), len(kernels), *maps.shape[-2:]))
    seen = _seen(maps, boundary, kernels.shape[-1] // 2)
    total: Floats = np.einsum("pfrcij,tfij->ptrc", seen, kernels, optimize=True)
    return total


class Equation:
    """The rates of a template without delays, from its definition."""

    def __init__(self, template: Template, inputs: Floats) -> None:
        self.template, self.inputs = template, inputs
        drive = template.z[:, np.newaxis, np.newaxis]
        self.drive = drive + _sum(template.B, inputs, template.input_boundary)

    def __call__(self, x: Floats) -> Floats:
        """Return dx/dt of states (pictures, layers, rows, cols)."""
        template = self.template
        y = template.output.numpy(x)
        rate = self.drive - x + _sum(template.A, y, template.boundary)
        maps = {"x": x, "y": y, "u": self.inputs}
        for coupling in template.nonlinear:
            edge = template.input_boundary if coupling.neighbour == "u" else template.boundary
            radius = coupling.weights.shape[0] // 2
            seen = _seen(maps[coupling.neighbour][:, coupling.source], edge, radius)
            own = maps[coupling.centre or "x"][:, coupling.centre_source, ..., None, None]
            weighed = coupling.weights * coupling.value(own, seen)
            rate[:, coupling.to] += weighed.sum(axis=(-2, -1))
        return np.asarray(rate / template.tau[:, np.newaxis, np.newaxis])


def _layered(maps: Floats) -> Floats:
    return maps[:, np.newaxis] if maps.ndim == 3 else maps


def _expected(template: Template, case: Case) -> Floats:
    start, time = _layered(case.states), case.length(template)
    given = np.zeros_like(start[:, :0]) if case.input is None else _layered(case.input)
    equation = Equation(template, given)
    if jumps(template):
        x = start
        for _ in range(round(time / _STEP)):
            x = x + _STEP * equation(x)
    else:
        x = refined(equation, start, time, 1e-7)
    return x[:, 0] if template.layers == 1 else x


REFERENCE_RUN_FORMS = (
    ClosedForm(
        "refined",
        _reference_run_case,
        _expected,
        REFERENCE_RUN_TOLERANCE,
        REASON,
        "the template's own equation, solved with small steps: weaker than a definition",
        needs=("time",),
        compares="state",
        rtol=1e-5,
    ),
    ClosedForm(
        "refined-jumps",
        _reference_run_case,
        _expected,
        JUMP_TOLERANCE,
        JUMP_REASON,
        "the template's own equation, whose rates jump, solved with small steps: weaker still",
        needs=("time",),
        compares="state",
    ),
)

FORMS = (*DELAYS_FORMS, *CELL_FORMS, *RAMPS_FORMS, *COURSES_FORMS, *REFERENCE_RUN_FORMS)
