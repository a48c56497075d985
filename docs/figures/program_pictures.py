"""Pictures of the tactile programs: `python -m docs.figures.program_pictures docs/programs`.

All of them, or those named after the folder. Each shows the readings of an array under a known
load, and the results of a program.
"""

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from cnnum.arrays import Floats
from cnnum.engine import Engine
from cnnum.lab.bench.programs.contact_errors import held
from cnnum.lab.bench.programs.edge_errors import Skin, found_places, run_edges
from cnnum.programs.library import get_program
from cnnum.sharing import colours
from cnnum.tactile.bump_loads import bump_readings
from cnnum.tactile.flat_punches import Joined, Outline, punch_pressure, read_below, triangle
from cnnum.tactile.indenters import Disc, Rectangle, Ring, Touch, frame_under, readings
from cnnum.tactile.texture import texture as whole_recording
from cnnum.tactile.texture_materials import FOUR, Stroke, rub
from docs.figures.scene_pictures import (
    active_contour_picture,
    moving_patterns_picture,
    on_off_picture,
    receptors_picture,
)
from docs.figures.slip_pictures import slip_and_twist_picture

MADE: Any = {"dpi": 100, "bbox_inches": "tight"}

DOT: Any = {"color": "#ffd92f", "markersize": 5, "mec": "k", "mew": 0.8}
"""Seen on dark and on light cells."""


