"""Programs in whole numbers against the same in double precision on the reference engine."""

import numpy as np
import pytest
from scipy import ndimage

import cnnum
from cnnum.embedded.formats import precision_named
from cnnum.embedded.making import make
from cnnum.errors import NotSupportedError
from cnnum.frame import FORCE_AXES
from cnnum.graph.nodes import RunSpec
from cnnum.graph.schedule import schedule
from cnnum.programs.fields import where
from cnnum.programs.transients import apply, transient
from cnnum.templates.tactile.halfspace_equilibrium import halfspace_equilibrium
from cnnum.templating.checks.tactile.halfspace import block_displacement, on_plane
from cnnum.templating.template import Template
from tests.embedded.conftest import SHORT, made, streams


@pytest.fixture(scope="module")
def reference():
    frames, found = streams((8, 8)), {}
    for name in ("slip", "twist"):
        engine = cnnum.Engine("reference")
        plan = engine.compile(cnnum.get_program(name).bind(**SHORT), (8, 8))
        stream = plan.stream((frames.shape[1],))
        answers = [stream.push(frame) for frame in frames]
        found[name] = {key: np.array([one[key] for one in answers]) for key in answers[0]}
    return found


# measured: 6e-4 of the largest strength in q15; a word of 7 bits sees little of a pattern's change
@pytest.mark.parametrize(("precision", "off"), [("q15", 2e-3), ("q7", 1.0)])
@pytest.mark.parametrize("name", ["slip", "twist"])
def test_strengths_are_near(name, precision, off, reference):
    output = f"{name}_strength"
    found, wanted = made(name, precision).run(streams((8, 8)))[output], reference[name][output]
    assert np.abs(wanted).max() > 0.05
    assert np.abs(found - wanted).max() <= off * np.abs(wanted).max()


def test_flags_are_the_same_in_q15(reference):
    for name, flag in (("slip", "gross_slip"), ("twist", "twist")):
        wanted = reference[name][flag]
        assert wanted.any()
        np.testing.assert_array_equal(made(name, "q15").run(streams((8, 8)))[flag], wanted)


def test_float32_is_the_same_program(reference):
    found = made("slip", "float32").run(streams((8, 8)))["slip_strength"]
    # single precision, and one product through the modes of the array
    np.testing.assert_allclose(found, reference["slip"]["slip_strength"], atol=1e-4)


@cnnum.program
def _shares(frame):
    """Shares of a load, where there is any: elsewhere, quotients are as large as any number."""
    loaded = frame.normal > 1.0
    ratio = cnnum.where(loaded, frame.shear_x / frame.normal, 0.0)
    held = cnnum.where(loaded, frame.normal, 0.0)
    whole = cnnum.maximum(held.sum(), 1e-30)
    lever = frame.shear_x.sum() / whole
    return {"ratio": ratio, "share": held / whole, "pull": held * lever}


def test_values_that_change_no_answer_take_no_places_of_a_format():
    random = np.random.default_rng(0)
    loads = np.zeros((40, 1, 4, 4, 3))
    loads[..., 0] = random.uniform(-2.0, 2.0, (40, 1, 4, 4))
    # a bare cell reads some 1e-9, and every second frame is bare
    loads[..., 2] = random.uniform(1e-9, 2e-9, (40, 1, 4, 4))
    loads[::2, :, 1:3, 1:3, 2] = random.uniform(1.5, 4.0, (20, 1, 2, 2))
    found = cnnum.Engine("reference", precision="q15").compile(_shares, (4, 4), like=loads)(loads)
    normal = np.where(loads[..., 2] > 1.0, loads[..., 2], 0.0)
    whole = np.maximum(normal.sum((-1, -2), keepdims=True), 1e-30)
    pull = normal * loads[..., 0].sum((-1, -2), keepdims=True) / whole
    ratio = np.where(normal > 0.0, loads[..., 0] / np.maximum(normal, 1.0), 0.0)
    for name, wanted in (("ratio", ratio), ("share", normal / whole), ("pull", pull)):
        # a step of an input is 2^-12 of 4, its share of the smallest load 2^-14; sums have 16
        off = np.abs(found[name] - wanted).max()
        assert off < 1e-3 * np.abs(wanted).max(), name


