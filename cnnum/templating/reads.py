"""The maps that the couplings of a template read, and by how much they may change a rate.

Engines and integrators ask here, so that a new kind of coupling answers here alone.
"""

import numpy as np

from cnnum.arrays import Floats
from cnnum.templating.couplings import NonlinearCoupling, Quantity
from cnnum.templating.template import Template


def _read_by(coupling: NonlinearCoupling, quantity: Quantity) -> bool:
    return quantity in (coupling.neighbour, coupling.centre)


def reads_states(template: Template) -> bool:
    """Return whether a coupling reads the states (not outputs) of cells."""
    return any(_read_by(coupling, "x") for coupling in template.nonlinear)


def reads_outputs(template: Template) -> bool:
    """Return whether a coupling reads the outputs of cells."""
    return bool(template.A.any()) or any(_read_by(c, "y") for c in template.nonlinear)


def reads_inputs(template: Template) -> bool:
    """Return whether a coupling reads inputs."""
    return bool(template.B.any()) or reads_inputs_around(template)


def reads_inputs_around(template: Template) -> bool:
    """Return whether any cell is driven by its neighbours' inputs."""
    radius = template.B.shape[-1] // 2
    around = template.B.copy()
    around[..., radius, radius] = 0.0
    couples = any(_read_by(coupling, "u") for coupling in template.nonlinear)
    return bool(around.any()) or delays_inputs(template) or couples


def moving_inputs(template: Template) -> list[int]:
    """Return the inputs that the cells go on reading as their states change."""
    moving = [coupling for coupling in template.nonlinear if not coupling.static]
    found = {coupling.source for coupling in moving if coupling.neighbour == "u"}
    return sorted(found | {c.centre_source for c in moving if c.centre == "u"})


def delays_outputs(template: Template) -> bool:
    """Return whether the template has a delayed A."""
    return template.delayed is not None and bool(template.delayed.A.any())


def delays_inputs(template: Template) -> bool:
    """Return whether the template has a delayed B."""
    return template.delayed is not None and bool(template.delayed.B.any())


def lag(template: Template, step: float) -> int:
    """Return the delay in steps, 0 without one."""
    return 0 if template.delayed is None else round(template.delayed.delay / step)


def jumps(template: Template) -> bool:
    """Return whether rates jump as states change, which no error estimate follows."""
    return any(coupling.jumps for coupling in template.nonlinear)


def bends(template: Template) -> bool:
    """Return whether rates may bend as states change: tables have corners, as some outputs do."""
    return not template.output.smooth or any(not c.static for c in template.nonlinear)


def autonomous(template: Template) -> bool:
    """Return whether a run may begin anew at any time: nothing is delayed or varies in time."""
    return template.delayed is None and not template.gains


def turning_points(template: Template, duration: float) -> tuple[float, ...]:
    """Return the times within a duration at which a gain jumps or bends: no step may cross one."""
    places = {place for gain in template.gains for place, _ in gain.table.points}
    return tuple(sorted(place for place in places if 0.0 < place < duration))


def gains_jump(template: Template) -> bool:
    """Return whether a gain in time is one of steps: at a point it has two values."""
    return any(gain.table.interpolation == "constant" for gain in template.gains)


def widened(template: Template) -> Floats:
    """Return by how much |dx/dt|·τ of each layer may change more than by A, (layers,)."""
    total = np.zeros(template.layers)
    for gain in template.gains:
        weights = float(np.abs(template.A[gain.to, gain.source]).sum())
        total[gain.to] += max(gain.table.largest - 1.0, 0.0) * weights
    total *= template.output.steepest
    for coupling in template.nonlinear:
        total[coupling.to] += coupling.stiffness
    return total
