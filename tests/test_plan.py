"""Plans: shapes, batches, refusals, and their descriptions of themselves."""

import numpy as np
import pytest

import cnnum
from cnnum.errors import ArrayError, MethodError, UnknownNameError

EDGE = cnnum.Template(
    "edge", [[0, 0, 0], [0, 1, 0], [0, 0, 0]], [[-1, -1, -1], [-1, 8, -1], [-1, -1, -1]], -1.0,
    boundary="zero-flux", duration=5.0,
)  # fmt: skip


@cnnum.program
def grip(frame):
    touched = frame.normal > 0.1
    return {
        "contact": touched.any(),
        "load": frame.normal.sum(),
        "edges": cnnum.apply(EDGE, input=touched.picture()),
        "shear": frame.shear_x + frame.shear_y,
    }


@pytest.fixture(scope="module")
def engine():
    return cnnum.Engine()


@pytest.mark.parametrize("lead", [(), (1,), (3, 2), (16,), (21,)])
def test_leading_axes_are_a_batch(engine, lead):
    frames = np.random.default_rng(0).uniform(-1, 1, (*lead, 4, 5, 3))
    got = engine.compile(grip, (4, 5))(frames)
    assert got["contact"].shape == lead
    assert got["edges"].shape == (*lead, 4, 5)
    np.testing.assert_allclose(got["load"], frames[..., 2].sum(axis=(-2, -1)), atol=1e-5)
    np.testing.assert_allclose(got["shear"], frames[..., 0] + frames[..., 1], atol=1e-6)


@pytest.mark.parametrize(
    ("shape", "words"),
    [((4, 5), "3"), ((5, 4, 3), "(..., 4, 5, 3)"), ((0, 4, 5, 3), "at least one")],
)
def test_frames_of_another_shape_are_refused(engine, shape, words):
    with pytest.raises(ArrayError) as caught:
        engine.compile(grip, (4, 5))(np.zeros(shape))
    assert words in str(caught.value)


def test_unknown_need_is_refused(engine):
    with pytest.raises(UnknownNameError, match="'contact'"):
        engine.compile(grip, (4, 5), ["slip"])


@pytest.mark.parametrize(
    ("name", "channels", "lacks"),
    [("slip", ("normal",), "shear_x"), ("contact", ("shear_x", "shear_y"), "normal")],
)
def test_an_axis_that_the_array_does_not_read_is_named(opencl, name, channels, lacks):
    with pytest.raises(UnknownNameError) as caught:
        opencl.compile(cnnum.get_program(name), (8, 8), channels=channels)
    sentence = str(caught.value)
    assert sentence.startswith(f"The program needs '{lacks}', which the array does not read")
    assert all(f"'{channel}'" in sentence for channel in channels)


def test_explanation_counts_what_runs_and_what_does_not(opencl):
    full = opencl.compile(grip, (4, 5)).explain()
    less = opencl.compile(grip, (4, 5), ["contact"]).explain()
    assert full.launches == less.launches == 1
    assert full.channels_read == ("shear_x", "shear_y", "normal")
    assert less.channels_read == ("normal",)
    assert full.maps_read_back == ("edges", "shear")
    assert less.maps_read_back == ()
    assert (less.bytes_in, less.bytes_out) == (4 * 20, 4)
    # a map of the frame and one that is read out, four bytes a cell; the whole program holds more
    assert less.private_bytes == 2 * 4 * 20
    assert less.private_bytes < full.private_bytes < 4 * 20 * 40
    assert full.scratch_bytes == 0
    assert less.flops < full.flops
    assert less.ops == 3  # channel, comparison, global OR
    assert len(full.transients) == 1
    left = {item.what: item for item in less.left_out}
    assert left["channel shear_x"].bytes == 4 * 20
    assert left["output edges"].bytes == 4 * 20
    assert left["template edge"].flops > 0
    assert "leaves out channel shear_x" in str(less)


def explained(body, shape=(4, 5)):
    """Return the reference engine's explanation of a program of one output."""
    program = cnnum.Program(lambda frame: {"a": body(frame)}, "explained")
    return cnnum.Engine("reference").compile(program, shape).explain()


def test_body_of_a_loop_counts_once_and_at_most_as_often_as_its_limit():
    """Of 20 cells: halve, add, the largest, and two on one number to compare it and turn it."""
    plan = explained(
        lambda frame: (
            cnnum.loop(
                lambda a: 0.5 * a + frame.shear_x,
                frame.normal,
                limit=7,
                until=lambda a: a.max() < 0.1,
            ).value
        )
    )
    body, flops = 5, 3 * 20 + 2
    assert (plan.ops, plan.ops_most) == (2 + 1 + body, 2 + 1 + 7 * body)  # channels and the loop
    assert (plan.flops, plan.flops_most) == (flops, 7 * flops)
    assert f"{plan.ops} operations" in str(plan)
    assert f"{plan.ops_most} operations, {plan.flops_most} flops" in str(plan)


def test_limits_of_nested_loops_multiply():
    def inner(a):
        return cnnum.loop(lambda b: 0.5 * b, a - 1.0, limit=3).value

    plan = explained(lambda frame: cnnum.loop(inner, frame.normal, limit=4).value)
    # the channel and the loop; of a round of it one difference and a loop; of a round of that one
    assert (plan.ops, plan.ops_most) == (2 + 2 + 1, 2 + 4 * (2 + 3 * 1))
    assert (plan.flops, plan.flops_most) == (20 + 20, 4 * (20 + 3 * 20))


