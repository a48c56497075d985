"""The peers by name: their function, the needed package, and their way of stepping."""

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from typing import cast

import numpy as np
from numpy.typing import NDArray

from cnnum.errors import MissingExtraError, missing_extra
from cnnum.lab.bench.peers.work import Work

Run = Callable[[Work], NDArray[np.floating]]


@dataclass(frozen=True, slots=True)
class Peer:
    """A peer.

    Attributes
    ----------
    name, package : str
    module : str
        Holds ``run(work)``, which returns the state at the end.
    fixed : bool
        It takes Euler's steps of the length asked for; else it controls its own error.
    slow : bool
        On large arrays a run takes seconds.
    extra : str
        Extra that installs the package.
    whole : bool
        It compiles for every number of steps: the whole work warms it, not a few steps.
    """

    name: str
    package: str
    module: str
    fixed: bool = True
    slow: bool = False
    extra: str = "peers"
    whole: bool = False

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
        return cast(Run, module.run)


PEERS = (
    Peer("celnn", "celnn", "celnn_network", slow=True),
    Peer("SciPy ndimage", "scipy", "ndimage_steps", slow=True),
    Peer("OpenCV filter2D", "opencv-python-headless", "opencv_steps"),
    Peer("Numba stencil", "numba", "numba_stencil"),
    Peer("JAX", "jax", "jax_steps", extra="race"),
    Peer("CAX", "cax", "cax_steps", slow=True, extra="race", whole=True),
    Peer("Taichi", "taichi", "taichi_steps", extra="race"),
    Peer("convolve2d + vode", "scipy", "vode", fixed=False, slow=True),
)


def peer_version(peer: Peer) -> str:
    """Return the version of a peer's package, empty if it is not installed."""
    try:
        return version(peer.package)
    except PackageNotFoundError:
        return ""
