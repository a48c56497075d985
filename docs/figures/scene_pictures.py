"""Pictures of packaged scenes against ground truth, for `docs.figures.program_pictures`."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from cnnum.arrays import Floats
from cnnum.drivers.simulated.array import SimulatedOptions
from cnnum.scenes.pipeline import load_scene
from cnnum.sharing import colours

PITCH = SimulatedOptions().pitch
"""Of the simulated array, m."""

TRUE, FOUND, OTHER = "0.8", "#0a6ebd", "#d1590b"
"""Colours of the truth, and of two outputs."""


class Played:
    """A packaged scene that has been played.

    Parameters
    ----------
    name : str
    needs : sequence of str
        Events and outputs; those of the scene unless given.
    """

    def __init__(self, name: str, needs: Sequence[str] = ()) -> None:
        scene = load_scene(name, changes={"needs": list(needs)} if needs else {})
        self.moments = list(scene.results())
        self.times = np.array([moment.frame.time for moment in self.moments])
        self.events = [event for moment in self.moments for event in moment.events]

    def truth(self, name: str) -> Floats:
        """Return a number of the ground truth in every frame."""
        truths = [moment.frame.truth for moment in self.moments]
        return np.array([float(each[name]) for each in truths if each is not None])

    def output(self, name: str) -> Floats:
        """Return an output in every frame."""
        return np.array([np.asarray(moment.outputs[name]) for moment in self.moments], np.float64)

    def at(self, time: float) -> int:
        """Return the frame at a time, s."""
        return int(np.searchsorted(self.times, time - 1e-9))


def _map(axes: Any, values: Floats, title: str, top: float) -> Any:
    image = axes.imshow(values, cmap=colours(), vmin=-top, vmax=top)
    axes.set(title=title, xticks=[], yticks=[])
    return image


def _events(axes: Any, played: Played, kinds: Sequence[str]) -> None:
    """Mark where events were reported, with their names."""
    top = axes.get_ylim()[1]
    for event in played.events:
        if event.kind in kinds:
            axes.axvline(event.time, color="0.3", lw=0.8, ls=":")
            axes.text(event.time, top, f" {event.title}", va="top", fontsize=7.5)


def active_contour_picture() -> Any:
    """A bar that is dragged: the region that the contour holds, and the bar's true outline."""
    played = Played("active_contour")
    inside = played.output("contour_inside")
    figure: Any = Figure(figsize=(9.0, 2.9), layout="constrained")
    turn, half = 0.4, np.array([1.5e-3, 3e-3]) / PITCH
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]]) * half
    spin = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    x, y = played.truth("x"), played.truth("y")
    for axes, time in zip(figure.subplots(1, 4), (0.42, 0.75, 1.5, 2.25), strict=True):
        n = played.at(time)
        axes.imshow(inside[n], cmap="Blues", vmin=0.0, vmax=1.6)
        centre = 3.5 + np.array([x[n], y[n]]) / PITCH
        outline = corners @ spin + centre
        axes.plot(outline[:, 0], outline[:, 1], color=OTHER, lw=1.5)
        axes.set(title=f"{time:g} s", xlim=(-0.5, 7.5), ylim=(7.5, -0.5), xlabel="column, cells")
    figure.axes[0].set_ylabel("row, cells")
    figure.suptitle("blue: taxels in the contour; line: true outline of the bar", fontsize=9)
    return figure


