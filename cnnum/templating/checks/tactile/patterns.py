"""Answers on patterns: outlines, contours, motion, receptor channels and grasp codes."""

from functools import partial

import numpy as np

from cnnum.arrays import Floats, Shape
from cnnum.tactile.bump_loads import bump_readings
from cnnum.tactile.indenters import Disc, Pressure, Reads, drawn, frame_under, readings, taxels
from cnnum.tactile.receptors import first_spike, ramp
from cnnum.tactile.texture import texture
from cnnum.templating.boundary import ZERO_FLUX
from cnnum.templating.checks.analytic.waves import layers_after
from cnnum.templating.checks.program_run import Outputs, ProgramCase, ProgramForm

CONTOURS_REST, CONTOURS_RATE, CONTOURS_NOISE = 20, 100.0, 1e-4


def _two_bodies(rng: np.random.Generator, shape: Shape) -> ProgramCase:
    """Draw a body with the largest load, and one apart from it that touches, too."""
    rows, cols = shape
    cut = int(rng.integers(cols // 2 - 1, cols // 2 + 1))
    body, other = np.zeros((2, *shape))
    body[rng.integers(0, 2) : rows - 1, :cut], other[1:, cut + 1 :] = 1.0, 0.8
    body[rows // 2, 0] = 1.2
    frames = CONTOURS_NOISE * rng.normal(size=(CONTOURS_REST + 40, *shape, 3))
    frames[CONTOURS_REST:, ..., 2] += body + other
    settings = {"rate": CONTOURS_RATE, "reads": "force", "push": 1.0, "speed": 60.0}
    return ProgramCase(frames, {"inside": np.sign(body)}, settings)


def _wrong_cells(case: ProgramCase, outputs: Outputs) -> float:
    wrong = (np.asarray(outputs["contour_inside"]) > 0) != (case.expected["inside"] > 0)
    return float(np.count_nonzero(wrong) + (float(outputs["contour_rests"]) == 0.0))


CONTOURS_FORMS = (
    ProgramForm(
        name="one-of-two-bodies",
        program="active_contour",
        needs=("contour_inside", "contour_rests"),
        cases=_two_bodies,
        error=_wrong_cells,
        tolerance=0.0,
        tolerance_reason="a cell is inside or not",
        summary="the body with the peak, all of it and nothing of another one",
    ),
)


MOVING_PATTERNS_RATE, MOVING_PATTERNS_REST, MOVING_PATTERNS_FRAMES = 100.0, 10, 110
LOOK, DELAY, RIM = 0.05, 0.1, 2


def _grating(rng: np.random.Generator, shape: Shape) -> tuple[Floats, float, float, bool]:
    """Draw a grating along one of the axes: frames, k (1/cell), ω (1/s), and whether along x."""
    k, speed = rng.uniform(0.4, 1.2), rng.choice([-1.0, 1.0]) * rng.uniform(1.0, 3.0)
    along, size = bool(rng.integers(2)), rng.uniform(0.5, 2.0)
    rows, cols = np.indices(shape)
    time = np.arange(MOVING_PATTERNS_FRAMES)[:, None, None] / MOVING_PATTERNS_RATE
    frames = np.zeros((MOVING_PATTERNS_REST + MOVING_PATTERNS_FRAMES, *shape, 3))
    frames[MOVING_PATTERNS_REST:, ..., 2] = size * np.cos(
        k * (cols if along else rows) - k * speed * time
    )
    return frames, k, k * speed, along


def grating_flow(k: float, omega: float, rate: float) -> float:
    """Return −u_t/u_x of a grating on taxels and frames: ω/k where both are fine.

    u_t is the change from frame to frame and u_x weighs five taxels, both of means of two frames:
    2 rate tan(ω/2 rate) over (8 sin k − sin 2k)/6.
    """
    return float(12.0 * rate * np.tan(0.5 * omega / rate) / (8.0 * np.sin(k) - np.sin(2.0 * k)))


def _flow(rng: np.random.Generator, shape: Shape) -> ProgramCase:
    frames, k, omega, along = _grating(rng, shape)
    flow = grating_flow(k, omega, MOVING_PATTERNS_RATE)
    expected = _along("flow_map", np.full(shape, flow), along)
    settings = {
        "rate": MOVING_PATTERNS_RATE,
        "rest": MOVING_PATTERNS_REST / MOVING_PATTERNS_RATE,
        "push": 1.0,
        "look": LOOK,
        "window": 0.0,
    }
    return ProgramCase(frames, expected, settings)


def _correlations(rng: np.random.Generator, shape: Shape) -> ProgramCase:
    frames, k, omega, along = _grating(rng, shape)
    size = np.abs(frames).max()
    # frames at 100 Hz are straight lines between samples of the sine
    late = omega * DELAY
    correlation = size**2 * np.sin(k) * late / (1.0 + late**2)
    expected = _along("motion_map", np.full(shape, correlation), along)
    expected["motion_map_x"][:, -1] = expected["motion_map_y"][-1] = 0.0
    settings = {
        "rate": MOVING_PATTERNS_RATE,
        "rest": MOVING_PATTERNS_REST / MOVING_PATTERNS_RATE,
        "push": 1.0,
        "delay": DELAY,
        "contrast": False,
    }
    return ProgramCase(frames, expected, settings)


def _along(name: str, answer: Floats, x: bool) -> dict[str, Floats]:
    """Return the maps of both axes: the answer along one of them, and 0 along the other."""
    return {f"{name}_{axis}": answer if x == (axis == "x") else 0.0 * answer for axis in "xy"}


def _off(case: ProgramCase, outputs: Outputs, rim: int = 0) -> float:
    """Return the largest error of a map, but for its rim, over the largest answer."""
    inner = (slice(rim, -rim or None),) * 2
    largest = max(np.abs(truth).max() for truth in case.expected.values())
    gaps = [np.abs(outputs[name] - truth)[inner].max() for name, truth in case.expected.items()]
    return float(max(gaps) / largest)


MOVING_PATTERNS_FORMS = (
    ProgramForm(
        name="drifting-grating",
        program="tactile_flow",
        needs=("flow_map_x", "flow_map_y"),
        cases=_flow,
        error=partial(_off, rim=RIM),
        tolerance=5e-3,
        tolerance_reason="a lean of 1e-3 of the slopes' energy, and of that of the place's means",
        summary="v = −u_t/u_x of a grating, with the taxels' and the frames' own waves",
    ),
    ProgramForm(
        name="correlated-grating",
        program="motion_direction",
        needs=("motion_map_x", "motion_map_y"),
        cases=_correlations,
        error=_off,
        tolerance=2e-2,
        tolerance_reason="the start fades as exp(−t/delay) to 2e-5, lines between samples lose "
        "(ω dt)²/12, and the sine's largest sample may miss its peak by 1 %",
        summary="A² sin k · ωτ / (1 + ω²τ²) of a grating, in every taxel at every time",
    ),
)


OUTLINES_NOISE = 2.5e-3
"""Noise of one reading, as a share of the peak: 2.5 mV (Table 3.II) of 1 V."""

OUTLINES_REST, HELD = 18, 3
OUTLINES_DEPTH = 0.5

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
    frames = OUTLINES_NOISE * rng.normal(size=(OUTLINES_REST + HELD, *loads.shape))
    frames[OUTLINES_REST:] -= loads / size
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
        loads[number, ..., 2] = frame_under(disc, shape, OUTLINES_DEPTH, reads)
    expected = {"radius": drawn, "place": places, "size": np.array(shape)}
    return ProgramCase(pressed(loads, rng), expected, {"depth": OUTLINES_DEPTH, "reads": reads})


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
    loads = -np.stack([readings(touch, size, OUTLINES_DEPTH, "strain") for touch in touches])
    peaks = np.max(np.abs(loads), axis=(1, 2, 3))
    pulls = np.array([touch.pulls for touch in touches])
    expected = {"load": 1.0 / peaks, "pull": pulls / peaks[:, None]}
    return ProgramCase(pressed(loads, rng), expected, {"depth": OUTLINES_DEPTH})


def _off_loads(case: ProgramCase, outputs: Outputs) -> float:
    """Return the largest error of a load along an axis, as a share of the normal load."""
    true = np.column_stack([case.expected["pull"], case.expected["load"]])
    # strain is negative under a push, and a pull's along its direction
    result = np.stack([outputs[name] for name in ("load_x", "load_y", "load_normal")], axis=-1)
    return float(np.max(np.abs(result - true) / case.expected["load"][:, None]))


def _unaided(rng: np.random.Generator, shape: Shape) -> ProgramCase:
    """Draw three punches under a cover that the program does not know."""
    case = _punches(rng, shape, "strain")
    expected = {name: case.expected[name][:3] for name in ("radius", "place")}
    return ProgramCase(case.frames[:, :3], {**expected, "size": case.expected["size"]})


OUTLINES_FORMS = (
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


WINDOW, APART, CODES_RATE = 8, 0.015, 60.0
"""Samples of `texture`, s between them, and frames per second."""

PITCH, CODES_DEPTH = 7.5, 1.0


def _bumps(rng: np.random.Generator, shape: Shape) -> ProgramCase:
    """Draw eight patterns of touched bumps, each dragged by up to half of its load."""
    loads = rng.uniform(-0.3, 0.3, (8, *shape, 3))
    loads[..., 2] = rng.uniform(0.4, 1.0, (8, *shape))
    touched = rng.random((8, *shape)) < 0.3
    touched[:, 0, 0] = True
    loads *= touched[..., None]
    read = bump_readings(loads, "strain", PITCH, CODES_DEPTH)
    size = np.abs(read).max(axis=(1, 2, 3), keepdims=True)
    parameters = {"push": -1.0, "bump_pitch": PITCH, "bump_depth": CODES_DEPTH}
    return ProgramCase(pressed(read, rng), {"loads": loads / size, "size": size}, parameters)


def _misjudged(case: ProgramCase, outputs: Outputs) -> float:
    """Return the largest error of a normal load, as a share of the largest one."""
    true = case.expected["loads"][..., 2]
    if not np.array_equal(outputs["bump_contact"] > 0, true > 0):
        return np.inf
    return float(np.abs(outputs["bump_load_normal"] - true).max() / true.max())


def _grasps(rng: np.random.Generator, shape: Shape) -> ProgramCase:
    """Draw 256 codes; each bit is the sign of a quarter of a finger's shear."""
    rows, cols = shape[0] // 2, shape[1] // 4
    codes = rng.integers(0, 1 << 16, 256)
    signs = 2.0 * (codes[:, None] >> np.arange(16) & 1).reshape(-1, 2, 2, 2, 2) - 1.0
    quarters = np.concatenate([signs[:, 0], signs[:, 1]], axis=2)
    shear = np.repeat(np.repeat(quarters, rows, axis=1), cols, axis=2)
    loads = np.concatenate([0.3 * shear, np.ones((*shear.shape[:-1], 1))], axis=-1)
    loads = np.asarray(loads, dtype=np.float64)
    return ProgramCase(pressed(loads, rng), {"codes": codes.astype(np.float64)})


def _wrong_codes(case: ProgramCase, outputs: Outputs) -> float:
    right = (outputs["grasp_code"] == case.expected["codes"]) & (outputs["code_known"] > 0)
    return float(np.count_nonzero(~right))


def _rubbed(rng: np.random.Generator, shape: Shape) -> ProgramCase:
    """Draw a friction of its own for every taxel, that wavers by a tenth from frame to frame."""
    still = 1e-4 * rng.normal(size=(20, *shape, 3))
    load = rng.uniform(0.5, 1.0, (2 * WINDOW, *shape))
    ratio = rng.uniform(0.3, 0.9, shape) * rng.uniform(0.9, 1.1, load.shape)
    way = rng.uniform(0.0, 2 * np.pi, shape)
    parts = (ratio * load * np.cos(way), ratio * load * np.sin(way), load)
    frames = np.concatenate([still, np.stack(parts, axis=-1)])
    # of an array slower than a sample every 15 ms, the frames of the window's time count
    true = texture(frames[20:], window=round(WINDOW * APART * CODES_RATE))
    expected = {"friction": true.friction[-1], "roughness": true.roughness[-1]}
    return ProgramCase(frames, expected, {"push": 1.0, "window": WINDOW, "rate": CODES_RATE})


def _off_texture(case: ProgramCase, outputs: Outputs) -> float:
    friction = np.abs(outputs["texture_friction"] - case.expected["friction"]).max()
    roughness = np.abs(outputs["texture_roughness"] - case.expected["roughness"]).max()
    return float(max(friction, roughness / 100.0))


CODES_FORMS = (
    ProgramForm(
        name="bump-loads",
        program="localize",
        needs=("bump_contact", "bump_load_normal"),
        cases=_bumps,
        error=_misjudged,
        tolerance=0.03,
        tolerance_reason="the inverse is cut at three bumps (2 %), the noise adds four deviations",
        summary="loads of bumps, by the finite-element influence summed bump by bump",
    ),
    ProgramForm(
        name="all-bits",
        program="grasp_code",
        needs=("grasp_code", "code_known"),
        cases=_grasps,
        error=_wrong_codes,
        tolerance=0.0,
        tolerance_reason="a bit is right or wrong",
        summary="codes of shears drawn bit by bit",
    ),
    ProgramForm(
        name="friction-and-roughness",
        program="texture",
        needs=("texture_friction", "texture_roughness"),
        cases=_rubbed,
        error=_off_texture,
        tolerance=2e-3,
        tolerance_reason="rest is known to 2e-5 of loads above 0.5, and floats to 1e-7",
        summary="(6.3) and (6.4) over the whole recording",
    ),
)


RECEPTOR_CHANNELS_RATE, RECEPTOR_CHANNELS_REST, RECEPTOR_CHANNELS_FRAMES = 100.0, 20, 60
CORNERS = {"sa1": (0, 1.0, 15.0), "ra1": (1, 20.0, 50.0), "pc": (2, 60.0, 400.0)}
"""High-passes of a channel, and its corners, Hz: Table 2.I."""

POINTS = dict.fromkeys(("sa1_field", "ra1_field", "pc_field", "sa2_field"), 0.0)
THRESHOLD, MEMBRANE, SILENCE = 0.1, 0.01, 0.002


def _course(channel: str, time: Floats) -> Floats:
    stages, slow, quick = CORNERS[channel]
    return ramp(time, stages=stages, slow=0.5 / np.pi / slow, quick=0.5 / np.pi / quick)


def _ramps(rng: np.random.Generator, shape: Shape) -> ProgramCase:
    """Draw a push and a shear for every taxel: ramps that begin and end at frames of their own."""
    begins = rng.integers(RECEPTOR_CHANNELS_REST, RECEPTOR_CHANNELS_REST + 15, shape)
    ends = begins + rng.integers(1, 20, shape)
    speed = rng.uniform(-1.0, 1.0, (*shape, 3))
    n = np.arange(RECEPTOR_CHANNELS_REST + RECEPTOR_CHANNELS_FRAMES)[:, None, None]
    risen = (np.clip(n, begins, ends) - begins) / RECEPTOR_CHANNELS_RATE
    expected = {
        name: speed[..., 2]
        * (
            _course(name, (n - begins) / RECEPTOR_CHANNELS_RATE)
            - _course(name, (n - ends) / RECEPTOR_CHANNELS_RATE)
        )
        for name in CORNERS
    }
    slow = _course("sa1", (n - begins) / RECEPTOR_CHANNELS_RATE) - _course(
        "sa1", (n - ends) / RECEPTOR_CHANNELS_RATE
    )
    expected |= {"sa2_x": speed[..., 0] * slow, "sa2_y": speed[..., 1] * slow}
    settings = {
        "rate": RECEPTOR_CHANNELS_RATE,
        "rest": RECEPTOR_CHANNELS_REST / RECEPTOR_CHANNELS_RATE,
        "push": 1.0,
        **POINTS,
    }
    return ProgramCase(risen[..., None] * speed, expected, settings)


def _off_course(case: ProgramCase, outputs: Outputs) -> float:
    """Return the largest error of an output, as a share of its largest value."""
    shares = (np.abs(outputs[n] - w).max() / np.abs(w).max() for n, w in case.expected.items())
    return float(max(shares))


def _steady(rng: np.random.Generator, shape: Shape) -> ProgramCase:
    """Draw a constant push for every taxel; the low-pass lets it through at once."""
    push = rng.uniform(0.05, 2.0, shape)
    push.flat[0] = 1.0
    frames = np.zeros((RECEPTOR_CHANNELS_REST + RECEPTOR_CHANNELS_FRAMES, *shape, 3))
    frames[RECEPTOR_CHANNELS_REST:, ..., 2] = push
    settings = {
        "rate": RECEPTOR_CHANNELS_RATE, "rest": RECEPTOR_CHANNELS_REST / RECEPTOR_CHANNELS_RATE,
        "push": 1.0, "between": "hold", "sa_to": 1e3, **POINTS,
        "threshold": THRESHOLD, "membrane": MEMBRANE, "refractory": SILENCE,
    }  # fmt: skip
    return ProgramCase(frames, {"interval": first_spike(push, THRESHOLD, MEMBRANE)}, settings)


def _wrong_spikes(case: ProgramCase, outputs: Outputs) -> float:
    """Return how far the spikes of 0.5 s are from as many as fit, in spikes."""
    # the first frame of the push counts as half of it
    seconds = (RECEPTOR_CHANNELS_FRAMES - 1) / RECEPTOR_CHANNELS_RATE
    fits = seconds / (case.expected["interval"] + SILENCE)
    counted = np.asarray(outputs["sa1_spikes"][RECEPTOR_CHANNELS_REST + 1 :]).sum(axis=0)
    return float(np.abs(counted - fits).max())


def _presses(rng: np.random.Generator, shape: Shape) -> ProgramCase:
    """Draw a ramp for every taxel; all begin together, and are held after a tenth of a second."""
    slope, lasts = rng.uniform(-1.0, 1.0, shape), 10
    frames = np.zeros((RECEPTOR_CHANNELS_REST + RECEPTOR_CHANNELS_FRAMES, *shape, 3))
    risen = (
        np.clip(
            np.arange(RECEPTOR_CHANNELS_REST + RECEPTOR_CHANNELS_FRAMES)
            - RECEPTOR_CHANNELS_REST
            + 1,
            0,
            lasts,
        )
        / RECEPTOR_CHANNELS_RATE
    )
    frames[..., 2] = risen[:, None, None] * slope
    widths, taus = (0.25, 2.0), (0.01, 0.03, 0.1)

    def ramp_layers(after: float) -> Floats:
        return layers_after(slope, ZERO_FLUX, max(after, 0.0), widths, taus)

    expected: dict[str, list[Floats]] = {"sustained": [], "transient": []}
    for n in range(RECEPTOR_CHANNELS_REST + RECEPTOR_CHANNELS_FRAMES):
        begun = (n - RECEPTOR_CHANNELS_REST + 1) / RECEPTOR_CHANNELS_RATE
        _, near, far, late = ramp_layers(begun) - ramp_layers(
            begun - lasts / RECEPTOR_CHANNELS_RATE
        )
        expected["sustained"].append(near - far)
        expected["transient"].append(near - far - late)
    answers = {
        f"{sign}_{name}": np.maximum(factor * np.array(maps), 0.0)
        for name, maps in expected.items()
        for sign, factor in (("on", 1.0), ("off", -1.0))
    }
    return ProgramCase(
        frames,
        answers,
        {
            "rate": RECEPTOR_CHANNELS_RATE,
            "rest": RECEPTOR_CHANNELS_REST / RECEPTOR_CHANNELS_RATE,
            "push": 1.0,
        },
    )


RECEPTOR_CHANNELS_FORMS = (
    ProgramForm(
        name="centre-and-surround",
        program="on_off",
        needs=("on_sustained", "off_sustained", "on_transient", "off_transient"),
        cases=_presses,
        error=_off_course,
        tolerance=1e-4,
        tolerance_reason="answers are differences of layers in single precision",
        summary="ramps that are held, wave by wave: three leaky cells each",
        compares="all",
    ),
    ProgramForm(
        name="ramp-and-hold",
        program="receptors",
        needs=("sa1", "ra1", "pc", "sa2_x", "sa2_y"),
        cases=_ramps,
        error=_off_course,
        tolerance=1e-4,
        tolerance_reason="PC's layers are differences of signals a thousand times as large, which "
        "single precision rounds",
        summary="ramps that are held, a slope and two times a taxel, by partial fractions",
        compares="all",
    ),
    ProgramForm(
        name="spikes-of-a-leaky-cell",
        program="receptors",
        needs=("sa1_spikes",),
        cases=_steady,
        error=_wrong_spikes,
        tolerance=1.01,
        tolerance_reason="a count is whole, and the charge of the first frame is not known",
        summary="as many spikes of a constant push as intervals τ ln(I/(I − θ)) + silence fit",
        compares="all",
    ),
)

FORMS = (
    *CONTOURS_FORMS,
    *MOVING_PATTERNS_FORMS,
    *OUTLINES_FORMS,
    *CODES_FORMS,
    *RECEPTOR_CHANNELS_FORMS,
)
