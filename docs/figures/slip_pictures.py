"""The picture of slip and twist against ground truth, for `docs.figures.program_pictures`."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from cnnum.drivers.simulated.array import SimulatedOptions
from cnnum.drivers.simulated.settings import Phase
from cnnum.engine import Engine
from cnnum.programs import program
from cnnum.programs.library import get_program
from cnnum.programs.machine import FrameFields

TRUE, FOUND = "0.8", "#0a6ebd"
"""Colours of the truth, and of a program's outputs."""

SCRIPT = (
    Phase("hold", 0.5),
    Phase("press", 0.4, load=1.0),
    Phase("hold", 0.3),
    Phase("pull", 0.15, speed=0.8e-3, direction=0.5),
    Phase("hold", 0.4),
    Phase("pull", 0.8, speed=0.8e-3, direction=0.5),
    Phase("relax", 0.3),
    Phase("hold", 0.3),
    Phase("twist", 0.6, angle=0.18),
    Phase("relax", 0.3),
    Phase("release", 0.3),
)
"""A touch, a pull that stops before it slips, one that slips, and a twist."""


@program
def both(frame: FrameFields) -> Any:
    """Slip and twist."""
    return {**get_program("slip")(frame), **get_program("twist")(frame)}


def played() -> tuple[Any, Any, dict[str, Any], dict[str, Any]]:
    """Return times, s, strain frames, the truth and the programs' outputs by name."""
    with SimulatedOptions(script=SCRIPT, seed=3).open() as array:
        frames = list(array.frames())
        strain = array.calibration.to_strain(np.stack([frame.values for frame in frames]))
    stream = Engine("numba").compile(both, strain.shape[1:3]).stream(rate=array.rate)
    outputs = [stream.push(frame) for frame in strain[..., :3].astype(np.float32)]
    names = ("slip", "twist_slip", "incipient")
    truths = [frame.truth for frame in frames if frame.truth is not None]
    truth = {name: np.array([each[name] for each in truths]) for name in names}
    got = {name: np.array([float(each[name]) for each in outputs]) for name in outputs[0]}
    return np.array([frame.time for frame in frames]), strain, truth, got


def slip_and_twist_picture() -> Figure:
    """Return maps of load and shear in four frames, and both strengths with their flags."""
    times, strain, truth, got = played()
    figure = Figure(figsize=(9.0, 5.6), layout="constrained")
    grid = figure.add_gridspec(3, 4, height_ratios=(1.5, 1.0, 1.0))
    moments = {"pressed": 1.1, "pulled, sticks": 1.7, "slides": 2.4, "twisted": 3.7}
    top, pull = np.abs(strain[..., 2]).max(), np.abs(strain[..., :2]).max()
    for column, (title, time) in enumerate(moments.items()):
        axes, frame = figure.add_subplot(grid[0, column]), -strain[np.searchsorted(times, time)]
        axes.imshow(frame[..., 2], cmap="Greys", vmin=0.0, vmax=1.3 * top)
        rows, columns = np.indices(frame.shape[:2])
        arrows = axes.quiver(
            columns, rows, frame[..., 0], -frame[..., 1], color=FOUND, scale=6.0 * pull
        )
        axes.set(title=f"{title}, {time:.1f} s", xticks=[], yticks=[])
        if column == 0:
            axes.set_xlabel("gray: load, darker is more", fontsize=8)
        if column == 1:
            axes.quiverkey(
                arrows, 0.25, -0.09, pull, f"shear: {100.0 * pull:.1f} % strain",
                labelpos="E", fontproperties={"size": 8},
            )  # fmt: skip
    shown = (
        ("slip_strength", "gross_slip", "slip", 0.40),
        ("twist_strength", "twist", "twist_slip", 0.1),
    )
    for row, (name, flag, true, level) in enumerate(shown, start=1):
        axes = figure.add_subplot(grid[row, :])
        high = 1.15 * max(got[name].max(), 2.0 * level)
        axes.fill_between(
            times, high, where=truth[true] > 0, color=TRUE, lw=0, label=f"true: {true}"
        )
        axes.plot(times, got[name], color=FOUND, lw=1.2, label=name)
        axes.fill_between(
            times, -0.08 * high, -0.02 * high, where=got[flag] > 0, color=FOUND, lw=0, label=flag
        )
        axes.axhline(level, color="0.4", lw=0.8, ls="--", label="level")
        axes.set(xlim=(0.0, times[-1]), ylim=(-0.1 * high, high), ylabel=name)
        axes.legend(loc="upper left", fontsize=8, framealpha=1.0)
    axes.set_xlabel("time, s")
    return figure