def on_off_picture() -> Any:
    """A punch that comes and goes: both transient answers in time, and the sustained one."""
    maps = ["on_sustained", "off_sustained", "on_transient", "off_transient"]
    played = Played("on_off", ["onset", "offset", "on_strength", "off_strength", *maps])
    figure: Any = Figure(figsize=(9.0, 5.6), layout="constrained")
    grid = figure.add_gridspec(2, 4, height_ratios=(1.5, 1.0))
    shown = (("sustained", 0.5), ("sustained", 1.3), ("transient", 0.5), ("transient", 1.38))
    answers = {
        kind: 100.0 * (played.output(f"on_{kind}") - played.output(f"off_{kind}"))
        for kind in ("sustained", "transient")
    }
    for column, (kind, time) in enumerate(shown):
        values = answers[kind]
        image = _map(
            figure.add_subplot(grid[0, column]), values[played.at(time)],
            f"{kind}, {time:g} s", float(np.abs(values).max()),
        )  # fmt: skip
        if column % 2:
            pair = [axes for axes in figure.axes if axes.get_title().startswith(kind)]
            label = "strain, %: ON above 0, OFF below"
            figure.colorbar(image, ax=pair, shrink=0.8, location="bottom", label=label)
    axes = figure.add_subplot(grid[1, :])
    load = played.truth("normal_force")
    for name, colour in (("on_strength", FOUND), ("off_strength", OTHER)):
        axes.plot(played.times, played.output(name), color=colour, lw=1.3, label=name)
    high = axes.get_ylim()[1]
    axes.fill_between(
        played.times, high * load / load.max(), color=TRUE, lw=0, zorder=0, label="load"
    )
    axes.axhline(10.0, color="0.4", lw=0.8, ls="--", label="level")
    axes.set(xlim=(0.3, played.times[-1]), ylim=(0.0, 1.2 * high), xlabel="time, s",
             ylabel="transient answer over noise")  # fmt: skip
    _events(axes, played, ("onset", "offset"))
    axes.legend(loc="upper right", fontsize=8, framealpha=1.0)
    return figure


def moving_patterns_picture() -> Any:
    """A ridged face that slides out and back: its speed by flow, and its way by correlations."""
    flow = Played("tactile_flow", ["flow", "flow_x", "flow_y"])
    drift = Played("motion_direction", ["drift", "motion_x", "motion_y"])
    figure: Any = Figure(figsize=(9.0, 4.6), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
    moved = np.gradient(flow.truth("x"), flow.times) / PITCH
    above.plot(flow.times, moved, color="0.6", lw=4.0, label="true speed of the face, x")
    above.plot(flow.times, flow.output("flow_x"), color=FOUND, lw=1.3, label="flow_x")
    above.plot(flow.times, flow.output("flow_y"), color=OTHER, lw=1.0, label="flow_y")
    above.set(ylabel="tactile_flow, cells/s", ylim=(-5.0, 6.0))
    below.plot(drift.times, drift.output("motion_x"), color=FOUND, lw=1.3, label="motion_x")
    below.plot(drift.times, drift.output("motion_y"), color=OTHER, lw=1.0, label="motion_y")
    below.set(ylabel="motion_direction, share", xlabel="time, s", ylim=(-0.6, 0.5))
    for axes, played, kinds in (
        (above, flow, ("flow", "flow_end")),
        (below, drift, ("drift", "drift_end")),
    ):
        axes.axhline(0.0, color="0.7", lw=0.6, zorder=0)
        axes.set_xlim(0.8, played.times[-1])
        _events(axes, played, kinds)
        axes.legend(loc="lower left", fontsize=8, framealpha=1.0, ncols=3)
    return figure


def receptors_picture() -> Any:
    """A sphere that presses, shakes, pulls and lets go: what each of the four channels says."""
    names = ("sa1", "ra1", "pc", "sa2")
    titles = ("SA-I, pressure", "RA-I, motion", "PC, vibration", "SA-II, stretch")
    events = ("pressure", "motion", "vibration", "stretch")
    played = Played("receptors", [*events, *(f"{name}_strength" for name in names)])
    figure: Any = Figure(figsize=(9.0, 6.4), layout="constrained")
    rows = figure.subplots(5, 1, sharex=True)
    rows[0].plot(played.times, played.truth("normal_force"), color="0.4", label="normal load")
    pull = np.hypot(played.truth("shear_x"), played.truth("shear_y"))
    rows[0].plot(played.times, pull, color="0.4", ls="--", label="pull")
    rows[0].set_ylabel("truth, N")
    rows[0].legend(loc="upper left", fontsize=8)
    for axes, name, title, event in zip(rows[1:], names, titles, events, strict=True):
        axes.plot(played.times, played.output(f"{name}_strength"), color=FOUND, lw=1.0)
        axes.set(yscale="symlog", ylabel=f"{title}\nover noise")
        axes.yaxis.label.set_fontsize(8)
        begins = [each.time for each in played.events if each.kind == event]
        ends = [each.time for each in played.events if each.kind == f"{event}_end"]
        for n, start in enumerate(begins):
            end = ends[n] if n < len(ends) else played.times[-1]
            axes.axvspan(start, end, color=FOUND, alpha=0.12, lw=0)
    rows[-1].set(xlabel="time, s (shaded: reported)", xlim=(0.35, played.times[-1]))
    return figure
