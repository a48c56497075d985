"""References of `edges` and `contact`: Hankel's, Love's and Hertz's solutions."""

from functools import partial

import numpy as np

from cnnum.arrays import Floats, Shape
from cnnum.tactile.indenters import Disc, Pressure, Reads, frame_under, taxels
from cnnum.tactile.touches import drawn, readings
from cnnum.templating.checks.program_records import Outputs, ProgramCase, ProgramForm

NOISE = 2.5e-3
"""Of one reading, as a share of the peak: 2.5 mV (Table 3.II) of 1 V."""

REST, HELD = 18, 3
DEPTH = 0.5

RADII = (1.4, 1.6)
"""Cells: radii of the punches on arrays that narrower ones would fit. A punch over fewer than seven
cells is never said to have an edge (docs/programs/edges.md)."""

AROUND = 0.4
"""Cells of skin between a contact and the rim of the array, so that no outline is cut off."""

FOUND = 0.6
"""Share of the links that outlines cross on which a place must be found, from five taxels a side
on: on four, outlines lie at the rim of the array, where an edge and a sphere look alike."""

MOST = 0.95
"""Share of the places whose distance counts."""


def pressed(loads: Floats, rng: np.random.Generator) -> Floats:
    """Return frames of rest and then of loads, all three axes, with the sign of strain."""
    size = np.max(np.abs(loads), axis=(-3, -2, -1), keepdims=True)
    frames = NOISE * rng.normal(size=(REST + HELD, *loads.shape))
    frames[REST:] -= loads / size
    return frames


def _discs(
    rng: np.random.Generator,
    shape: Shape,
    pressure: Pressure,
    radii: tuple[float, float],
    reads: Reads,
) -> ProgramCase:
    """Draw eight discs side by side, their radii in parts of the array."""
    low, high = (part * min(shape) for part in radii)
    drawn = rng.uniform(low, high, 8)
    room = np.clip(0.5 * min(shape) - drawn - AROUND, 0.0, 0.5)
    places = rng.uniform(-1.0, 1.0, (8, 2)) * room[:, None]
    loads = np.zeros((8, *shape, 3))
    for number, (radius, (x, y)) in enumerate(zip(drawn, places, strict=True)):
        disc = Disc(float(radius), (float(x), float(y)), pressure)
        loads[number, ..., 2] = frame_under(disc, shape, DEPTH, reads)
    expected = {"radius": drawn, "place": places, "size": np.array(shape)}
    return ProgramCase(pressed(loads, rng), expected, {"depth": DEPTH, "reads": reads})


def _off_outline(case: ProgramCase, outputs: Outputs) -> float:
    """Return within which distance of the circles most places lie, infinite where too few do."""
    rows, cols = case.expected["size"]
    off, crossed = [np.zeros(0)], 0
    for number, radius in enumerate(case.expected["radius"]):
        right, below = outputs["edge_to_right"][number], outputs["edge_to_below"][number]
        r1, c1 = np.nonzero(right >= 0.0)
        r2, c2 = np.nonzero(below >= 0.0)
        x = np.concatenate([c1 + right[r1, c1], c2.astype(np.float64)]) - (cols - 1) / 2
        y = np.concatenate([r1.astype(np.float64), r2 + below[r2, c2]]) - (rows - 1) / 2
        disc = Disc(float(radius), tuple(case.expected["place"][number]))
        off.append(np.abs(disc.distance(x, y)))
        crossed += _crossed(disc, (rows, cols))
    every = np.concatenate(off)
    if min(rows, cols) > 4 and every.size <= FOUND * crossed:
        return np.inf
    return float(np.quantile(every, MOST)) if every.size > 1 else 0.0


def _crossed(disc: Disc, shape: Shape) -> int:
    """Return how many links between neighbouring taxels an outline crosses."""
    inside = disc.distance(*taxels(shape)) < 0.0
    return int(sum(np.diff(inside, axis=axis).sum() for axis in (0, 1)))


def _punches(rng: np.random.Generator, shape: Shape, reads: Reads) -> ProgramCase:
    size = min(shape)
    radii = (max(0.22, RADII[0] / size), max(0.34, RADII[1] / size))
    return _discs(rng, shape, "punch", radii, reads)


def _edges_found(case: ProgramCase, outputs: Outputs) -> float:
    return float(np.max(outputs["edge_count"]))


def _spheres(rng: np.random.Generator, shape: Shape) -> ProgramCase:
    return _discs(rng, shape, "hertz", (0.42, 0.48), "strain")


