"""The machine around the templates: memories, loops, branches, logic, on every engine."""

import numpy as np
import pytest
from scipy.ndimage import binary_propagation, label

import cnnum
from cnnum.errors import ArrayError, MethodError

CROSS = [[0, 1, 0], [1, 1, 1], [0, 1, 0]]
DILATION = cnnum.Template("dilation", [[0]], CROSS, 4.0, boundary=-1.0, duration="settle")
PICTURE = {"channels": ("picture",)}


@pytest.fixture(scope="module", params=["opencl-float32", "opencl-float64", "numba", "reference"])
def engine(request):
    name, _, precision = request.param.partition("-")
    return cnnum.Engine(name, precision=precision or None)


def pictures(count, shape, share, seed=0):
    rng = np.random.default_rng(seed)
    return np.where(rng.random((count, *shape)) < share, 1.0, -1.0)


def grown_from_rim(frame):
    """Figures that touch the north or west rim, by dilating within the picture."""
    figure = frame.picture > 0.0
    seed = figure & (frame.row.equals(0.0) | frame.column.equals(0.0))

    def grow(marker):
        return cnnum.apply(DILATION, input=marker.picture()).black() & figure

    run = cnnum.loop(grow, seed, limit=100)
    return {"grown": run.value, "iterations": run.iterations, "finished": run.finished}


@pytest.mark.parametrize("count", [1, 40])
def test_loop_until_nothing_changes_is_reconstruction(engine, count):
    u = pictures(count, (8, 9), 0.55)
    got = engine.compile(cnnum.program(grown_from_rim), (8, 9), **PICTURE)(u)
    seed = np.zeros((8, 9), dtype=bool)
    seed[0] = seed[:, 0] = True
    for picture, grown, finished in zip(u, got["grown"], got["finished"], strict=True):
        expected = binary_propagation(seed & (picture > 0), mask=picture > 0)
        np.testing.assert_array_equal(grown.astype(bool), expected)
        assert finished


def test_frames_of_a_batch_stop_on_their_own(engine):
    """Each frame's count of iterations is the one it has alone."""
    u = pictures(20, (6, 6), 0.6, seed=1)
    plan = engine.compile(cnnum.program(grown_from_rim), (6, 6), **PICTURE)
    together = plan(u)["iterations"]
    assert len(set(together)) > 1
    np.testing.assert_array_equal(together, [plan(one)["iterations"] for one in u])


def test_loop_that_hits_its_limit_is_never_silent(engine):
    def short(frame):
        return {"a": cnnum.loop(lambda x: x + 1.0, frame.picture, limit=3).value}

    def asked(frame):
        run = cnnum.loop(lambda x: x + 1.0, frame.picture, limit=3)
        return {"a": run.value, "finished": run.finished}

    u = pictures(1, (2, 2), 0.5)
    with pytest.raises(MethodError, match="end"):
        engine.compile(cnnum.program(short), (2, 2), **PICTURE)(u)
    got = engine.compile(cnnum.program(asked), (2, 2), **PICTURE)(u)
    np.testing.assert_array_equal(got["a"], u + 3)
    assert not got["finished"][0]


def stops_beyond(frame):
    """From 0, fall by `fall` and climb back by at most 3/16, until -5/16 is passed, or 3 times."""

    def turn(x, turns):
        climb = cnnum.loop(lambda z: z + 1 / 16, x, limit=3, until=lambda z: z.max() >= 0.0)
        return climb.value - frame.fall, turns + 1 / 16

    ends = {"limit": 4, "until": lambda x, turns: (x.max() <= -5 / 16) | (turns >= 3 / 16)}
    run = cnnum.loop(turn, frame.start, frame.start.sum() * 0.0, **ends)
    return {"x": run.values[0], "turns": run.values[1]}


FALLS = np.array([10 / 16, 1 / 16, 4 / 16])
"""The first is beyond at once, from where no climb leads back; the last comes to its limit."""


