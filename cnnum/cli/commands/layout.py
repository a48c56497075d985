"""`cnnum layout`: the layout of a file of others, proposed and drawn."""

from pathlib import Path
from typing import TYPE_CHECKING, cast

import click

from cnnum.cli.options import assignments, force_option, json_option, setting_option
from cnnum.cli.output import Output
from cnnum.safety.values import visible

if TYPE_CHECKING:
    from cnnum.arrays import Floats
    from cnnum.recordings.recording import Recording

SHADES = " .:-=+*#%@"
"""From nothing to the most, in a picture of letters."""

WIDEST = 64
"""Taxels side by side in such a picture; of larger arrays it shows the largest of several."""


@click.command("layout")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--topic", default="", help="Topic to read from an MCAP file or a bag.")
@setting_option("Set a key of the layout, such as 'rate=60'; may be repeated.")
@click.option("--write", is_flag=True, help="Write the layout next to FILE, with the suffix .toml.")
@force_option
@json_option
def command(
    file: Path, topic: str, settings: tuple[str, ...], write: bool, force: bool, as_json: bool
) -> int:
    """Propose the layout of FILE, and draw one of its frames.

    FILE is a text table, a NumPy, HDF5 or Parquet file, an MCAP file or a bag, lines of JSON, or
    the bytes that an array sent. The exit code is 1 if the file does not determine everything
    that a layout needs.
    """
    from cnnum.drivers.options import read_options
    from cnnum.drivers.own_data.driver import recording_by
    from cnnum.drivers.own_data.layout import DataLayout
    from cnnum.drivers.own_data.proposal import propose
    from cnnum.drivers.own_data.proposed_shape import settle_shape, take_channels
    from cnnum.errors import RecordingError, SceneError, missing_file
    from cnnum.safety.files import refuse_target, write_whole
    from cnnum.safety.reading import names_something

    output = Output(as_json)
    if not names_something(file):
        raise missing_file(RecordingError, f"There is no file '{file}'.")
    target = file.with_suffix(".toml")
    if write:
        refuse_target(target, error=RecordingError, force=force)
    given = assignments(settings)
    proposal = propose(file, topic or str(given.get("topic", "")), str(given.get("time", "")))
    known: set[str] = {key.split(".")[0] for key in given}
    if "time" in given:
        known.add("rate")
    proposal.undecided = [said for said in proposal.undecided if said.split(":")[0] not in known]
    if isinstance(channels := given.get("channels"), list):
        take_channels(proposal, len(cast("list[object]", channels)))
    proposal.table |= given
    recording: Recording | None = None
    unshaped = "shape" not in given and bool(proposal.shapes)
    try:
        # its shape may follow from its presses, for which a rate is of no matter
        spare = {"rate": 1.0} if unshaped and proposal.asks("rate") else {}
        recording = recording_by(file, read_options(DataLayout, proposal.table | spare, Path()))
        before = dict(proposal.table)
        if (unshaped and not settle_shape(proposal, recording)) or spare:
            recording = None
        elif proposal.table != before:
            recording = recording_by(file, read_options(DataLayout, proposal.table, Path()))
    except SceneError as error:
        if given or "rate" not in str(error):
            raise
    text = proposal.text()
    written = write and recording is not None
    if written:
        write_whole(target, text, error=RecordingError, force=force)
    output.record(
        {
            "kind": "layout",
            "file": str(file),
            "layout": dict(proposal.table),
            "undecided": proposal.undecided,
            "seen": proposal.seen,
            "frames": 0 if recording is None else len(recording),
            "rate_hz": None if recording is None else recording.rate,
            "written": str(target) if written else None,
        },
    )
    if not as_json:
        click.echo(visible(text).rstrip("\n"))
        if recording is not None:
            click.echo("")
            click.echo(repr(recording))
            number = most_moved(recording)
            click.echo(f"frame {number}, {recording.channels[-1]} less its rest:")
            click.echo(drawn(moved(recording, number)))
    if written:
        click.echo(visible(f"Written: {target}"), err=as_json)
    return 0 if recording is not None else 1


def _rest(recording: "Recording") -> "Floats":
    """Return the median of the last channel over the first second; 0 where nothing is finite."""
    import numpy as np

    first = recording.values[: max(3, round(recording.rate)), ..., -1]
    good = np.isfinite(first)
    return np.asarray(
        np.nanmedian(np.where(good, first, np.where(good.any(axis=0), np.nan, 0.0)), axis=0)
    )


def moved(recording: "Recording", number: int) -> "Floats":
    """Return the last channel of a frame less its median over the first second."""
    import numpy as np

    with np.errstate(all="ignore"):
        away = recording.values[number, ..., -1] - _rest(recording)
        return np.where(np.isfinite(away), away, 0.0)


def most_moved(recording: "Recording") -> int:
    """Return the number of the frame whose last channel is furthest from its rest."""
    import numpy as np

    with np.errstate(all="ignore"):
        away = np.abs(recording.values[..., -1] - _rest(recording))
    away = np.where(np.isfinite(away), away, 0.0)
    return int(np.argmax(away.reshape(len(away), -1).sum(axis=1)))


def drawn(values: "Floats") -> str:
    """Return (rows, cols) magnitudes as lines of letters, two a taxel."""
    import numpy as np

    sizes = np.abs(values)
    step = -(-max(sizes.shape) // WIDEST)
    rows, cols = (-(-size // step) for size in sizes.shape)
    wide = np.zeros((rows * step, cols * step))
    wide[: sizes.shape[0], : sizes.shape[1]] = sizes
    small = wide.reshape(rows, step, cols, step).max(axis=(1, 3))
    top = float(small.max()) or 1.0
    shades = np.rint((len(SHADES) - 1) * small / top).astype(int).tolist()
    lines = ["".join(2 * SHADES[shade] for shade in row) for row in shades]
    edge = "+" + "-" * 2 * cols + "+"
    return "\n".join([edge, *(f"|{line}|" for line in lines), edge])
