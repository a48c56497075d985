"""Sums over neighbourhoods of large arrays outside the steps, from rows in vectors.

A few rows are taken at a time: what their cells and those around them give is set side by side, so
that every vector of neighbours that is loaded is aligned, and goes no farther than the cache.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from cnnum.engines.opencl.ir.expressions import Element, Name
from cnnum.engines.opencl.ir.statements import Block, Statement, Sweep, Verbatim, verbatim
from cnnum.engines.opencl.large_arrays.row_vectors import PlainRows, own_text, plain_rows
from cnnum.engines.opencl.large_arrays.strip_rows import At, Rows
from cnnum.engines.opencl.lowering.storage import ALIGNED
from cnnum.engines.opencl.text import fill, filled, indented
from cnnum.engines.opencl.transients.builder import COL, ROW, TransientBuilder
from cnnum.templating.boundary import Boundary

ROWS_NEAR = Name("rows_near")

NEAR_BYTES = 192 * 1024
"""What is kept at a time, where rows are short enough: it stays in the second cache."""

STACK_BYTES = 1024 * 1024
"""What of it lies on a thread's stack at most."""

LEAST_ROWS, MOST_ROWS = 4, 32
"""Rows at a time; those above and below them are taken with others, too."""


@dataclass(frozen=True, slots=True)
class Seen:
    """What cells see of their neighbours.

    Attributes
    ----------
    name : str
        The variable of the kernel.
    values : sequence of sequence of Statement
        Of each layer, or the only one: statements in cell `i` that set `now`.
    boundary : Boundary
    fixed : float or None
        What virtual cells of a fixed boundary hold.
    """

    name: str
    values: Sequence[Sequence[Statement]]
    boundary: Boundary
    fixed: float | None


@dataclass(frozen=True, slots=True)
class _Near:
    """What is kept at a time.

    Attributes
    ----------
    layout : PlainRows
    rows : int
        Whose sums are found; those around them are kept, too.
    seen, sums : int
        Things that cells see, and sums.
    on_stack : bool
        Whether it lies on the stack of a thread, else in scratch.
    """

    layout: PlainRows
    rows: int
    seen: int
    sums: int
    on_stack: bool

    @property
    def each(self) -> int:
        """Numbers of a thing that is seen."""
        return (self.rows + 2 * self.layout.radius) * self.layout.pitch

    @property
    def size(self) -> int:
        """Numbers of all."""
        return self.seen * self.each + self.sums * self.layout.length


def sums_by_rows(text: TransientBuilder) -> bool:
    """Return whether neighbours outside the steps are summed so: on processors, of large arrays."""
    return text.tables.by_vectors and text.radius > 0 and not text.arena.private


def _near(text: TransientBuilder, seen: int, sums: int) -> _Near:
    """Return what is kept for sums of so much that is seen."""
    (rows, cols), tables, radius = text.shape, text.tables, text.radius

    def kept(space: str) -> _Near:
        layout = plain_rows(cols, radius, tables.width, text.layers, space)
        fit = NEAR_BYTES // (seen * layout.pitch * tables.dtype.itemsize) - 2 * radius
        high = min(rows, MOST_ROWS, max(LEAST_ROWS, fit))
        return _Near(layout, high, seen, sums, space == "__private")

    # a kernel that is a whole plan would have the rows of all its sums on the stack
    near = kept("__private")
    fits = tables.split and near.size * tables.dtype.itemsize <= STACK_BYTES
    return near if fits else kept("__global")


def line_of(layer: int) -> Element:
    """Return the sum of a layer in the cell at hand of a sweep."""
    return Name(f"line{layer}")[COL]