@pytest.mark.parametrize("precision", ["opencl q15", "reference q15", "reference", "numba walked"])
def test_a_loop_within_a_loop_counts_where_its_frame_goes_on(precision):
    name, _, kind = precision.partition(" ")
    shape = (2, 2) if kind != "walked" else (40, 80)
    frames = np.zeros((3, *shape, 2))
    frames[..., 0], frames[..., 1] = -1 / 16, FALLS[:, np.newaxis, np.newaxis]
    more = {"channels": ("start", "fall")}
    if kind == "q15":
        more["like"] = np.tile(frames[:2], (6, 1, 1, 1))  # memories fill for 8 frames
    engine = cnnum.Engine(name, precision="q15" if kind == "q15" else None)
    plan = engine.compile(cnnum.program(stops_beyond), shape, **more)
    got = plan(frames[:2])
    np.testing.assert_array_equal(got["x"][:, 0, 0], [-10 / 16, -1 / 16])
    np.testing.assert_array_equal(got["turns"], [1 / 16, 3 / 16])
    with pytest.raises(MethodError, match=r"in 1 of 3 frames \(the first is frame 2\)"):
        plan(frames)


def test_loop_carries_several_values_and_numbers(engine):
    """Fibonacci in every cell: values swap, a counter runs along, a flag ends it."""

    def fibonacci(frame):
        def step(a, b, n):
            return b, a + b, n + 1.0

        one = frame.picture * 0.0 + 1.0
        run = cnnum.loop(step, one, one, one.sum() * 0.0, limit=50, until=lambda a, b, n: n >= 10.0)
        return {"a": run.values[0], "n": run.values[2]}

    got = engine.compile(cnnum.program(fibonacci), (2, 3), **PICTURE)(pictures(3, (2, 3), 0.5))
    assert (got["a"] == 89.0).all()
    assert (got["n"] == 10.0).all()


def test_loops_can_be_nested(engine):
    """Connected components, one by one: the outer loop takes a figure, the inner one grows it."""

    @cnnum.program
    def components(frame):
        number = frame.row * frame.shape[1] + frame.column

        def take(left, found):
            first = cnnum.where(left, number, 1e6).min()
            seed = left & number.equals(first)

            def grow(marker):
                return cnnum.apply(DILATION, input=marker.picture()).black() & left

            figure = cnnum.loop(grow, seed, limit=100).value
            return left & ~figure, found + 1.0

        figures = frame.picture > 0.0
        run = cnnum.loop(
            take, figures, figures.count() * 0.0, limit=64, until=lambda left, found: ~left.any()
        )
        return {"count": cnnum.where(figures.any(), run.values[1], 0.0)}

    u = pictures(18, (7, 7), 0.4, seed=2)
    got = engine.compile(components, (7, 7), **PICTURE)(u)["count"]
    np.testing.assert_array_equal(got, [label(picture > 0)[1] for picture in u])


def test_branch_runs_where_its_flag_holds(engine):
    def scaled(frame):
        black = (frame.picture > 0.0).count()
        (value,) = cnnum.branch(black > 8.0, lambda x: x * 10.0, frame.picture)
        return {"value": value}

    u = pictures(33, (4, 4), 0.5, seed=3)
    many = (u > 0).sum(axis=(1, 2)) > 8
    assert 0 < many.sum() < 33
    got = engine.compile(cnnum.program(scaled), (4, 4), **PICTURE)(u)["value"]
    np.testing.assert_array_equal(got, np.where(many[:, None, None], 10 * u, u))


def test_memory_outlives_frames_of_a_stream(engine):
    """A leaky sum over frames, against the same recursion in NumPy."""

    @cnnum.program
    def leaky(frame):
        memory = frame.memory()
        total = 0.5 * memory.value + frame.picture
        memory.store(total)
        change = frame.picture - frame.previous(frame.picture)
        return {"total": total, "changed": abs(change).sum(), "first": frame.first}

    frames = np.random.default_rng(4).integers(-4, 5, (5, 3, 2, 2)).astype(float)
    stream = engine.compile(leaky, (2, 2), **PICTURE).stream(batch=(3,))
    total, before = np.zeros((3, 2, 2)), frames[0]
    for number, frame in enumerate(frames):
        got = stream.push(frame)
        total = 0.5 * total + frame
        np.testing.assert_array_equal(got["total"], total)  # halves and integers are exact
        np.testing.assert_array_equal(got["changed"], np.abs(frame - before).sum(axis=(1, 2)))
        assert (got["first"] == (number == 0)).all()
        before = frame
    with pytest.raises(ArrayError, match="leading axes"):
        stream.push(frames[0, 0])


