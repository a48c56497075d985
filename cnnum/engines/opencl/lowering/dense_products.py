"""Chains of linear operations that were fused into dense products."""

import numpy as np

from cnnum import kernels as ir
from cnnum.engines.opencl.lowering.storage import Tables
from cnnum.graph.nodes import Product

SUMS = 6
"""Sums of several frames side by side that are kept in registers at a time."""

COLUMNS = 4
"""Columns of a matrix that are added at a time to the sums of a single frame."""

J, K, V = ir.names("j k v")


def product(
    tables: Tables, operation: Product, sources: list[ir.Expression], slot: ir.Name
) -> list[ir.Statement]:
    """Return statements that set an array to Σ matrix · source + constant.

    Parameters
    ----------
    tables : Tables
    operation : Product
    sources : list of Expression
        Of `i`, for the maps that are read.
    slot : Name
        Of the array.
    """
    write = _by_rows if tables.lanes > 1 else _by_columns
    return write(tables, operation, sources, slot)


def _by_rows(
    tables: Tables, operation: Product, sources: list[ir.Expression], slot: ir.Name
) -> list[ir.Statement]:
    """Each number of a matrix meets many frames: sums stay in registers."""
    cells, constant = operation.constant.size, ir.Integer(tables.data(operation.constant))
    block = largest_divisor(cells, SUMS)
    sums = [ir.Name(f"sum{m}") for m in range(block)]
    body: list[ir.Statement] = [
        ir.declare(sum, tables.number_at(constant + K + m)) for m, sum in enumerate(sums)
    ]
    for matrix, source in zip(operation.matrices, sources, strict=True):
        at = ir.Integer(tables.data(np.ascontiguousarray(matrix)))
        adds = [
            ir.add(sum, tables.number_at(at + (K + m) * cells + ir.CELL) * V)
            for m, sum in enumerate(sums)
        ]
        body.append(ir.Loop(ir.CELL, cells, (ir.fixed(V, source), *adds)))
    body += [ir.Assign(slot[K + m], sum) for m, sum in enumerate(sums)]
    return [ir.Loop(K, cells, tuple(body), step=block)]


def _by_columns(
    tables: Tables, operation: Product, sources: list[ir.Expression], slot: ir.Name
) -> list[ir.Statement]:
    """Only one frame: compilers vectorise along the cells."""
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
