"""Chains of linear operations give the same as one dense product and one by one."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

import cnnum
from cnnum.graph.nodes import Product, Transient

SHAPE = (4, 5)
CELLS = SHAPE[0] * SHAPE[1]
SPREAD = [[0, 0.25, 0], [0.25, 0, 0.25], [0, 0.25, 0]]
TURNED = [[0.1, 0.2, 0], [-0.1, 0.3, 0.2], [0, -0.2, 0.1]]
EDGE = [[0, -1, 0], [-1, 4, -1], [0, -1, 0]]
LAYERS = [[SPREAD, np.multiply(0.2, SPREAD)], [np.multiply(-0.3, SPREAD), SPREAD]]


def linear(name, A, B=None, z=0.0, **about):
    return cnnum.Template(name, A, B, z, output="linear", **about)


# one of each way to the end without steps, with each boundary, bias, start and number of layers
DIFFUSE = linear("diffuse", SPREAD, initial="input", boundary="zero-flux", duration=0.7)
RIM = linear("rim", SPREAD, EDGE, 0.3, boundary=0.5, input_boundary=-0.5, initial=0.2, duration=1.5)
RING = linear(
    "ring", np.multiply(0.8, SPREAD), TURNED, -0.2, boundary="periodic", duration="settle", tau=2.0
)
DENSE = linear("dense", TURNED, SPREAD, 0.1, boundary=-0.4, initial="input", duration=0.8)
STILL = cnnum.Template("still", [[0]], TURNED, 0.5, boundary=1.0, initial=0.4, duration=0.6)
PAIR = linear(
    "pair", LAYERS, [[EDGE, SPREAD], [SPREAD, TURNED]], [0.1, 0.2], tau=[1.0, 0.5],
    boundary="zero-flux", duration=0.9,
)  # fmt: skip


def repeated(value, count, template=DIFFUSE):
    """Apply a template over and over."""
    for _ in range(count):
        value = cnnum.apply(template, input=value)
    return value


MAPS = {
    "add": lambda a, b: a + 0.5 * b,
    "subtract": lambda a, b: a - b / 4.0,
    "negate": lambda a, b: -a + 0.25,
    "weigh": lambda a, b: a * np.linspace(-1.0, 1.0, CELLS).reshape(SHAPE),
    "mean": lambda a, b: a - b.sum() / CELLS,
    "diffuse": lambda a, b: cnnum.apply(DIFFUSE, input=a),
    "rim": lambda a, b: cnnum.apply(RIM, input=a),
    "ring": lambda a, b: cnnum.apply(RING, input=a, bias=b),
    "dense": lambda a, b: cnnum.apply(DENSE, input=a, state=b),
    "still": lambda a, b: cnnum.transient(STILL, input=a, bias=b).states[0],
    "pair": lambda a, b: cnnum.transient(PAIR, input=[a, b]).states[1],
}


@st.composite
def chains(draw):
    """Return an affine program; it ends with enough templates to be worth fusing."""
    steps = draw(
        st.lists(
            st.tuples(st.sampled_from(sorted(MAPS)), st.integers(0, 99), st.integers(0, 99)),
            min_size=2,
            max_size=8,
        )
    )

    def built(frame):
        fields = [frame.a, frame.b]
        for name, i, j in steps:
            fields.append(MAPS[name](fields[i % len(fields)], fields[j % len(fields)]))
        last = repeated(fields[-1] + fields[-2], 8)
        return {"last": last, "other": fields[len(fields) // 2] - last}

    return cnnum.program(built)


def products(plan):
    return [node for node in plan.built.nodes if isinstance(node.operation, Product)]


def close(got, expected, scale, precision, name):
    # up to 16 operations one after the other, each of which rounds its largest value a few times
    limit = 50 * np.finfo(precision).eps * scale
    np.testing.assert_allclose(got, expected, rtol=0, atol=limit, err_msg=name)


@settings(max_examples=8, deadline=None)
@given(
    program=chains(),
    precision=st.sampled_from(["float32", "float64"]),
    seed=st.integers(0, 2**16),
    batch=st.sampled_from([(), (3,), (17,)]),
)
@pytest.mark.in_full("test_random_programs_agree_to_the_bit")
def test_fused_chains_are_what_they_were(engines, reference, program, precision, seed, batch):
    """Numba's own dense products, one by one, are the truth; the reference solves one frame."""
    frames = np.random.default_rng(seed).normal(size=(*batch, *SHAPE, 2))
    plans = {
        label: engine.compile(program, SHAPE, channels=("a", "b"))
        for label, engine in engines.items()
        if precision in label or label == "numba-float64"
    }
    alone = plans["numba-float64"].unfused()
    assert not products(alone)
    scale = max(float(np.abs(step.value).max()) for step in alone.trace(frames))
    true = alone(frames)
    for label, plan in plans.items():
        assert len(plan.built.nodes) < len(plan.schedule.nodes), label
        got = plan(frames)
        for name, value in true.items():
            close(got[name], value, scale, plan.precision, f"{label}: {name}")
    first = (0,) * len(batch)
    solved = reference.compile(program, SHAPE, channels=("a", "b"))
    assert not products(solved)
    for name, value in solved(frames[first]).items():
        # solved to 1e-10 sixteen times, each of which may grow earlier errors fourfold
        np.testing.assert_allclose(true[name][first], value, rtol=0, atol=1e-7 * scale)