def _touches(rng: np.random.Generator, shape: Shape) -> ProgramCase:
    case = _discs(rng, shape, "hertz", (0.2, 0.3), "strain")
    # two are enough: thresholds of noisy cells are slow to solve exactly
    expected = {**case.expected, "place": case.expected["place"][:2]}
    return ProgramCase(case.frames[:, :2], expected)


def _off_centre(case: ProgramCase, outputs: Outputs) -> float:
    rows, cols = case.expected["size"]
    if not np.all(outputs["contact"] > 0):
        return np.inf
    row = outputs["contact_row"] - (rows - 1) / 2 - case.expected["place"][:, 1]
    column = outputs["contact_column"] - (cols - 1) / 2 - case.expected["place"][:, 0]
    return float(np.hypot(row, column).max())


def _pulled(rng: np.random.Generator, shape: Shape) -> ProgramCase:
    """Draw two spheres that are pulled by up to 0.65 of their load, at 0.2 to 0.4 of the array."""
    size = min(shape)
    touches = drawn(rng, (0.2 * size, 0.4 * size), size, 2)
    loads = -np.stack([readings(touch, size, DEPTH, "strain") for touch in touches])
    peaks = np.max(np.abs(loads), axis=(1, 2, 3))
    pulls = np.array([touch.pulls for touch in touches])
    expected = {"load": 1.0 / peaks, "pull": pulls / peaks[:, None]}
    return ProgramCase(pressed(loads, rng), expected, {"depth": DEPTH})


def _off_loads(case: ProgramCase, outputs: Outputs) -> float:
    """Return the largest error of a load along an axis, as a share of the normal load."""
    true = np.column_stack([case.expected["pull"], case.expected["load"]])
    # strain is negative under a push, and a pull's along its direction
    found = np.stack([outputs[name] for name in ("load_x", "load_y", "load_normal")], axis=-1)
    return float(np.max(np.abs(found - true) / case.expected["load"][:, None]))


def _unaided(rng: np.random.Generator, shape: Shape) -> ProgramCase:
    """Draw three punches under a cover that the program does not know."""
    case = _punches(rng, shape, "strain")
    expected = {name: case.expected[name][:3] for name in ("radius", "place")}
    return ProgramCase(case.frames[:, :3], {**expected, "size": case.expected["size"]})


FORMS = (
    ProgramForm(
        name="enhanced",
        program="edge_enhancement",
        needs=("edge_to_right", "edge_to_below"),
        cases=_unaided,
        error=_off_outline,
        tolerance=0.6,
        tolerance_reason="the blur of half a cell of cover is left in the frame",
        summary="95 % of distances from circles, cells: strain under flat punches, enhanced",
    ),
    ProgramForm(
        name="outline-strain",
        program="edges",
        needs=("edge_to_right", "edge_to_below"),
        cases=partial(_punches, reads="strain"),
        error=_off_outline,
        tolerance=0.5,
        tolerance_reason="the program promises half a cell of 95 % of its places",
        summary="95 % of distances from circles, cells: strain under flat punches, by waves",
    ),
    ProgramForm(
        name="outline-stress",
        program="edges",
        needs=("edge_to_right", "edge_to_below"),
        cases=partial(_punches, reads="stress"),
        error=_off_outline,
        tolerance=0.5,
        tolerance_reason="the program promises half a cell of 95 % of its places",
        summary="95 % of distances from circles, cells: stress under flat punches, by waves",
    ),
    ProgramForm(
        name="no-edge",
        program="edges",
        needs=("edge_count",),
        cases=_spheres,
        error=_edges_found,
        tolerance=0.0,
        tolerance_reason="a sphere has no edge",
        summary="edges found in strain under Hertz's pressure",
    ),
    ProgramForm(
        name="centroid",
        program="contact",
        needs=("contact", "contact_row", "contact_column"),
        cases=_touches,
        error=_off_centre,
        tolerance=0.15,
        tolerance_reason="values below a tenth of the peak are cut off, cell by cell",
        summary="distance from the middle of a sphere's contact, cells",
    ),
    ProgramForm(
        name="loads",
        program="contact",
        needs=("load_x", "load_y", "load_normal"),
        cases=_pulled,
        error=_off_loads,
        tolerance=0.12,
        tolerance_reason="strain does not wholly separate a pull from a pressure near it",
        summary="loads of spheres over their normal load, by Hertz and Cattaneo-Mindlin",
    ),
)