def _sheet(columns: int, width: float = 3.4, height: float = 3.5) -> tuple[Any, Any]:
    figure: Any = Figure(figsize=(width * columns, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots(1, columns, squeeze=False)[0]


def _map(axis: Any, values: Floats, title: str, top: float | None = None) -> Any:
    """Draw a map, blue where positive; the labels of rows are for the first of a sheet."""
    top = top or float(np.abs(values).max()) or 1.0
    image = axis.imshow(values, cmap=colours(), vmin=-top, vmax=top)
    axis.set(title=title, xlabel="column, cells")
    return image


def _flags(axis: Any, values: Any, title: str) -> None:
    """Draw a logic map: grey where it holds."""
    axis.imshow(values, cmap="Greys", vmin=0.0, vmax=2.0)
    axis.set(title=title, xlabel="column, cells")


def _streamed(name: str, frames: Floats, **parameters: object) -> dict[str, Floats]:
    plan = Engine().compile(get_program(name).bind(**parameters), frames.shape[1:3])
    stream, outputs = plan.stream(rate=plan.rate or 200.0), dict[str, Floats]()
    for frame in frames:
        outputs = stream.push(frame)
    return outputs


def _held(load: Floats) -> Floats:
    frames = 5e-3 * np.random.default_rng(2).normal(size=(21, *load.shape))
    frames[18:] += load
    return frames


def edges_picture() -> Any:
    """Strain under flat punches and under smooth contacts, with the outlines found in it."""
    punches: list[tuple[str, Outline]] = [
        ("square", Rectangle(3.6, 3.6, 0.0, (0.2, -0.3))),
        ("round", Disc(2.4, (0.2, -0.3))),
        ("ring", Ring(1.0, 2.8, (0.1, 0.2))),
        ("bar, 34°", Rectangle(1.7, 5.0, 0.6)),
        ("triangle", triangle(5.0, 0.5, (0.1, 0.2))),
        ("two", Joined((Disc(1.4, (1.5, 1.1)), Disc(1.3, (-1.5, -1.2))))),
    ]
    smooth = Disc(3.0, (0.2, 0.1), "hertz")
    pressures = [punch_pressure(body, 8) for _, body in punches]
    seen = read_below(pressures, 8, 0.5, "strain")
    seen = np.concatenate([seen, frame_under(smooth, (8, 8), 0.5, "strain")[None]])
    bodies = [*punches, ("sphere: no edge", smooth)]
    got = run_edges(Engine(), seen, Skin())
    figure, axes = _sheet(len(bodies), 2.7, 3.6)
    fine, image = np.linspace(-0.5, 7.5, 161), None
    for number, (axis, (name, body)) in enumerate(zip(axes, bodies, strict=True)):
        image = _map(axis, seen[number] / seen[number].max(), name, 1.0)
        x, y = np.meshgrid(fine - 3.5, fine - 3.5)
        axis.contour(fine, fine, body.distance(x, y), [0.0], colors="k", linestyles="--")
        where = found_places(got["edge_to_right"][number], got["edge_to_below"][number])
        axis.plot(where[:, 1], where[:, 0], "o", label="edge found", **DOT)
        axis.plot([], [], "k--", label="true outline")
    axes[0].set_ylabel("row, cells")
    figure.colorbar(image, ax=list(axes), label="compressive strain / peak", shrink=0.65)
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2, frameon=False)
    return figure


def edge_enhancement_picture() -> Any:
    """What taxels read below covers, and below it the enhanced frame with the outlines found."""
    cases: list[tuple[str, Outline, float]] = [
        ("square, 0.3 pitches", Rectangle(4.0, 4.0, 0.35, (0.2, -0.3)), 0.3),
        ("bar, 0.5", Rectangle(2.0, 6.0, 0.6), 0.5),
        ("triangle, 0.5", triangle(5.2, 0.5, (0.1, 0.2)), 0.5),
        ("two, 0.3", Joined((Disc(1.5, (1.7, 1.3)), Disc(1.4, (-1.6, -1.3)))), 0.3),
        ("round, 1.0", Disc(2.4, (0.2, -0.3)), 1.0),
    ]
    figure: Any = Figure(figsize=(2.6 * len(cases), 6.4), layout="constrained")
    rows = figure.subplots(2, len(cases))
    fine, image = np.linspace(-0.5, 7.5, 161), None
    x, y = np.meshgrid(fine - 3.5, fine - 3.5)
    for column, (name, body, depth) in enumerate(cases):
        seen = read_below([punch_pressure(body, 8)], 8, depth, "strain")[0]
        skin = Skin(depth=depth)
        stream = -skin.stream(seen[None])[:, 0]
        got = _streamed(
            "edge_enhancement", np.stack([0.0 * stream, 0.0 * stream, stream], axis=-1), rate=200.0
        )
        enhanced = got["edge_enhanced"]
        image = _map(rows[0, column], -stream[-1], name, 1.0)
        _map(rows[1, column], enhanced / np.abs(enhanced).max(), "edge_enhanced", 1.0)
        where = found_places(got["edge_to_right"], got["edge_to_below"])
        rows[1, column].plot(where[:, 1], where[:, 0], "o", label="outline found", **DOT)
        for axis in rows[:, column]:
            axis.contour(fine, fine, body.distance(x, y), [0.0], colors="k", linestyles="--")
            axis.plot([], [], "k--", label="true outline")
        rows[0, column].set_xlabel("")
    labels = ("compressive strain / peak", "enhanced frame / peak")
    for row, label in zip(rows, labels, strict=True):
        row[0].set_ylabel("row, cells")
        figure.colorbar(image, ax=list(row), label=label, shrink=0.75)
    handles, names = rows[1, 0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=2, frameon=False)
    return figure


def _loads(axis: Any, loads: Floats, title: str) -> Any:
    """Draw normal loads as colours and shear loads as arrows."""
    image = axis.imshow(loads[..., 2], cmap="Blues", vmin=0.0, vmax=1.0)
    axis.set(title=title, xlabel="column, bumps")
    rows, cols = np.nonzero(np.abs(loads).max(axis=-1) > 0)
    shear = loads[rows, cols]
    arrow = {"angles": "xy", "scale_units": "xy", "scale": 0.35, "width": 0.012, "color": "#d1590b"}
    drawn = axis.quiver(cols, rows, shear[:, 0], shear[:, 1], **arrow)
    axis.quiverkey(drawn, 0.15, 0.08, 0.35, "shear of 0.35", labelpos="E", coordinates="axes")
    return image


def localize_picture() -> Any:
    """Readings of bumps 3 bump radii apart over a pad, and the loads behind them."""
    loads = np.zeros((8, 8, 3))
    for row, col, x, y, z in ((1, 1, 0.3, 0, 0.8), (1, 3, 0, 0.4, 1), (5, 5, -0.3, -0.3, 0.9)):
        loads[row, col] = x, y, z
    loads[5, 6] = 0.2, -0.2, 0.7
    read = bump_readings(loads, "pad", 3.0, 0.5)
    got = _streamed("localize", _held(read), push=1.0, taxels="pad", bump_pitch=3.0, bump_depth=0.5)
    figure, axes = _sheet(4, 3.7, 3.9)
    image = axes[0].imshow(read[..., 2], cmap="Blues", vmin=0.0)
    axes[0].set(title="read: normal combination", xlabel="column, bumps", ylabel="row, bumps")
    label = "stress × (bump radius)² / load"
    figure.colorbar(image, ax=axes[0], label=label, shrink=0.8, location="bottom")
    found = np.stack([got[f"bump_load_{axis}"] for axis in ("x", "y", "normal")], axis=-1)
    _loads(axes[1], loads, "true loads")
    image = _loads(axes[2], np.where(got["bump_contact"][..., None] > 0, found, 0.0), "loads found")
    label = "normal load; shear is in the same unit"
    figure.colorbar(image, ax=list(axes[1:3]), label=label, shrink=0.4, location="bottom")
    _flags(axes[3], got["bump_patch"] > 0, f"{got['bump_patches']:.0f} contacts found")
    axes[3].set_xlabel("column, bumps")
    patches = np.unique(got["bump_patch"][got["bump_patch"] > 0])
    for number, label in enumerate(patches, start=1):
        at = tuple(np.argwhere(got["bump_patch"] == label)[0])
        r, c = got["bump_patch_row"][at], got["bump_patch_column"][at]
        axes[3].plot(c, r, "k+", markersize=10, label="centroid" if number == 1 else None)
        axes[3].annotate(str(number), (c, r), (14, 14), textcoords="offset points")
    axes[3].legend(loc="lower left", fontsize=8)
    return figure


def _compared(axis: Any, names: Sequence[str], true: Floats, found: Floats) -> None:
    """Draw bars of true and found values, with their numbers."""
    for off, values, colour, label in (
        (-0.2, true, "0.72", "true"),
        (0.2, found, "#0a6ebd", "found"),
    ):
        places = np.arange(len(names)) + off
        bars = axis.bar(places, values, 0.36, color=colour, label=label)
        axis.bar_label(bars, fmt="%.2f", fontsize=9, padding=2)
    axis.set_xticks(range(len(names)), names, fontsize=8.5)
    axis.set_box_aspect(1.0)
    axis.margins(y=0.15)
    axis.legend(loc="upper left", fontsize=9)


def contact_picture() -> Any:
    """A pulled sphere: its normal strain, the taxels touched, and the loads found."""
    body = Touch(4.6, (0.6, -0.4), 0.5, 0.4)
    seen = readings(body, 16, 0.5, "strain")
    got = _streamed("contact", held([seen])[:, 0])
    strain = -seen[..., 2] / np.abs(seen[..., 2]).max()
    high = np.where(strain > 0.1, strain, 0.0)
    cells = np.arange(16.0)
    raw = [float(np.dot(high.sum(axis=axis), cells) / high.sum()) for axis in (0, 1)]
    figure, axes = _sheet(3, 4.3, 4.7)
    image = _map(axes[0], strain, "read: normal strain of a pulled sphere", 1.0)
    label = "compressive strain / peak"
    figure.colorbar(image, ax=axes[0], label=label, shrink=0.8, location="left")
    area = f"{got['contact_area']:.0f} taxels; true area {np.pi * body.radius**2:.0f}"
    _flags(axes[1], got["contact_map"], f"found: {area}")
    names = ("load_x", "load_y", "load_normal", "friction_used")
    true = np.array([*body.pulls, 1.0, np.hypot(*body.pulls)])
    _compared(axes[2], names, true, np.array([float(got[name]) for name in names]))
    axes[2].set(title="loads", ylabel="shares of the true normal load")
    turn = np.linspace(0, 2 * np.pi, 90)
    x, y = 7.5 + body.centre[0], 7.5 + body.centre[1]
    for axis in axes[:2]:
        axis.plot(x + body.radius * np.cos(turn), y + body.radius * np.sin(turn), "k:")
        axis.plot([], [], "k:", label="true contact")
        axis.plot(*raw, "x", color="#e07b00", ms=9, mew=2.5, label="centroid of the strain")
        axis.plot(
            got["contact_column"], got["contact_row"], "k+", ms=11, mew=2, label="centroid found"
        )
    arrow = {"angles": "xy", "scale_units": "xy", "scale": 0.15, "width": 0.012, "color": "#1a7a1a"}
    axes[0].quiver(x, y, *body.pulls, **arrow)
    axes[0].plot([], [], color="#1a7a1a", marker=r"$\rightarrow$", ms=14, ls="", label="true pull")
    axes[0].set_ylabel("row, cells")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, frameon=False)
    return figure


