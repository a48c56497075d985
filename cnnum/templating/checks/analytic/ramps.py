"""A chain of leaky cells behind a signal that rises steadily: exact, by partial fractions.

The first layer is the signal itself, u = u₀ + v t. Each of `stages` layers follows what the one
before it leaves, with the time constant `slow`, and takes it off: a high-pass. The last layer
follows the rest with `quick`: a low-pass.
"""

import numpy as np

from cnnum.arrays import Floats, Shape
from cnnum.tactile.receptors import ramp
from cnnum.templating.checks.parameters import number
from cnnum.templating.checks.pictures import with_even
from cnnum.templating.checks.records import Case, ClosedForm
from cnnum.templating.template import Template

TOLERANCE = 1e-5
"""Of signals of order 1 in single precision, whose layers are differences of them."""


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


FORMS = (
    ClosedForm(
        "ramp",
        _ramp,
        _risen,
        TOLERANCE,
        "layers are differences of signals of order 1, in single precision",
        "leaky cells in a row behind a signal that rises steadily, by partial fractions",
        needs=("stages", "quick"),
        takes=("slow",),
        compares="state",
    ),
)