def sweep_sums(
    text: TransientBuilder,
    seen: list[Seen],
    sums: list[list[str]],
    body: Sequence[Statement],
    begin: Sequence[Statement] = (),
) -> None:
    """Append a sweep over all cells that knows sums of what neighbours give.

    Parameters
    ----------
    text : TransientBuilder
    seen : list of Seen
    sums : list of list of str
        Of each layer, statements that add to the sum of a vector of cells.
    body : sequence of Statement
        Statements in cell `i`, whose sum of a layer is `line_of(layer)`. They change nothing that
        other cells see.
    begin : sequence of Statement
        What declares the numbers that the sums use.
    """
    near, (rows, cols) = _near(text, len(seen), len(sums)), text.shape
    places = {one.name: n * near.each for n, one in enumerate(seen)}
    lines = len(seen) * near.each
    places |= {f"line{n}": lines + n * near.layout.length for n in range(len(sums))}
    pointer = f"{near.layout.space} scalar *const"
    mark = text.arena.mark()
    with text.aside() as declared:
        near_by = _declared(text, near, -(-rows // near.rows))
    swept = filled(
        "row_sweep",
        block=near.rows,
        rows=rows,
        cols=cols,
        radius=text.radius,
        near=[near_by, *begin],
        arrays=verbatim(f"{pointer} {name} = near + {at};" for name, at in places.items()),
        seen=[_row_of(text, near.layout, one) for one in seen],
        sums=[_sum_of(near.layout, n, lines) for n, lines in enumerate(sums)],
        body=body,
    )
    text.tables.types |= near.layout.functions(text.tables.dtype.itemsize)
    text.body.append(Block((*declared, Sweep(ROW, -(-rows // near.rows), (swept,)))))
    text.arena.release(mark)


def rows_near(text: TransientBuilder, seen: int, inputs: dict[str, int]) -> Rows:
    """Return rows whose sums see what a sweep does; inputs have places among all of it."""
    near = _near(text, seen, text.layers)
    offsets = {name: place * near.each for name, place in inputs.items()}
    return Rows(text, near.layout, (1.0,) * text.layers, offsets, "near")


def _declared(text: TransientBuilder, near: _Near, blocks: int) -> Verbatim:
    """Return the declaration of what is kept while the rows of the block `r` are taken."""
    if near.on_stack:
        return Verbatim((f"scalar near[{near.size}] __attribute__((aligned(64)));",))
    # blocks of a plan that is parted are taken at the same time
    step = -(-near.size // ALIGNED) * ALIGNED if text.tables.split else 0
    text.array(ROWS_NEAR, max(near.size, blocks * step))
    return Verbatim(("__global scalar *const near = ", ROWS_NEAR + ROW * step, ";"))


def _row_of(text: TransientBuilder, layout: PlainRows, one: Seen) -> Verbatim:
    """Return the text that sets a row, which may be a virtual one."""
    rows = text.shape[0]
    row, beyond = "at_row", list[str]()
    constant = None if one.fixed is None else text.literal(one.fixed)
    if one.boundary.pad_mode == "wrap":
        row = f"(at_row % {rows} + {rows}) % {rows}"
    elif constant is None:
        # mirrors repeat where a neighbourhood is wider than the array is high
        turn = f"(at_row % {2 * rows} + {2 * rows}) % {2 * rows}"
        row = f"min({turn}, {2 * rows - 1} - {turn})"
    else:
        row = f"clamp(at_row, 0, {rows - 1})"
        first, end = -layout.radius, layout.cols + layout.radius
        beyond = [
            f"for (int c = {first}; c < {end} && row != at_row; ++c) {{",
            f"    {one.name}[p + c] = {constant};",
            "}",
        ]
    each: list[Statement] = [
        filled(
            "row_seen",
            radius=layout.radius,
            pitch=layout.pitch,
            place=layout.head + layer * layout.span,
            cols=layout.cols,
            value=value,
            array=one.name,
            virtual=verbatim(layout.virtual(one.name, one.boundary, constant)),
            beyond=verbatim(beyond),
        )
        for layer, value in enumerate(one.values)
    ]
    return Verbatim((f"{{ const int row = {row};\n    ", tuple(each), "\n}"))


def _sum_of(layout: PlainRows, layer: int, lines: list[str]) -> Verbatim:
    """Return the text that sums what the cells of the row `own` see."""
    summed = fill(
        "row_sum",
        length=layout.length,
        width=layout.width,
        radius=layout.radius,
        pitch=layout.pitch,
        head=layout.head,
        sum=At(layer, 0).sum,
        lines=indented(lines, 1),
        to=f"line{layer}",
        space=layout.space,
    )
    return Verbatim((own_text(summed),))
