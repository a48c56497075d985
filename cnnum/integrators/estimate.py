"""How the error of a run is estimated: the share of each step, and the growth of earlier ones.

An error e of the state follows e' = J e, J being the array's Jacobian along the run. So does the
rate dx/dt of an array that nothing moves from outside, as x'' = J x': the change of the largest
rate over a step is a sample of an error's change. A cell passes its error on by f', so rates count
by it: those of saturated cells are the largest of most pictures, fall as the cells come to rest,
and would hide that errors grow in the others. Where the rates fall the change is taken for 1, as an
error may lie in another direction. The logarithmic norm μ∞(J) bounds it from above:

    E⁺ = E · g + added · max(g, 1)^{1/(p+2)},   g = min(max(‖f'k⁺‖ / ‖f'k‖, 1), e^{μh})

(Hairer, Nørsett & Wanner, Solving ODEs I, section I.10: the bound alone is rigorous; for an array
that decides it is astronomic). The share of a step is the leading part of its own truncation error.
It comes from the stages: `ButcherTableau.truncation`, and `ExponentialMethod.followed`. What is
left out of e^z − R(z) of a growing mode is at most e^{z/(p+2)} − 1 of its leading part, p being
the order: Σ_n z^n (p+1)!/(p+1+n)! ≤ e^{z/(p+2)}.
"""

import numpy as np

from cnnum.arrays import Floats
from cnnum.templating.network import reads_states, widened
from cnnum.templating.template import Template

SAFETY = 3.0
"""Of the sum over steps: an error may grow in a direction in which the state does not move. With
1.5 one in 60 random networks had a frame whose error was missed, with 2.5 a linear one in some
2,000 by a hundredth. Where corners of f are crossed it is more, as `AdaptiveSteps.safety` has
it."""

FLOOR = 0.03
"""Share of `atol` that is stated at least of a run by steps. The share of a step is that of a
linear array: where f is curved it may vanish by chance, far below the tolerance. With 0.01 one in
8,000 random networks stated too little, by a twentieth."""

LOST = 1e30
"""An error that says that nothing is known of it: of fixed steps, or any more, as on a cycle that
never rests it grows without end. Above every tolerance, and twice as much is a float32, too."""

ROUNDINGS = 4.0
"""Of a step: those of its sum and of the rates in it, as parts of the state."""

SMALLEST_RATE = 1e-30
"""Taken for the largest rate of an array at rest, in 1/time."""

AROUND = 2.0**-6
"""f' of a state is the mean slope of f from so far below it to so far above: 1/64 of the linear
range, and far above the roundings of float32."""

LEAST_SLOPE = 1e-3
"""Taken for f' where f is flat: an array all of whose cells are saturated moves on, too."""


def slopes_count(template: Template) -> bool:
    """Return whether f' scales the rates, which it does not if it is 1 or couplings read states."""
    return not (template.output.linear or reads_states(template))


def error_growth(template: Template) -> float:
    """Return a bound on the logarithmic norm of an array's Jacobian, whatever cells saturate.

    Errors grow by e^{μt} at most, 1/time; μ is negative where the array contracts. It is the
    largest of (−1 + a_ii d_i + Σ |a_ij| d_j) / τ over the rows. Here d = f' is any slope that the
    output has.
    """
    own, others = _own_and_others(template)
    others += widened(template)
    return float(((own + others - 1.0) / template.tau).max())


def delayed_growth(template: Template) -> float:
    """Return a bound on the growth rate of the states of a template with a delay, 1/time."""
    assert template.delayed is not None
    late = np.abs(template.delayed.A).sum(axis=(1, 2, 3)) * template.output.steepest
    return error_growth(template) + float((late / template.tau).max())


def linear_growth(template: Template) -> float:
    """Return the same bound for the linear couplings A alone."""
    own, others = _own_and_others(template)
    return float(((own + others - 1.0) / template.tau).max())


def _own_and_others(template: Template) -> tuple[Floats, Floats]:
    """Return the largest couplings of a cell of each layer to itself, and to others."""
    own = np.einsum("llkk->lk", template.A)[:, template.A.shape[-1] // 2]
    others = np.abs(template.A).sum(axis=(1, 2, 3)) - np.abs(own)
    low, high = template.output.slope
    return np.maximum(low * own, high * own), template.output.steepest * others
