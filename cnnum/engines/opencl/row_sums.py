"""Sums over neighbourhoods of large arrays outside the steps, from rows in vectors.

A few rows are taken at a time: what their cells and those around them give is set side by side, so
that every vector of neighbours that is loaded is aligned, and goes no farther than the cache.
"""

from dataclasses import dataclass

from cnnum.engines.opencl.plain_rows import PlainRows, own_text, plain_rows
from cnnum.engines.opencl.storage import ALIGNED
from cnnum.engines.opencl.strip_rows import At, Rows
from cnnum.engines.opencl.text import fill, indented
from cnnum.engines.opencl.transients import TransientText
from cnnum.templating.boundary import Boundary

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
    values : list of list of str
        Of each layer, or the only one: statements in cell `i` that set `now`.
    boundary : Boundary
    fixed : float or None
        What virtual cells of a fixed boundary hold.
    """

    name: str
    values: list[list[str]]
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


def sums_by_rows(text: TransientText) -> bool:
    """Return whether neighbours outside the steps are summed so: on processors, of large arrays."""
    return text.tables.by_vectors and text.radius > 0 and not text.arena.private


def _near(text: TransientText, seen: int, sums: int) -> _Near:
    """Return what is kept for sums of so much that is seen."""
    (rows, cols), tables, radius = text.shape, text.tables, text.radius

    def kept(space: str) -> _Near:
        layout = plain_rows(cols, radius, tables.width, text.layers, space)
        fit = NEAR_BYTES // (seen * layout.pitch * tables.dtype.itemsize) - 2 * radius
        high = min(rows, MOST_ROWS, max(LEAST_ROWS, fit))
        return _Near(layout, high, seen, sums, space == "__private")

    # a kernel that is a whole plan would have the rows of all its sums on the stack
    near = kept("__private")
    fits = tables.parted and near.size * tables.dtype.itemsize <= STACK_BYTES
    return near if fits else kept("__global")


def sweep_sums(
    text: TransientText, seen: list[Seen], sums: list[list[str]], body: list[str]
) -> None:
    """Append a sweep over all cells that knows sums of what neighbours give.

    Parameters
    ----------
    text : TransientText
    seen : list of Seen
    sums : list of list of str
        Of each layer, statements that add to the sum of a vector of cells.
    body : list of str
        Statements in cell `i`, whose sum of a layer is `line{layer}[c]`. They change nothing that
        other cells see.
    """
    near, (rows, cols) = _near(text, len(seen), len(sums)), text.shape
    places = {one.name: n * near.each for n, one in enumerate(seen)}
    lines = len(seen) * near.each
    places |= {f"line{n}": lines + n * near.layout.length for n in range(len(sums))}
    pointer = f"{near.layout.space} scalar *const"
    mark = text.arena.mark()
    text.lines.append("{")
    begin = _declared(text, near, -(-rows // near.rows))
    filled = fill(
        "row_sweep",
        blocks=-(-rows // near.rows),
        block=near.rows,
        rows=rows,
        cols=cols,
        radius=text.radius,
        near=begin,
        arrays=indented([f"{pointer} {name} = near + {at};" for name, at in places.items()], 1),
        seen="\n".join(_row_of(text, near.layout, one) for one in seen),
        sums="\n".join(_sum_of(text, near.layout, n, lines) for n, lines in enumerate(sums)),
        body=indented(body, 3),
    )
    text.tables.types |= near.layout.functions(text.tables.dtype.itemsize)
    text.lines += [*filled.splitlines(), "}"]
    text.arena.release(mark)


def rows_near(text: TransientText, seen: int, inputs: dict[str, int]) -> Rows:
    """Return rows whose sums see what a sweep does; inputs have places among all of it."""
    near = _near(text, seen, text.layers)
    apart = {name: place * near.each for name, place in inputs.items()}
    return Rows(text, near.layout, (1.0,) * text.layers, apart, "near")


def _declared(text: TransientText, near: _Near, blocks: int) -> str:
    """Return the declaration of what is kept while the rows of the block `r` are taken."""
    if near.on_stack:
        return f"scalar near[{near.size}] __attribute__((aligned(64)));"
    # blocks of a plan that is parted are taken at the same time
    step = -(-near.size // ALIGNED) * ALIGNED if text.tables.parted else 0
    text.array("rows_near", max(near.size, blocks * step))
    return f"__global scalar *const near = rows_near + r * {step};"


def _row_of(text: TransientText, layout: PlainRows, one: Seen) -> str:
    """Return the text that sets a row, which may be a virtual one."""
    rows = text.shape[0]
    row, beyond = "at_row", list[str]()
    constant = None if one.fixed is None else text.number(one.fixed)
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
    lines = [f"{{ const int row = {row};"]
    for layer, value in enumerate(one.values):
        lines += fill(
            "row_seen",
            radius=layout.radius,
            pitch=layout.pitch,
            place=layout.head + layer * layout.span,
            cols=layout.cols,
            value=" ".join(value),
            array=one.name,
            virtual=indented(layout.virtual(one.name, one.boundary, constant), 1),
            beyond=indented(beyond, 1),
        ).splitlines()
    return indented([*lines, "}"], 2)


def _sum_of(text: TransientText, layout: PlainRows, layer: int, lines: list[str]) -> str:
    """Return the text that sums what the cells of the row `own` see."""
    filled = fill(
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
    return indented(own_text(filled).splitlines(), 2)
