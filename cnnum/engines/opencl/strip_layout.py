"""How the rows of a large array's strips lie in memory, so that vectors of cells can be loaded.

A short row lies as it is. A long one is cut into as many pieces as a vector has lanes, and a lane
takes a piece: neighbours left and right of a vector of cells are the vectors before and after it,
so that every vector that is loaded is aligned. Only at the ends of a row do lanes need what the
lane beside them has.
"""

from dataclasses import dataclass

from cnnum.boundary import Boundary

LANES_FROM = 16
"""Vectors of a row from which lanes take pieces of it: a row's ends cost two moves of lanes."""

LANES_STEPS = 64
"""Steps from which it pays: cells of 1024×1024 take 1.3 ms longer to get there and back, and a
step is 10 to 30 µs quicker."""

DIGITS = "0123456789abcdef"


@dataclass(frozen=True, slots=True)
class RowLayout:
    """Where the cells of a row are.

    Attributes
    ----------
    cols : int
    radius : int
        Virtual cells on either side.
    width : int
        Lanes of a vector.
    boundary : Boundary
    constant : str or None
        Literal of the virtual cells' output where the boundary is fixed.
    levels : int
        Stages of steps that are taken in this layout.
    layers : int
        Rows of each stand side by side.
    """

    cols: int
    radius: int
    width: int
    boundary: Boundary
    constant: str | None
    levels: int
    layers: int

    @property
    def vectors(self) -> int:
        """Vectors that hold a row."""
        return -(-self.cols // self.width)

    @property
    def in_lanes(self) -> bool:
        """Whether lanes take pieces of a row."""
        return self.vectors >= max(LANES_FROM, self.radius) and self.levels >= LANES_STEPS

    @property
    def pieces(self) -> int:
        """Pieces that a row is cut into."""
        return self.width if self.in_lanes else 1

    @property
    def length(self) -> int:
        """Cells of a piece."""
        return self.vectors if self.in_lanes else self.cols

    @property
    def step(self) -> int:
        """Numbers from a cell to its right neighbour."""
        return self.pieces

    @property
    def head(self) -> int:
        """Numbers before the first cell of a row: virtual cells, and what aligns the first."""
        return self.radius * self.width if self.in_lanes else self.width

    @property
    def span(self) -> int:
        """Numbers from a row of a layer to that of the next."""
        return (self.vectors + (2 * self.radius if self.in_lanes else 2)) * self.width

    @property
    def pitch(self) -> int:
        """Numbers from a row to the next.

        An odd number of vectors: 1024 columns took a third longer with an even one, whose rows
        stand in a page where other rows do.
        """
        return (self.layers * self.span // self.width | 1) * self.width

    def place(self, col: int) -> int:
        """Return the place of a cell, counted from the row's first."""
        piece, at = divmod(col, self.length) if self.in_lanes else (0, col)
        return at * self.step + piece

    def sides(self) -> list[str]:
        """Return the text that sets the virtual cells of the row `y` that begins at `p`."""
        if not self.in_lanes:
            return [
                line
                for n in range(self.radius)
                for line in (
                    f"y[p - {n + 1}] = {self._left(n)};",
                    f"y[p + {self.cols + n}] = {self._right(n)};",
                )
            ]
        # virtual cells right of the row, where the last piece has room for them
        within = min(self.radius, self.vectors * self.width - self.cols)
        lines = [f"y[p + {self.place(self.cols + n)}] = {self._right(n)};" for n in range(within)]
        for n in range(self.radius):
            lines += self._ends(n)
        return lines

    def _ends(self, n: int) -> list[str]:
        """Return the text that sets the n-th vectors before and after a row's."""
        last, ahead, behind = self.width - 1, DIGITS[: self.width - 1], DIGITS[1 : self.width]
        before = f"before.s{DIGITS[last]}{ahead}"
        after = f"after.s{behind}{DIGITS[last]}"
        beyond = self.vectors * self.width + n - self.cols
        virtual = f" after.s{DIGITS[last]} = {self._right(beyond)};"
        first, final = n * self.width, (self.vectors - 1 - n) * self.width
        return [
            f"{{ vec before = *(__global const vec *)(y + p + {final});",
            f"before = {before}; before.s0 = {self._left(n)};",
            f"*(__global vec *)(y + p - {first + self.width}) = before; }}",
            f"{{ vec after = *(__global const vec *)(y + p + {first});",
            f"after = {after};{virtual if beyond < self.radius else ''}",
            f"*(__global vec *)(y + p + {self.vectors * self.width + first}) = after; }}",
        ]

    def _left(self, n: int) -> str:
        """Return the n-th virtual cell left of the row."""
        # the mirror lies between cells: the n-th cell beyond repeats the n-th within
        wraps = self.boundary.pad_mode == "wrap"
        return self.constant or f"y[p + {self.place(self.cols - 1 - n if wraps else n)}]"

    def _right(self, n: int) -> str:
        """Return the n-th virtual cell right of the row."""
        wraps = self.boundary.pad_mode == "wrap"
        return self.constant or f"y[p + {self.place(n if wraps else self.cols - 1 - n)}]"
