"""A small array's read-outs, such as sums: several chains side by side.

A sum that runs through the cells one by one waits four cycles for each of them. Compilers may not
change its order, so they work out all that shares its loop one cell at a time. Every kernel of a
plan sums up in the same order. So a frame's results do not depend on its neighbours.
"""

from cnnum import kernels as ir
from cnnum.engines.opencl.lowering.storage import Tables
from cnnum.engines.opencl.text import filled
from cnnum.graph.elementwise import ReduceOp

CHAIN, NUMBERS, K, AT = ir.names("chain numbers k at")

CHAINS = 8
"""Of 4, 8 and 16 chains single frames take as long, and with 16 large batches take 1 % more."""


def chains(cells: int) -> int:
    """Return how many chains read out an array, or a stack of them."""
    return min(CHAINS, cells)


def chained(tables: Tables, function: ReduceOp, count: int, cells: int) -> str:
    """Return the name of the kernel's function that reads one number out of many.

    Parameters
    ----------
    tables : Tables
        Gets the function's text.
    function : ReduceOp
    count : int
        Of the numbers, in private memory.
    cells : int
        Of the array.
    """
    name = f"{function.name}_of_{count}"
    if name not in tables.types:
        text = filled(
            "chained",
            read_out=function.name,
            count=count,
            chains=chains(cells),
            function=name,
            body=_body(function, count, chains(cells)),
        )
        tables.types[name] = "\n".join(tables.printer.lines([text]))
    return name


def step(function: ReduceOp, total: ir.Expression, value: ir.Expression) -> ir.Expression:
    """Return a total after one more value."""
    return total + value if function.how == "+" else ir.call(function.how, total, value)


def _body(function: ReduceOp, count: int, width: int) -> list[ir.Statement]:
    last = count // width * width

    def into(end: int, value: ir.Expression) -> ir.Loop:
        return ir.Loop(K, end, (ir.Assign(CHAIN[K], step(function, CHAIN[K], value)),))

    lines: list[ir.Statement] = [
        ir.Array(CHAIN, width, None),
        ir.Loop(K, width, (ir.Assign(CHAIN[K], NUMBERS[K]),)),
        ir.Loop(AT, last, (into(width, NUMBERS[AT + K]),), start=width, step=width),
        into(count - last, NUMBERS[ir.Integer(last) + K]),
    ]
    while width > 1:
        half = (width + 1) // 2
        lines.append(into(width - half, CHAIN[ir.Integer(half) + K]))
        width = half
    return [*lines, ir.Verbatim(("return ", CHAIN[0], ";"))]