def test_body_of_a_branch_counts_once():
    def halved(frame):
        return cnnum.branch(frame.normal.max() > 0.1, lambda a: 0.5 * a, frame.normal)[0]

    plan = explained(halved)
    # the channel, its largest, the comparison, the branch and its body
    assert (plan.ops, plan.flops) == (plan.ops_most, plan.flops_most) == (5, 20 + 1 + 20)
    assert "limits" not in str(plan)


def test_skeleton_counts_its_round_of_eight_templates():
    """64 for the picture, and a round of 168 a cell: 2 to start and to read, 18 or 20 a template.

    `SKELBW1`, 3, 5 and 7 have a B of 6 weights, the others of 7; the A of one takes 6 a step.
    """
    program = cnnum.get_program("skeleton")
    plan = cnnum.Engine("reference").compile(program, (8, 8), channels=("picture",)).explain()
    a_round = 64 * (8 * 2 + 4 * (2 * 6 + 6) + 4 * (2 * 7 + 6))
    assert (plan.flops, plan.flops_most) == (64 + a_round, 64 + 65 * a_round) == (10_816, 698_944)
    # channel, comparison and loop; of each template two operations and itself
    assert (plan.ops, plan.ops_most) == (3 + 24, 3 + 65 * 24)


def test_loop_that_nothing_wanted_reaches_is_left_out_with_its_body():
    def function(frame):
        halved = cnnum.loop(lambda a: 0.5 * a, frame.normal, limit=7).value
        return {"sum": frame.normal.sum(), "a": halved}

    program = cnnum.program(function)
    plan = cnnum.Engine("reference").compile(program, (4, 5), ["sum"]).explain()
    assert (plan.ops, plan.ops_most) == (2, 2)
    left = {item.what: item.flops for item in plan.left_out}
    assert left["loop of at most 7"] == 20


def test_source_is_what_was_built(opencl):
    less = opencl.compile(grip, (4, 5), ["contact"]).source
    full = opencl.compile(grip, (4, 5)).source
    assert "__kernel" in less
    assert "edge:" in full
    assert "edge:" not in less


def test_zero_weights_never_reach_the_text(opencl):
    """A shift has one weight that is not zero: one product in the text."""
    template = cnnum.Template("east", [[0]], [[0, 0, 0], [0, 0, 2.5], [0, 0, 0]], duration="settle")
    plan = opencl.compile(
        cnnum.Program(lambda frame: {"a": cnnum.apply(template, input=frame.normal)}, "one"), (4, 5)
    )
    assert plan.source.count("sum +=") == 1


def test_output_that_is_not_finite_is_never_handed_out(engine):
    overflow = cnnum.Program(lambda frame: {"a": cnnum.exp(frame.normal * 1000.0)}, "one")
    with pytest.raises(ArrayError, match="'a'"):
        engine.compile(overflow, (2, 2))(np.ones((2, 2, 3)))


def test_engine_run_needs_what_the_template_needs():
    engine = cnnum.Engine("reference")
    with pytest.raises(ArrayError, match="needs an input"):
        engine.run(EDGE)
    with pytest.raises(ArrayError, match="share their rows"):
        engine.run(EDGE, input=np.zeros((3, 3)), state=np.zeros((3, 4)))
    with pytest.raises(ArrayError, match="do not broadcast"):
        engine.run(EDGE, input=np.zeros((2, 3, 3)), state=np.zeros((4, 3, 3)))
    decay = cnnum.Template("decay", [[0]], duration=1.0)
    with pytest.raises(ArrayError, match="no control template"):
        engine.run(decay, input=np.zeros((3, 3)))
    with pytest.raises(ArrayError, match="at least an initial state"):
        engine.run(decay)


def test_all_transients_of_a_program_run_by_the_method_that_is_asked_for():
    """Decay and diffusion by steps, as near the exact answer as asked; nothing beyond the bound."""
    frame = np.random.default_rng(4).uniform(-1.0, 1.0, (6, 6, 3))
    smooth, filtered = cnnum.get_template("tactile_diffusion"), cnnum.get_template("laplacian")

    @cnnum.program
    def both(frame):
        spread = cnnum.apply(smooth, input=frame.normal)
        return {"spread": spread, "bent": cnnum.apply(filtered, input=spread)}

    engine = cnnum.Engine("numba", precision="float64")
    exact = engine.compile(both, (6, 6))
    steps = engine.compile(both, (6, 6), method="dormand-prince", rtol=1e-8, atol=1e-8)
    assert {solver.method for solver in exact.solvers.values()} == {"propagator"}
    assert {solver.method for solver in steps.solvers.values()} == {"dormand-prince"}
    got, true = steps(frame), exact(frame)
    # errors of 1e-8 a step; the Laplacian's weights take eight times those of its map
    assert max(float(np.abs(got[name] - true[name]).max()) for name in true) < 1e-6
    with pytest.raises(MethodError, match="outside the stability bound"):
        engine.compile(both, (6, 6), method="euler", dt=50.0)


def test_parts_are_counted_by_kind_and_bodies_once():
    """Two templates with feedback, one of them in a loop's body, and one without."""
    diffusion, slope = (cnnum.get_template(n) for n in ("tactile_diffusion", "gradient_x"))

    def parted(frame):
        spread = cnnum.apply(diffusion, input=frame.normal)
        steep = cnnum.apply(slope, input=spread)
        return cnnum.loop(
            lambda a: cnnum.apply(diffusion, input=a) + frame.shear_x,
            steep,
            limit=3,
            until=lambda a: a.max() < 0.1,
        ).value

    plan = explained(parted)
    assert (plan.parts.feedback, plan.parts.feedforward) == (2, 1)
    # an addition on maps; the largest; its comparison and the flag's turn
    assert (plan.parts.local, plan.parts.reductions, plan.parts.scalar) == (1, 1, 2)
    assert "2 templates with feedback and 1 without" in str(plan)
