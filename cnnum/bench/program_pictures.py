"""Pictures of the tactile programs: `python -m cnnum.bench.program_pictures docs/programs`.

Each shows what an array reads of a known load, and what a program makes of it.
"""

import sys
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from cnnum.arrays import Floats
from cnnum.bench.edge_errors import NOISE, found_places, run_edges
from cnnum.engine import Engine
from cnnum.program_library import get_program
from cnnum.tactile.bump_loads import bump_readings
from cnnum.tactile.indenters import Disc, Indenter, Rectangle, Ring, frame_under, two_bars
from cnnum.tactile.texture import texture as whole_recording
from cnnum.tactile.texture_materials import FOUR, Stroke, rub

MADE: Any = {"dpi": 100, "bbox_inches": "tight"}


def _sheet(columns: int, width: float = 3.4) -> tuple[Any, Any]:
    figure: Any = Figure(figsize=(width * columns, 3.5), layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots(1, columns, squeeze=False)[0]


def _map(figure: Any, axis: Any, values: Floats, title: str, unit: str) -> None:
    top = float(np.abs(values).max()) or 1.0
    image = axis.imshow(values, cmap="RdBu_r", vmin=-top, vmax=top)
    figure.colorbar(image, ax=axis, label=unit, shrink=0.8)
    axis.set(title=title, xlabel="column, cells", ylabel="row, cells")


def _streamed(name: str, frames: Floats, **parameters: object) -> dict[str, Floats]:
    plan = Engine().compile(get_program(name).bind(**parameters), frames.shape[1:3])
    stream, outputs = plan.stream(), dict[str, Floats]()
    for frame in frames:
        outputs = stream.push(frame)
    return outputs


def _held(load: Floats) -> Floats:
    frames = NOISE * np.random.default_rng(2).normal(size=(21, *load.shape))
    frames[18:] += load
    return frames


def edges_picture() -> Any:
    """Strain under four indenters and a sphere, with the outlines found in it."""
    bodies: list[tuple[str, Indenter]] = [
        ("disc", Disc(2.4, (0.2, -0.3))),
        ("ring", Ring(1.0, 2.8, (0.1, 0.2))),
        ("rectangle, 29°", Rectangle(2.8, 4.0, 0.5)),
        ("two bars, 34°", two_bars(1.7, 3.8, 1.5, 0.6)),
        ("sphere (Hertz)", Disc(3.4, (0.2, 0.1), "hertz")),
    ]
    got = run_edges(Engine(), [body for _, body in bodies], 8, 0.5, "strain")
    figure, axes = _sheet(len(bodies))
    fine = np.linspace(-0.5, 7.5, 161)
    for number, (axis, (name, body)) in enumerate(zip(axes, bodies, strict=True)):
        seen = frame_under(body, (8, 8), 0.5, "strain")
        _map(figure, axis, seen / seen.max(), name, "compressive strain / its peak")
        x, y = np.meshgrid(fine - 3.5, fine - 3.5)
        axis.contour(fine, fine, body.distance(x, y), [0.0], colors="k", linestyles=":")
        where = found_places(got["edge_to_right"][number], got["edge_to_below"][number])
        axis.plot(where[:, 1], where[:, 0], "o", color="#2a8c2a", markersize=4, label="edge found")
        axis.plot([], [], "k:", label="true outline")
    axes[0].legend(loc="upper left", fontsize=7)
    return figure


def localize_picture() -> Any:
    """Readings of bumps 3 bump radii apart over a pad, and the loads behind them."""
    loads = np.zeros((8, 8, 3))
    for row, col, x, y, z in ((1, 1, 0.3, 0, 0.8), (1, 3, 0, 0.4, 1), (5, 5, -0.3, -0.3, 0.9)):
        loads[row, col] = x, y, z
    loads[5, 6] = 0.2, -0.2, 0.7
    read = bump_readings(loads, "pad", 3.0, 0.5)
    got = _streamed("localize", _held(read), push=1.0, taxels="pad", bump_pitch=3.0, bump_depth=0.5)
    figure, axes = _sheet(3, 3.9)
    _map(figure, axes[0], read[..., 2], "read: normal combination", "stress × r², load")
    _map(figure, axes[1], got["bump_load_normal"], "loads found, arrows: shear", "load")
    rows, cols = np.indices((8, 8))
    axes[1].quiver(
        *(cols, rows, got["bump_load_x"], got["bump_load_y"]), angles="xy", scale=2.5, width=0.01
    )
    _map(figure, axes[2], got["bump_patch"], f"{got['bump_patches']:.0f} contacts", "label")
    for r, c in zip(got["bump_patch_row"].flat, got["bump_patch_column"].flat, strict=True):
        if r or c:
            axes[2].plot(c, r, "k+", markersize=10)
    axes[2].plot([], [], "k+", label="centroid of a contact")
    axes[2].legend(loc="lower left", fontsize=7)
    return figure


def contact_picture() -> Any:
    """Strain under a sphere, the taxels that count as touched, and the centroid."""
    body = Disc(2.2, (0.6, -0.4), "hertz")
    seen = frame_under(body, (8, 8), 0.5, "strain")
    frames = _held(-np.stack([0 * seen, 0 * seen, seen / seen.max()], axis=-1))
    got = _streamed("contact", frames)
    figure, axes = _sheet(2, 4.0)
    _map(figure, axes[0], seen / seen.max(), "read: a sphere", "compressive strain / its peak")
    _map(figure, axes[1], got["contact_map"], f"{got['contact_area']:.0f} taxels", "touched")
    for axis in axes:
        turn = np.linspace(0, 2 * np.pi, 90)
        axis.plot(4.1 + 2.2 * np.cos(turn), 3.1 + 2.2 * np.sin(turn), "k:", label="true contact")
        axis.plot(got["contact_column"], got["contact_row"], "k+", label="centroid found")
        axis.legend(loc="lower left", fontsize=7)
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
    figure, axes = _sheet(4)
    for axis, (name, pair) in zip(axes, cases.items(), strict=True):
        shear = np.concatenate([np.stack(finger, axis=-1) for finger in pair], axis=1)
        load = np.concatenate([0.3 * shear, np.ones((2, 4, 1))], axis=-1)
        got = _streamed("grasp_code", _held(load), push=1.0)
        said = [k for k in cases if got[f"grasp_{k}"] > 0]
        row, col = np.indices((2, 4))
        axis.quiver(col, row, shear[..., 0], shear[..., 1], angles="xy", scale=8, color="#0a6ebd")
        axis.axvline(1.5, color="0.5")
        axis.set(
            title=f"{name}: code {int(got['grasp_code'])}, read as {', '.join(said)}",
            xlabel="columns: finger 1 | finger 2",
            ylabel="row, taxels",
            xlim=(-0.7, 3.7),
            ylim=(1.7, -0.7),
            aspect="equal",
        )
        axis.title.set_fontsize(9)
    return figure


def texture_picture() -> Any:
    """Friction and roughness frame by frame of four materials, beside the whole recording's."""
    rng = np.random.default_rng(3)
    strokes = [rub(material, Stroke(frames=200), rng) for material in FOUR]
    still = 2.5e-3 * rng.normal(size=(20, 2, 2, 3))
    frames = np.concatenate([still, np.stack(strokes, axis=1).reshape(200, 2, 2, 3)])
    plan = Engine().compile(get_program("texture").bind(push=1.0, window=64, ratio=0.5), (2, 2))
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
            later = np.arange(20, 220, 20)
            axis.plot(later, exact[(later - 20, *place)], "o", color=line[0].get_color(), ms=4)
    axes[0].set(title="friction (6.3)", xlabel="frame of 15 ms", ylabel="shear over normal load")
    axes[1].set(title="roughness (6.4)", xlabel="frame of 15 ms", ylabel="%")
    axes[0].plot([], [], "o", color="0.4", label="over the recording")
    axes[0].legend(fontsize=7)
    return figure


PICTURES = {
    "contact": contact_picture,
    "edges": edges_picture,
    "localize": localize_picture,
    "grasp-code": grasp_code_picture,
    "texture": texture_picture,
}


def main(folder: Path) -> None:
    """Write every picture as PNG into a folder."""
    for name, make in PICTURES.items():
        make().savefig(folder / f"{name}.png", **MADE)


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "docs/programs"))
