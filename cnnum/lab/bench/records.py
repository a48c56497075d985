"""Rows as a file keeps them: with the machine, the versions and the device they are from."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from cnnum.errors import ReportError
from cnnum.report.environment import Environment
from cnnum.safety.files import append, make_folder, sentences, write_whole
from cnnum.sharing import json_value

Row = dict[str, object]


def as_row(record: Any) -> Row:
    """Return a row's fields; a number that is not finite becomes None."""
    return {key: json_value(value) for key, value in asdict(record).items()}


def append_row(
    folder: Path | None,
    name: str,
    rows: Sequence[Mapping[str, object]],
    *,
    force: bool = False,
) -> None:
    """Append the last row to a benchmark's file of rows; the first begins the file.

    Parameters
    ----------
    folder : Path or None
        Made if it is not there; None keeps nothing.
    name : str
        The benchmark: the file is `NAME.jsonl`, a JSON object a line.
    rows : sequence of mapping
    force : bool
        Whether a file of rows that another run has left is begun anew.

    Raises
    ------
    ReportError
        If there is such a file, or it cannot be written.
    """
    if folder is None:
        return
    path = rows_file(folder, name)
    with sentences(path, ReportError):
        make_folder(folder)
    if len(rows) == 1:
        write_whole(path, b"", force=force)
    with sentences(path, ReportError):
        append(path, (json.dumps(dict(rows[-1]), ensure_ascii=False) + "\n").encode("utf-8"))


def rows_file(folder: Path, name: str) -> Path:
    """Return the file of a benchmark's rows, which is there while it runs."""
    return folder / f"{name}.jsonl"


def data_text(
    title: str, rows: Sequence[Mapping[str, object]], device: str, omissions: Sequence[str]
) -> str:
    """Return the data behind a picture, as JSON.

    Parameters
    ----------
    title : str
        The command that measured it.
    rows : sequence of mapping
    device : str
    omissions : sequence of str
        The cases left out, and why.
    """
    here = Environment.here(device)
    tree = {
        "command": title,
        "environment": {**asdict(here), "versions": dict(here.versions)},
        "rows": list(rows),
        "omissions": list(omissions),
    }
    return json.dumps(tree, indent=1, ensure_ascii=False) + "\n"