# measured, of the largest displacement: 3e-7 in single precision, 4e-4 in q15, 0.16 in q7
@pytest.mark.parametrize(("precision", "off"), [("float32", 1e-6), ("q15", 1e-3), ("q7", 0.3)])
def test_an_elastic_block_is_at_rest_at_once(precision, off):
    """One product of shifts on the torus, against a direct solve of the block's energy."""
    loads = np.random.default_rng(1).normal(size=(60, 1, 6, 5, 3))
    block = halfspace_equilibrium.bind(
        thickness=1.5, pitch=1.0, slabs=6, layers=2, poisson=0.45, youngs_modulus=2.9, match=False
    )
    names = [f"displacement_{axis}" for axis in "xyz"]
    planned = schedule(block.trace((6, 5), FORCE_AXES), FORCE_AXES, names)
    found = make("block", planned, precision_named(precision), loads, "euler").run(loads)
    got = np.stack([found[name][:, 0] for name in names], axis=-1)
    for frame in range(0, len(loads), 6):
        wanted = on_plane(block_displacement(loads[frame, 0], 6, 0.75, 0.45), 2)
        assert np.abs(got[frame] - wanted).max() < off * np.abs(wanted).max()


def test_receptors_in_whole_numbers_are_near_and_their_spikes_are_refused():
    needs = ["sa1", "ra1", "sa2_x", "sa1_active", "ra1_active", "sa2_active"]
    frames = streams((8, 8))[:, :1]
    program = cnnum.get_program("receptors").bind(**SHORT)
    stream = cnnum.Engine("numba", precision="float64").compile(program, (8, 8), needs).stream((1,))
    answers = [stream.push(frame) for frame in frames]
    found = made("receptors", "q15", needs=needs).run(frames)
    for name in needs:
        wanted = np.array([one[name] for one in answers])
        # measured: 7e-4 of the largest
        off = 0.0 if name.endswith("active") else 2e-3
        assert wanted.any()
        assert np.abs(found[name] - wanted).max() <= off * np.abs(wanted).max()
    with pytest.raises(NotSupportedError, match="logarithm"):
        made("receptors", "q15", needs=["ra1_spikes"])
    spikes = made("receptors", "float32", needs=["ra1_spikes"]).run(frames)["ra1_spikes"]
    stream = cnnum.Engine("numba").compile(program, (8, 8), ["ra1_spikes"]).stream((1,))
    wanted = np.array([stream.push(frame)["ra1_spikes"] for frame in frames])
    assert wanted.any()
    # a spike at the end of a frame may be taken for the next one's
    assert np.abs(np.cumsum(spikes - wanted, axis=0)).max() <= 1


def test_flow_in_whole_numbers_is_near_and_is_known_in_the_same_frames():
    """Energies of noise are a millionth of a touch's, and their squares are lost in 31 bits."""
    needs = ["flow_x", "flow_y", "flow_known", "flow_map_x", "flow_map_y"]
    frames = streams((8, 8))[:, :2]
    program = cnnum.get_program("tactile_flow").bind(**SHORT)
    engine = cnnum.Engine("numba", precision="float64")
    stream = engine.compile(program, (8, 8), needs).stream((2,))
    answers = [stream.push(frame) for frame in frames]
    found = made("tactile_flow", "q15", needs=needs).run(frames)
    for name in needs:
        wanted = np.array([one[name] for one in answers])
        # measured: at most 1.1 % of the root mean square
        off = 0.0 if name == "flow_known" else 0.03
        assert wanted.any()
        gap = np.sqrt(np.mean((found[name] - wanted) ** 2))
        assert gap <= off * np.sqrt(np.mean(wanted**2)), name


SPREADS = np.array([[0.0, 0.25, 0.0], [0.25, -1.0, 0.25], [0.0, 0.25, 0.0]])


