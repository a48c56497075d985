"""Chains of linear operations that were fused into dense products."""

import numpy as np

from cnnum.engines.opencl.ir.expressions import CELL, Expression, Integer, Name, total
from cnnum.engines.opencl.ir.statements import (
    Assign,
    Declare,
    Loop,
    Statement,
    add,
    block,
    declare,
    fixed,
)
from cnnum.engines.opencl.lowering.storage import Tables
from cnnum.graph.nodes import Product

SUMS = 6
"""Sums of several frames side by side that are kept in registers at a time."""

COLUMNS = 4
"""Columns of a matrix that are added at a time to the sums of a single frame."""

J, K, V = Name("j"), Name("k"), Name("v")


def product(
    tables: Tables, operation: Product, sources: list[Expression], slot: Name
) -> list[Statement]:
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
    tables: Tables, operation: Product, sources: list[Expression], slot: Name
) -> list[Statement]:
    """Each number of a matrix meets many frames: sums stay in registers."""
    cells, constant = operation.constant.size, Integer(tables.data(operation.constant))
    block = _divisor(cells, SUMS)
    sums = [Name(f"sum{m}") for m in range(block)]
    body: list[Statement] = [
        declare(sum, tables.number_at(constant + K + m)) for m, sum in enumerate(sums)
    ]
    for matrix, source in zip(operation.matrices, sources, strict=True):
        at = Integer(tables.data(np.ascontiguousarray(matrix)))
        adds = [
            add(sum, tables.number_at(at + (K + m) * cells + CELL) * V)
            for m, sum in enumerate(sums)
        ]
        body.append(Loop(CELL, cells, (fixed(V, source), *adds)))
    body += [Assign(slot[K + m], sum) for m, sum in enumerate(sums)]
    return [Loop(K, cells, tuple(body), step=block)]


def _by_columns(
    tables: Tables, operation: Product, sources: list[Expression], slot: Name
) -> list[Statement]:
    """Only one frame: compilers vectorise along the cells."""
    cells, constant = operation.constant.size, Integer(tables.data(operation.constant))
    columns = _divisor(cells, COLUMNS)
    values = [Name(f"v{m}") for m in range(columns)]
    lines: list[Statement] = [Loop(K, cells, (Assign(slot[K], tables.number_at(constant + K)),))]
    for matrix, source in zip(operation.matrices, sources, strict=True):
        at = Integer(tables.data(np.ascontiguousarray(matrix.T)))
        body: list[Statement] = [Declare("real", tuple((value, None) for value in values))]
        body += [
            block(fixed(CELL, J + m, of="int"), Assign(value, source))
            for m, value in enumerate(values)
        ]
        terms: list[Expression] = [
            tables.number_at(at + (J + m) * cells + K) * value for m, value in enumerate(values)
        ]
        body.append(Loop(K, cells, (add(slot[K], total(terms)),)))
        lines.append(Loop(J, cells, tuple(body), step=columns))
    return lines


def _divisor(number: int, most: int) -> int:
    return max(n for n in range(1, most + 1) if number % n == 0)
