"""Answers of `tactile_flow` and `motion_direction`: drifting gratings."""

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
    flow = np.array(grating_flow(k, omega, RATE))
    expected = {f"flow_map_{axis}": flow if along == (axis == "x") else 0.0 * flow for axis in "xy"}
    settings = {"rate": RATE, "rest": REST / RATE, "push": 1.0, "look": LOOK, "window": 0.0}
    return ProgramCase(frames, expected, settings)


def _off_flow(case: ProgramCase, outputs: Outputs) -> float:
    """Return the largest error away from the rim, as a share of the speed."""
    inner = (slice(RIM, -RIM), slice(RIM, -RIM))
    speed = max(abs(float(flow)) for flow in case.expected.values())
    return (
        max(
            float(np.abs(outputs[name][inner] - flow).max()) for name, flow in case.expected.items()
        )
        / speed
    )


def _correlations(rng: np.random.Generator, shape: Shape) -> ProgramCase:
    frames, k, omega, along = _grating(rng, shape)
    size = np.abs(frames).max()
    # frames at 100 Hz are straight lines between samples of the sine
    late = omega * DELAY
    found = size**2 * np.sin(k) * late / (1.0 + late**2)
    expected = {
        f"motion_map_{axis}": np.full(shape, found * (along == (axis == "x"))) for axis in "xy"
    }
    expected["motion_map_x"][:, -1] = expected["motion_map_y"][-1] = 0.0
    settings = {"rate": RATE, "rest": REST / RATE, "push": 1.0, "delay": DELAY, "contrast": False}
    return ProgramCase(frames, expected, settings)


def _off_correlation(case: ProgramCase, outputs: Outputs) -> float:
    largest = max(np.abs(each).max() for each in case.expected.values())
    return float(max(np.abs(outputs[n] - w).max() for n, w in case.expected.items()) / largest)


FORMS = (
    ProgramForm(
        name="drifting-grating",
        program="tactile_flow",
        needs=("flow_map_x", "flow_map_y"),
        cases=_flow,
        error=_off_flow,
        tolerance=5e-3,
        tolerance_reason="a lean of 1e-3 of the slopes' energy, and of that of the place's means",
        summary="v = −u_t/u_x of a grating, with the taxels' and the frames' own waves",
    ),
    ProgramForm(
        name="correlated-grating",
        program="motion_direction",
        needs=("motion_map_x", "motion_map_y"),
        cases=_correlations,
        error=_off_correlation,
        tolerance=2e-2,
        tolerance_reason="the start fades as exp(−t/delay) to 2e-5, lines between samples lose "
        "(ω dt)²/12, and the sine's largest sample may miss its peak by 1 %",
        summary="A² sin k · ωτ / (1 + ω²τ²) of a grating, in every taxel at every time",
    ),
)
