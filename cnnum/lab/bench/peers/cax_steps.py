"""Euler's steps as a complex system of CAX: its convolution perceives, and its scan takes steps."""

from functools import cache
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cnnum.lab.bench.peers.work import Work

jax: Any = import_module("jax")
jnp: Any = import_module("jax.numpy")
nnx: Any = import_module("flax.nnx")
cax: Any = import_module("cax.core")
perceive: Any = import_module("cax.core.perceive")


@cache
def _system(size: int, mirrored: bool, rim: float, linear: bool, double: bool) -> Any:
    """Return the system of a form; CAX compiles it for each size and number of steps."""
    radius, dtype = size // 2, jnp.float64 if double else jnp.float32
    how: dict[str, Any] = {"mode": "symmetric"} if mirrored else {"constant_values": rim}

    class Euler(cax.ComplexSystem):  # type: ignore[misc]
        """x' = −x + A ∗ f(x) + w, a cell's neighbours being perceived by a convolution."""

        def __init__(self) -> None:
            self.neighbours = perceive.ConvPerceive(
                1, 1, kernel_size=(size, size), padding="VALID", rngs=nnx.Rngs(0)
            )

        def weigh(self, kernel: NDArray[np.floating]) -> None:
            """Take the weights of A."""
            self.neighbours.conv.kernel[...] = jnp.asarray(kernel, dtype)[:, :, None, None]

        def _step(self, state: Any, input: Any = None, *, sow: bool = False) -> Any:
            drive, h = input
            y = state if linear else jnp.clip(state, -1.0, 1.0)
            padded = jnp.pad(y, ((radius, radius), (radius, radius), (0, 0)), **how)
            return state + h * (self.neighbours(padded) + drive - state)

    system = Euler()
    # its first weights are random numbers, of float32
    system.neighbours.conv.kernel = nnx.Param(jnp.zeros((size, size, 1, 1), dtype))
    return system


def run(work: Work) -> NDArray[np.floating]:
    """Return the state at the end."""
    double = work.dtype == np.dtype(np.float64)
    size = work.feedback.shape[0]
    radius, (rows, cols) = size // 2, work.start.shape
    how: dict[str, Any] = {"mode": "symmetric"} if work.mirrored else {"constant_values": work.rim}
    given = np.pad(work.input, radius, **how)
    drive = np.full((rows, cols), work.bias)
    for (r, c), weight in np.ndenumerate(work.control):
        drive += weight * given[r : r + rows, c : c + cols]
    with jax.enable_x64(double):
        system = _system(size, work.mirrored, work.rim, work.linear, double)
        system.weigh(work.feedback)
        start, w = (jnp.asarray(maps, work.dtype)[..., None] for maps in (work.start, drive))
        ended = system(start, (w, work.dtype.type(work.step)), num_steps=work.steps)
        return np.asarray(ended)[..., 0]
