"""How far `contact` is from true loads.

`python -m cnnum.lab.bench.programs.contact_errors [strain|stress]` prints it.

Frames are those of `cnnum.tactile.indenters` with noise. The program knows nothing of the
tractions.
"""

import sys
from collections.abc import Sequence

import numpy as np

from cnnum.arrays import Floats
from cnnum.engine import Engine
from cnnum.programs.library import get_program
from cnnum.tactile.halfspace import band_pass, low_pass
from cnnum.tactile.indenters import WIDEST, Reads, Touch, drawn, readings
from cnnum.templating.checks.program_run import RATE

NOISE = 2.5e-3
"""Noise, as a share of the largest reading: 2.5 mV (Table 3.II) of 1 V."""

REST, HELD = 20, 3
DEPTHS = (0.5, 0.75, 1.0, 1.3)
WAVES = 8
"""Waves of the pitch to each side, beyond which a cover of a quarter of it passes 1e-4."""

RADII = ((0.5, 1.0), (1.0, 1.5), (1.5, 2.5), (2.5, 4.0), (4.0, 6.5))


def held(readings: Sequence[Floats], seed: int = 0) -> Floats:
    """Return frames of rest and then of touches side by side, (frames, touches, rows, cols, 3)."""
    seen = np.stack(readings)
    size = NOISE * np.abs(seen).max(axis=(1, 2, 3), keepdims=True)
    frames = size * np.random.default_rng(seed).normal(size=(REST + HELD, *seen.shape))
    frames[REST:] += seen
    return np.asarray(frames)


def run_contact(
    engine: Engine, touches: Sequence[Touch], cells: int, depth: float, reads: Reads
) -> dict[str, Floats]:
    """Return the outputs of `contact` after rest and three frames of each touch."""
    frames = held([readings(touch, cells, depth, reads) for touch in touches])
    program = get_program("contact").bind(rate=RATE, depth=depth, reads=reads)
    stream = engine.compile(program, (cells, cells)).stream((len(touches),))
    outputs = dict[str, Floats]()
    for frame in frames:
        outputs = stream.push(frame)
    return outputs


def errors(touches: Sequence[Touch], got: dict[str, Floats], cells: int) -> dict[str, Floats]:
    """Return errors of all touches: loads, area and friction as shares, the place in cells."""
    pulls = np.array([touch.pulls for touch in touches])
    pull, radius = (np.array([getattr(t, name) for t in touches]) for name in ("pull", "radius"))
    x, y = np.array([touch.centre for touch in touches]).T + (cells - 1) / 2
    return {
        "load_normal": got["load_normal"] - 1.0,
        "load_x, load_y": np.hypot(got["load_x"] - pulls[:, 0], got["load_y"] - pulls[:, 1]) / pull,
        "friction_used": got["friction_used"] / pull - 1.0,
        "place": np.hypot(got["contact_column"] - x, got["contact_row"] - y),
        "contact_area": got["contact_area"] / (np.pi * radius**2) - 1.0,
    }


def aliased(radius: float, depth: float, reads: Reads) -> float:
    """Return by how much readings of a sphere add up to too much, at most, by its place.

    Taxels a pitch apart take waves of the pitch for none at all (Poisson's summation formula).
    Their sum is all that an endless array knows of a load.

    Parameters
    ----------
    radius : float
        Radius of the contact, pitches.
    depth : float
        Depth of the cover, pitches.
    reads : "strain" or "stress"

    Returns
    -------
    float
        In loads; from a place on a taxel, or between four.
    """
    number = np.arange(-WAVES, WAVES + 1.0)
    m, n = np.meshgrid(number, number)
    k = np.where((m == 0) & (n == 0), np.inf, 2 * np.pi * np.hypot(m, n))
    finite = np.where(np.isinf(k), 1.0, k)
    sphere = 3 * (np.sin(finite * radius) - finite * radius * np.cos(finite * radius))
    passes = (low_pass if reads == "stress" else band_pass)(finite, depth)
    waves = np.where(np.isinf(k), 0.0, passes * sphere / (finite * radius) ** 3)
    return float(max(abs(waves.sum()), abs((waves * (-1.0) ** (m + n)).sum())))


def main(reads: Reads = "strain", count: int = 24) -> None:
    """Print quantiles of the errors."""
    engine, rng = Engine(), np.random.default_rng(1)
    heads = ("load_normal, %", "pull, %", "friction_used, %", "place, cells", "area, %")
    print(f"5, 50 and 95 % of {count} touches; {reads}\n| cells | z/pitch | radius | ", end="")
    print(*heads, sep=" | ", end=" |\n")
    for cells in (4, 8, 16):
        for depth in DEPTHS:
            for radii in RADII:
                if radii[0] >= WIDEST * cells:
                    continue
                touches = drawn(rng, radii, cells, count)
                off = errors(touches, run_contact(engine, touches, cells, depth, reads), cells)
                row = [
                    " ".join(f"{v:.2f}" if name == "place" else f"{100 * v:.0f}" for v in three)
                    for name, values in off.items()
                    for three in [np.quantile(values, [0.05, 0.5, 0.95])]
                ]
                print(f"| {cells} | {depth} | {radii[0]}–{radii[1]}", *row, sep=" | ", end=" |\n")
    for radius in (0.5, 0.7, 1.0):
        shares = {depth: f"{aliased(radius, depth, reads):.1%}" for depth in DEPTHS}
        print(f"readings of a sphere of {radius} cells add up to this share too much: {shares}")


if __name__ == "__main__":
    main("stress" if "stress" in sys.argv else "strain")
