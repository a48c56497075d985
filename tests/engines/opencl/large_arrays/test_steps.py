"""Steps of large arrays, strip by strip, and of wide batches are the reference's own steps."""

import numpy as np
import pytest
from scipy.ndimage import correlate

from cnnum.engine import Engine
from cnnum.engines.devices.selection import working_devices
from cnnum.engines.opencl.lowering import kernel_source
from cnnum.templating.template import Template

REFERENCE = Engine("reference")
DEVICES = [device.label for device in working_devices()]

# one work item; strips of odd heights; low and wide ones; more and fewer steps than a launch holds,
# rows that narrower vectors take
SHAPES = [((40, 33), 9), ((941, 70), 33), ((40, 1700), 9), ((290, 300), 66), ((3300, 20), 5)]
BOUNDARIES = (0.3, "zero-flux", "periodic")
OUTPUTS = (("standard", 1), ("standard", 2), ("linear", 1), ("full-range", 1))
"""And the radius of the couplings; first the usual network."""


def runs_of(output, radius, boundary):
    """Return precision, shape and steps: in the usual network each shape meets every boundary, in
    float64 on some of them and in float32 on the others; in another each shape meets every output
    and every boundary once.

    Each is a kernel of its own to build.
    """
    kind, edge = OUTPUTS.index((output, radius)), BOUNDARIES.index(boundary)
    if kind > 0:
        return [("float32", *SHAPES[::2][(kind + edge) % 3])]
    double = (edge, (edge + 3) % 5)
    return [("float64" if n in double else "float32", *run) for n, run in enumerate(SHAPES)]


def random_template(rng, boundary, output, radius, symmetric=False, tau=1.5):
    k = 2 * radius + 1
    feedback = rng.normal(size=(k, k)) * (0.3 / k)
    return Template(
        "random",
        0.5 * (feedback + feedback[::-1]) if symmetric else feedback,
        rng.normal(size=(3, 3)),
        0.1,
        tau=tau,
        boundary=boundary,
        output=output,
    )


@pytest.mark.one_in(5)
@pytest.mark.parametrize("boundary", BOUNDARIES)
@pytest.mark.parametrize(("output", "radius"), OUTPUTS)
def test_strips_step_as_one_array(boundary, output, radius):
    """To rounding: up to 66 steps of values of order 1, of the usual network in float64, too.

    Networks that do not settle double a rounding of 6e-8 some times on their way.
    """
    rng = np.random.default_rng(4)
    template = random_template(rng, boundary, output, radius)
    for precision, shape, steps in runs_of(output, radius, boundary):
        maps = {name: rng.uniform(-1, 1, (2, *shape)) for name in ("input", "state")}
        wanted = REFERENCE.run(template, duration=0.05 * steps, dt=0.05, **maps)
        got = Engine(precision=precision).run(template, duration=0.05 * steps, dt=0.05, **maps)
        scale = {"float32": 1e-5, "float64": 1e-13}[precision] * np.abs(wanted.state).max()
        assert np.abs(got.state - wanted.state).max() <= scale
        assert np.abs(got.output - wanted.output).max() <= scale


@pytest.mark.one_in(5)
@pytest.mark.parametrize("seed", range(8))
def test_strips_of_any_size_step_as_one_array(seed, monkeypatch):
    """Any rows, columns, steps and batch: strips are high or low, launches full or not.

    Some rows have no cells for all lanes, and no lane of some has cells for a whole vector.
    """
    monkeypatch.setattr(kernel_source, "WHOLE_CELLS", 0)
    monkeypatch.setattr(kernel_source, "PRIVATE_CELLS", 0)
    rng = np.random.default_rng(seed)
    few = (1, 5) if seed % 2 else (5, 25)
    radius, batch, steps = (int(rng.integers(*span)) for span in ((1, 3), (1, 4), few))
    shape = tuple(int(side) for side in rng.integers(4 * radius, 200, 2))
    boundary = (0.3, "zero-flux", "periodic")[seed % 3]
    output = ("standard", "linear", "full-range")[rng.integers(3)]
    template = random_template(rng, boundary, output, radius, symmetric=seed % 4 > 1)
    maps = {name: rng.uniform(-1, 1, (batch, *shape)) for name in ("input", "state")}
    wanted = REFERENCE.run(template, duration=0.05 * steps, dt=0.05, **maps).state
    engine = Engine(precision="float64")
    got = engine.run(template, duration=0.05 * steps, dt=0.05, **maps).state
    # up to 24 steps of values of order 1
    assert np.abs(got - wanted).max() <= 1e-13 * np.abs(wanted).max()


