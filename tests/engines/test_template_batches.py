"""A batch of templates: the same as its templates one by one, on every engine."""

import numpy as np
import pytest

from cnnum import Engine, Template, TemplateBatch, get_template
from cnnum.errors import ArrayError, NotSupportedError, TemplateError
from cnnum.lab.bench.throughput import rate_beside_one
from cnnum.templating.couplings import DelayedCoupling, Gain, NonlinearCoupling
from cnnum.templating.functions import Table

NAMES = ("opencl", "numba")


@pytest.fixture(params=NAMES)
def engine(request, names):
    if request.param not in names:
        pytest.skip(f"the engine '{request.param}' does not work here")
    return Engine(request.param)


CASES = ("HOLE", "CCD_HOR", "EDGE", "PATCHMAK")


def near(name, rng, count, width=0.05):
    template = get_template(name)

    def drawn(part):
        return part * (1.0 + width * rng.normal(size=(count, 1, *part.shape)))

    b = drawn(template.B) if template.inputs else None
    return TemplateBatch(template, drawn(template.A), b, drawn(template.z))


@pytest.mark.parametrize("name", CASES)
def test_every_engine_agrees_with_the_reference(name, engine):
    rng = np.random.default_rng(3)
    batch, pictures = near(name, rng, 3), np.sign(rng.normal(size=(2, 8, 8)))
    found = engine.run(batch, input=pictures, duration=1.0, dt=0.05, method="euler")
    expected = Engine("reference").run(batch, input=pictures, duration=1.0, dt=0.05, method="euler")
    assert found.output.shape == (3, 2, 8, 8)
    assert found.steps.shape == (3, 2)
    # twenty steps in float32: some 1e-7 each of states up to 10, amplified e^6 at most
    assert np.abs(found.state - expected.state).max() < 2e-3


@pytest.mark.parametrize("name", ["HOLE", "SHADOW"])
def test_runs_to_rest_end_in_the_same_picture(name, engine):
    rng = np.random.default_rng(4)
    batch, pictures = near(name, rng, 4), np.sign(rng.normal(size=(2, 8, 8)))
    together = engine.run(batch, input=pictures)
    for number, template in enumerate(batch.templates()):
        alone = Engine("numba").run(template, input=pictures)
        # black and white to the bit but for the last of the way
        assert np.abs(together.output[number] - alone.output).max() < 1e-3
        assert np.array_equal(together.settled[number], alone.settled)


def test_every_number_of_a_template_can_be_its_own(engine):
    rng = np.random.default_rng(5)
    pictures, states = rng.uniform(-1, 1, (2, 4, 6, 5))
    base = Template("mine", np.zeros((3, 3)), np.zeros((3, 3)), boundary="periodic", duration=0.7)
    batch = TemplateBatch(
        base,
        rng.normal(size=(4, 3, 3)),
        rng.normal(size=(4, 3, 3)),
        rng.normal(size=4),
        np.array([1.0, 2.0, 1.0, 0.5]),
    )
    bias, mask = rng.normal(size=(6, 5)), rng.random((6, 5)) < 0.3
    given = {"bias": bias, "mask": mask}
    found = engine.run(batch, input=pictures, state=states, **given)
    for number, template in enumerate(batch.templates()):
        own = {"input": pictures[number], "state": states[number]}
        alone = Engine("numba").run(template, **own, **given, rtol=1e-6, atol=1e-7)
        # rtol 1e-4 of states up to 10
        assert np.abs(found.state[number] - alone.state).max() < 3e-3