def test_a_chain_whose_sources_cancel_is_a_constant_map(engines):
    """(a − a) + ¼ spreads to ¼ under mirrored rims, to rounding, for any a."""

    @cnnum.program
    def nothing(frame):
        return {"value": repeated(frame.a - frame.a + 0.25, 8)}

    # the weights sum to 1: a constant map stays
    for label, engine in engines.items():
        plan = engine.compile(nothing, SHAPE, channels=("a",))
        assert not plan.built.transients
        got = plan(np.random.default_rng(0).normal(size=(3, *SHAPE, 1)))["value"]
        np.testing.assert_allclose(got, 0.25, rtol=1e-5, err_msg=label)


def laplacian():
    """The five-point Laplacian with mirrored rims, from its bonds."""
    matrix = np.zeros((CELLS, CELLS))
    place = np.arange(CELLS).reshape(SHAPE)
    down = zip(place[1:].flat, place[:-1].flat, strict=True)
    across = zip(place[:, 1:].flat, place[:, :-1].flat, strict=True)
    for a, b in [*down, *across]:
        matrix[a, a] -= 1
        matrix[b, b] -= 1
        matrix[a, b] += 1
        matrix[b, a] += 1
    return matrix


def test_a_product_is_the_matrix_of_its_chain():
    """Three diffusions, the mean taken out, twice, and a constant: e^{3·L t/4} − 1/n, doubled."""

    @cnnum.program
    def chain(frame):
        value = repeated(frame.a, 3)
        return {"value": 2.0 * (value - frame.a.sum() / CELLS) + 0.5}

    plan = cnnum.Engine().compile(chain, SHAPE, channels=("a",))
    (node,) = products(plan)
    expected = 2.0 * (expm(3 * 0.7 * laplacian() / 4.0) - 1.0 / CELLS)
    # products of 20 terms in float64
    np.testing.assert_allclose(node.operation.matrices[0], expected, atol=1e-13)
    np.testing.assert_allclose(node.operation.constant, 0.5, atol=1e-13)
    assert [argument.operation.channel for argument in node.arguments] == ["a"]


def six_times(template):
    """Return a program that applies a template over and over to six times a channel."""
    return cnnum.Program(lambda f: {"value": repeated(6.0 * f.a, 6, template)}, "six_times")


@pytest.mark.parametrize(
    ("A", "initial"), [(SPREAD, "input"), ([[0.5]], 0.0), ([[0]], 0.0)], ids=str
)
def test_outputs_that_saturate_are_never_fused(engines, reference, A, initial):
    """Inputs of ±6 leave the linear range, where a product would go on."""
    template = cnnum.Template("standard", A, SPREAD, boundary=0.0, initial=initial, duration=1.0)
    frames = np.random.default_rng(2).normal(size=(3, *SHAPE, 1))
    expected = reference.compile(six_times(template), SHAPE, channels=("a",))(frames)
    for label, engine in engines.items():
        plan = engine.compile(six_times(template), SHAPE, channels=("a",))
        assert not products(plan), label
        # six transients at rtol 1e-4, which six products of gain below 2 can make 64 times as much
        np.testing.assert_allclose(
            plan(frames)["value"], expected["value"], atol=6e-3, err_msg=label
        )


def test_states_of_uncoupled_cells_are_linear_beyond_their_output(engines, reference):
    """Where A = 0 the state never sees the output, so chains of states may be fused."""

    @cnnum.program
    def states(frame):
        value = 2000.0 * frame.a
        for _ in range(6):
            value = cnnum.transient(STILL, input=value).states[0]
        return {"state": value, "output": cnnum.transient(STILL, input=value).outputs[0]}

    frames = np.random.default_rng(3).normal(size=(3, *SHAPE, 1))
    expected = reference.compile(states, SHAPE, channels=("a",))(frames)
    assert np.abs(expected["state"]).max() > 1.0
    for engine in engines.values():
        plan = engine.compile(states, SHAPE, channels=("a",))
        assert len(products(plan)) == 1
        got = plan(frames)
        for name, value in expected.items():
            close(got[name], value, 6000.0, engine.precision, name)


