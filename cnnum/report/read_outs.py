"""Pictures of read-outs against their level: why an event is reported, and what a level costs."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from textwrap import fill
from typing import Any

import numpy as np

from cnnum.arrays import Floats
from cnnum.report.plots import PALETTE, page_style, write_picture
from cnnum.scenes.explaining import CAUSES, Explained
from cnnum.scenes.tuning import Outcome, Tuned

RATES = (
    "pattern_speed",
    "incoherent_shear",
    "trend",
    "load_rate",
    "swings",
    "ratio_rate",
    "turning",
)
"""Read-outs in 1/s; the others have no unit."""

PLACES = ("x", "y", "row", "column", "sense", "centred", "pivots")
"""Outputs of a kind that say where, which way and how, and not whether."""

HELD = {"still": "slowest movement that counts", **CAUSES}
"""What the movement of a slip is divided by, in words."""

WIDE = 58
"""Signs of a line above a column."""


def draw_explained(
    path: Path, frames: Sequence[tuple[Explained, ...]], at: float, *, force: bool = False
) -> None:
    """Draw the read-outs of slip and twist around a time, one column per kind.

    Parameters
    ----------
    path : Path
        Its suffix says the kind of picture.
    frames : sequence of tuple of Explained
        As `Scene.explain_between` returns them.
    at : float, s
        Time of the frame in question, on the clock of the frames.
    force : bool
        Whether an existing file is replaced.

    Raises
    ------
    UnknownNameError, ReportError
        As `write_picture`.
    """
    with page_style():
        write_picture(_explained(frames, at), path, force=force)


def _explained(frames: Sequence[tuple[Explained, ...]], at: float) -> Any:
    from matplotlib.figure import Figure

    columns = list(zip(*frames, strict=True))
    figure: Any = Figure(figsize=(5.8 * len(columns), 9.5), layout="constrained")
    panels = figure.subplots(4, len(columns), squeeze=False, sharex=True)
    for column, moments in zip(panels.T, columns, strict=True):
        times = np.array([moment.time for moment in moments])
        chosen = moments[int(np.abs(times - at).argmin())]
        parts = {
            name.removeprefix(f"{chosen.kind}_"): np.array([m.read_outs[name] for m in moments])
            for name in chosen.read_outs
        }
        rates = {name: part for name, part in parts.items() if name in RATES}
        numbers = {name: part for name, part in parts.items() if name not in (*RATES, *PLACES)}
        _draw_strength(column[0], moments, times)
        column[0].set_title(fill(str(chosen), WIDE), fontweight="normal", fontsize=9.5)
        below = iter(column[1:])
        if rates:
            _draw_lines(next(below), times, rates, "read-outs, 1/s")
        if chosen.holds:
            _draw_holds(next(below), moments, times)
        _draw_lines(next(below), times, numbers, "read-outs (no unit)")
        unused = list(below)
        for panel in unused:
            panel.set_axis_off()
        used = column[: len(column) - len(unused)]
        for panel in used:
            panel.axvline(chosen.time, color="grey", linewidth=0.8, zorder=0)
        used[-1].set_xlabel("time, s")
        used[-1].tick_params(labelbottom=True)
    return figure


def _legend(panel: Any, columns: int) -> None:
    panel.legend(
        loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=columns, borderpad=0.0,
        handlelength=1.2, columnspacing=1.2,
    )  # fmt: skip


def _draw_strength(panel: Any, moments: Sequence[Explained], times: Floats) -> None:
    kind, level = moments[0].kind, moments[0].level
    strength = np.array([moment.strength for moment in moments])
    panel.fill_between(times, 0.0, 1.0, where=[moment.reported for moment in moments],
                       transform=panel.get_xaxis_transform(), color=PALETTE[1], alpha=0.15,
                       linewidth=0.0, step="mid", label=f"{kind} is reported")  # fmt: skip
    panel.plot(times, strength, label="strength")
    panel.axhline(level, color=PALETTE[1], linestyle="--", label=f"level, {level:.3g}")
    panel.set_ylabel(f"{kind}_strength (no unit)")
    panel.set_ylim(0.0, 1.1 * max(2.0 * level, float(strength.max())))

    def margin(strength: Floats) -> Floats:
        return strength / level

    def back(margin: Floats) -> Floats:
        return margin * level

    panel.secondary_yaxis("right", functions=(margin, back)).set_ylabel(
        "margin: strength over level"
    )
    panel.legend(loc="upper left")


def _draw_lines(panel: Any, times: Floats, parts: Mapping[str, Floats], label: str) -> None:
    for name, part in parts.items():
        panel.plot(times, part, label=name)
    panel.set_ylabel(label)
    _legend(panel, 3)


def _draw_holds(panel: Any, moments: Sequence[Explained], times: Floats) -> None:
    names = list(moments[0].holds)
    parts = [[moment.holds[name] for moment in moments] for name in names]
    panel.stackplot(times, parts, labels=[HELD[name] for name in names], colors=PALETTE, alpha=0.75)
    panel.set_ylabel("divisor of the\nmovement, 1/s")
    _legend(panel, 2)


def draw_tuned(path: Path, tuned: Tuned, *, force: bool = False) -> None:
    """Draw what levels report by mistake, and with labels what they find and how late.

    Parameters
    ----------
    path : Path
        Its suffix says the kind of picture.
    tuned : Tuned
    force : bool
        Whether an existing file is replaced.

    Raises
    ------
    UnknownNameError, ReportError
        As `write_picture`.
    """
    with page_style():
        write_picture(_tuned(tuned), path, force=force)


def _tuned(tuned: Tuned) -> Any:
    from matplotlib.figure import Figure

    labelled = tuned.seen.events > 0
    size = (5.2 * (1 + 2 * labelled), 4.0)
    figure: Any = Figure(figsize=size, layout="constrained")
    panels = figure.subplots(1, 1 + 2 * labelled, squeeze=False, sharey=True)[0]
    curves = {name: curve for name, curve in tuned.curves.items() if curve}
    if not tuned.constants:
        curves.pop("shipped", None)  # the same
    floor = 0.3 / (tuned.seen.seconds / 600.0)  # no report: below one in all recordings
    for colour, (name, curve) in zip(PALETTE, reversed(curves.items()), strict=False):
        levels, outcomes = zip(*curve, strict=True)
        rates = [max(outcome.rate, floor) for outcome in outcomes]
        label = f"{name} constants" if tuned.constants else "any level"
        panels[0].plot(levels, rates, color=colour, label=label)
        bounds = [outcome.bound for outcome in outcomes]
        panels[0].plot(levels, bounds, color=colour, linestyle=":", label="at most, 95 %")
        if labelled:
            panels[1].plot([100.0 * o.share for o in outcomes], rates, color=colour, label=label)
            panels[2].plot([o.delay for o in outcomes], rates, color=colour, label=label)
    _mark(panels, tuned.level, tuned.seen, floor, f"chosen, {tuned.level:.3g}", "o")
    _mark(panels, tuned.shipped_level, tuned.shipped, floor, "shipped", "s")
    for panel in panels:
        panel.axhline(tuned.asked, color="grey", linestyle="--", linewidth=0.8, label="asked")
        panel.set_yscale("log")
    panels[0].set(xscale="log", xlabel=f"{tuned.parameter} of {tuned.event} (no unit)")
    panels[0].set_ylabel(f"false reports in ten minutes (none at {floor:.2g})")
    if labelled:
        panels[1].set_xlabel(f"found, % of {tuned.seen.events} events")
        panels[2].set_xlabel("median delay after the label, s")
    panels[0].legend(loc="best")
    return figure


def _mark(
    panels: Any, level: float, outcome: Outcome, floor: float, label: str, marker: str
) -> None:
    """Put a level into every panel, hollow for the shipped one."""
    face = "none" if marker == "s" else PALETTE[1]
    look = {"marker": marker, "color": PALETTE[1], "markerfacecolor": face, "linestyle": "none"}
    for panel, x in zip(panels, (level, 100.0 * outcome.share, outcome.delay), strict=False):
        panel.plot([x], [max(outcome.rate, floor)], label=label, **look)
