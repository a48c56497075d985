"""No time stepping where cells see only themselves: three linear pieces, one after the other.

τ x' = −x + a f(x) + w with f(x) = (|x + 1| − |x − 1|)/2 is linear below −1, between, and above 1.
A state moves one way only, so that it passes each piece once at most, and all is said with
d = e^{−t/τ}, what is left of a decay:

* outside, towards e = w + a s (s = ±1 the side): x = e + (x₀ − e) d. It comes to s, if e lies
  inside of s, when d = (s − e)/(x₀ − e).
* between, with the rate g(x) = (a − 1) x + w: x = x₀ + g(x₀) (d^{1−a} − 1)/(a − 1). It comes to
  b = sign g, if g(b) has g's sign, when d = (g(x₀)/g(b))^{1/(a−1)}; for a = 1, e^{−(b−x₀)/g}.
"""

from dataclasses import dataclass

import numpy as np

from cnnum.arrays import Floats
from cnnum.template import Template

LONGEST = 60.0
"""Time constants up to which what is left of a decay, e^{−60} = 9e-27, is far from what a device
takes for 0; longer runs that are not to equilibrium take steps."""


@dataclass(frozen=True, slots=True, eq=False)
class Separate:
    """Cells that see only themselves, with the standard output function.

    Attributes
    ----------
    own : (layers,) float
        a of every layer.
    left : (layers,) float
        e^{−t/τ} at the end of every layer; 0 at equilibrium.
    """

    own: Floats
    left: Floats


def separate(template: Template, duration: float) -> Separate | None:
    """Return the exact answer after `duration` (infinite: equilibrium), None where there is none.

    There is none where a cell sees another one or f is another, where a run is too long, and at
    equilibrium for a = 1, whose cells may rest anywhere.
    """
    middle = template.A.shape[-1] // 2
    own = np.array([template.A[n, n, middle, middle] for n in range(template.layers)])
    alone = np.count_nonzero(template.A) == np.count_nonzero(own)
    if not (alone and template.plain and template.output.name == "standard"):
        return None
    settles = bool(np.isinf(duration))
    if (settles and (own == 1.0).any()) or (
        not settles and duration > LONGEST * template.tau.min()
    ):
        return None
    with np.errstate(under="ignore"):
        return Separate(own, np.exp(-duration / template.tau))