def test_figures_of_a_run_keep_it_as_it_is():
    """Figures of a run (its error, its time) are not lost in a product."""

    @cnnum.program
    def stated(frame):
        run = cnnum.transient(DIFFUSE, input=repeated(frame.a, 5))
        ends = cnnum.apply(RIM, input=run.outputs[0])
        return {"value": run.outputs[0], "error": run.error, "time": run.time, "ends": ends}

    frame = np.random.default_rng(4).normal(size=(*SHAPE, 1))
    plan = cnnum.Engine().compile(stated, SHAPE, channels=("a",))
    left = [
        n.operation.template.name for n in plan.built.nodes if isinstance(n.operation, Transient)
    ]
    assert len(products(plan)) == 2  # before the run that is asked for, and after it
    assert left == ["diffuse"]
    got = plan(frame)
    exact = expm(6 * 0.7 * laplacian() / 4.0) @ frame.ravel()
    assert got["time"] == pytest.approx(0.7)
    # the product before it adds 20 roundings to the run's own error
    own = 20 * np.finfo("float32").eps * np.abs(frame).max()
    assert 0.0 < np.abs(got["value"].ravel() - exact).max() <= got["error"] + own


def test_memories_loops_and_what_is_read_between(engines, reference):
    @cnnum.program
    def mixed(frame):
        value = middle = repeated(frame.a, 6)
        for _ in range(6):
            value = cnnum.apply(RIM, input=value + frame.previous(middle))
        grown = cnnum.loop(lambda x: cnnum.maximum(x, value), middle, limit=3).value
        return {"middle": middle, "value": value, "grown": grown, "total": value.sum()}

    frames = np.random.default_rng(5).normal(size=(3, *SHAPE, 1))
    want = reference.compile(mixed, SHAPE, channels=("a",)).stream()
    expected = [want.push(frame) for frame in frames]
    for label, engine in engines.items():
        plan = engine.compile(mixed, SHAPE, channels=("a",))
        assert len(products(plan)) == 2, label
        stream = plan.stream()
        for frame, wanted in zip(frames, expected, strict=True):
            got = stream.push(frame)
            for name, value in wanted.items():
                # the reference solves to 1e-10; the total adds 20 cells
                scale = CELLS * np.abs(wanted["value"]).max()
                limit = 1e-7 if engine.precision == "float64" else 1e-6
                np.testing.assert_allclose(
                    got[name], value, atol=limit * scale, err_msg=f"{label} {name}"
                )


def test_a_frame_is_the_same_alone_and_in_a_batch():
    plan = cnnum.Engine("numba").compile(six_times(DIFFUSE), SHAPE, channels=("a",))
    frames = np.random.default_rng(6).normal(size=(5, *SHAPE, 1))
    together = plan(frames)["value"]
    for frame, value in zip(frames, together, strict=True):
        np.testing.assert_array_equal(plan(frame)["value"], value)


def test_only_what_saves_arithmetic_is_fused():
    engine = cnnum.Engine()
    edge = linear("edge", [[0]], EDGE, boundary=0.0, duration="settle")
    once = cnnum.Program(lambda frame: {"a": cnnum.apply(edge, input=frame.a) + frame.b}, "one")
    assert not products(engine.compile(once, (8, 8), channels=("a", "b")))
    for shape, count in (((8, 8), 1), ((16, 16), 1), ((16, 17), 0)):
        # twenty diffusions take 20 · 6 · 256 · 32 operations on 16×16 cells, a product 2 · 256²
        many = cnnum.Program(lambda f: {"a": repeated(f.a, 20)}, "one")
        assert len(products(engine.compile(many, shape, channels=("a",)))) == count


def test_a_plan_says_what_was_fused_and_still_shows_every_step():
    frame = np.random.default_rng(7).normal(size=(*SHAPE, 1))
    plan = cnnum.Engine().compile(six_times(DIFFUSE), SHAPE, channels=("a",))
    stated, before = plan.explain(), plan.unfused().explain()
    item = stated.left_out[-1]
    assert item.what.startswith("6 × template diffuse")
    assert "fused into 1 dense product" in item.why
    assert item.flops == before.flops - stated.flops > 0
    assert len(before.transients) == 6
    assert stated.transients == ()
    steps = list(plan.trace(frame))
    assert sum("diffuse" in step.operation for step in steps) == 6
    close(steps[-1].value, plan(frame)["value"], 6 * np.abs(frame).max(), "float32", "trace")
