"""The kernel text of chains of linear operations that were fused into dense products."""

import numpy as np

from cnnum.engines.opencl.storage import Tables
from cnnum.graph.nodes import Product

SUMS = 6
"""Sums of several frames side by side that are kept in registers at a time."""

COLUMNS = 4
"""Columns of a matrix that are added at a time to the sums of a single frame."""


def product(tables: Tables, operation: Product, sources: list[str], slot: str) -> list[str]:
    """Return statements that set an array to Σ matrix · source + constant.

    Parameters
    ----------
    tables : Tables
    operation : Product
    sources : list of str
        Expressions of `i` for the maps that are read.
    slot : str
        Name of the array.
    """
    if tables.lanes > 1:
        return _by_rows(tables, operation, sources, slot)
    return _by_columns(tables, operation, sources, slot)


def _by_rows(tables: Tables, operation: Product, sources: list[str], slot: str) -> list[str]:
    """Each number of a matrix meets many frames: sums stay in registers."""
    cells, constant = operation.constant.size, tables.data(operation.constant)
    block = _divisor(cells, SUMS)
    lines = [f"for (int k = 0; k < {cells}; k += {block}) {{"]
    lines += [f"    real sum{m} = R(data[{constant} + k + {m}]);" for m in range(block)]
    for matrix, source in zip(operation.matrices, sources, strict=True):
        at = tables.data(np.ascontiguousarray(matrix))
        lines += [f"    for (int i = 0; i < {cells}; ++i) {{", f"        const real v = {source};"]
        lines += [
            f"        sum{m} += R(data[{at} + (k + {m}) * {cells} + i]) * v;" for m in range(block)
        ]
        lines.append("    }")
    return [*lines, *(f"    {slot}[k + {m}] = sum{m};" for m in range(block)), "}"]


def _by_columns(tables: Tables, operation: Product, sources: list[str], slot: str) -> list[str]:
    """Only one frame: compilers vectorise along the cells."""
    cells, constant = operation.constant.size, tables.data(operation.constant)
    block = _divisor(cells, COLUMNS)
    lines = [f"for (int k = 0; k < {cells}; ++k) {{ {slot}[k] = R(data[{constant} + k]); }}"]
    for matrix, source in zip(operation.matrices, sources, strict=True):
        at = tables.data(np.ascontiguousarray(matrix.T))
        lines.append(f"for (int j = 0; j < {cells}; j += {block}) {{")
        lines.append(f"    real {', '.join(f'v{m}' for m in range(block))};")
        lines += [f"    {{ const int i = j + {m}; v{m} = {source}; }}" for m in range(block)]
        terms = [f"R(data[{at} + (j + {m}) * {cells} + k]) * v{m}" for m in range(block)]
        added = f"{slot}[k] += {' + '.join(terms)};"
        lines += [f"    for (int k = 0; k < {cells}; ++k) {{ {added} }}", "}"]
    return lines


def _divisor(number: int, most: int) -> int:
    return max(n for n in range(1, most + 1) if number % n == 0)
