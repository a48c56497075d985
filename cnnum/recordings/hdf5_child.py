"""Reads arrays of an HDF5 or Parquet file in a process of its own, whose end harms nobody.

A library ends its process on some damaged files, takes memory by what a file says, and opens
other files that it names. So this script runs alone: it has limits, and may open no file but the
one that comes as its standard input. It imports nothing of cnnum. Its request is JSON, the first
argument: ``kind``, ``names`` of the arrays, ``most`` bytes that all of them together may have,
``memory`` bytes beyond its own, ``seconds``, and of Parquet's ``rows`` a column and the number that
it must have. It answers with a line of JSON, then the arrays'
bytes. Where no names are wanted, the line has shapes and types of all arrays, and the attributes.
"""

import codecs
import json
import math
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

NUMBERS = "fiub"
STAMPED = ("timestamp", "duration")
NANOSECONDS = {"s": 10**9, "ms": 10**6, "us": 1000, "ns": 1}
"""Types of columns that are times, and their units; they are handed on in ns."""

LISTED = 12
MOST_LISTED, LONGEST_TEXT = 1024, 1 << 16
"""Arrays and letters of an attribute, where all are asked for."""


def of_parquet(
    file: Any, wanted: list[str], most: int, rows: tuple[str, int] | None = None
) -> tuple[dict[str, Any], list[Any]]:
    """Return the head and the columns of a Parquet file, lists in them as further axes.

    With `rows`, the groups in which no row has that number are not read.
    """
    import numpy as np

    parquet: Any = import_module("pyarrow.parquet")
    opened: Any = parquet.ParquetFile(file, thrift_string_size_limit=1 << 24)
    names: list[str] = [str(name) for name in opened.schema_arrow.names]
    count = int(opened.metadata.num_rows)
    if not wanted:
        some: Any = next(opened.iter_batches(batch_size=1), None) if count else None
        shapes: dict[str, Any] = {}
        for name in names[:MOST_LISTED]:
            kind = str(opened.schema_arrow.field(name).type)
            # times of a zone would be objects of pandas
            whole = some is None or kind.startswith(STAMPED)
            first: Any = None if whole or some is None else some.column(name)[0].as_py()
            shape = list(np.shape(first)) if first is not None else []
            shapes[name] = [[count, *shape], kind]
        return {"names": names, "shapes": shapes, "attributes": {}}, []
    if any(name not in names for name in wanted):
        return {"names": names[:LISTED]}, []
    numbers = range(opened.metadata.num_row_groups)
    groups = [n for n in numbers if _may_hold(opened.metadata.row_group(n), rows)]
    if sum(int(opened.metadata.row_group(n).total_byte_size) for n in groups) > most:
        raise ValueError("it claims to unpack to more bytes than the file can contain")
    table: Any = opened.read_row_groups(groups, columns=wanted, use_threads=False)
    held: list[Any] = []
    for name in wanted:
        column: Any = table.column(name).combine_chunks()
        scale = 1
        if str(column.type).startswith(STAMPED):
            scale = NANOSECONDS[column.type.unit]
            column = column.cast("int64")
        shape = [len(table)]
        while hasattr(column, "flatten") and hasattr(column, "values"):
            inner: Any = column.flatten()
            width, rest = divmod(len(inner), max(1, len(column)))
            if rest:
                raise ValueError(f"the lists of the column '{name}' differ in length")
            shape.append(width)
            column = inner
        array = np.asarray(column.to_numpy(zero_copy_only=False))
        if array.dtype.kind not in NUMBERS:
            raise ValueError(f"the column '{name}' must contain numbers, got '{array.dtype}'")
        held.append(array.reshape(shape) * scale)
    head = [[array.dtype.newbyteorder("<").str, list(array.shape)] for array in held]
    return {"names": names[:LISTED] + wanted, "arrays": head}, held


def _may_hold(group: Any, rows: tuple[str, int] | None) -> bool:
    """Return whether a group may have such rows, by the least and the largest number in it."""
    if rows is None:
        return True
    columns = (group.column(place) for place in range(int(group.num_columns)))
    own: Any = next((column for column in columns if column.path_in_schema == rows[0]), None)
    if own is None or own.statistics is None or not own.statistics.has_min_max:
        return True
    return bool(own.statistics.min <= rows[1] <= own.statistics.max)