# rows and columns, radius, boundary, method and time constants of a launch or two
UNUSUAL = [
    ((41, 70), 5, 0.3, "euler", 1.2),
    ((30, 50), 6, "periodic", "heun", 0.3),
    ((75, 31), 9, "zero-flux", "euler", 0.6),
    ((1, 300), 1, "periodic", "heun", 0.3),
    ((2, 170), 3, "zero-flux", "euler", 1.2),
    ((3, 160), 2, "periodic", "euler", 1.2),
    ((300, 2), 3, "periodic", "euler", 1.2),
    ((300, 1), 1, 0.3, "heun", 0.3),
    ((60, 11), 3, "zero-flux", "heun", 0.3),
]


@pytest.mark.one_in(2)
@pytest.mark.parametrize("number", range(len(UNUSUAL)))
def test_arrays_of_any_form_step_as_one(number, monkeypatch):
    """Neighbourhoods wider than a block of rows, a row's piece, or the array itself.

    Every other pair of them is taken in parts: each is a kernel to build.
    """
    if number % 4 > 1:
        monkeypatch.setattr(kernel_source, "WHOLE_CELLS", 0)
    shape, radius, boundary, method, duration = UNUSUAL[number]
    rng = np.random.default_rng(number)
    template = random_template(rng, boundary, "standard", radius)
    maps = {name: rng.uniform(-1, 1, (2, *shape)) for name in ("input", "state")}
    runs = [
        Engine(name, precision="float64").run(
            template, method=method, duration=duration, dt=0.05, **maps
        )
        for name in ("opencl", "reference")
    ]
    got, wanted = (run.state for run in runs)
    # up to 24 steps of values of order 1, each a sum of at most 361 products
    assert np.abs(got - wanted).max() <= 1e-12 * np.abs(wanted).max()


def test_discrete_time_goes_by_strips():
    """A thresholded sum a step, x⁺ = w + A ∗ sign(x), with nothing left of the state before."""
    rng = np.random.default_rng(7)
    template = random_template(rng, "periodic", "sign", 1, tau=1.0)
    feedback, control = template.A[0, 0], template.B[0, 0]
    u, x = rng.uniform(-1, 1, (2, 300, 290))
    got = Engine("opencl", precision="float64").run(template, input=u, state=x, duration=5)
    drive = correlate(u, control, mode="wrap") + 0.1
    for _ in range(5):
        x = drive + correlate(np.where(x >= 0, 1.0, -1.0), feedback, mode="wrap")
    # nine products of numbers of order 1, and no sum so near 0 that its sign is not known
    assert np.abs(got.state - x).max() <= 1e-14
    assert np.abs(x).min() > 1e-9
    np.testing.assert_array_equal(got.output, np.where(x >= 0, 1.0, -1.0))
    assert got.error == np.inf  # a rounding may turn a sign: nothing is known beforehand


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("batch", [1, 7, 33])
def test_lanes_and_rows_step_as_one_frame(device, batch):
    """A single frame in registers, and frames side by side in lanes, on every device.

    Two rows at a time where there are registers enough, and an even number of them.
    """
    rng = np.random.default_rng(5)
    for boundary, rows in ((0.3, 5), ("zero-flux", 6), ("periodic", 6)):
        template = random_template(rng, boundary, "standard", 1)
        maps = {name: rng.uniform(-1, 1, (batch, rows, 7)) for name in ("input", "state")}
        wanted = REFERENCE.run(template, duration=1.0, dt=0.05, **maps).state
        got = Engine(device=device).run(template, duration=1.0, dt=0.05, **maps).state
        # 20 steps of values of order 1
        assert np.abs(got - wanted).max() <= 3e-6 * np.abs(wanted).max()


def test_runs_are_the_same_to_the_bit():
    rng = np.random.default_rng(6)
    template = random_template(rng, "zero-flux", "standard", 1)
    engine = Engine()
    for shape in ((8, 8), (300, 300)):
        u = rng.uniform(-1, 1, (3, *shape))
        first, second = (
            engine.run(template, input=u, duration=1.0, dt=0.05).state for _ in range(2)
        )
        np.testing.assert_array_equal(first, second)
