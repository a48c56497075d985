"""A refined solution of a template's own equation: it shows that an engine runs it right, no more.

This is the weaker kind of check, for templates whose answer nothing else defines: unlike every
other it is computed from the template's weights, by its own sums and SciPy's integrator.
"""

import numpy as np

from cnnum.arrays import Floats, Shape
from cnnum.templating.boundary import Boundary
from cnnum.templating.checks.analytic.refined import refined
from cnnum.templating.checks.parameters import number
from cnnum.templating.checks.pictures import gray
from cnnum.templating.checks.records import Case, ClosedForm
from cnnum.templating.reads import jumps
from cnnum.templating.template import Template

TOLERANCE = 0.02
REASON = (
    "states may grow as e^7 on the way, and errors of 1e-5 of a step with them; templates that "
    "only decay come within 1e-4"
)
JUMP_TOLERANCE = 0.1
JUMP_REASON = (
    "where tables jump, an engine's steps of 0.01 leave a cell a few steps late, at rates up to 3"
)
_STEP = 0.002


def _case(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    pictures = gray(rng, shape, 0.9)
    state = np.repeat(pictures[:, np.newaxis], template.layers, axis=1)
    one = template.layers == 1
    return Case(
        input=pictures if template.inputs else None,
        state=0.5 * (state[:, 0] if one else state),
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


FORMS = (
    ClosedForm(
        "refined",
        _case,
        _expected,
        TOLERANCE,
        REASON,
        "the template's own equation, solved with small steps: weaker than a definition",
        needs=("time",),
        compares="state",
        rtol=1e-5,
    ),
    ClosedForm(
        "refined-jumps",
        _case,
        _expected,
        JUMP_TOLERANCE,
        JUMP_REASON,
        "the template's own equation, whose rates jump, solved with small steps: weaker still",
        needs=("time",),
        compares="state",
    ),
)
