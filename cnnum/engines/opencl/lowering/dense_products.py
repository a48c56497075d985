"""Dense products and reductions of a small array, such as sums, in several parallel chains.

A sequential sum over the cells waits four cycles for each addition. Compilers may not reorder it,
so everything that shares its loop is computed one cell at a time. Every kernel of a plan sums in
the same order, so a frame's results do not depend on the other frames in its batch.
"""

import numpy as np

from cnnum import kernels as ir
from cnnum.engines.opencl.lowering.storage import Tables
from cnnum.engines.opencl.text import filled
from cnnum.graph.elementwise import ReduceOp
from cnnum.graph.nodes import Product

COLUMNS = 4
"""Number of matrix columns added at a time."""

J, K = ir.names("j k")


def product(
    tables: Tables, operation: Product, sources: list[ir.Expression], slot: ir.Name
) -> list[ir.Statement]:
    """Return statements that set an array to Σ matrix · source + constant.

    Compilers vectorise along the cells; each number holds the interleaved frames of a batch.

    Parameters
    ----------
    tables : Tables
    operation : Product
    sources : list of Expression
        Expressions in `i` for the maps that are read.
    slot : Name
        Of the array.
    """
    cells, constant = operation.constant.size, ir.Integer(tables.data(operation.constant))
    columns = largest_divisor(cells, COLUMNS)
    values = [ir.Name(f"v{m}") for m in range(columns)]
    lines: list[ir.Statement] = [
        ir.Loop(K, cells, (ir.Assign(slot[K], tables.number_at(constant + K)),))
    ]
    for matrix, source in zip(operation.matrices, sources, strict=True):
        at = ir.Integer(tables.data(np.ascontiguousarray(matrix.T)))
        body: list[ir.Statement] = [ir.Declare("real", tuple((value, None) for value in values))]
        body += [
            ir.block(ir.fixed(ir.CELL, J + m, of="int"), ir.Assign(value, source))
            for m, value in enumerate(values)
        ]
        terms: list[ir.Expression] = [
            tables.number_at(at + (J + m) * cells + K) * value for m, value in enumerate(values)
        ]
        body.append(ir.Loop(K, cells, (ir.add(slot[K], ir.total(terms)),)))
        lines.append(ir.Loop(J, cells, tuple(body), step=columns))
    return lines


def largest_divisor(number: int, most: int) -> int:
    """Return the largest divisor not above `most`."""
    return max(n for n in range(1, most + 1) if number % n == 0)


CHAIN, NUMBERS, READ_OUTS_K, AT = ir.names("chain numbers k at")

CHAINS = 8
"""Single frames take the same time with 4, 8 and 16 chains; large batches take 1 % more with 16."""


def chains(cells: int) -> int:
    """Return the number of parallel chains that reduce an array or a stack of arrays."""
    return min(CHAINS, cells)


def chained(tables: Tables, function: ReduceOp, count: int, cells: int) -> str:
    """Return the name of the kernel function that reduces many numbers to one.

    Parameters
    ----------
    tables : Tables
        Receives the function's source.
    function : ReduceOp
    count : int
        Number of values, in private memory.
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
    """Return the reduction after one more value."""
    return total + value if function.how == "+" else ir.call(function.how, total, value)


def _body(function: ReduceOp, count: int, width: int) -> list[ir.Statement]:
    last = count // width * width

    def into(end: int, value: ir.Expression) -> ir.Loop:
        return ir.Loop(
            READ_OUTS_K,
            end,
            (ir.Assign(CHAIN[READ_OUTS_K], step(function, CHAIN[READ_OUTS_K], value)),),
        )

    lines: list[ir.Statement] = [
        ir.Array(CHAIN, width, None),
        ir.Loop(READ_OUTS_K, width, (ir.Assign(CHAIN[READ_OUTS_K], NUMBERS[READ_OUTS_K]),)),
        ir.Loop(AT, last, (into(width, NUMBERS[AT + READ_OUTS_K]),), start=width, step=width),
        into(count - last, NUMBERS[ir.Integer(last) + READ_OUTS_K]),
    ]
    while width > 1:
        half = (width + 1) // 2
        lines.append(into(width - half, CHAIN[ir.Integer(half) + READ_OUTS_K]))
        width = half
    return [*lines, ir.Verbatim(("return ", CHAIN[0], ";"))]