def test_memories_latch_hold_count_and_average(engine):
    """Each rule against the same one in Python, frame by frame and cell by cell."""

    @cnnum.program
    def kept(frame):
        p, flag = frame.picture, frame.picture.max() > 3.0
        return {
            "latched": frame.memory(logic=True).latch(p > 5.0, p > 0.0),
            "held": frame.memory().hold(p, p > 2.0),
            "last": frame.memory(scalar=True).hold(p.sum(), flag),
            "counted": frame.memory().count(p > -4.0),
            "leaky": frame.memory().mean(p, 0.25),
            "plain": frame.memory().mean(p, 1.0 / (frame.age + 1.0)),
            "age": frame.age,
            "older": frame.age + 1.0,
        }

    frames = np.random.default_rng(7).integers(-9, 10, (40, 2, 3)).astype(float)
    plan = engine.compile(kept, (2, 3), **PICTURE)
    stream = plan.stream()
    latched, held, last, counted, leaky = np.zeros((2, 3), dtype=bool), 0.0, 0.0, 0, 0.0
    for number, p in enumerate(frames):
        got = stream.push(p)
        latched = (p > 5) | (latched & (p > 0))
        held, last = np.where(p > 2, p, held), p.sum() if p.max() > 3 else last
        counted = np.where(p > -4, counted + 1, 0)
        leaky = leaky + 0.25 * (p - leaky)
        np.testing.assert_array_equal(got["latched"].astype(bool), latched)
        np.testing.assert_array_equal(got["held"], held)
        np.testing.assert_array_equal(got["last"], last)
        np.testing.assert_array_equal(got["counted"], counted)
        # rounding of single precision, on values up to 9
        np.testing.assert_allclose(got["leaky"], leaky, atol=1e-5)
        np.testing.assert_allclose(got["plain"], frames[: number + 1].mean(axis=0), atol=1e-5)
        assert got["age"] == number
        assert got["older"] == number + 1
    assert len(kept.trace((2, 3), ("picture",)).memories) == 7  # one for both ages


def test_memories_hand_on_what_they_held(engine):
    """A line of memories, each of which stores the map of the one before it, in both orders."""

    @cnnum.program
    def delayed(frame):
        line = [frame.memory() for _ in range(5)]
        for place, after in ((1, 0), (2, 1), (3, 4)):
            line[place].store(line[after].value)
        line[0].store(frame.picture)
        line[4].store(frame.picture)
        return {str(k): memory.value for k, memory in enumerate(line)}

    frames = np.random.default_rng(6).integers(-9, 10, (6, 2, 2)).astype(float)
    stream = engine.compile(delayed, (2, 2), **PICTURE).stream()
    for number, frame in enumerate(frames):
        got = stream.push(frame)
        for name, late in (("0", 1), ("1", 2), ("2", 3), ("4", 1), ("3", 2)):
            was = frames[number - late] if number >= late else np.zeros((2, 2))
            np.testing.assert_array_equal(got[name], was)


def test_two_streams_of_a_plan_do_not_share_memories(engine):
    @cnnum.program
    def held(frame):
        memory = frame.memory()
        memory.store(frame.picture)
        return {"before": memory.value}

    plan = engine.compile(held, (2, 2), **PICTURE)
    one, other = plan.stream(), plan.stream()
    one.push(np.ones((2, 2)))
    assert (other.push(np.ones((2, 2)))["before"] == 0).all()
    assert (one.push(np.ones((2, 2)))["before"] == 1).all()


