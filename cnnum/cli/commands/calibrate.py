"""`cnnum calibrate`: from a scan of point loads to a calibration file."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from cnnum.cli.options import file_option, force_option, json_option
from cnnum.cli.output import Output, facts, quantity

if TYPE_CHECKING:
    from cnnum.tactile.taxel import CalibrationFit

COLUMNS = ("x", "y", "fx", "fy", "fz", "left", "right", "top", "bottom")
"""Columns of a scan: place of the load (m), force (N), bridge voltages (V)."""

LISTED = 10
"""Rows of outliers that are named on the terminal; `--json` has all."""


@click.command("calibrate")
@click.argument("scan", type=click.Path(path_type=Path))
@click.option(
    "--youngs-modulus",
    type=click.FloatRange(1.0, 1e12),
    required=True,
    metavar="PA",
    help="Young's modulus of the cover.",
)
@click.option(
    "--depth",
    type=click.FloatRange(1e-9, 10.0),
    metavar="M",
    help="Thickness of the cover; fitted by default.",
)
@click.option(
    "--limit", type=float, default=float("inf"), metavar="V", help="End of the voltage range."
)
@file_option("calibration.toml", "File to write the calibration to.")
@force_option
@json_option
def command(
    scan: Path,
    youngs_modulus: float,
    depth: float | None,
    limit: float,
    out: Path,
    force: bool,
    as_json: bool,
) -> int:
    """Fit the calibration of a taxel to SCAN, a CSV file of point loads on its cover.

    The columns are x, y (m, from the taxel), fx, fy, fz (N), left, right, top, bottom (V,
    amplified). With a column time (s, since switch-on) the offsets may drift. Outliers such as
    spikes are listed, and their influence on the fit is bounded. The calibration is written as
    TOML for the key 'calibration.file' of a scene.
    """
    from cnnum.drivers.text_table import read_table
    from cnnum.tactile.taxel import fit_calibration

    table = read_table(scan)
    numbers = table.numbers(COLUMNS)
    times = table.numbers(("time",))[:, 0] if "time" in table.header else None
    fit = fit_calibration(
        numbers[:, :2],
        numbers[:, 2:5],
        numbers[:, 5:],
        youngs_modulus=youngs_modulus,
        depth=depth,
        times=times,
        limit=limit,
    )
    fit.calibration.save(out, force=force)
    output = Output(as_json)
    output.record(_record(fit, out, len(numbers)))
    output.show(facts(_facts(fit, len(numbers)), title=f"Written: {out}"))
    return 0


def _record(fit: "CalibrationFit", out: Path, points: int) -> dict[str, object]:
    field = fit.field
    return {
        "kind": "calibration",
        "file": str(out),
        "points": points,
        "depth": fit.depth,
        "alpha_normal": fit.calibration.alpha_normal,
        "beta_ns": fit.calibration.beta_ns,
        "residual": fit.residual,
        "outliers": _outliers(fit),
        "width": None if field is None else field.width,
        "amplitude": None if field is None else field.amplitude,
        "inhibition": None if field is None else field.inhibition,
    }


def _outliers(fit: "CalibrationFit") -> list[int]:
    """Return the rows of the scan, from 1 below its header, that are far off all others."""
    return [row + 1 for row, far in enumerate(fit.outliers) if far.any()]


def _facts(fit: "CalibrationFit", points: int) -> list[tuple[str, str]]:
    pairs = [
        ("points", str(points)),
        ("depth", quantity(fit.depth, "m")),
        ("β_ns", f"{fit.calibration.beta_ns:.4g}"),
        ("α_n", f"{fit.calibration.alpha_normal:.4g} 1/V"),
        ("left over", quantity(fit.residual, "V")),
    ]
    if rows := _outliers(fit):
        listed = ", ".join(map(str, rows[:LISTED])) + (", …" if len(rows) > LISTED else "")
        pairs.append(("outliers", f"{len(rows)}, given little weight: rows {listed}"))
    if fit.field is not None:
        pairs.append(("W", quantity(fit.field.width, "m")))
    return pairs
