"""Answers of `tactile_flow` and `motion_direction`: drifting gratings."""

from functools import partial

import numpy as np

from cnnum.arrays import Floats, Shape
from cnnum.templating.checks.program_records import Outputs, ProgramCase, ProgramForm

RATE, REST, FRAMES = 100.0, 10, 110
LOOK, DELAY, RIM = 0.05, 0.1, 2


def _grating(rng: np.random.Generator, shape: Shape) -> tuple[Floats, float, float, bool]:
    """Draw a grating along one of the axes: frames, k (1/cell), ω (1/s), and whether along x."""
    k, speed = rng.uniform(0.4, 1.2), rng.choice([-1.0, 1.0]) * rng.uniform(1.0, 3.0)
    along, size = bool(rng.integers(2)), rng.uniform(0.5, 2.0)
    rows, cols = np.indices(shape)
    time = np.arange(FRAMES)[:, None, None] / RATE
    frames = np.zeros((REST + FRAMES, *shape, 3))
    frames[REST:, ..., 2] = size * np.cos(k * (cols if along else rows) - k * speed * time)
    return frames, k, k * speed, along


def grating_flow(k: float, omega: float, rate: float) -> float:
    """Return −u_t/u_x of a grating on taxels and frames: ω/k where both are fine.

    u_t is the change from frame to frame and u_x weighs five taxels, both of means of two frames:
    2 rate tan(ω/2 rate) over (8 sin k − sin 2k)/6.
    """
    return float(12.0 * rate * np.tan(0.5 * omega / rate) / (8.0 * np.sin(k) - np.sin(2.0 * k)))


def _flow(rng: np.random.Generator, shape: Shape) -> ProgramCase:
    frames, k, omega, along = _grating(rng, shape)
    flow = grating_flow(k, omega, RATE)
    expected = _along("flow_map", np.full(shape, flow), along)
    settings = {"rate": RATE, "rest": REST / RATE, "push": 1.0, "look": LOOK, "window": 0.0}
    return ProgramCase(frames, expected, settings)


def _correlations(rng: np.random.Generator, shape: Shape) -> ProgramCase:
    frames, k, omega, along = _grating(rng, shape)
    size = np.abs(frames).max()
    # frames at 100 Hz are straight lines between samples of the sine
    late = omega * DELAY
    found = size**2 * np.sin(k) * late / (1.0 + late**2)
    expected = _along("motion_map", np.full(shape, found), along)
    expected["motion_map_x"][:, -1] = expected["motion_map_y"][-1] = 0.0
    settings = {"rate": RATE, "rest": REST / RATE, "push": 1.0, "delay": DELAY, "contrast": False}
    return ProgramCase(frames, expected, settings)


def _along(name: str, answer: Floats, x: bool) -> dict[str, Floats]:
    """Return the maps of both axes: the answer along one of them, and 0 along the other."""
    return {f"{name}_{axis}": answer if x == (axis == "x") else 0.0 * answer for axis in "xy"}


def _off(case: ProgramCase, outputs: Outputs, rim: int = 0) -> float:
    """Return the largest error of a map, but for its rim, over the largest answer."""
    inner = (slice(rim, -rim or None),) * 2
    largest = max(np.abs(each).max() for each in case.expected.values())
    gaps = [np.abs(outputs[name] - each)[inner].max() for name, each in case.expected.items()]
    return float(max(gaps) / largest)


FORMS = (
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
