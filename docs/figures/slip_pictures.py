"""Pictures of slip and twist against ground truth, for `docs.figures.program_pictures`.

The scenes are the simulated array's: its springs know nothing of what the programs assume.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, pi, sin
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from cnnum.arrays import Floats, Shape
from cnnum.drivers.simulated.array import SimulatedArray
from cnnum.drivers.simulated.script import Phase
from cnnum.drivers.simulated.settings import Settings
from cnnum.engine import Engine
from cnnum.programs.library import get_program

TRUE, FOUND, OTHER = "0.72", "#0a6ebd", "#c05a00"
"""Colours: what is true, what a program says, and what a second one says."""

SIDEWAYS = 0.5
"""rad. Direction of the pulls."""

THRESHOLD = 6.0
"""Noise floors. What `grasp_slip` takes unless told otherwise."""

COUNTS = 2e4
"""Of a raw reading, for a strain of 1: a wide contact then reads some hundreds."""

WHOLE = (
    Phase("hold", 0.3),
    Phase("press", 0.4, load=1.0),
    Phase("hold", 0.3),
    Phase("pull", 0.6, speed=0.8e-3, direction=SIDEWAYS),
    Phase("relax", 0.3),
    Phase("hold", 0.3),
    Phase("twist", 0.6, angle=0.18),
    Phase("relax", 0.3),
)
"""A touch, a pull until it slips, and a twist."""

HELD = (
    Phase("press", 0.3, load=1.0),
    Phase("hold", 1.5),
    Phase("pull", 0.13, speed=0.8e-3, direction=SIDEWAYS),
    Phase("hold", 0.5),
    Phase("relax", 0.3),
    Phase("hold", 0.8),
    Phase("pull", 1.0, speed=0.8e-3, direction=SIDEWAYS),
    Phase("relax", 0.4),
)
"""A pull that stops before slip, and one that slips; the touch is cut off."""

CUT = 0.4
"""s. What of `HELD` the stream has not seen."""


@dataclass(frozen=True, slots=True)
class Played:
    """A scene and what a program made of it.

    Attributes
    ----------
    times : (frames,) float, s
    strain : (frames, rows, cols, 3) float
    truth, got : dict of (frames, ...) float
        By name: what is true, and the program's outputs.
    """

    times: Floats
    strain: Floats
    truth: dict[str, Floats]
    got: dict[str, Floats]

    def first(self, name: str, *, true: bool = False) -> int:
        """Return the frame in which a flag begins."""
        return int(np.argmax((self.truth if true else self.got)[name] > 0))

    def slips(self) -> Floats:
        """Return the true share of the contact radius that slips, 0 without contact."""
        a, c = self.truth["contact_radius"], self.truth["stick_radius"]
        return np.asarray(np.where(a > 0, 1.0 - c / np.where(a > 0, a, 1.0), 0.0))


def play(settings: Settings, program: str, cut: float, scale: float, **parameters: float) -> Played:
    """Return a scene from `cut` seconds on, and what a program makes of its scaled strain."""
    array = SimulatedArray(settings)
    frames = list(array.frames())[round(cut * settings.rate) :]
    strain = array.calibration.to_strain(np.stack([frame.values for frame in frames]))
    plan = Engine().compile(get_program(program).bind(**parameters), settings.shape)
    stream = plan.stream()
    outputs = [stream.push(scale * frame) for frame in strain]
    truths = [frame.truth.values for frame in frames if frame.truth]
    return Played(
        np.arange(len(frames)) / settings.rate,
        strain,
        {name: np.array([truth[name] for truth in truths]) for name in truths[0]},
        {name: np.array([each[name] for each in outputs]) for name in outputs[0]},
    )


def _start() -> tuple[float, float]:
    return -0.5e-3 * cos(SIDEWAYS), -0.5e-3 * sin(SIDEWAYS)


def _spans(flag: Floats) -> list[tuple[int, int]]:
    """Return the first frame of every time a flag holds, and the one after its last."""
    steps = np.diff(np.concatenate([[0], (flag > 0).astype(int), [0]]))
    begins, ends = np.flatnonzero(steps > 0).tolist(), np.flatnonzero(steps < 0).tolist()
    return list(zip(begins, ends, strict=True))


def _bars(axis: Any, played: Played, flag: Floats, at: float, colour: str) -> None:
    """Draw when a flag holds."""
    step = played.times[1] - played.times[0]
    bars = [(played.times[a], step * (b - a)) for a, b in _spans(flag)]
    axis.broken_barh(bars, (at - 0.16, 0.32), color=colour)


def _delay(axis: Any, played: Played, row: int, found: int, true: int) -> None:
    """Write how late a report is, to the left of its bars."""
    late = found - true
    word = f"reported {abs(late)} frames {'after' if late > 0 else 'before'} the truth"
    said = word if late else "reported in the true frame"
    at = played.times[min(found, true)] - 0.02
    axis.text(at, row, said, va="center", ha="right", fontsize=9, backgroundcolor="w")


def _lanes(axis: Any, played: Played, lanes: Sequence[tuple[str, str, str]]) -> None:
    """Draw flags as bars, the truth's above the program's, and how late it is."""
    for row, (name, true, _) in enumerate(lanes):
        _bars(axis, played, played.truth[true], row - 0.2, TRUE)
        _bars(axis, played, played.got[name], row + 0.2, FOUND)
        _delay(axis, played, row, played.first(name), played.first(true, true=True))
    axis.set(yticks=range(len(lanes)), yticklabels=[label for *_, label in lanes])
    axis.set_ylim(len(lanes) - 0.5, -0.5)
    for colour, label in ((TRUE, "true"), (FOUND, "program's flag")):
        axis.barh([0], [0], color=colour, label=label)
    axis.legend(loc="lower left", fontsize=9)


@dataclass(frozen=True, slots=True)
class _Moment:
    """A frame to show, and the one at rest that it is compared with."""

    title: str
    frame: int
    rest: int
    said: str = ""


def _directed(played: Played, flag: str) -> tuple[int, str]:
    """Return the frame of a report, and its direction beside the true one."""
    at = played.first(flag)
    x, y = played.got["slip_x"][at], played.got["slip_y"][at]
    return at, f"{np.degrees(np.arctan2(y, x)):.1f}° (true {np.degrees(SIDEWAYS):.1f}°)"


def _moments(played: Played) -> list[_Moment]:
    pulled = int(np.argmax(np.hypot(played.truth["shear_x"], played.truth["shear_y"]) > 0)) - 1
    turned = int(np.argmax(played.truth["twist_rate"] > 0)) - 1
    twist = played.first("twist")
    incipient, gross = _directed(played, "incipient_slip"), _directed(played, "gross_slip")
    rates = [f"{played.got['twist_rate'][at]:.3f} rad/s" for at in (twist, twist + 60)]
    true = played.truth["twist_rate"][twist]
    return [
        _Moment("before the pull", pulled, pulled),
        _Moment("incipient slip reported", incipient[0], pulled, incipient[1]),
        _Moment("gross slip reported", gross[0], pulled, gross[1]),
        _Moment("twist reported", twist, turned, f"{rates[0]} (true {true:.3f})"),
        _Moment("0.3 s later", twist + 60, turned, rates[1]),
    ]


def _circle(axis: Any, centre: tuple[float, float], radius: float, **style: object) -> None:
    turn = np.linspace(0.0, 2.0 * pi, 90)
    axis.plot(centre[0] + radius * np.cos(turn), centre[1] + radius * np.sin(turn), **style)


def _shear(axis: Any, played: Played, at: _Moment, pitch: float, tag: str) -> Any:
    """Draw how the shear strain has changed since rest; return the image."""
    strain = played.strain[at.frame] - played.strain[at.rest]
    x, y = -1e3 * strain[..., 0], -1e3 * strain[..., 1]
    image = axis.imshow(np.hypot(x, y), cmap="Blues", vmin=0.0, vmax=24.0)
    rows, cols = np.nonzero(np.hypot(x, y) > 1.0)
    arrow = {"angles": "xy", "scale_units": "xy", "scale": 16.0, "width": 0.011}
    axis.quiver(cols, rows, x[rows, cols], y[rows, cols], color="k", zorder=3, **arrow)
    truth = {name: float(values[at.frame]) for name, values in played.truth.items()}
    middle = (strain.shape[1] - 1) / 2, (strain.shape[0] - 1) / 2
    centre = middle[0] + truth["x"] / pitch, middle[1] + truth["y"] / pitch
    if truth["stick_radius"] > 0:
        _circle(axis, centre, truth["stick_radius"] / pitch, color=OTHER, lw=2.2)
    _circle(axis, centre, truth["contact_radius"] / pitch, color="k", ls=":", lw=1.5)
    said = f", {at.said}" if at.said else ""
    axis.set_title(f"{tag} {at.title}\n{played.times[at.frame]:.2f} s{said}", fontsize=9)
    axis.set(xlabel="column, cells", xticks=range(0, 8, 2), yticks=range(0, 8, 2))
    return image


def _key(figure: Any, axis: Any, image: Any) -> None:
    """Draw the key to the maps: colours, arrow and circles."""
    figure.colorbar(image, ax=axis, label="change of shear strain\nsince rest, 10⁻³", shrink=0.8)
    marks: list[tuple[dict[str, Any], str]] = [
        ({"color": "k", "marker": r"$\rightarrow$", "ms": 14, "ls": ""}, "shear, as it is pulled"),
        ({"color": "k", "ls": ":", "lw": 1.5}, "true contact"),
        ({"color": OTHER, "lw": 2}, "true stick region"),
    ]
    for style, label in marks:
        axis[0].plot([], [], label=label, **style)
    handles, labels = axis[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False)


def _lines(axis: Any, played: Played, name: str, true: Floats, label: str, unit: str) -> None:
    axis.plot(played.times, true, color=TRUE, lw=5, label=f"true {label}", solid_capstyle="butt")
    axis.plot(played.times, played.got[name], color=FOUND, lw=1.6, label=name)
    axis.set_ylabel(unit)


def _while(values: Floats, when: NDArray[np.bool_]) -> Floats:
    """Return values where something goes on, and a gap elsewhere."""
    return np.asarray(np.where(when, values, np.nan))


def _times(axes: Sequence[Any], played: Played, moments: Sequence[_Moment]) -> None:
    """Give axes one time, with the moments shown above marked in it."""
    for axis in axes:
        axis.set_xlim(played.times[0], played.times[-1])
        axis.grid(axis="x", alpha=0.3)
        for at in moments:
            axis.axvline(played.times[at.frame], color="k", lw=0.7, ls=":")
    for at, tag in zip(moments, "abcde", strict=False):
        axes[0].annotate(
            tag, (played.times[at.frame], 1.0), (0, 3), xycoords=("data", "axes fraction"),
            textcoords="offset points", ha="center", fontweight="bold",
        )  # fmt: skip
    axes[-1].set_xlabel("time, s")


SLIPS = (
    ("incipient_slip", "incipient", "incipient slip"),
    ("gross_slip", "slip", "gross slip"),
    ("twist", "twist_slip", "twist"),
)


def slip_and_twist_picture() -> Any:
    """A touch, a slip and a twist: shear maps, flags, strengths and the rate, with the truth."""
    settings = Settings(seed=11, start=_start(), script=WHOLE)
    depth = settings.thickness / settings.pitch
    played = play(settings, "tactile", 0.0, 1.0, depth=depth)
    moments = _moments(played)
    figure: Any = Figure(figsize=(13, 9.5), layout="constrained")
    FigureCanvasAgg(figure)
    top, below = figure.subfigures(2, 1, height_ratios=[1.0, 1.7])
    maps = top.subplots(1, 5)
    shown = [
        _shear(axis, played, at, settings.pitch, tag)
        for axis, at, tag in zip(maps, moments, "abcde", strict=True)
    ]
    maps[0].set_ylabel("row, cells")
    _key(top, list(maps), shown[0])
    axes = below.subplots(4, 1, sharex=True, height_ratios=[1.1, 1, 1, 1])
    _lanes(axes[0], played, SLIPS)
    pulled = np.hypot(played.truth["shear_x"], played.truth["shear_y"]) > 0.1
    turned = played.truth["twist_rate"]
    share = "share that slips", "1 − c/a"
    _lines(axes[1], played, "slip_strength", _while(played.slips(), pulled), *share)
    _lines(axes[2], played, "twist_strength", _while(played.slips(), turned > 0), *share)
    _lines(axes[3], played, "twist_rate", turned, "rate", "rad/s")
    axes[3].set_ylim(-0.05, 0.5)
    for axis in axes[1:]:
        axis.legend(loc="upper left", fontsize=9)
    _times(axes, played, moments)
    return figure


def grasp_slip_picture() -> Any:
    """The score of a pad that holds something: a pull that stops, and one that slips."""
    figure: Any = Figure(figsize=(11, 5.6), layout="constrained")
    FigureCanvasAgg(figure)
    force, score, flags = figure.subplots(3, 1, sharex=True, height_ratios=[1, 1.5, 0.7])
    pads: dict[Shape, str] = {(4, 4): FOUND, (8, 8): OTHER}
    for row, (shape, colour) in enumerate(pads.items(), start=1):
        settings = Settings(seed=11, shape=shape, rate=60.0, start=_start(), script=HELD)
        played = play(settings, "grasp_slip", CUT, COUNTS, threshold=THRESHOLD)
        name = f"{shape[0]}×{shape[1]} taxels"
        score.plot(played.times, played.got["slip_strength"], color=colour, label=name)
        score.set_xlim(played.times[0], played.times[-1])
        _bars(flags, played, played.got["gross_slip"], row, colour)
        if row == 1:
            _bars(flags, played, played.truth["slip"], 0, TRUE)
            _pull(force, played, settings.friction)
    score.axhline(THRESHOLD, color="k", ls="--", lw=1, label="threshold")
    score.set(ylabel="score, noise floors", ylim=(0, None))
    flags.set(yticks=[0, 1, 2], yticklabels=["true gross slip", "reported, 4×4", "reported, 8×8"])
    flags.set(ylim=(2.5, -0.5), xlabel="time, s; the stream begins in the grasp")
    for axis in (force, score):
        axis.legend(loc="upper left", fontsize=9)
    for axis in (force, score, flags):
        axis.grid(axis="x", alpha=0.3)
    return figure


def _pull(axis: Any, played: Played, friction: float) -> None:
    """Draw the true shear force over the friction that there is."""
    force = np.hypot(played.truth["shear_x"], played.truth["shear_y"])
    share = force / (friction * played.truth["normal_force"])
    axis.fill_between(played.times, share, color=TRUE, lw=0, label="true pull over friction, Q/μP")
    axis.set(ylabel="Q/μP", ylim=(0, 1.6), yticks=[0, 0.5, 1])
    axis.axhline(1.0, color="k", lw=0.7, ls=":")
