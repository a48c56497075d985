"""Rows of cells in their order, read as vectors: neighbours are moved together in registers."""

from dataclasses import dataclass

import numpy as np

from cnnum.engines.opencl.strip_layout import DIGITS, LEAST_WIDTH
from cnnum.engines.opencl.text import fill, owned
from cnnum.templating.boundary import Boundary

_OWN = ("vec", "between")
"""Names that rows in lanes have, too."""


@dataclass(frozen=True, slots=True)
class PlainRows:
    """Where the cells of a row are; its first stands where a vector begins.

    Attributes
    ----------
    cols : int
    radius : int
        Virtual cells on either side.
    width : int
        Lanes of a vector.
    layers : int
        Rows of each stand side by side.
    space : str
        Where pointers point to: `__private` or `__global`.
    """

    cols: int
    radius: int
    width: int
    layers: int
    space: str

    @property
    def vectors(self) -> int:
        """Vectors that hold a row."""
        return -(-self.cols // self.width)

    @property
    def length(self) -> int:
        """Numbers of the vectors that hold a row."""
        return self.vectors * self.width

    @property
    def head(self) -> int:
        """Numbers before the first cell of a row: virtual cells."""
        return -(-self.radius // self.width) * self.width

    @property
    def span(self) -> int:
        """Numbers from a row of a layer to that of the next."""
        return self.length + 2 * self.head

    @property
    def pitch(self) -> int:
        """Numbers from a row to the next, an odd number of vectors as in `RowLayout`."""
        return (self.layers * self.span // self.width | 1) * self.width

    def loaded(self, array: str, source: int, row: int, col: int, start: str = "p") -> str:
        """Return the expression of the cells so many rows and columns from those at `start`."""
        vector, part = divmod(col, self.width)
        at = f"{array} + {row * self.pitch + source * self.span + vector * self.width} + {start}"
        if part:
            return f"{_moved(self.space, part)}({at})"
        return f"*({self.space} const vec *)({at})"

    def virtual(self, array: str, boundary: Boundary, constant: str | None) -> list[str]:
        """Return the text that sets the virtual cells of a row of an array that begins at `p`."""
        if constant is not None:
            values = [constant] * (self.cols + 2 * self.radius)
        else:
            source = np.pad(np.arange(self.cols), self.radius, mode=boundary.pad_mode)
            values = [f"{array}[p + {at}]" for at in source.tolist()]
        beyond = range(self.cols, self.cols + self.radius)
        return [
            f"{array}[p + {place}] = {values[place + self.radius]};"
            for place in (*range(-self.radius, 0), *beyond)
        ]

    def functions(self, itemsize: int) -> dict[str, str]:
        """Return the types and functions that expressions name, each by a key of its own."""
        lanes = f"ext_vector_type({self.width}), aligned({itemsize})"
        texts = {"vectors of rows": own_text(fill("row_vectors", attributes=lanes))}
        columns = range(-self.radius, self.radius + 1)
        for part in sorted({col % self.width for col in columns} - {0}):
            moved = _moved(self.space, part)
            texts[moved] = own_text(
                fill(
                    "row_moved",
                    moved=moved,
                    space=self.space,
                    width=self.width,
                    lanes=", ".join(f"{v}.s{DIGITS[n]}" for v, n in self._lanes(part)),
                )
            )
        return texts

    def _lanes(self, part: int) -> list[tuple[str, int]]:
        """Return which lanes of two vectors are the cells from one of the first on."""
        both = [(vector, lane) for vector in ("a", "b") for lane in range(self.width)]
        return both[part : part + self.width]


def own_text(text: str) -> str:
    """Return a text whose types and functions are those of such rows."""
    return owned(text, _OWN, "of_row")


def _moved(space: str, part: int) -> str:
    return f"beside{space}_{part}"


def plain_rows(cols: int, radius: int, lanes: int, layers: int, space: str) -> PlainRows:
    """Return rows in vectors of so many lanes, or of fewer where a row has less than half."""
    width = lanes
    while width > LEAST_WIDTH and 2 * cols <= width:
        width //= 2
    return PlainRows(cols, radius, width, layers, space)
