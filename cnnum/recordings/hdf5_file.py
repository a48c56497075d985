"""Arrays of HDF5 and Parquet files, which a child process reads: its end is a sentence here."""

import json
import os
import subprocess
import sys
import threading
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import IO, Any, cast

import numpy as np
from numpy.typing import NDArray

from cnnum.errors import RecordingError, missing_extra, unreadable
from cnnum.safety.reading import MEGABYTE, open_regular
from cnnum.safety.values import host_bytes

PARQUET = ".parquet"

CHILD = Path(__file__).with_name("hdf5_child.py")

DENSEST = 1032
"""Bytes that one byte of a file may become: the most that DEFLATE packs into one."""

SMALLEST = 16 * MEGABYTE
"""Bytes that a file may hold however small it is."""

SECONDS, BYTES_A_SECOND = 60.0, 4e6
"""s that reading may take, and bytes of the file for which it may take another."""

LARGEST_HEAD = MEGABYTE
"""Bytes of the line before the arrays."""

Answer = tuple[dict[str, Any], list[NDArray[Any]]]


def read_hdf5(
    path: Path, names: Sequence[str], rows: tuple[str, int] | None = None
) -> tuple[list[str], Mapping[str, NDArray[Any]]]:
    """Return names of arrays in an HDF5 file, and the arrays of the wanted names.

    Parameters
    ----------
    path : Path
    names : sequence of str
        Wanted ones; a name may have folders, as in "trial1/taxels".
    rows : (column, number), optional
        Of a Parquet file: groups in which no row has that number are not read.

    Returns
    -------
    (list of str, mapping of str to array)
        Some names of the file, the wanted ones among them where it has them. No arrays unless it
        has all of them.

    Raises
    ------
    MissingExtraError
        If h5py is not installed.
    RecordingError
        If the file cannot be read: it is damaged, its numbers lie in other files, or it says to
        hold far more than it is large.
    """
    head, arrays = _asked(path, names, rows)
    result = [str(name) for name in head.get("names", ())]
    return result, dict(zip(names, arrays, strict=False))


def list_hdf5(path: Path) -> tuple[dict[str, tuple[tuple[int, ...], str]], dict[str, Any]]:
    """Return the shapes and types of all arrays of an HDF5 file, and the attributes of the file.

    It raises as `read_hdf5`.
    """
    head, _ = _asked(path, ())
    shapes = {name: (tuple(shape), kind) for name, (shape, kind) in head.get("shapes", {}).items()}
    return shapes, dict(head.get("attributes", {}))


def _asked(path: Path, names: Sequence[str], rows: tuple[str, int] | None = None) -> Answer:
    parquet = path.suffix.lower() == PARQUET
    library, extra = ("pyarrow", "lerobot") if parquet else ("h5py", "hdf5")
    if find_spec(library) is None:
        kind = "Parquet" if parquet else "HDF5"
        raise missing_extra(f"the {kind} file '{path.name}'", library, extra)
    try:
        with open_regular(path) as file:
            size = os.fstat(file.fileno()).st_size
            room = host_bytes() or DENSEST * size
            most = min(max(SMALLEST, DENSEST * size), room)
            seconds = SECONDS + size / BYTES_A_SECOND
            request: dict[str, Any] = {"names": list(names), "most": most, "seconds": int(seconds)}
            request |= {"kind": "parquet" if parquet else "hdf5", "rows": rows}
            # a chunk is held twice while it is unpacked
            request |= {"memory": 2 * most + 256 * MEGABYTE}
            head, arrays = child_answer(file, request, seconds)
    except OSError as error:
        raise unreadable(RecordingError, f"'{path}'", error) from None
    if "error" in head:
        raise RecordingError(f"'{path}' cannot be read: {_sentence(head['error'])}.")
    return head, arrays


def child_answer(file: IO[bytes], request: Mapping[str, Any], seconds: float) -> Answer:
    """Return the answer of a child that reads a file; its death is an answer with an "error"."""
    command = [sys.executable, "-P", str(CHILD), json.dumps(dict(request))]
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
    with subprocess.Popen(
        command,
        stdin=file,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env=environment,
    ) as child:
        late = threading.Event()

        def end() -> None:
            late.set()
            child.kill()

        clock = threading.Timer(seconds, end)
        clock.start()
        try:
            got = received(cast(IO[bytes], child.stdout), int(request["most"]))
        finally:
            clock.cancel()
            child.kill()
    if late.is_set():
        return {"error": f"it took more than {seconds:.0f} s"}, []
    return got or ({"error": "it is damaged, and ended the HDF5 library that read it"}, [])


def received(source: IO[bytes], most: int) -> Answer | None:
    """Return what a child has sent, None if it ended before its last byte."""
    line = source.readline(LARGEST_HEAD)
    if not line.endswith(b"\n"):
        return None
    head: dict[str, Any] = json.loads(line)
    arrays = list[NDArray[Any]]()
    for kind, shape in head.get("arrays", ()):
        array = np.empty(shape, np.dtype(kind))
        if array.nbytes > most:
            return None
        view, at = array.reshape(-1).view(np.uint8).data, 0
        while at < len(view):
            count = int(cast(Any, source).readinto(view[at:]))
            if not count:
                return None
            at += count
        arrays.append(array)
    return head, arrays


def _sentence(error: object) -> str:
    """Return what a library says, in one line of printable signs, without its last full stop."""
    text = "".join(sign if sign.isprintable() else " " for sign in str(error))
    return " ".join(text.split())[:300].rstrip(".")