@pytest.mark.one_in(3)
@pytest.mark.parametrize("code", range(16))
def test_all_sixteen_logic_functions(engine, code):
    table = f"{code:04b}"

    def applied(frame):
        p, q = frame.p > 0.0, frame.q > 0.0
        return {"a": cnnum.logic(table, p, q), "flag first": cnnum.logic(table, p.any(), q)}

    both = np.array([[[-1, -1], [-1, 1], [1, -1], [1, 1]]], dtype=float)
    plan = engine.compile(cnnum.program(applied), (1, 4), channels=("p", "q"))
    got = {name: "".join(str(int(v)) for v in found[0]) for name, found in plan(both).items()}
    assert got == {"a": table, "flag first": 2 * table[2:]}


def test_read_outs_of_a_whole_map(engine):
    @cnnum.program
    def read(frame):
        row, column = frame.picture.argmax()
        p = frame.picture
        centre_row, centre_column = frame.centroid(p * p)
        return {
            "sum": p.sum(), "max": p.max(), "min": p.min(), "mean": p.mean(),
            "row": row, "column": column, "all": (p > -9.0).all(), "any": (p > 9.0).any(),
            "count": (p > 0.0).count(), "centre_row": centre_row, "centre_column": centre_column,
        }  # fmt: skip

    maps = np.random.default_rng(5).permutation(20 * 12).reshape(20, 3, 4) / 32.0 - 3.0
    got = engine.compile(read, (3, 4), **PICTURE)(maps)
    flat = maps.reshape(20, -1)
    np.testing.assert_array_equal(got["sum"], flat.sum(axis=1))  # multiples of 1/32 are exact
    np.testing.assert_array_equal(got["max"], flat.max(axis=1))
    np.testing.assert_array_equal(got["min"], flat.min(axis=1))
    np.testing.assert_allclose(got["mean"], flat.mean(axis=1), rtol=1e-6)
    np.testing.assert_array_equal(4 * got["row"] + got["column"], flat.argmax(axis=1))
    np.testing.assert_array_equal(got["count"], (flat > 0).sum(axis=1))
    places, weights = np.indices((3, 4)).reshape(2, -1).T, flat**2
    expected = weights @ places / weights.sum(axis=1, keepdims=True)
    np.testing.assert_allclose(got["centre_row"], expected[:, 0], rtol=1e-6)
    np.testing.assert_allclose(got["centre_column"], expected[:, 1], rtol=1e-6)
    assert got["all"].all()
    assert not got["any"].any()


@pytest.mark.parametrize(("rows", "columns"), [(1, 0), (0, -2), (-1, 1), (0, 0)])
def test_shift_moves_whole_cells(engine, rows, columns):
    def moved(frame):
        return {"a": cnnum.shift(frame.picture, rows, columns, boundary="periodic")}

    u = np.random.default_rng(6).integers(-9, 9, (2, 4, 5)).astype(float)
    got = engine.compile(cnnum.program(moved), (4, 5), **PICTURE)(u)["a"]
    np.testing.assert_array_equal(got, np.roll(u, (rows, columns), axis=(1, 2)))


def test_trace_shows_every_operation(engine):
    plan = engine.compile(cnnum.program(grown_from_rim), (4, 4), ["grown"], **PICTURE)
    u = pictures(2, (4, 4), 0.6, seed=7)
    steps = list(plan.trace(u))
    assert [step.number for step in steps] == list(range(len(steps)))
    assert all(a < step.number for step in steps for a in step.arguments)
    np.testing.assert_array_equal(steps[0].value, u)
    (last,) = [step for step in steps if step.outputs == ("grown",)]
    np.testing.assert_array_equal(last.value, plan(u)["grown"])


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_not_finite_frames_are_refused(engine, bad):
    plan = engine.compile(cnnum.program(grown_from_rim), (2, 2), **PICTURE)
    with pytest.raises(ArrayError, match="finite"):
        plan(np.full((2, 2), bad))


def test_division_by_nothing_is_nothing(engine):
    def ratio(frame):
        return {"a": frame.p / frame.q}

    frame = np.array([[[3.0, 0.0], [3.0, 2.0]]])
    plan = engine.compile(cnnum.program(ratio), (1, 2), channels=("p", "q"))
    assert plan(frame)["a"].tolist() == [[0.0, 1.5]]