def grasp_code_picture() -> Any:
    """Shear under two fingers in the four motions, with the code and the name that they get."""
    corner = np.array([[-1.0, 1.0], [-1.0, 1.0]])
    down = corner.T
    one = np.ones((2, 2))
    cases = {
        "slip": ((one, one), (-one, one)),
        "twist": ((-down, corner), (down, -corner)),
        "tilt": ((one, one), (one, -one)),
        "squeeze": ((corner, down), (corner, down)),
    }
    figure, axes = _sheet(4, 3.3, 2.4)
    for axis, (name, pair) in zip(axes, cases.items(), strict=True):
        shear = np.concatenate([np.stack(finger, axis=-1) for finger in pair], axis=1)
        load = np.concatenate([0.3 * shear, np.ones((2, 4, 1))], axis=-1)
        got = _streamed("grasp_code", _held(load), push=1.0)
        said = [k for k in cases if got[f"grasp_{k}"] > 0]
        row, col = np.indices((2, 4))
        # a gap between the fingers, so that no arrow of one ends in the other
        place = col + np.where(col > 1, 0.8, 0.0)
        axis.plot(place.ravel(), row.ravel(), "o", color="0.6", ms=4)
        arrow = {"angles": "xy", "scale_units": "xy", "scale": 2.2, "width": 0.012}
        axis.quiver(place, row, shear[..., 0], shear[..., 1], color="#0a6ebd", **arrow)
        axis.axvline(1.9, color="0.5", lw=1)
        code = int(got["grasp_code"])
        axis.set(
            title=f"{name}: read as {', '.join(said)}\ncode {code} = 0x{code:04X}",
            xlabel="columns: finger 1 | finger 2",
            xlim=(-0.7, 4.5),
            ylim=(1.7, -0.7),
            xticks=[0, 1, 2.8, 3.8],
            xticklabels=["0", "1", "2", "3"],
            yticks=[0, 1],
            aspect="equal",
        )
        axis.title.set_fontsize(9)
    axes[0].set_ylabel("row, taxels")
    return figure


