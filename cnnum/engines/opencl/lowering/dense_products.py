"""Chains of linear operations that were fused into dense products."""

import numpy as np

from cnnum import kernels as ir
from cnnum.engines.opencl.lowering.storage import Tables
from cnnum.graph.nodes import Product

COLUMNS = 4
"""Columns of a matrix that are added at a time."""

J, K = ir.names("j k")


def product(
    tables: Tables, operation: Product, sources: list[ir.Expression], slot: ir.Name
) -> list[ir.Statement]:
    """Return statements that set an array to Σ matrix · source + constant.

    Compilers vectorise along the cells; the frames of a batch lie side by side in each number.

    Parameters
    ----------
    tables : Tables
    operation : Product
    sources : list of Expression
        Of `i`, for the maps that are read.
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
    """Return the largest divisor that is not larger than `most`."""
    return max(n for n in range(1, most + 1) if number % n == 0)
