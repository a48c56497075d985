"""Memory for results: a block is used again once no array of it is held."""

import sys
from dataclasses import dataclass

import numpy as np

from cnnum.arrays import Floats

OWN = 2
"""References to a block without an array: its keeper's, and the one that asks."""


@dataclass(slots=True, eq=False)
class KeptBlock:
    """Hands out numbers for results; arrays made of them keep them as long as they live.

    The system clears memory page by page when it is touched for the first time: of results of
    1024×1024 cells that takes longer than to write them.
    """

    _block: Floats | None = None

    def take(self, size: int) -> Floats:
        """Return a number of uninitialised numbers that no other array shares."""
        kept = self._block
        if kept is not None and kept.size == size:
            del kept
            if sys.getrefcount(self._block) <= OWN:
                assert self._block is not None
                return self._block
        self._block = np.empty(size)
        return self._block