@pytest.mark.parametrize("shape", [(1, 1), (1, 3), (2, 2), (3, 4)])
def test_arrays_smaller_than_their_templates_lie_in_lanes_too(shape, engine):
    rng = np.random.default_rng(11)
    form = Template("small", np.zeros((3, 3)), np.zeros((3, 3)), output="tanh", duration=1.5)
    batch = TemplateBatch(
        form, rng.normal(size=(40, 3, 3)), rng.normal(size=(40, 3, 3)), rng.normal(size=40)
    )
    pictures = rng.uniform(-1, 1, (40, *shape))
    found = engine.run(batch, input=pictures)
    if engine.name == "opencl":
        assert "side by side" in found.reason
    for number, template in enumerate(batch.templates()):
        own = Engine("reference").run(template, input=pictures[number], rtol=1e-8, atol=1e-9)
        # rtol 1e-4 a step of states up to 10
        assert np.abs(found.state[number] - own.state).max() < 3e-3


def alone(batch, **given):
    """Return the states of the templates one by one, at a tolerance far below those of lanes."""
    exact = Engine("numba", precision="float64")
    fine = {"rtol": 1e-7, "atol": 1e-8}
    return np.array([exact.run(one, **given, **fine).state for one in batch.templates()])


def test_delays_and_their_weights_can_be_a_template_s_own(engine):
    rng = np.random.default_rng(7)
    pictures, before = rng.uniform(-1, 1, (2, 6, 5))
    nothing = np.zeros((1, 1, 3, 3))
    form = Template("late", nothing, nothing, boundary="zero-flux", duration=1.7,
                    delayed=DelayedCoupling(1.0, nothing, nothing))  # fmt: skip
    late, control, weights = 0.4 * rng.normal(size=(3, 4, 3, 3))
    batch = TemplateBatch(
        form, weights, delay=np.array([0.5, 0.52, 0.52, 0.5]), delayed_A=late, delayed_B=control
    )
    found = engine.run(batch, input=pictures, previous=before)
    expected = alone(batch, input=pictures, previous=before)
    # the tolerance of steps that are halved until they keep it, of states up to 2
    assert np.abs(found.state - expected).max() < 2e-4
    assert np.all(found.error >= np.abs(found.state - expected).max(axis=(1, 2)))
    assert found.state.std(axis=0).max() > 0.1


def test_gains_and_nonlinear_weights_can_be_a_template_s_own(engine):
    rng = np.random.default_rng(8)
    pictures = rng.uniform(-1, 1, (6, 5))
    bend, steps = (
        Table(way, ((-1.0, 0.2), (0.5, 1.0), (2.0, 0.5))) for way in ("linear", "constant")
    )
    nothing = np.zeros((3, 3))
    form = Template("courses", nothing, nothing, duration=1.7, gains=[Gain(0, 0, bend)], nonlinear=[
        NonlinearCoupling(nothing, bend, "y", "y"), NonlinearCoupling(nothing, bend, "u", "x"),
        NonlinearCoupling(nothing, steps, "u")])  # fmt: skip
    # three neighbours of each kind: kernels of few are built quickly
    weights, control, *coupled = 0.4 * rng.normal(size=(5, 3, 3, 3)) * np.eye(3)
    gains = rng.uniform(-1.0, 2.0, (3, 3))
    batch = TemplateBatch(form, weights, control, tau=np.array([1.0, 0.5, 2.0]),
                          nonlinear=coupled, gains=[gains])  # fmt: skip
    found = engine.run(batch, input=pictures)
    # rtol 1e-4 of states of about 1, over some steps
    assert np.abs(found.state - alone(batch, input=pictures)).max() < 1e-3
    assert found.state.std(axis=0).max() > 0.1


def test_several_layers_with_one_input(engine):
    rng = np.random.default_rng(9)
    form = Template("two", np.zeros((2, 2, 3, 3)), np.zeros((2, 1, 3, 3)), duration=1.0)
    pictures = rng.uniform(-1, 1, (3, 6, 5))
    tau = np.array([[1.0, 2.0], [1.0, 1.0], [0.5, 1.0]])
    weights = 0.3 * rng.normal(size=(3, 2, 2, 3, 3)) * np.eye(3)
    control = rng.normal(size=(3, 2, 1, 3, 3))
    batch = TemplateBatch(form, weights, control, rng.normal(size=(3, 2)), tau)
    found = engine.run(batch.spread(), input=pictures)
    assert found.output.shape == (3, 3, 2, 6, 5)
    assert np.abs(found.state - alone(batch, input=pictures)).max() < 1e-3


