"""Methods with numbers of their own in every layer: the registry of such integrators."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.integrators.exponential import ETD_RK2, EXPONENTIAL_EULER
from cnnum.integrators.tableau import Explicit, Pair


class LayerMethod(Protocol):
    """An integrator that says, of a step and a time constant, which sums of rates a step is.

    Engines see its steps alone, so that they run one that they have never heard of.
    """

    @property
    def name(self) -> str:
        """What `method` names it by."""
        ...

    @property
    def order(self) -> int:
        """Order of the error of a run."""
        ...

    def fixed(self, step: float, tau: float) -> Explicit:
        """Return a step of a layer."""
        ...

    def followed(self, step: float, tau: float) -> Pair:
        """Return the same step with stages that tell its error."""
        ...

    def growth(self, steps: Floats, values: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Return the factors of modes a step, (steps, modes), where 1/τ = 1 and J has `values`."""
        ...


LAYER_METHODS: dict[str, LayerMethod] = {m.name: m for m in (EXPONENTIAL_EULER, ETD_RK2)}
"""By their names: another one is a record here."""
