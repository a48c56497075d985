"""An independent simulator of cell arrays: scipy.ndimage and small Runge–Kutta steps in float64.

It shares nothing with the engines: it pads through scipy's own modes, couples through
scipy.ndimage.correlate, and takes fixed steps far below the stability bound.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from scipy import ndimage

from cnnum.arrays import Floats
from cnnum.boundary import Boundary
from cnnum.template import Duration, Template

SETTLED = 1e-7
MODES = {"symmetric": "reflect", "wrap": "wrap", "constant": "constant"}


@dataclass(frozen=True, slots=True)
class Run:
    output: Floats
    state: Floats
    time: float
    settled: bool
    method: str = "small-step RK4"


@dataclass(frozen=True, slots=True)
class Simulator:
    """The interface of an engine, for one layer and any number of inputs."""

    limit: float = 400.0
    name: str = "simulator"
    precision: str = "float64"

    def run(
        self,
        template: Template,
        *,
        input: Floats | None = None,
        state: Floats | None = None,
        bias: Floats | None = None,
        mask: Floats | None = None,
        duration: Duration | None = None,
        method: str = "auto",
    ) -> Run:
        assert mask is None
        slope = derivative(template, input, bias)
        x = start(template, input, state)
        wanted = template.duration if duration is None else duration
        end = self.limit if wanted == "settle" else float(wanted)
        steps = max(int(np.ceil(end * 5.0 * (1.0 + np.abs(template.A).sum()))), 20)
        for n in range(steps):
            if wanted == "settle" and n % 16 == 0 and np.abs(slope(x)).max() < SETTLED:
                return Run(template.output.numpy(x), x, n * end / steps, settled=True)
            x = runge_kutta(slope, x, end / steps)
        return Run(template.output.numpy(x), x, end, settled=False)


def start(template: Template, given: Floats | None, state: Floats | None) -> Floats:
    if state is not None:
        return state
    assert given is not None
    if template.initial == "input":
        return given
    rows_and_cols = given.shape[-2:]
    return np.full((given.shape[0], *rows_and_cols), float(template.initial))


def derivative(
    template: Template, given: Floats | None, bias: Floats | None
) -> Callable[[Floats], Floats]:
    drive: Floats | float = template.z[0] if bias is None else template.z[0] + bias
    for n in range(template.inputs):
        assert given is not None
        picture = given if template.inputs == 1 else given[:, n]
        drive = drive + couple(template.B[0, n], picture, template.input_boundary)
    f, feedback, rim = template.output.numpy, template.A[0, 0], template.boundary

    def slope(x: Floats) -> Floats:
        return (drive + couple(feedback, f(x), rim) - x) / template.tau[0]

    return slope


def couple(kernel: Floats, pictures: Floats, boundary: Boundary) -> Floats:
    return ndimage.correlate(
        pictures, kernel[np.newaxis], mode=MODES[boundary.pad_mode], cval=boundary.constant or 0.0
    )


def runge_kutta(slope: Callable[[Floats], Floats], x: Floats, h: float) -> Floats:
    k1 = slope(x)
    k2 = slope(x + h / 2 * k1)
    k3 = slope(x + h / 2 * k2)
    k4 = slope(x + h * k3)
    return x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


@pytest.fixture(scope="session")
def simulator() -> Simulator:
    return Simulator()


@pytest.fixture(scope="session")
def hasty_simulator() -> Simulator:
    """Gives up early: for templates that may never settle."""
    return Simulator(limit=40.0)