def test_errors_of_lanes_hold(opencl):
    batch, picture = near("HOLE", np.random.default_rng(6), 4), np.ones((8, 8))
    found = opencl.run(batch, input=picture, duration=6.0)
    for number, template in enumerate(batch.templates()):
        exact = Engine("numba").run(template, input=picture, duration=6.0, rtol=1e-8, atol=1e-9)
        assert np.abs(found.state[number] - exact.state).max() <= found.error[number].max()


def test_lanes_share_one_launch(opencl):
    rng = np.random.default_rng(6)
    batch = near("HOLE", rng, 40)
    pictures = np.sign(rng.normal(size=(8, 8)))
    result = opencl.run(batch, input=pictures)
    assert "side by side in lanes" in result.reason
    kept = len(opencl._open.plans)
    opencl.run(near("HOLE", rng, 40), input=pictures)
    assert len(opencl._open.plans) <= kept + 1  # other weights, perhaps the next rung of rates


def test_templates_of_one_form_make_a_batch():
    found = TemplateBatch.of([get_template("SHIFTE"), get_template("SHIFTN")])
    assert found.lead == (2,)
    assert [t.digest for t in found.templates()] == [
        get_template(name).digest for name in ("SHIFTE", "SHIFTN")
    ]
    with pytest.raises(TemplateError, match="one form"):
        TemplateBatch.of([get_template("HOLE"), get_template("EDGE")])


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        ({"A": np.zeros((2, 2))}, "k odd"),
        ({"A": np.zeros((2, 3, 3)), "z": np.zeros(3)}, "broadcast"),
        ({"tau": np.zeros(3)}, "tau above 0"),
        ({"delay": 1.0}, "no part 'delay'"),
        ({"gains": [np.ones(3)]}, "one for each of its 0"),
    ],
)
def test_numbers_that_do_not_fit_are_refused(parts, words):
    with pytest.raises(TemplateError, match=words):
        TemplateBatch(get_template("HOLE"), **parts)


def test_axes_that_do_not_broadcast_are_refused(engine):
    batch = TemplateBatch(get_template("HOLE"), z=np.zeros(3))
    with pytest.raises(ArrayError, match="do not broadcast"):
        engine.run(batch, input=np.zeros((2, 8, 8)))
    with pytest.raises(NotSupportedError, match="one by one"):
        engine.run(batch, input=np.zeros((8, 8)), at=[1.0])


def test_a_step_outside_the_bound_of_one_template_is_refused(opencl):
    kernels = np.zeros((2, 3, 3))
    kernels[:, 1, 1] = [0.0, -9.0]
    base = Template("mine", np.zeros((3, 3)), duration=1.0, initial=0.5)
    with pytest.raises(ValueError, match="stability bound"):
        opencl.run(TemplateBatch(base, kernels), state=np.zeros((8, 8)), dt=0.5)


def test_the_rate_beside_one_template_is_a_ratio(opencl):
    maps = np.random.default_rng(0).uniform(-1, 1, (64, 8, 8))
    template = get_template("HOLE")
    assert rate_beside_one(opencl, template, maps, 0.01, 50) > 0.0


def test_a_batch_runs_in_whole_numbers(opencl):
    """One by one: lanes have numbers of their own in real ones alone."""
    corner = get_template("CORNER")
    batch = TemplateBatch.of([corner, corner])
    u = np.where(np.random.default_rng(2).random((5, 5)) < 0.5, 1.0, -1.0)
    engine = opencl.with_precision("q15")
    together = engine.run(batch, input=u, method="euler")
    alone = engine.run(corner, input=u, method="euler")
    np.testing.assert_array_equal(together.output, [alone.output, alone.output])
