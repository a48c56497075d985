"""`cnnum export`: a program as C99 for a microcontroller."""

import os
import re
from pathlib import Path

import click

from cnnum.cli.options import completed, force_option, json_option
from cnnum.cli.output import Output

SHORT, LONG = 48, 160
"""Frames of each stream of the test vector: long ones where they change more outputs."""


@click.command("export")
@click.argument("program", shell_complete=completed("program"))
@click.option("--shape", default="8x8x3", show_default=True, help="Rows, columns and axes.")
@click.option("--precision", default="q15", show_default=True, help="q15, q7, qM.N or float32.")
@click.option(
    "--method",
    type=click.Choice(("auto", "euler")),
    default="auto",
    show_default=True,
    help="Products where they are exact, or Euler's steps, of cells that see others.",
)
@click.option("--needs", help="Wanted outputs, as in gross_slip,slip_x; all unless given.")
@click.option(
    "--out",
    "-o",
    required=True,
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder to write.",
)
@force_option
@json_option
def command(
    program: str,
    shape: str,
    precision: str,
    method: str,
    needs: str | None,
    out: Path,
    force: bool,
    as_json: bool,
) -> int:
    """Write PROGRAM as self-contained C99, with a test vector and a Makefile.

    PROGRAM is one of the library, or one of your own as FILE.py:FUNCTION or MODULE:FUNCTION.

    Memory is static, and precisions of whole numbers need no mathematics library. The range of
    every value is measured on simulated scenes; values beyond it saturate.
    """
    from cnnum.scenes.arrangement import named
    from cnnum.scenes.range_streams import made, vector_streams

    size, place = shape_of(shape), program
    program = named(place).name
    ours = require_room(out, program, force=force)
    wanted = None if needs is None else tuple(name.strip() for name in needs.split(","))
    found = made(place, size, precision, method, wanted)
    about = (
        f"Program '{program}' on {size[0]} x {size[1]} cells in {precision}, method {method}.",
        "Written by 'cnnum export'.",
    )
    exported = found.export(vector_streams(size, SHORT), about)
    if exported.vector.still:
        longer = found.export(vector_streams(size, LONG), about)
        if len(longer.vector.still) < len(exported.vector.still):
            exported = longer
    exported.write(out, force=force or ours)
    vector = exported.vector
    output = Output(as_json)
    output.record(
        {
            "kind": "export",
            "program": program,
            "shape": [*size, 3],
            "precision": precision,
            "method": method,
            "folder": str(out),
            "files": sorted(exported.files),
            "memory_bytes": exported.memory_bytes,
            "input_bytes": exported.input_bytes,
            "output_bytes": exported.output_bytes,
            "table_bytes": exported.table_bytes,
            "vector_frames": len(vector.frames),
            "vector_streams": sum(vector.begins),
            "outputs_that_stay": list(vector.still),
            "constants_flipped": vector.flipped,
            "constants_unnoticed": sum(vector.unseen.values()),
        }
    )
    output.show(
        f"Wrote {', '.join(sorted(exported.files))} to {out}.",
        f"Memory {exported.memory_bytes} bytes, a frame {exported.input_bytes}, its answers "
        f"{exported.output_bytes}, tables {exported.table_bytes}.",
        f"The test vector has {len(vector.frames)} frames of {sum(vector.begins)} streams.",
        *vector.about(found.program),
    )
    return 0


def require_room(out: Path, program: str, *, force: bool) -> bool:
    """Refuse a folder that cannot be made or written, before the work of a minute.

    Returns
    -------
    bool
        Whether it holds an earlier export of this program, which is replaced.

    Raises
    ------
    click.UsageError
        If a file is in its way, its place takes no files, or it holds such files of other work.
    """
    from cnnum.embedded.c.files import in_the_way, is_export

    there = next(place for place in (out, *out.absolute().parents) if place.exists())
    if not (there.is_dir() and os.access(there, os.W_OK | os.X_OK)):
        raise click.UsageError(f"'{out}' cannot be written: '{there}' takes no new files.")
    ours = is_export(out, program)
    if not (force or ours) and (other := in_the_way(out, program)):
        raise click.UsageError(
            f"'{out}' has a file '{other}' that no export of '{program}' wrote: choose another "
            "folder, or give --force."
        )
    return ours


def shape_of(text: str) -> tuple[int, int]:
    """Return rows and columns of a shape such as 8x8x3.

    Raises
    ------
    click.UsageError
        If it is none.
    """
    found = re.fullmatch(r"(\d{1,3})x(\d{1,3})(x3)?", text)
    if found is None or int(found[1]) < 2 or int(found[2]) < 2:
        raise click.UsageError(f"A shape is ROWSxCOLSx3, as in 8x8x3, got '{text:.60}'.")
    return int(found[1]), int(found[2])
