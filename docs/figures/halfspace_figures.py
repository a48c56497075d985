"""Pictures of the half-space for the docs: ``python -m docs.figures.halfspace_figures DIR``.

Writes a PNG and the data behind it, with the machine and the versions, for each of three pictures.
"""

import json
import platform
import sys
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from cnnum.arrays import Floats
from cnnum.engine import Engine
from cnnum.lab.bench.charts import png
from cnnum.lab.bench.programs.halfspace_runs import (
    MODULUS,
    PITCH,
    Row,
    both_ways,
    equilibrium,
    inverse,
    love_errors,
)
from cnnum.programs.library import get_program
from cnnum.sharing import colours
from cnnum.tactile.halfspace import SurfaceToDepth

Picture = Any
"""Matplotlib says little of the types of its arguments."""


def ways_figure(ways: Sequence[Row], love: Sequence[Row]) -> Picture:
    """Return error over run time of both ways, and over the cell against Love patches."""
    figure: Picture = Figure(figsize=(11, 4.4), layout="constrained")
    left, right = figure.subplots(1, 2)
    for mark, way in zip("osD^v<>P", dict.fromkeys(r["way"] for r in ways), strict=False):
        own = [r for r in ways if r["way"] == way]
        left.plot(_of(own, "seconds"), _of(own, "error"), marker=mark, label=way)
    left.set(xscale="log", yscale="log", xlabel="time of one 8×8×3 frame, s")
    left.set(ylabel="largest error / largest load", title="Against the lattice's own transform")
    left.axhline(1e-5, color="0.6", linewidth=0.8, linestyle=":")
    # both shears have the same error: the larger mark shows around the smaller one
    for mark, size, load in (("o", 11, "q_x"), ("s", 6, "q_y"), ("D", 6, "p")):
        own = [r for r in love if r["load"] == load]
        label = f"${load}$ on 2×2 taxels"
        right.plot(
            _of(own, "cells"), _of(own, "error"), marker=mark, ms=size, mfc="none", label=label
        )
    cells = np.array([1.0, 8.0])
    right.plot(cells, 0.2 / cells**2, "k:", label="slope 2")
    right.set(xscale="log", yscale="log", xlabel="cells a taxel, along each axis")
    right.set(ylabel="largest error / largest stress", title="Against Love and Cerruti patches")
    right.set_xticks([1, 2, 4, 8], ["1", "2", "4", "8"])
    right.set_xticks([], minor=True)
    _finish(left, right)
    return figure


