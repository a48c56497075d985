"""The work of a race in plain terms that every peer understands, and the peers by name."""

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from typing import cast

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.errors import MissingExtraError, missing_extra
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


Run = Callable[[Work], NDArray[np.floating]]


@dataclass(frozen=True, slots=True)
class Peer:
    """A peer.

    Attributes
    ----------
    name, package : str
    module : str
        Holds the function, which takes the work and returns the state at the end.
    fixed : bool
        It takes Euler's steps of the length asked for; else it controls its own error.
    slow : bool
        On large arrays a run takes seconds.
    extra : str
        Extra that installs the package.
    whole : bool
        It compiles for every number of steps: the whole work warms it, not a few steps.
    function : str
    """

    name: str
    package: str
    module: str
    fixed: bool = True
    slow: bool = False
    extra: str = "peers"
    whole: bool = False
    function: str = "run"

    def load(self) -> Run:
        """Return its function.

        Raises
        ------
        MissingExtraError
            If its package is not installed, or cannot be imported.
        """
        try:
            module = import_module(f"cnnum.lab.bench.peers.{self.module}")
        except ModuleNotFoundError:
            raise missing_extra(f"peer '{self.name}'", self.package, self.extra) from None
        except ImportError as error:
            raise MissingExtraError(
                f"Peer '{self.name}': '{self.package}' cannot be imported ({error})."
            ) from error
        return cast(Run, getattr(module, self.function))


PEERS = (
    Peer("celnn", "celnn", "celnn_network", slow=True),
    Peer("SciPy ndimage", "scipy", "scipy_ways", slow=True, function="by_ndimage"),
    Peer("OpenCV filter2D", "opencv-python-headless", "opencv_steps"),
    Peer("Numba stencil", "numba", "numba_stencil"),
    Peer("JAX", "jax", "jax_steps", extra="race"),
    Peer("CAX", "cax", "cax_steps", slow=True, extra="race", whole=True),
    Peer("Taichi", "taichi", "taichi_steps", extra="race"),
    Peer("convolve2d + vode", "scipy", "scipy_ways", fixed=False, slow=True, function="by_vode"),
)


def peer_version(peer: Peer) -> str:
    """Return the version of a peer's package, empty if it is not installed."""
    try:
        return version(peer.package)
    except PackageNotFoundError:
        return ""
