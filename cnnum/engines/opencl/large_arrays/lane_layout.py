"""How the rows of a large array's strips lie in memory, so that vectors of cells can be loaded.

A row is cut into as many pieces as a vector has lanes, and a lane takes a piece: neighbours left
and right of a vector of cells are the vectors before and after it. So every vector that is loaded
is aligned. Only at the ends of a row do lanes need values of the next lane.
"""

from dataclasses import dataclass

import numpy as np

from cnnum import kernels as ir
from cnnum.templating.boundary import Boundary

LEAST_VECTORS = 3
"""Vectors of a row, at least, by narrower ones: a row's ends cost two moves of lanes. A step of
rows of 20 numbers took a fourth longer in two vectors of 16."""

LEAST_WIDTH = 4
"""Lanes of the narrowest vector."""

DIGITS = "0123456789abcdef"


@dataclass(frozen=True, slots=True)
class RowLayout:
    """Where the cells of a row are.

    Attributes
    ----------
    cols : int
    radius : int
        Virtual cells on either side.
    lanes : int
        Of the device's vectors.
    boundary : Boundary
    layers : int
        Rows of each stand side by side.
    """

    cols: int
    radius: int
    lanes: int
    boundary: Boundary
    layers: int

    @property
    def width(self) -> int:
        """Lanes of a vector, which are the pieces of a row."""
        width, least = self.lanes, max(LEAST_VECTORS, self.radius)
        while width > LEAST_WIDTH and -(-self.cols // width) < least:
            width //= 2
        return width

    @property
    def vectors(self) -> int:
        """Vectors that hold a row: the cells of a piece."""
        return -(-self.cols // self.width)

    @property
    def head(self) -> int:
        """Numbers before the first cell of a row: virtual cells."""
        return self.radius * self.width

    @property
    def span(self) -> int:
        """Numbers from a row of a layer to that of the next."""
        return (self.vectors + 2 * self.radius) * self.width

    @property
    def pitch(self) -> int:
        """Numbers from a row to the next.

        An odd number of vectors: 1024 columns took a third longer with an even one, whose rows
        stand in a page where other rows do.
        """
        return (self.layers * self.span // self.width | 1) * self.width

    def loaded(
        self, array: ir.Expression, source: int, row: int, col: int, start: ir.Name
    ) -> ir.Load:
        """Return the cells some rows and columns from those at `start`."""
        offsets = row * self.pitch + source * self.span + col * self.width
        return ir.Load(array + offsets + start)

    def place(self, col: int) -> int:
        """Return the place of a cell, counted from the row's first."""
        piece, at = divmod(col, self.vectors)
        return at * self.width + piece

    def sides(self, constant: str | None) -> list[str]:
        """Return the text that sets the virtual cells of the row `y` that begins at `p`.

        Where the boundary is fixed they are all `constant`.
        """
        # virtual cells right of the row, where the last piece has room for them
        within = min(self.radius, self.vectors * self.width - self.cols)
        lines = [
            f"y[p + {self.place(self.cols + n)}] = {self._virtual(self.cols + n, constant)};"
            for n in range(within)
        ]
        for n in range(self.radius):
            lines += self._ends(n, constant)
        return lines

    def turned(self) -> list[str]:
        """Return the text that makes vectors `a` of the lanes of as many, by way of `b`.

        Merged in pairs, number by number, the vectors' place in the square moves by a digit.
        """
        size, half = self.width, self.width // 2
        lines, arrays = list[str](), ("a", "b")
        for n in range(size.bit_length() - 1):
            old, new = arrays[n % 2], arrays[1 - n % 2]
            for k in range(size):
                side = ("lo", "hi")[k % 2]
                lines += [
                    f"{new}[{k}].{place} = {old}[{at}].{side};"
                    for place, at in (("even", k // 2), ("odd", k // 2 + half))
                ]
        odd = (size.bit_length() - 1) % 2
        return lines + [f"a[{k}] = b[{k}];" for k in range(size * odd)]

    def _ends(self, n: int, constant: str | None) -> list[str]:
        """Return the text that sets the n-th vectors before and after a row's."""
        last, ahead, behind = self.width - 1, DIGITS[: self.width - 1], DIGITS[1 : self.width]
        before = f"before.s{DIGITS[last]}{ahead}"
        after = f"after.s{behind}{DIGITS[last]}"
        beyond, virtual = self.vectors * self.width + n, ""
        if beyond < self.cols + self.radius:
            virtual = f" after.s{DIGITS[last]} = {self._virtual(beyond, constant)};"
        first, final = n * self.width, (self.vectors - 1 - n) * self.width
        return [
            f"{{ vec before = *(__global const vec *)(y + p + {final});",
            f"before = {before}; before.s0 = {self._virtual(-1 - n, constant)};",
            f"*(__global vec *)(y + p - {first + self.width}) = before; }}",
            f"{{ vec after = *(__global const vec *)(y + p + {first});",
            f"after = {after};{virtual}",
            f"*(__global vec *)(y + p + {self.vectors * self.width + first}) = after; }}",
        ]

    def _virtual(self, col: int, constant: str | None) -> str:
        """Return a virtual cell next to the row."""
        if constant is not None:
            return constant
        source = np.pad(np.arange(self.cols), self.radius, mode=self.boundary.pad_mode)
        return f"y[p + {self.place(int(source[col + self.radius]))}]"
