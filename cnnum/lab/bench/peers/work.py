"""One array's work, in plain terms that every peer understands."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.templating.template import Template


@dataclass(frozen=True, slots=True, eq=False)
class Work:
    """x' = −x + A ∗ f(x) + w on one layer, from x₀ for a time, f clipping to [−1, 1] or f(x) = x.

    Attributes
    ----------
    template : Template
        Of one layer; its boundary is a constant or zero-flux.
    start : (rows, cols) float
        x₀.
    input : (rows, cols) float
        0 where the template has no control.
    duration, step : float
        Time constants; the step is that of the fixed steps.
    tolerance : float
        Relative and absolute, of methods that control their error.
    dtype : dtype
        Number type of a peer that has a choice.
    """

    template: Template
    start: Floats
    input: Floats
    duration: float
    step: float
    tolerance: float
    dtype: np.dtype[np.floating]

    @property
    def feedback(self) -> Floats:
        """A, (k, k)."""
        return np.asarray(self.template.A[0, 0])

    @property
    def control(self) -> Floats:
        """B, as large as A, as some peers want it; zeros where there is none."""
        same = np.zeros_like(self.feedback)
        if self.template.inputs:
            given = self.template.B[0, 0]
            rim = (same.shape[0] - given.shape[0]) // 2
            same[rim : same.shape[0] - rim, rim : same.shape[1] - rim] = given
        return same

    @property
    def bias(self) -> float:
        """The template's z."""
        return float(self.template.z[0])

    @property
    def rim(self) -> float:
        """State of virtual cells, where they are constant."""
        return self.template.boundary.constant or 0.0

    @property
    def mirrored(self) -> bool:
        """Whether the boundary is zero-flux."""
        return self.template.boundary.constant is None

    @property
    def linear(self) -> bool:
        """Whether f(x) = x."""
        return self.template.output.linear

    @property
    def steps(self) -> int:
        """Number of fixed steps."""
        return round(self.duration / self.step)

    def output(self, state: NDArray[np.floating]) -> NDArray[np.floating]:
        """Return y = f(x)."""
        return state if self.linear else np.clip(state, -1.0, 1.0)
