"""One transient in float64: the state equation in NumPy, solved by SciPy far below its tolerance.

Written from the state equation alone; shares no neighbourhood code with the other engines
(`scipy.ndimage.correlate` here), so that agreement means something.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.ndimage import correlate

from cnnum.arrays import Floats
from cnnum.boundary import Boundary
from cnnum.errors import MethodError
from cnnum.integrators.choice import FixedSteps, Solver
from cnnum.integrators.tableau import Row
from cnnum.template import Template

_Mode = Literal["constant", "reflect", "grid-wrap"]
_NDIMAGE_MODES: dict[str, _Mode] = {
    "constant": "constant",
    "symmetric": "reflect",
    "wrap": "grid-wrap",
}


@dataclass(frozen=True, slots=True)
class Settings:
    """How long a transient runs and how exactly.

    Attributes
    ----------
    duration : float
        In time constants; a limit where it settles.
    settle : bool
    rtol, atol : float
        What "settled" means; the solver itself works at `PRECISION`.
    fixed : FixedSteps or None
        Steps that were asked for and are taken as they are.
    """

    duration: float
    settle: bool
    rtol: float
    atol: float
    fixed: FixedSteps | None

    @classmethod
    def of(cls, solver: Solver) -> "Settings":
        """Return the settings that a chosen solver stands for."""
        fixed = solver.scheme if isinstance(solver.scheme, FixedSteps) else None
        return cls(solver.duration, solver.settle, solver.rtol, solver.atol, fixed)


PRECISION = 1e-10
"""Relative tolerance of the solver; kinks of f cost steps, not accuracy."""


@dataclass(frozen=True, slots=True, eq=False)
class StateEquation:
    """dx/dt of one frame, flattened."""

    template: Template
    drive: Floats
    held: NDArray[np.bool_] | None

    @property
    def layers_shape(self) -> tuple[int, ...]:
        """(layers, rows, cols)."""
        return self.drive.shape

    def __call__(self, _time: float, flat: Floats) -> Floats:
        """Return dx/dt."""
        template = self.template
        x = flat.reshape(self.layers_shape)
        y = template.output.numpy(x)
        edge = None
        if template.boundary.constant is not None:
            edge = float(template.output.numpy(np.asarray(template.boundary.constant)))
        rate = self.drive - x + _couple(template.A, y, template.boundary, edge)
        rate = rate / template.tau[:, np.newaxis, np.newaxis]
        if template.output.limited:
            outward = ((x >= 1.0) & (rate > 0.0)) | ((x <= -1.0) & (rate < 0.0))
            rate = np.where(outward, 0.0, rate)
        if self.held is not None:
            rate = np.where(self.held, 0.0, rate)
        return rate.ravel()


def _couple(kernels: Floats, maps: Floats, boundary: Boundary, edge: float | None) -> Floats:
    mode = _NDIMAGE_MODES[boundary.pad_mode]
    total = np.zeros((kernels.shape[0], *maps.shape[1:]))
    for to in range(kernels.shape[0]):
        for source in range(kernels.shape[1]):
            if kernels[to, source].any():
                total[to] += correlate(
                    maps[source], kernels[to, source], mode=mode, cval=edge or 0.0
                )
    return total


def solve_transient(
    template: Template,
    shape: tuple[int, int],
    settings: Settings,
    inputs: Floats | None,
    state: Floats | None,
    bias: Floats | None,
    held: NDArray[np.bool_] | None,
) -> dict[str, Floats]:
    """Return the end of a transient.

    Parameters
    ----------
    template : Template
    shape : (rows, cols)
    settings : Settings
    inputs, state, bias : (maps, rows, cols) float or None
    held : (rows, cols) bool or None
        Fixed-state mask.

    Returns
    -------
    dict
        "output" and "state" as (layers, rows, cols); "time", "steps", "settled", "error".
    """
    equation = StateEquation(template, _drive(template, shape, inputs, bias), held)
    start = _start(template, shape, inputs, state)
    if settings.fixed is not None:
        end, time, steps = _march(equation, start, settings, settings.fixed)
    else:
        end, time, steps = _integrate(equation, start, settings)
    final = end.reshape(start.shape)
    known = settings.fixed is None
    return {
        "output": template.output.numpy(final),
        "state": final,
        "time": np.asarray(time),
        "steps": np.asarray(float(steps)),
        "settled": np.asarray(float(_change(equation, end, settings) <= 1.0)),
        "error": np.asarray(PRECISION * (1.0 + float(np.abs(final).max())) if known else -1.0),
    }


def _drive(
    template: Template, shape: tuple[int, int], inputs: Floats | None, bias: Floats | None
) -> Floats:
    drive = np.broadcast_to(template.z[:, np.newaxis, np.newaxis], (template.layers, *shape)).copy()
    if inputs is not None:
        edge = template.input_boundary.constant
        drive += _couple(template.B, inputs, template.input_boundary, edge)
    return drive if bias is None else drive + bias


def _start(
    template: Template, shape: tuple[int, int], inputs: Floats | None, state: Floats | None
) -> Floats:
    if state is not None:
        return np.array(state)
    if template.initial == "input":
        assert inputs is not None
        return np.array(inputs)
    return np.full((template.layers, *shape), float(template.initial))


def _change(equation: StateEquation, flat: Floats, settings: Settings) -> float:
    return _relative_change(equation, equation(0.0, flat), flat, settings)


def _relative_change(
    equation: StateEquation, rate: Floats, flat: Floats, settings: Settings
) -> float:
    """Return the largest rate in units of the tolerance."""
    slowest = float(equation.template.tau.max())
    scale = settings.atol + settings.rtol * np.abs(flat)
    return float((np.abs(slowest * rate) / scale).max())


def _integrate(
    equation: StateEquation, start: Floats, settings: Settings
) -> tuple[Floats, float, int]:
    """Run SciPy's Dormand–Prince 8(5,3); to equilibrium in stretches that double."""
    flat, time, steps, stretch = start.ravel(), 0.0, 0, settings.duration
    if settings.settle:
        # well below the tolerance that is asked for, so that what is left does not count
        settings = Settings(
            settings.duration, True, 1e-3 * settings.rtol, 1e-3 * settings.atol, None
        )
        stretch = 4.0
    while time < settings.duration:
        stretch = min(stretch, settings.duration - time)
        solution = solve_ivp(
            equation, (0.0, stretch), flat, method="DOP853", rtol=PRECISION, atol=PRECISION
        )
        if not solution.success:
            raise MethodError(f"The reference solver stopped: {solution.message}")
        flat, time, steps = solution.y[:, -1], time + stretch, steps + len(solution.t) - 1
        if settings.settle and _change(equation, flat, settings) <= 1.0:
            break
        stretch *= 2.0
    return flat, time, steps


def _march(
    equation: StateEquation, start: Floats, settings: Settings, scheme: FixedSteps
) -> tuple[Floats, float, int]:
    """Take fixed steps of an explicit method, as they were asked for."""
    flat, method = start.ravel(), scheme.tableau
    for step in range(scheme.count):
        stages: list[Floats] = []
        for row in method.a:
            moved = flat + scheme.step * _combined(row, stages, flat)
            stages.append(equation(0.0, _limited(equation, moved)))
        change = _relative_change(equation, stages[0], flat, settings)
        flat = _limited(equation, flat + scheme.step * _combined(method.b, stages, flat))
        if scheme.settle and change <= 1.0:
            return flat, (step + 1) * scheme.step, step + 1
    return flat, scheme.count * scheme.step, scheme.count


def _combined(weights: Row, stages: list[Floats], like: Floats) -> Floats:
    total = np.zeros_like(like)
    for weight, stage in zip(weights, stages, strict=True):
        total += float(weight) * stage
    return total


def _limited(equation: StateEquation, flat: Floats) -> Floats:
    return np.clip(flat, -1.0, 1.0) if equation.template.output.limited else flat