def answer(file: Any, wanted: list[str], most: int) -> tuple[dict[str, Any], list[Any]]:
    """Return the head of the answer, and the arrays."""
    h5py: Any = import_module("h5py")
    result: list[str] = []

    def note(name: Any, item: Any) -> None:
        listed = len(result) < (LISTED if wanted else MOST_LISTED) or name in wanted
        if listed and isinstance(item, h5py.Dataset) and isinstance(name, str):
            result.append(name)

    with h5py.File(file, "r") as opened:
        opened.visititems(note)
        if not wanted:
            return _listed(opened, result), []
        if any(name not in result for name in wanted):
            return {"names": result}, []
        arrays: list[Any] = [opened[name] for name in wanted]
        total = 0
        for name, array in zip(wanted, arrays, strict=True):
            total += _size(name, array)
        if total > most:
            raise ValueError(
                f"its arrays claim to have {total:,} bytes, which is more than the file can contain"
            )
        held: list[Any] = [array[...] for array in arrays]
    head = [[array.dtype.newbyteorder("<").str, list(array.shape)] for array in held]
    return {"names": result, "arrays": head}, held


def _listed(opened: Any, names: list[str]) -> dict[str, Any]:
    """Return the names of arrays with their shapes and types, and the attributes of the file."""
    shapes: dict[str, Any] = {
        name: [list(map(int, opened[name].shape or ())), str(opened[name].dtype)] for name in names
    }
    attributes: dict[str, Any] = {}
    for name in list(opened.attrs)[:LISTED]:
        value: Any = opened.attrs[name]
        value = value.tolist() if hasattr(value, "tolist") else value
        if len(str(value)) <= LONGEST_TEXT and isinstance(value, (str, int, float, list)):
            attributes[str(name)] = value
    return {"names": names, "shapes": shapes, "attributes": attributes}


def _size(name: str, array: Any) -> int:
    """Return the bytes of an array, or of one of its chunks if that is larger.

    Raises
    ------
    ValueError
        If it holds no numbers, or they lie elsewhere.
    """
    if array.shape is None:
        raise ValueError(f"the array '{name}' is empty: it has neither a shape nor numbers")
    if array.external is not None or array.is_virtual:
        raise ValueError(f"the numbers of the array '{name}' are in other files")
    if array.dtype.kind not in NUMBERS:
        raise ValueError(f"the array '{name}' must contain numbers, got the type '{array.dtype}'")
    cells = math.prod(int(n) for n in array.shape)
    chunk = math.prod(int(n) for n in array.chunks or ())
    return max(cells, chunk) * int(array.dtype.itemsize)


def limit(memory: int, seconds: int) -> None:
    """Leave this process so much more memory and time, and no file that is not open already."""
    try:
        import resource
    except ImportError:  # Windows has no such limits; the parent's clock holds there, too
        return
    statm = Path("/proc/self/statm")
    if statm.exists():
        used = int(statm.read_bytes().split()[0]) * resource.getpagesize()
        _at_most(resource.RLIMIT_AS, used + memory)
    _at_most(resource.RLIMIT_CPU, seconds)
    _at_most(resource.RLIMIT_CORE, 0)
    _at_most(resource.RLIMIT_NOFILE, 0)


def _at_most(kind: int, value: int) -> None:
    import resource

    soft, hard = resource.getrlimit(kind)
    known = [n for n in (value, soft, hard) if n != resource.RLIM_INFINITY]
    resource.setrlimit(kind, (min(known), hard))


def run(request: dict[str, Any], source: Any, target: Any) -> None:
    """Answer a request; what goes wrong is a sentence of the answer."""
    import numpy as np

    # before there is a limit on files: the codec is that of types of text
    parquet = request.get("kind") == "parquet"
    for library in ("pyarrow.parquet", "pyarrow.compute") if parquet else ("h5py",):
        import_module(library)
    codecs.lookup("ascii")
    limit(int(request["memory"]), int(request["seconds"]))
    try:
        names, most = list[str](request["names"]), int(request["most"])
        if parquet:
            head, held = of_parquet(source, names, most, request.get("rows"))
        else:
            head, held = answer(source, names, most)
    except Exception as error:  # whatever a library finds in a damaged file
        head, held = {"error": f"{error}" or type(error).__name__}, []
    target.write(json.dumps(head, default=str).encode() + b"\n")
    for array in held:
        target.write(np.asarray(array, array.dtype.newbyteorder("<")).tobytes())
    target.flush()


if __name__ == "__main__":
    run(json.loads(sys.argv[1]), sys.stdin.buffer, sys.stdout.buffer)
