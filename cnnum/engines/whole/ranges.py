"""The streams on which an engine in whole numbers measures the range of every value."""

from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from cnnum.arrays import finite
from cnnum.engines.backend import Backend
from cnnum.engines.whole import WholeBackend
from cnnum.errors import ArrayError, ProgramError

if TYPE_CHECKING:
    from collections.abc import Sequence


def measuring(backend: Backend, like: ArrayLike, trailing: "Sequence[int]") -> Backend:
    """Return an engine that measures ranges on streams.

    Parameters
    ----------
    backend : Backend
    like : (frames, ..., rows, cols, channels) float
    trailing : (rows, cols, channels)

    Raises
    ------
    ProgramError
        If the engine counts in real numbers.
    ArrayError
        If the streams have another shape, or no frame.
    """
    if not isinstance(backend, WholeBackend):
        raise ProgramError(
            f"'like' gives ranges to whole numbers, and this engine counts in {backend.precision}: "
            "leave it out, or take precision='q15'."
        )
    frames = finite("like", like)
    if frames.ndim < 4 or frames.shape[-3:] != tuple(trailing) or not frames.size:
        rows, cols, channels = trailing
        raise ArrayError(
            f"'like' must have the shape (frames, ..., {rows}, {cols}, {channels}), got "
            f"{frames.shape}."
        )
    return backend.measuring(frames.reshape(len(frames), -1, *frames.shape[-3:]))
