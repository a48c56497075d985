"""Rows as a file keeps them: with the machine, the versions and the device they are from."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from cnnum.report.environment import Environment
from cnnum.safety.files import write_whole
from cnnum.sharing.json_values import json_value

Row = dict[str, object]


def as_row(record: Any) -> Row:
    """Return a row's fields; a number that is not finite becomes None."""
    return {key: json_value(value) for key, value in asdict(record).items()}


def append_row(folder: Path | None, name: str, rows: Sequence[Mapping[str, object]]) -> None:
    """Append the last row to a benchmark's file of rows; the first begins the file anew.

    Parameters
    ----------
    folder : Path or None
        Made if it is not there; None keeps nothing.
    name : str
        The benchmark: the file is `NAME.jsonl`, a JSON object a line.
    rows : sequence of mapping
    """
    if folder is None:
        return
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / f"{name}.jsonl").open("w" if len(rows) == 1 else "a", encoding="utf-8") as file:
        file.write(json.dumps(dict(rows[-1]), ensure_ascii=False) + "\n")


def write_data(
    path: Path,
    title: str,
    rows: Sequence[Mapping[str, object]],
    device: str,
    omissions: Sequence[str],
) -> None:
    """Write the data behind a picture.

    Parameters
    ----------
    path : Path
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
    write_whole(path, (json.dumps(tree, indent=1, ensure_ascii=False) + "\n").encode("utf-8"))
