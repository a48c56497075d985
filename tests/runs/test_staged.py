"""Programs that leave out transients of a known end give what SciPy and the transients give."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage

import cnnum
from cnnum.graph.nodes import RunSpec
from cnnum.programs.fields import minimum
from cnnum.programs.transients import apply, transient

SQUARE = np.ones((3, 3), bool)
SHAPE = (19, 23)
CROSS = [[0.0, 1.0, 0.0], [0.0, 3.0, 0.0], [0.0, 1.0, 0.0]]


@cnnum.program
def inner_objects(frame):
    """Smooth a picture, fill the holes, and keep objects with a mark, in two waves."""
    picture, marks = frame.channel("picture"), frame.channel("marks")
    warm = apply(cnnum.get_template("DIFFUS"), input=picture)
    filled = apply(cnnum.get_template("HOLE"), input=(warm > 0.0).picture())
    # gray marks stay gray
    reached = apply(cnnum.get_template("RECALL"), input=filled, state=minimum(marks, filled))
    return {
        "warm": warm,
        "filled": filled.black(),
        "reached": reached.black(),
        "area": (filled.black() & ~reached.black()).count(),
        "gain": warm * reached,
    }


def frames_of(count, seed=0):
    rng = np.random.default_rng(seed)
    noise = ndimage.gaussian_filter(rng.normal(size=(count, *SHAPE)), (0, 1, 1))
    marks = np.where(rng.random((count, *SHAPE)) < 0.02, 1.0, -1.0)
    return np.stack([np.clip(4.0 * noise, -1.0, 1.0), marks], -1)


@pytest.mark.parametrize("engine", ["opencl", "numba"])
def test_program_in_stages_gives_what_scipy_and_its_transients_give(engine):
    plan = cnnum.Engine(engine).compile(inner_objects, SHAPE, channels=("picture", "marks"))
    frames = frames_of(6)
    # of two frames a start is gray, so that nothing is proven without the way
    frames[[1, 4], 3, 5, 1] = 0.25
    assert str(plan.explain()).count("found by wavefront") == 2
    got, whole = plan(frames), plan.unfused()(frames)
    for name, values in whole.items():
        if name not in ("warm", "gain"):
            np.testing.assert_array_equal(got[name], values, err_msg=name)
    # DIFFUS may be rounded otherwise in a kernel of its own
    np.testing.assert_allclose(got["warm"], whole["warm"], atol=1e-6)
    np.testing.assert_allclose(got["gain"], whole["gain"], atol=1e-6)
    filled = [ndimage.binary_fill_holes(warm > 0.0) for warm in got["warm"]]
    np.testing.assert_array_equal(got["filled"], filled)
    for number in (0, 2, 3, 5):
        marks = frames[number, ..., 1] > 0.0
        reached = ndimage.binary_propagation(marks & filled[number], SQUARE, mask=filled[number])
        np.testing.assert_array_equal(got["reached"][number], reached)


@cnnum.program
def ranked(frame):
    return {"middle": apply(cnnum.get_template("MEDIAN"), input=frame.channel("picture"))}


@pytest.mark.parametrize("engine", ["opencl", "numba"])
def test_ranks_are_named_and_found_without_steps(engine):
    plan = cnnum.Engine(engine).compile(ranked, SHAPE, channels=("picture",))
    assert "found by decision" in str(plan.explain())
    picture = frames_of(1, 3)[0, ..., 0]
    expected = ndimage.median_filter(picture, 3, mode="nearest")
    inner = (slice(1, -1), slice(1, -1))
    # MEDIAN's table shifts its levels by 1e-2 at most, and frames are float32
    np.testing.assert_allclose(plan(picture)["middle"][inner], expected[inner], atol=1.1e-2)


def shown(start, **options):
    """Return a program of uncoupled cells: EDGE, or cells that begin at a channel and keep it."""
    kept = cnnum.Template("kept", A=[[2.0]], B=[[2.0]], z=0.0, duration=10.0)

    @cnnum.program
    def program(frame):
        picture = frame.channel("picture")
        given = {"template": kept, "state": picture} if start else {"template": "EDGE"}
        run = transient(**given, input=picture)
        return {"shown": run.outputs[0].black(), **{k: getattr(run, k) for k in options}}

    return program


def test_uncoupled_cells_are_decided_on_the_host_where_a_kernel_needs_their_states():
    """Of starts in a channel nothing is known before a frame; those of EDGE are 0."""
    large = np.where(np.random.default_rng(1).random((128, 130)) < 0.5, 1.0, -1.0)
    small = large[:40, :30]
    for engine, start, options, picture, named in (
        ("numba", True, {}, small, True),
        ("opencl", True, {}, small, False),
        ("opencl", True, {}, large, True),
        ("numba", True, {"settled": True}, small, False),
        ("reference", True, {}, small, False),
        ("numba", False, {}, small, True),
        ("opencl", False, {}, large, False),
    ):
        eroded = ndimage.binary_erosion(picture > 0.0, SQUARE, border_value=1)
        plan = cnnum.Engine(engine).compile(
            shown(start, **options), picture.shape, channels=("picture",)
        )
        assert ("found by decision" in str(plan.explain())) is named
        expected = (picture > 0.0) & (start | ~eroded)
        np.testing.assert_array_equal(plan(picture)["shown"], expected)


def test_outputs_are_arrays_of_their_own():
    @cnnum.program
    def program(frame):
        picture = frame.channel("picture")
        edge = apply(cnnum.get_template("EDGE"), input=picture)
        return {"first": edge, "second": edge, "picture": picture}

    given = np.where(np.random.default_rng(1).random(SHAPE) < 0.5, 1.0, -1.0)
    for precision in ("float32", "float64"):
        engine = cnnum.Engine("numba", precision=precision)
        got = engine.compile(program, SHAPE, channels=("picture",))(given)
        arrays = [*got.values(), given]
        for at, array in enumerate(arrays):
            assert not any(np.shares_memory(array, other) for other in arrays[:at])
            array += 1.0


@pytest.mark.parametrize(
    ("shape", "options"), [((16, 16), {}), ((17, 16), {"method": "euler"}), ((17, 16), {"dt": 0.1})]
)
def test_small_arrays_and_chosen_methods_take_the_way(shape, options):
    plan = cnnum.Engine("numba").compile("holes", shape, channels=("picture",), **options)
    assert "found by" not in str(plan.explain())


def test_wave_that_is_longer_than_its_run_takes_the_way():
    @cnnum.program
    def short(frame):
        run = transient(
            cnnum.get_template("HOLE"), input=frame.channel("picture"), spec=RunSpec(duration=3.0)
        )
        return {"filled": run.outputs[0]}

    plan = cnnum.Engine("numba").compile(short, (24, 24), channels=("picture",))
    picture = -np.ones((24, 24))
    picture[4:9, 4:9] = 1.0
    np.testing.assert_array_equal(plan(picture)["filled"], plan.unfused()(picture)["filled"])
    assert (plan(picture)["filled"] > -1.0).sum() > 25


def test_second_inputs_count():
    control = np.array([[[[0.5]], [[-2.0]]]])
    maps = np.where(np.random.default_rng(2).random((2, *SHAPE)) < 0.5, 1.0, -1.0)
    for feedback, initial in ((CROSS, 1.0), ([[2.0]], 0.5)):  # a wave, and uncoupled cells
        template = cnnum.Template("two inputs", feedback, control, -1.5, initial=initial)

        @cnnum.program
        def program(frame, template=template):
            return {"output": apply(template, input=[frame.channel("a"), frame.channel("b")])}

        expected = cnnum.Engine("reference").run(template, input=maps).output
        engine = cnnum.Engine("numba")
        plan = engine.compile(program, SHAPE, channels=("a", "b"))
        np.testing.assert_allclose(plan(np.moveaxis(maps, 0, -1))["output"], expected, atol=1e-3)
        np.testing.assert_allclose(engine.run(template, input=maps).output, expected, atol=1e-3)


def asked_loops(frame):
    run = cnnum.loop(lambda x: 0.5 * x, frame.channel("a"), limit=2)
    return {"ended": run.finished, "filled": apply("HOLE", input=(run.values[0] > 0.1).picture())}


VALUES = tuple(f"value {n}" for n in range(6))


def named_as_values(frame):
    first, *others = (frame.channel(name) for name in VALUES)
    return {"filled": apply("HOLE", input=first), "all": sum((2.0 * x for x in others), first)}


def short_of_rest(frame):
    spec = RunSpec(settle_limit=3.0)
    return {"filled": transient("HOLE", input=frame.channel("a"), spec=spec).outputs[0]}


def test_programs_give_what_they_give_as_a_whole():
    programs = {asked_loops: ("a",), named_as_values: VALUES, short_of_rest: ("a",)}
    for function, channels in programs.items():
        program = cnnum.program(function)
        plan = cnnum.Engine("numba").compile(program, SHAPE, channels=channels)
        rng = np.random.default_rng(3)
        frames = np.where(rng.random((2, *SHAPE, len(channels))) < 0.5, 1.0, -1.0)
        got, whole = plan(frames), plan.unfused()(frames)
        for name, values in whole.items():
            np.testing.assert_array_equal(got[name], values, err_msg=f"{program.name} {name}")


def test_starts_that_overflow_are_refused():
    @cnnum.program
    def program(frame):
        a = frame.channel("a")
        return {"reached": apply("RECALL", input=a, state=a * 1e200 * 1e200)}

    plan = cnnum.Engine("numba").compile(program, SHAPE, channels=("a",))
    with pytest.raises(cnnum.errors.FrameError, match="'reached' of program 'program'"):
        plan(np.ones(SHAPE))


WEIGHTS = (0.25, 0.5, 1.0)
MARGIN = 1.0 / 64.0
"""Part of every z: sums over black and white are at least so far from an edge."""


def drawn(seed):
    """Return a program of two to five templates, and frames of which it leaves out some."""
    rng = np.random.default_rng((54, seed))
    shape = [(19, 23), (1, 257), (257, 1), (3, 86)][seed % 4]
    places = rng.integers(0, 1 << 30, (5, 4))
    boundaries = (-1.0, 0.5, 3.0, "zero-flux", "periodic")
    templates = []
    for n in range(int(rng.integers(2, 6))):
        feedback = rng.choice(WEIGHTS, (3, 3)) * (rng.random((3, 3)) < rng.choice([0.0, 0.3, 0.6]))
        feedback[1, 1] = rng.choice([1.0, 1.5, 3.0])
        control = rng.choice([1.0, -0.5, 2.0], (3, 3)) * (rng.random((3, 3)) < 0.3)
        templates.append(
            cnnum.Template(
                f"drawn {n}", feedback, control, rng.integers(-8, 9) / 4.0 + MARGIN,
                boundary=boundaries[rng.integers(5)], input_boundary=boundaries[rng.integers(5)],
                initial=[1.0, -1.0, "input", 0.5][rng.integers(4)], tau=rng.choice([0.5, 1.0, 4.0]),
                duration=["settle", 1.0, 4.0, 200.0][rng.integers(4)],
            )
        )  # fmt: skip

    @cnnum.program
    def program(frame):
        maps, results = [frame.channel("a"), frame.channel("b")], {}
        for n, template in enumerate(templates):
            given, state, bias, mask = (maps[k % len(maps)] for k in places[n])
            run = transient(
                template, input=given, state=state if places[n, 0] % 2 else None,
                bias=bias if places[n, 1] % 4 == 0 else None,
                mask=mask > MARGIN if places[n, 2] % 4 == 0 else None,
            )  # fmt: skip
            maps.append(run.outputs[0])
            results[f"output {n}"] = maps[-1]
            if places[n, 3] % 8 == 0:
                results[f"state {n}"] = run.states[0]
        return results

    frames = np.where(rng.random((3, *shape, 2)) < rng.random((3, 1, 1, 2)), 1.0, -1.0)
    frames[1, 0, :5] = rng.integers(-12, 13, (5, 2))[: frames.shape[2]] / 8.0
    return program, shape, frames


def test_drawn_programs_give_what_they_give_as_a_whole():
    engine, named = cnnum.Engine("numba"), 0
    for seed in range(10):
        program, shape, frames = drawn(seed)
        plan = engine.compile(program, shape, channels=("a", "b"))
        named += str(plan.explain()).count("found by")
        got, whole = plan(frames), plan.unfused()(frames)
        for name, values in whole.items():
            # tolerances of steps, by which gray outputs may differ in a part that is fused
            np.testing.assert_allclose(got[name], values, atol=1e-3, err_msg=f"{seed} {name}")
    assert named > 10


class Counted:
    """A part of a program that counts its runs."""

    def __init__(self, part):
        self.part, self.runs, self.new_memory = part, 0, part.new_memory

    def run(self, frames, memory, *, first):
        self.runs += 1
        return self.part.run(frames, memory, first=first)


def test_warming_up_runs_all_parts_and_the_whole_program_once():
    plan = cnnum.Engine("numba").compile(inner_objects, SHAPE, channels=("picture", "marks"))
    staged = plan.executable
    stages = [
        s if s.executable is None else replace(s, executable=Counted(s.executable))
        for s in staged._stages
    ]
    staged._stages, staged.whole = tuple(stages), Counted(staged.whole)
    parts = [s.executable for s in stages if s.executable is not None]
    plan.warm_up()
    assert len(parts) > 1
    assert all(part.runs > 0 for part in (*parts, staged.whole))
    before = staged.whole.runs
    plan(frames_of(1)[0])
    assert staged.whole.runs == before