@pytest.mark.parametrize("method", ["auto", "euler"])
@pytest.mark.parametrize("coupled", [False, True], ids=["alone", "coupled"])
@pytest.mark.parametrize(
    ("rate", "slow"), [(50.0, 0.1), (200.0, 1.0), (1000.0, 0.1), (1000.0, 4.0)]
)
def test_a_layer_that_goes_on_from_frame_to_frame_does_not_get_stuck(rate, slow, coupled, method):
    """x' = (u − x) / τ, a frame at a time, ends at u: with 16 bits, it stopped on the way."""
    A = SPREADS if coupled else np.zeros((1, 1))
    leak = Template("leak", A=A, B=[[1.0]], z=0.0, tau=slow, output="linear", boundary="zero-flux")
    spec = RunSpec(duration=1.0 / rate, dt=slow / 100.0 if method == "euler" else None)

    @cnnum.program
    def follows(frame):
        memory = frame.memory("layer")
        run = transient(leak, input=frame.normal, state=memory.value, spec=spec)
        memory.store(run.states[0])
        return {"layer": run.states[0]}

    count = min(1500, round(5.0 * slow * rate))
    loads = np.full((count, 4, 5, 1), 0.7)
    made = make(
        "follows",
        schedule(follows.bind(rate=rate).trace((4, 5), ("normal",)), ("normal",), None),
        precision_named("q15"),
        loads[:, np.newaxis],
        method,
    )
    layer = made.run(loads[:, np.newaxis])["layer"][:, 0]
    times = (1.0 + np.arange(count)) / (slow * rate)
    wanted = 0.7 * (1.0 - np.exp(-times))[:, None, None]
    # the step of the input, that of a weight of 24 bits once per frame, and, of Euler's steps of at
    # most a hundredth of τ, half of that at the steepest place
    steps = 0.7 * min(0.01, 1.0 / (slow * rate)) / 2.0 if method == "euler" else 0.0
    bound = 2.0**-15 + 0.7 * 2.0**-22 * slow * rate + steps
    np.testing.assert_allclose(layer, np.broadcast_to(wanted, layer.shape), atol=bound)


@pytest.mark.parametrize(("cells", "kernel"), [(8, 3), (24, 15), (40, 31)])
def test_a_large_kernel_over_a_memory_fits_in_64_bits(cells, kernel):
    """Weights beside a memory have more bits only as far as a sum of their products has room."""
    random = np.random.default_rng(kernel)
    weights = random.uniform(-1.0, 1.0, (kernel, kernel))
    blur = Template("blur", A=[[0.0]], B=weights, z=0.0, output="linear", boundary=0.0)

    @cnnum.program
    def blurred(frame):
        memory = frame.memory("slow")
        sums = apply(blur, input=memory.value)
        memory.store(0.99 * memory.value + 0.01 * frame.normal)
        return {"sums": sums}

    loads = random.uniform(0.0, 1.0, (30, cells, cells, 1))
    engine = cnnum.Engine("reference", precision="q15")
    plan = engine.compile(blurred, (cells, cells), channels=("normal",), like=loads)
    stream, slow = plan.stream(), np.zeros((cells, cells))
    for load in loads:
        given = stream.push(load)["sums"]
        wanted = ndimage.correlate(slow, weights, mode="constant")
        slow = 0.99 * slow + 0.01 * load[..., 0]
    # the step of a word of 16 bits with up to four times the room
    np.testing.assert_allclose(given, wanted, atol=2.0**-13 * np.abs(wanted).max())


LIMITED = {"A": [[0.5]], "tau": 4.0, "output": "full-range", "boundary": "zero-flux"}
RIM = {"A": 0.4 * SPREADS, "tau": 1.0, "output": "linear", "boundary": 0.5}
SCALED = {"A": [[1.0]], "tau": 0.01, "output": "linear", "boundary": 0.0}
RESET = {"A": [[0.0]], "tau": 1.0, "output": "linear"}
WAYS = {
    "limited": (LIMITED, 5000.0, {}),
    "beside a rim": (RIM, 5000.0, {}),
    "scaled": (SCALED, 10.0, {"dt": 0.0002}),
    "reset": (RESET, 1000.0, {}),
}


@pytest.mark.parametrize("method", ["auto", "euler"])
@pytest.mark.parametrize("way", WAYS)
def test_what_comes_back_to_a_memory_keeps_its_bits(way, method):
    """Whatever lies between: a limit, a rim, a factor, a choice; 16 bits were 0.6 % off or more."""
    numbers, rate, steps = WAYS[way]
    template = Template("goes_on", B=[[1.0]], z=0.0, **numbers)

    @cnnum.program
    def follows(frame):
        memory = frame.memory("layer")
        spec = RunSpec(duration=1.0 / rate, **steps)
        state = transient(template, input=frame.normal, state=memory.value, spec=spec).states[0]
        if way == "scaled":
            memory.store(0.999 * state)
        else:
            halved = where(frame.age > 290.0, 0.5 * state, state)
            memory.store(halved if way == "reset" else state)
        return {"state": state}

    count = 60 if way == "scaled" else 300
    loads = np.full((count, 1, 4, 5, 1), 0.7)
    traced = follows.bind(rate=rate).trace((4, 5), ("normal",))
    wanted = schedule(traced, ("normal",), None)
    made = make("follows", wanted, precision_named("q15"), loads, method)
    # the step of an output of 16 bits with four times the room, and weights of 24 bits
    assert made.errors(loads)["state"] < 1e-3
