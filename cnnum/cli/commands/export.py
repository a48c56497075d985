"""`cnnum export`: a program as C99 for a microcontroller."""

import os
import re
from pathlib import Path
from typing import TYPE_CHECKING

import click

from cnnum.cli.options import (
    assignments,
    completed,
    force_option,
    json_option,
    set_option,
    trust_option,
)
from cnnum.cli.output import Output
from cnnum.embedded.c.packages import PACKAGES

if TYPE_CHECKING:
    from cnnum.embedded.c.files import Exported


@click.command("export")
@click.argument("programs", nargs=-1, metavar="[PROGRAM]...", shell_complete=completed("program"))
@click.option("--shape", help="Rows and columns; by default those of --like, or 8x8.")
@click.option("--precision", default="q15", show_default=True, help="q15, q7, qM.N or float32.")
@click.option(
    "--method",
    type=click.Choice(("auto", "euler")),
    default="auto",
    show_default=True,
    help="Exact products where possible, or Euler steps, for coupled cells.",
)
@click.option("--rate", type=click.FloatRange(min=0, min_open=True), help="Frames per second.")
@click.option(
    "--like",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Recording on which ranges are measured.",
)
@click.option("--channels", help="Channels of a frame, such as normal or shear_x,shear_y,normal.")
@click.option(
    "--scene",
    help="Scene that supplies program, parameters, outputs and calibrated frames.",
)
@set_option
@trust_option
@click.option(
    "--package",
    type=click.Choice(PACKAGES),
    help="Also write the files for this build system.",
)
@click.option(
    "--share-memory",
    is_flag=True,
    help="Let working arrays share memory, as those of several programs always do.",
)
@click.option("--needs", help="Outputs, such as gross_slip,slip_x; all by default.")
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
    programs: tuple[str, ...],
    shape: str | None,
    precision: str,
    method: str,
    rate: float | None,
    like: Path | None,
    channels: str | None,
    scene: str | None,
    settings: tuple[str, ...],
    trust: bool,
    package: str | None,
    share_memory: bool,
    needs: str | None,
    out: Path,
    force: bool,
    as_json: bool,
) -> int:
    """Write PROGRAM as self-contained C99, with a test vector and a Makefile.

    PROGRAM is a program of the library, or your own as FILE.py:FUNCTION or MODULE:FUNCTION. Several
    are exported as one, which computes common fields once and shares working memory. With --scene
    it is the program of the scene.

    Memory is static, and whole-number precisions need no mathematics library. The range of every
    value is measured on the frames of --like or --scene, or on simulated strain, and values
    beyond it saturate. Time constants are those for the rate of these frames, or for --rate.
    """
    from cnnum.scenes.arrangement import named
    from cnnum.scenes.exporting import export, export_scene
    from cnnum.scenes.pipeline import load_scene

    if bool(programs) == (scene is not None):
        raise click.UsageError("Give either a PROGRAM, or a scene with --scene.")
    if scene is not None:
        if (
            any(option is not None for option in (shape, rate, like, channels, needs))
            or share_memory
        ):
            raise click.UsageError(
                "A scene determines shape, rate, channels and outputs: leave these options out."
            )
        with load_scene(scene, changes=assignments(settings), trust=trust) as opened:
            ours = require_room(out, opened.plan.program, package, force=force)
            exported = export_scene(opened, precision=precision, method=method)
    else:
        size = None if shape is None else shape_of(shape)
        several = [named(program) for program in programs]
        label = "_".join(program.name for program in several)
        ours = require_room(out, label, package, force=force)
        exported = export(
            several,
            size,
            precision=precision,
            method=method,
            needs=_names(needs),
            channels=_names(channels),
            rate=rate,
            like=like,
            share_memory=share_memory,
        )
    if package is not None:
        exported = exported.packaged(package)
    exported.write(out, force=force or ours)
    _show(exported, out, Output(as_json))
    return 0


def _show(exported: "Exported", out: Path, output: Output) -> None:
    vector, facts, program = exported.vector, exported.facts, exported.program
    output.record(
        {
            "kind": "export",
            "program": program.name,
            "shape": [*program.shape, len(program.of_kind("input"))],
            "precision": facts.precision,
            "method": facts.method,
            "rate": facts.rate,
            "unit": facts.unit,
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
            "errors": dict(exported.errors),
        }
    )
    timed = (
        []
        if facts.rate is None
        else [f"Time constants are those for {facts.rate:g} frames per second."]
    )
    output.show(
        f"Wrote {', '.join(sorted(exported.files))} to {out}.",
        f"Memory {exported.memory_bytes} bytes, a frame {exported.input_bytes}, its answers "
        f"{exported.output_bytes}, tables {exported.table_bytes}.",
        *timed,
        f"The test vector has {len(vector.frames)} frames of {sum(vector.begins)} streams.",
        *exported.about(),
    )


def _names(text: str | None) -> tuple[str, ...] | None:
    return None if text is None else tuple(name.strip() for name in text.split(","))


def require_room(out: Path, program: str, package: str | None = None, *, force: bool) -> bool:
    """Check that a folder can be created and written, before a minute of work.

    Returns
    -------
    bool
        Whether it holds an earlier export of this program, which is replaced.

    Raises
    ------
    click.UsageError
        If a file is in the way, the place cannot be written, or it holds another program's export.
    """
    from cnnum.embedded.c.files import in_the_way, is_export

    there = next(place for place in (out, *out.absolute().parents) if place.exists())
    if not (there.is_dir() and os.access(there, os.W_OK | os.X_OK)):
        raise click.UsageError(f"'{out}' cannot be written: no files can be created in '{there}'.")
    ours = is_export(out, program)
    if not force and (other := in_the_way(out, program, package)):
        raise click.UsageError(
            f"'{out}' contains the file '{other}', which is not from an export of '{program}': "
            "choose another folder, or use --force."
        )
    return ours


def shape_of(text: str) -> tuple[int, int]:
    """Return rows and columns of a shape such as 8x8x3.

    Raises
    ------
    click.UsageError
        If it is none.
    """
    match = re.fullmatch(r"(\d{1,3})x(\d{1,3})(x3)?", text)
    if match is None or int(match[1]) < 2 or int(match[2]) < 2:
        raise click.UsageError(f"A shape must be ROWSxCOLSx3, such as 8x8x3, got '{text:.60}'.")
    return int(match[1]), int(match[2])
