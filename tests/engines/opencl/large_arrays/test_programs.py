"""Beyond 256×256 cells a plan runs in parts that all cores share, with one kernel's own bits."""

import numpy as np
import pytest
import scipy.ndimage

import cnnum
from cnnum.engines.opencl import executable
from cnnum.engines.opencl.large_arrays import strip_steps
from cnnum.engines.opencl.lowering import kernel_source
from cnnum.engines.opencl.transients import couplings, strategies
from cnnum.templating.couplings import DelayedCoupling, Gain, NonlinearCoupling
from cnnum.templating.functions import Table

SHAPE = (9, 11)
WEAK = [[0.02, -0.05, 0.01], [0.1, 0.4, -0.06], [0.03, 0.08, -0.02]]
CONTROL = [[0.2, -0.1, 0.3], [0.4, 0.5, -0.6], [0.7, 0.1, -0.2]]
SPREAD = [[0.1, 0.3, 0.1], [0.3, -0.9, 0.3], [0.1, 0.3, 0.1]]
BEND = Table("linear", ((-1.0, -0.3), (0.0, 0.1), (1.0, 0.4)))


def template(**parts):
    settings = {"boundary": "zero-flux", "tau": 1.5, "duration": 2.0}
    feedback = parts.pop("A", WEAK)
    return cnnum.Template("weak", feedback, CONTROL, 0.1, **{**settings, **parts})


def layers():
    rng = np.random.default_rng(2)
    return cnnum.Template(
        "layers", rng.normal(size=(2, 2, 3, 3)) * 0.05, rng.normal(size=(2, 1, 3, 3)), [0.1, -0.2],
        tau=[1.0, 2.0], boundary=-0.5, duration=2.0, output="tanh",
    )  # fmt: skip


def torus():
    """Return more states than a dense product takes."""
    rng = np.random.default_rng(3)
    return cnnum.Template(
        "torus", rng.normal(size=(11, 11, 3, 3)) * 0.01, rng.normal(size=(11, 1, 3, 3)), [0.1] * 11,
        boundary="periodic", initial=0.0, output="linear", duration="settle",
    )  # fmt: skip


RULES = [(strip_steps, "lanes_fit"), (couplings, "lanes_fit")]
"""Functions that decide whether neighbours are read by vectors."""

CASES = {
    "adaptive": (template(output="tanh"), {}),
    "adaptive, until it settles": (template(), {"duration": "settle"}),
    "Euler, until it settles": (template(), {"duration": "settle", "dt": 0.2}),
    "rk4": (template(boundary="periodic"), {"method": "rk4", "dt": 0.13}),
    "Chebyshev": (template(A=SPREAD, boundary=0.3), {"method": "runge-kutta-chebyshev"}),
    "exponential": (template(), {"method": "etd-rk2", "dt": 0.1}),
    "propagator": (template(output="linear"), {"method": "propagator"}),
    "decay": (template(A=[[0]], boundary=0.0), {}),
    "shifts on a torus": (torus(), {"method": "propagator"}),
    "uncoupled": (template(A=[[2]], boundary=0.0), {}),
    "full-range": (template(output="full-range"), {"dt": 0.1}),
    "sign": (template(output="sign", duration=4.0, tau=1.0), {}),
    "layers": (layers(), {}),
    "nonlinear": (
        template(nonlinear=[NonlinearCoupling(np.full((3, 3), 0.1), BEND, "x", "x")]),
        {},
    ),
    "delayed": (
        template(
            delayed=DelayedCoupling(0.3, np.full((1, 1, 3, 3), 0.04), np.full((1, 1, 3, 3), 0.1)),
            initial=0.0,
        ),
        {},
    ),
    "gain": (template(gains=[Gain(0, 0, BEND)]), {}),
}


@pytest.fixture
def parted(monkeypatch):
    """An engine that runs arrays of any size in parts."""
    monkeypatch.setattr(kernel_source, "PRIVATE_CELLS", 0)
    monkeypatch.setattr(kernel_source, "WHOLE_CELLS", 0)
    monkeypatch.setattr(executable, "WIDE_CELLS", 0)
    return cnnum.Engine("opencl")


def maps_for(net, rng):
    maps = {"input": rng.uniform(-1, 1, (3, *SHAPE)) * np.array([0.1, 1, 3])[:, None, None]}
    if net.delayed is not None:
        maps["previous"] = rng.uniform(-1, 1, (3, *SHAPE))
    return maps


OTHER_ORDER = (
    "Euler, until it settles", "sign", "full-range", "rk4", "exponential",
    "adaptive, until it settles",
)  # fmt: skip
"""Cases in which one kernel adds in another order. `fused_euler` does so with the weights,
`euler_in_registers` with equal ones, and `integrators.schemes` with stages of a step."""


