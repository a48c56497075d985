"""Memory layout of rows in strips of a large array, for aligned vector loads.

A row is cut into as many pieces as a vector has lanes, and each lane holds one piece. The left and
right neighbours of a vector of cells are then the vectors before and after it, so every load is
aligned. Only at the ends of a row do lanes need values of the next lane.
"""

from dataclasses import dataclass

from cnnum import kernels as ir
from cnnum.engines.opencl.text import WIDE_BYTES, fill, filled, indented, names_of, owned
from cnnum.engines.opencl.transients.builder import NOW, TransientBuilder
from cnnum.templating.boundary import Boundary, line_sources

LEAST_VECTORS = 3
"""Minimum number of vectors per row; shorter rows use narrower vectors, since a row's ends cost two
lane shifts. A step with rows of 20 numbers took a fourth longer in two vectors of 16."""

LEAST_WIDTH = 4
"""Lanes of the narrowest vector."""

DIGITS = "0123456789abcdef"

NUMBERS = (
    "rows", "cols", "layers", "radius", "width", "length", "last", "head", "span", "pitch",
)  # fmt: skip
"""Attributes of a layout that kernel templates refer to."""


@dataclass(frozen=True, slots=True)
class RowLayout:
    """The memory layout of a row's cells.

    Attributes
    ----------
    rows, cols : int
    radius : int
        Virtual cells on each side.
    lanes : int
        Lanes of the device's vectors.
    boundary : Boundary
    layers : int
        Number of layers, whose rows are interleaved.
    """

    rows: int
    cols: int
    radius: int
    lanes: int
    boundary: Boundary
    layers: int

    @property
    def width(self) -> int:
        """Lanes of a vector, which is also the number of pieces of a row."""
        width, least = self.lanes, max(LEAST_VECTORS, self.radius)
        while width > LEAST_WIDTH and -(-self.cols // width) < least:
            width //= 2
        return width

    @property
    def length(self) -> int:
        """Vectors per row, which is also the number of cells in a piece."""
        return -(-self.cols // self.width)

    @property
    def head(self) -> int:
        """Numbers before the first cell of a row, for virtual cells."""
        return self.radius * self.width

    @property
    def span(self) -> int:
        """Numbers from a row of one layer to that of the next layer."""
        return (self.length + 2 * self.radius) * self.width

    @property
    def pitch(self) -> int:
        """Numbers from one row to the next.

        An odd number of vectors: 1024 columns took a third longer with an even number, which aligns
        rows at the same page offsets.
        """
        return (self.layers * self.span // self.width | 1) * self.width

    @property
    def size(self) -> int:
        """Size of an array that holds all rows."""
        return (self.rows + 2 * self.radius) * self.pitch

    @property
    def last(self) -> int:
        """Index in a row of the vector at which its last square block begins."""
        return max(0, self.length - self.width)

    def numbers(self, text: str) -> dict[str, int]:
        """Return the attributes that the kernel template in a file refers to."""
        return {name: getattr(self, name) for name in NUMBERS if name in names_of(text)}

    def loaded(
        self, array: ir.Expression, source: int, row: int, col: int, start: ir.Name
    ) -> ir.Load:
        """Return the cells at a row and column offset from those at `start`."""
        offsets = row * self.pitch + source * self.span + col * self.width
        return ir.Load(array + offsets + start)

    def place(self, col: int) -> int:
        """Return the index of a real or virtual cell relative to the row's first cell."""
        piece = min(max(col // self.length, 0), self.width - 1)
        return (col - piece * self.length) * self.width + piece

    def sides(self, constant: str | None) -> list[str]:
        """Return the code that sets the virtual cells of the row `y` that begins at `p`.

        With a fixed boundary they are all `constant`.
        """
        # the last piece may have room for some; lanes of vectors beyond are copies of these, too.
        # Where pieces are short, they are copies even of vectors beyond
        end, room = self.cols + self.radius, self.length * self.width
        lines = [self._virtual(col, constant) for col in range(self.cols, min(end, room))]
        for n in range(self.radius):
            lines += self._ends(n)
            lines += [self._virtual(col, constant) for col in (-1 - n, room + n) if col < end]
        return lines

    def beyond(self, rows: range, constant: str | None) -> list[str]:
        """Return the code that sets virtual rows above or below the array; see `sides`."""
        if constant is not None:
            return [f"fill_row(y, {row}, {constant});" for row in rows]
        return [f"copy_row(y, {row}, {self._source(self.rows, row)});" for row in rows]

    def _ends(self, n: int) -> list[str]:
        """Return the code that fills the n-th vectors before and after a row from adjacent lanes.

        The first lane before, and the last one after, have none.
        """
        first, last = DIGITS[0], DIGITS[self.width - 1]
        ends = (
            (-1 - n, self.length - 1 - n, f"s{first}{DIGITS[: self.width - 1]}"),
            (self.length + n, n, f"s{DIGITS[1 : self.width]}{last}"),
        )
        return [
            f"*(__global vec *)(y + p + {to * self.width}) = "
            f"(*(__global const vec *)(y + p + {source * self.width})).{lanes};"
            for to, source, lanes in ends
        ]

    def _virtual(self, col: int, constant: str | None) -> str:
        """Return the code that sets a virtual cell left or right of the row."""
        value = constant or f"y[p + {self.place(self._source(self.cols, col))}]"
        return f"y[p + {self.place(col)}] = {value};"

    def _source(self, count: int, at: int) -> int:
        """Return the row or column, out of `count`, that a virtual one copies."""
        return int(line_sources(self.boundary, count, self.radius)[at + self.radius])


def block_rows(vector_bytes: int) -> int:
    """Return the rows processed at once, whose sums fill the registers of a processor.

    Vectors of 64 bytes come with 32 registers (AVX-512), shorter ones with 16. With 16, Euler steps
    of 1024×1024 cells take 1.15 to 1.35 times as long in blocks of four rows as in blocks of two.
    """
    return 4 if vector_bytes >= WIDE_BYTES else 2


OWN = (
    "vec", "ROW", "between", "turned", "part_of", "keep_lanes", "keep_cells", "to_lanes",
    "from_lanes", "fill_lanes", "copy_lanes", "copy_row", "fill_row",
    "sides", "all_sides", "upper", "lower",
)  # fmt: skip
"""Names to make unique, since a plan may contain this code several times."""


def lanes_fit(text: TransientBuilder) -> bool:
    """Return whether the lane layout suits an array: a large one whose cells have neighbours."""
    return text.radius > 0 and not text.arena.private


def row_layout(text: TransientBuilder, boundary: Boundary | None = None) -> RowLayout:
    """Return the layout of rows with a boundary, by default that of the states."""
    ends = boundary or text.template.boundary
    return RowLayout(*text.shape, text.radius, text.tables.width, ends, text.layers)


def lane_text(text: TransientBuilder, layout: RowLayout) -> str:
    """Return the types and functions of the lane layout."""
    return fill("lanes", **layout.numbers("lanes"), bytes=text.tables.dtype.itemsize)


def rim_text(text: TransientBuilder, layout: RowLayout, suffix: str, fixed: float | None) -> str:
    """Return the functions that set virtual cells; `fixed` is the value at a fixed boundary."""
    rows, constant = layout.rows, None if fixed is None else text.literal(fixed)
    return fill(
        "strip_rims",
        **layout.numbers("strip_rims"),
        suffix=suffix,
        sides=indented(layout.sides(constant), 1),
        upper=indented(layout.beyond(range(-text.radius, 0), constant), 1),
        lower=indented(layout.beyond(range(rows, rows + text.radius), constant), 1),
    )


def inputs_of(source: int) -> str:
    """Return the name of the array that holds an input in lanes."""
    return f"lane_u{source}"


def keep_rows(text: TransientBuilder, number: int) -> None:
    """Append the array of an input, and the sweep that copies its rows to the lane layout."""
    boundary = text.template.input_boundary
    layout, array = row_layout(text, boundary), ir.Name(inputs_of(number))
    text.array(array, layout.size)
    source = lane_text(text, layout) + rim_text(text, layout, "", boundary.constant)
    types, kind = text.tables.types, "rows in lanes"
    key = f"{kind} {source}"
    types.setdefault(key, "")
    suffix = f"_lanes{[name for name in types if name.startswith(kind)].index(key)}"
    types[key] = owned(source, OWN, suffix[1:])
    row = filled(
        "lane_row",
        **layout.numbers("lane_row"),
        value=[ir.Assign(NOW, text.operands.inputs[number])],
        to=array,
        suffix=suffix,
    )
    text.body.append(ir.Sweep(ir.ROW, text.shape[0], (row,)))
    text.body += [ir.Verbatim((f"{side}{suffix}(", array, ");")) for side in ("upper", "lower")]
