"""Answers of `receptors` and `on_off`: ramps that are held, and the spikes of a constant push."""

import numpy as np

from cnnum.arrays import Floats, Shape
from cnnum.tactile.receptors import first_spike, ramp
from cnnum.templating.boundary import ZERO_FLUX
from cnnum.templating.checks.analytic.centre_surround import layers_after
from cnnum.templating.checks.program_records import Outputs, ProgramCase, ProgramForm

RATE, REST, FRAMES = 100.0, 20, 60
CORNERS = {"sa1": (0, 1.0, 15.0), "ra1": (1, 20.0, 50.0), "pc": (2, 60.0, 400.0)}
"""High-passes of a channel, and its corners, Hz: Table 2.I."""

POINTS = dict.fromkeys(("sa1_field", "ra1_field", "pc_field", "sa2_field"), 0.0)
THRESHOLD, MEMBRANE, SILENCE = 0.1, 0.01, 0.002


def _course(channel: str, time: Floats) -> Floats:
    stages, slow, quick = CORNERS[channel]
    return ramp(time, stages=stages, slow=0.5 / np.pi / slow, quick=0.5 / np.pi / quick)


def _ramps(rng: np.random.Generator, shape: Shape) -> ProgramCase:
    """Draw a push and a shear for every taxel: ramps that begin and end at frames of their own."""
    begins = rng.integers(REST, REST + 15, shape)
    ends = begins + rng.integers(1, 20, shape)
    speed = rng.uniform(-1.0, 1.0, (*shape, 3))
    n = np.arange(REST + FRAMES)[:, None, None]
    risen = (np.clip(n, begins, ends) - begins) / RATE
    expected = {
        name: speed[..., 2]
        * (_course(name, (n - begins) / RATE) - _course(name, (n - ends) / RATE))
        for name in CORNERS
    }
    slow = _course("sa1", (n - begins) / RATE) - _course("sa1", (n - ends) / RATE)
    expected |= {"sa2_x": speed[..., 0] * slow, "sa2_y": speed[..., 1] * slow}
    settings = {"rate": RATE, "rest": REST / RATE, "push": 1.0, **POINTS}
    return ProgramCase(risen[..., None] * speed, expected, settings)


def _off_course(case: ProgramCase, outputs: Outputs) -> float:
    """Return the largest error of an output, as a share of its largest value."""
    shares = (np.abs(outputs[n] - w).max() / np.abs(w).max() for n, w in case.expected.items())
    return float(max(shares))


def _steady(rng: np.random.Generator, shape: Shape) -> ProgramCase:
    """Draw a constant push for every taxel; the low-pass lets it through at once."""
    push = rng.uniform(0.05, 2.0, shape)
    push.flat[0] = 1.0
    frames = np.zeros((REST + FRAMES, *shape, 3))
    frames[REST:, ..., 2] = push
    settings = {
        "rate": RATE, "rest": REST / RATE, "push": 1.0, "between": "hold", "sa_to": 1e3, **POINTS,
        "threshold": THRESHOLD, "membrane": MEMBRANE, "refractory": SILENCE,
    }  # fmt: skip
    return ProgramCase(frames, {"interval": first_spike(push, THRESHOLD, MEMBRANE)}, settings)


def _wrong_spikes(case: ProgramCase, outputs: Outputs) -> float:
    """Return how far the spikes of 0.5 s are from as many as fit, in spikes."""
    # the first frame of the push counts as half of it
    seconds = (FRAMES - 1) / RATE
    fits = seconds / (case.expected["interval"] + SILENCE)
    counted = np.asarray(outputs["sa1_spikes"][REST + 1 :]).sum(axis=0)
    return float(np.abs(counted - fits).max())


def _presses(rng: np.random.Generator, shape: Shape) -> ProgramCase:
    """Draw a ramp for every taxel; all begin together, and are held after a tenth of a second."""
    slope, lasts = rng.uniform(-1.0, 1.0, shape), 10
    frames = np.zeros((REST + FRAMES, *shape, 3))
    risen = np.clip(np.arange(REST + FRAMES) - REST + 1, 0, lasts) / RATE
    frames[..., 2] = risen[:, None, None] * slope
    widths, taus = (0.25, 2.0), (0.01, 0.03, 0.1)

    def ramp_layers(after: float) -> Floats:
        return layers_after(slope, ZERO_FLUX, max(after, 0.0), widths, taus)

    expected: dict[str, list[Floats]] = {"sustained": [], "transient": []}
    for n in range(REST + FRAMES):
        begun = (n - REST + 1) / RATE
        _, near, far, late = ramp_layers(begun) - ramp_layers(begun - lasts / RATE)
        expected["sustained"].append(near - far)
        expected["transient"].append(near - far - late)
    answers = {
        f"{sign}_{name}": np.maximum(factor * np.array(maps), 0.0)
        for name, maps in expected.items()
        for sign, factor in (("on", 1.0), ("off", -1.0))
    }
    return ProgramCase(frames, answers, {"rate": RATE, "rest": REST / RATE, "push": 1.0})


FORMS = (
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