@pytest.mark.one_in(4)
@pytest.mark.parametrize("name", CASES)
def test_parts_give_the_bits_of_one_kernel(name, parted, monkeypatch):
    """Three frames of different size, so that adaptive steps and settling differ between them."""
    net, settings = CASES[name]
    rng = np.random.default_rng(1)
    maps = maps_for(net, rng)
    if name not in OTHER_ORDER:  # sweeps, which add in one kernel's order: vectors of rows do not
        for room, asked in RULES:
            monkeypatch.setattr(room, asked, lambda _: False)
    if name == "adaptive":
        maps |= {"mask": rng.uniform(size=SHAPE) < 0.2, "bias": rng.uniform(-1, 1, SHAPE)}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(kernel_source, "PRIVATE_CELLS", 32 * 32)
        patch.setattr(kernel_source, "WHOLE_CELLS", 32 * 32)
        # stages one after the other, as in parts: small frames have them in a loop, whose
        # multiply-adds are fused otherwise
        patch.setattr(strategies, "rolls", lambda _: False)
        whole = cnnum.Engine("opencl")
        wanted = [
            whole.run(net, **{k: v[[n]] if v.ndim == 3 else v for k, v in maps.items()}, **settings)
            for n in range(3)
        ]
    got = parted.run(net, **maps, **settings)
    if name.startswith("adaptive"):
        assert len(set(got.steps.tolist())) > 1
    if name in OTHER_ORDER:
        state = np.concatenate([result.state for result in wanted])
        # some 50 steps of values up to 3: a rounding each, which the couplings do not enlarge
        assert np.abs(got.state - state).max() <= 50 * 3 * np.finfo(np.float32).eps
        return
    for field in ("state", "output", "time", "steps", "settled", "error"):
        together = np.concatenate([getattr(result, field) for result in wanted])
        np.testing.assert_array_equal(getattr(got, field), together, err_msg=field)


@cnnum.program
def flood(frame):
    """Nested loops, a branch, read-outs and a memory: how far a seed gets, twice."""
    free, seed = frame.a > 0.0, frame.b > 3.0

    def grow(reached):
        wider = reached
        for rows, cols in ((0, 1), (1, 0), (0, -1), (-1, 0)):
            wider = cnnum.maximum(wider, cnnum.shift(reached, rows, cols, boundary=0.0))
        return cnnum.where(free, wider, 0.0)

    def until_it_rests(reached):
        return cnnum.loop(grow, reached, limit=400).value

    start = cnnum.where(free & seed, 1.0, 0.0)
    run = cnnum.loop(until_it_rests, start, limit=5)
    (some,) = cnnum.branch(seed.any(), lambda x: x + run.value, free.picture())
    before = frame.previous(run.value)
    return {
        "reached": run.value,
        "count": run.value.sum(),
        "rounds": run.iterations,
        "some": some,
        "new": (run.value - before).sum(),
        "largest": (frame.a * run.value).max(),
        "least": (frame.a * run.value).min(),
    }


def flooded(free, seed):
    labels, _ = scipy.ndimage.label(free)
    touched = set(np.unique(labels[free & seed]).tolist()) - {0}
    return np.isin(labels, sorted(touched)) & free


@pytest.mark.one_in(3)
@pytest.mark.parametrize("most", [32 * 32, 256 * 256])
@pytest.mark.parametrize("shape", [(40, 33), (5, 300)])
def test_large_programs_are_right(shape, most, monkeypatch):
    """Against labelled regions, for frames whose loops take different numbers of rounds.

    Once in parts, once as one kernel whose arrays are too large to be private.
    """
    monkeypatch.setattr(kernel_source, "WHOLE_CELLS", most)
    rng = np.random.default_rng(7)
    stream = cnnum.Engine("opencl").compile(flood, shape, channels=("a", "b")).stream((4,))
    before = None  # on the first frame, the past is the present
    for _ in range(2):
        frames = rng.integers(-12, 20, (4, *shape, 2)) / 4.0
        frames[1, :, :, 1] = 0.0  # nothing to start from: no round at all
        wanted = np.stack([flooded(f[..., 0] > 0, f[..., 1] > 3) for f in frames]).astype(float)
        got = stream.push(frames)
        np.testing.assert_array_equal(got["reached"], wanted)
        np.testing.assert_array_equal(got["count"], wanted.sum(axis=(1, 2)))
        new = wanted - (wanted if before is None else before)
        np.testing.assert_array_equal(got["new"], new.sum(axis=(1, 2)))
        weighed = frames[..., 0] * wanted
        np.testing.assert_array_equal(got["largest"], weighed.max(axis=(1, 2)))
        np.testing.assert_array_equal(got["least"], weighed.min(axis=(1, 2)))
        assert got["rounds"][1] <= 1 < got["rounds"][0]
        picture = np.where(frames[..., 0] > 0, 1.0, -1.0)
        np.testing.assert_array_equal(got["some"][0], picture[0] + wanted[0])
        np.testing.assert_array_equal(got["some"][1], picture[1])
        before = wanted


def test_large_pictures_have_their_holes_filled(parted):
    """A binary wave over 130×140 cells, through arrays that no core has to itself."""
    rng = np.random.default_rng(8)
    pictures = rng.uniform(size=(2, 130, 140)) < 0.55
    black = np.where(pictures, 1.0, -1.0)
    filled = parted.run(cnnum.get_template("HOLE"), input=black).output > 0
    cross = scipy.ndimage.generate_binary_structure(2, 1)
    wanted = np.stack([scipy.ndimage.binary_fill_holes(p, structure=cross) for p in pictures])
    np.testing.assert_array_equal(filled, wanted)
