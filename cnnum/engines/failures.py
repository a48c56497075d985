"""Messages of an engine whose run did not come to its end."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cnnum.errors import MethodError


def refuse_unfinished(unfinished: NDArray[Any]) -> None:
    """Raise if any frame of a batch holds a transient or a loop that did not reach its end.

    Parameters
    ----------
    unfinished : (batch,) bool or float
        Not 0 where one did not.

    Raises
    ------
    MethodError
        If there is such a frame.
    """
    failed = np.flatnonzero(unfinished)
    if failed.size:
        raise MethodError(
            f"A transient or a loop did not reach its end in {failed.size} of {len(unfinished)} "
            f"frames (the first is frame {failed[0]}): loosen the tolerances, shorten the "
            "duration, or raise the loop's limit."
        )