def equilibrium_figure(rows: Sequence[Row]) -> Picture:
    """Return error against (4.9) over the cell, and work over Poisson's ratio."""
    figure: Picture = Figure(figsize=(11, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    for mark, ratio in zip("os", (0.3, 0.49), strict=True):
        own = [r for r in rows if r["poisson"] == ratio]
        left.plot(_of(own, "cells"), _of(own, "error"), marker=mark, label=f"ν = {ratio}")
        near = _of(own, "matched_error")
        left.plot(_of(own, "cells"), near, marker=mark, ls="--", label=f"ν = {ratio}, matched")
    cells = np.array([1.0, 3.0])
    left.plot(cells, 0.6 / cells**2, "k:", label="slope 2")
    left.set(xscale="log", yscale="log", xlabel="cells a unit of length (the taxels lie 2 deep)")
    left.set(ylabel="largest error / largest $u_z$", title="Relaxation, against (4.9)")
    left.set_xticks([1, 2, 3], ["1", "2", "3"])
    left.set_xticks([], minor=True)
    own = sorted((r for r in rows if r["cells"] == 1), key=lambda r: _number(r["poisson"]))
    gap = [1 - 2 * _number(r["poisson"]) for r in own]
    right.plot(gap, _of(own, "time_constants"), marker="o", label="time constants")
    right.plot(gap, _of(own, "steps"), marker="s", label="steps (of up to 40 stages)")
    right.plot(gap, [1e3 * _number(r["seconds"]) for r in own], marker="D", label="run time, ms")
    right.set(xscale="log", yscale="log")
    right.invert_xaxis()
    right.set(title="Work to equilibrium, 8×8 cells × 6 slabs × 3")
    right.set(xlabel="1 − 2ν (ν grows to the right, up to 0.49)", ylabel="number, or ms")
    _finish(left, right)
    return figure


def inverse_figure(rows: Sequence[Row], maps: Sequence[tuple[str, Floats, float]]) -> Picture:
    """Return several contacts as they are, as taxels see them and as they come back; then costs."""
    figure: Picture = Figure(figsize=(11, 7), layout="constrained")
    axes = figure.subplots(2, 3)
    for at, (title, values, unit) in enumerate(maps):
        where = axes[0, at]
        limit = float(np.abs(values).max()) / unit
        # a push is blue: a positive pressure, a negative strain
        pushed = colours() if unit == 1e3 else colours().reversed()
        shown = where.imshow(values / unit, cmap=pushed, vmin=-limit, vmax=limit)
        where.set(title=title, xlabel="column, taxels", ylabel="row, taxels")
        label = "pressure, kPa" if unit == 1e3 else "strain, 10⁻³ (noise 0.1)"
        figure.colorbar(shown, ax=where, label=label, shrink=0.85)
    for place, key, factor, name in (
        (axes[1, 0], "width", 1e3, "width of the point response, mm"),
        (axes[1, 1], "noise", 1e-3, "noise of the pressure, kPa RMS"),
        (axes[1, 2], "kept", 1.0, "share of a one-taxel push that comes back"),
    ):
        for pitch in dict.fromkeys(_number(r["pitch"]) for r in rows):
            own = [r for r in rows if r["pitch"] == pitch]
            x = [1e3 * _number(r["thickness"]) for r in own]
            y = [factor * _number(r[key]) for r in own]
            place.plot(x, y, marker="o", label=f"pitch {1e3 * pitch:g} mm")
        place.set(xlabel="thickness of the cover, mm", ylabel=name)
        place.grid(visible=True, alpha=0.3)
        place.set_ylim(0, None)
    # one key below for all three: inside, it would lie on the lines
    handles, labels = axes[1, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), frameon=False)
    return figure


def contacts(engine: Engine) -> list[tuple[str, Floats, float]]:
    """Return pressure of three contacts at once, ε_zz with noise, and the pressure found."""
    load = np.zeros((8, 8, 3))
    load[1:3, 1:3, 2], load[5:7, 4:7, 2], load[1, 6, 2] = 8e3, 6e3, 12e3
    strain = SurfaceToDepth((8, 8), PITCH, 1.0e-3, youngs_modulus=MODULUS)(load)
    strain += np.random.default_rng(3).normal(0.0, 1e-4, strain.shape)
    found = engine.compile(get_program("surface_load"), (8, 8), ["load_normal"])(strain)
    return [
        ("pressure of three contacts", load[..., 2], 1e3),
        ("strain $ε_{zz}$ under 1 mm", strain[..., 2], 1e-3),
        ("pressure by surface_load", found["load_normal"], 1e3),
    ]


def _of(rows: Sequence[Row], key: str) -> list[float]:
    return [_number(row[key]) for row in rows]


def _number(value: object) -> float:
    assert isinstance(value, int | float)
    return float(value)


def _finish(*axes: Any) -> None:
    for each in axes:
        each.grid(visible=True, alpha=0.3)
        each.legend(fontsize=8)


def _write(folder: Path, name: str, figure: Picture, rows: dict[str, list[Row]], on: str) -> None:
    (folder / f"{name}.png").write_bytes(png(figure))
    packages = {each: version(each) for each in ("cnnum-emulator", "numpy", "scipy", "pyopencl")}
    data = {"device": on, "machine": platform.platform(), "versions": packages, **rows}
    (folder / f"{name}.json").write_text(json.dumps(data, indent=1) + "\n")


def _ways(engine: Engine, folder: Path) -> None:
    ways, love = list(both_ways(engine)), list(love_errors(engine))
    name = "halfspace-error-time"
    _write(folder, name, ways_figure(ways, love), {"ways": ways, "love": love}, engine.device)


def _rest(engine: Engine, folder: Path) -> None:
    sizes = [(1, r) for r in (0.0, 0.3, 0.4, 0.45, 0.48, 0.49)]
    rest = [equilibrium(*each) for each in (*sizes, (2, 0.3), (2, 0.49), (3, 0.3), (3, 0.49))]
    figure = equilibrium_figure(rest)
    _write(folder, "halfspace-equilibrium", figure, {"rows": rest}, engine.device)


def _back(engine: Engine, folder: Path) -> None:
    covers = [(p, z) for p in (0.75e-3, 1.5e-3, 3e-3) for z in (0.3e-3, 0.5e-3, 1e-3, 1.5e-3, 2e-3)]
    back = [inverse(engine, *each) for each in covers]
    figure = inverse_figure(back, contacts(engine))
    _write(folder, "surface-load", figure, {"rows": back}, engine.device)


PICTURES = {
    "halfspace-error-time": _ways,
    "halfspace-equilibrium": _rest,
    "surface-load": _back,
}


def main(folder: Path, names: Sequence[str] = tuple(PICTURES)) -> None:
    """Measure, draw and write everything, or the pictures named."""
    engine = Engine()
    for name in names:
        PICTURES[name](engine, folder)


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:] or tuple(PICTURES))
