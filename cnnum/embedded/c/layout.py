"""The structures of the C text as NumPy has them: bytes in, bytes out."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cnnum.embedded.c.program import WIDTHS, element_type
from cnnum.embedded.emulator import Numbers
from cnnum.embedded.program import Array

CODES = {"float": "<f4", "uint8_t": "<u1", "int8_t": "<i1", "int16_t": "<i2", "int32_t": "<i4"}


def record_type(arrays: Sequence[Array], *, memory: bool = False) -> np.dtype[Any]:
    """Return the layout of a structure of the header, its widest members first.

    Parameters
    ----------
    arrays : sequence of Array
    memory : bool
        Whether it is that of the memory, which begins with a flag.
    """
    ordered = sorted(arrays, key=lambda one: -WIDTHS[element_type(one)])
    members: list[Any] = [
        (one.name, CODES[element_type(one)], (max(1, one.length),)) for one in ordered
    ]
    if memory:
        members = [("started", "<i4"), *members]
    return np.dtype(members or [("nothing", "<u1")], align=True)


def bytes_of(arrays: Sequence[Array], *, memory: bool = False) -> int:
    """Return the size of a structure, with the bytes that C adds at its end."""
    return record_type(arrays, memory=memory).itemsize


def packed(
    arrays: Sequence[Array], values: Mapping[str, Numbers], batch: int, *, memory: bool = False
) -> NDArray[Any]:
    """Return a batch of structures; fields that are not given are 0."""
    records = np.zeros(batch, dtype=record_type(arrays, memory=memory))
    for one in arrays:
        if one.name in values:
            records[one.name] = values[one.name]
    return records


def unpacked(arrays: Sequence[Array], records: NDArray[Any]) -> dict[str, Numbers]:
    """Return the numbers of structures by array, (batch, length) each."""
    real = {"f": np.float64}
    return {
        one.name: records[one.name].astype(real.get(records[one.name].dtype.kind, np.int64))
        for one in arrays
    }