def texture_picture() -> Any:
    """Friction and roughness frame by frame of four materials, and the whole recording's."""
    rng = np.random.default_rng(3)
    strokes = [rub(material, Stroke(frames=200), rng) for material in FOUR]
    still = 2.5e-3 * rng.normal(size=(20, 2, 2, 3))
    frames = np.concatenate([still, np.stack(strokes, axis=1).reshape(200, 2, 2, 3)])
    plan = Engine().compile(
        get_program("texture").bind(rate=70.0, push=1.0, window=64, ratio=0.5), (2, 2)
    )
    stream = plan.stream()
    got = [stream.push(frame) for frame in frames]
    true = whole_recording(frames[20:], window=64)
    figure, axes = _sheet(2, 5.5)
    for number, material in enumerate(FOUR):
        place = divmod(number, 2)
        for axis, name, exact in (
            (axes[0], "texture_friction", 2.0 * true.friction),
            (axes[1], "texture_roughness", true.roughness),
        ):
            line = axis.plot([o[name][place] for o in got], label=material.name)
            later = np.arange(40, 220, 20)
            axis.plot(later, exact[(later - 20, *place)], "o", color=line[0].get_color(), ms=4)
    axes[0].set(title="friction (6.3)", ylabel="shear over normal load")
    axes[1].set(title="roughness (6.4)", ylabel="roughness, %")
    for axis in axes:
        axis.axvline(20, color="0.7", lw=1, ls="--")
        axis.set_xlabel("frame of 15 ms; rubbing begins at the dashed line")
        axis.grid(alpha=0.3)
    axes[0].plot([], [], "o", color="0.4", label="the recording as a whole")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=5, frameon=False)
    return figure


PICTURES: dict[str, Callable[[], Any]] = {
    "contact": contact_picture,
    "edges": edges_picture,
    "edge-enhancement": edge_enhancement_picture,
    "localize": localize_picture,
    "grasp-code": grasp_code_picture,
    "texture": texture_picture,
    "slip-and-twist": slip_and_twist_picture,
    "active-contour": active_contour_picture,
    "on-off": on_off_picture,
    "moving-patterns": moving_patterns_picture,
    "receptors": receptors_picture,
}


def main(folder: Path, names: Sequence[str] = tuple(PICTURES)) -> None:
    """Write the pictures of that name as PNG into a folder, or all of them."""
    for name in names:
        PICTURES[name]().savefig(folder / f"{name}.png", **MADE)


if __name__ == "__main__":
    main(
        Path(sys.argv[1] if len(sys.argv) > 1 else "docs/programs"), sys.argv[2:] or tuple(PICTURES)
    )
