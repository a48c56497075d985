"""What a program may hold in whole numbers and in C: memories, branches, names, any bits in memory.

Wanted values are written out, or come from NumPy. Every program is also compiled, under sanitizers.
"""

import re
import subprocess

import numpy as np
import pytest

import cnnum
from cnnum.embedded.c.files import identifier
from cnnum.embedded.c.text import packed, record_type
from cnnum.embedded.emulator import cleared
from cnnum.embedded.formats import precision_named
from cnnum.embedded.making import make
from cnnum.embedded.program import array_names
from cnnum.errors import ArrayError, MethodError, ProgramError
from cnnum.graph.schedule import schedule
from tests.embedded.conftest import SANITIZERS, compiled

PRECISIONS = ("float32", "q15", "q7", "q5.6")
CHANNELS = ("a", "b")
SHAPE = (3, 4)
FRAMES = np.random.default_rng(0).integers(-8, 9, (12, 1, *SHAPE, 2)) / 8.0
"""Exact in every precision."""


def exported(function, precision, name="mine", frames=FRAMES):
    program = cnnum.Program(function, name)
    planned = schedule(program.trace(SHAPE, CHANNELS), CHANNELS, None)
    return make(name, planned, precision_named(precision), frames)


def in_c(made, compiler, folder, frames=FRAMES):
    """The outputs of the compiled program, whose vector passes too: (frames, ...) each."""
    made.export(frames).write(folder)
    name = identifier(made.program.name)
    vector = compiled(compiler, folder, name, "vector.c", *SANITIZERS)
    assert subprocess.run([vector], check=False).returncode == 0
    main = compiled(compiler, folder, name, "stream.c", *SANITIZERS)
    inputs, outputs = (made.program.of_kind(kind) for kind in ("input", "output"))
    rows = [packed(inputs, made.inputs(frame), 1) for frame in frames]
    given = b"".join(row.tobytes() for row in rows)
    done = subprocess.run([main], input=given, capture_output=True, check=True)
    answers = np.frombuffer(done.stdout, dtype=record_type(outputs))
    rows = [
        made.outputs({one.name: answer[one.name][None] for one in outputs}) for answer in answers
    ]
    return {name: np.stack([row[name][0] for row in rows]) for name in made.program.outputs}


def everywhere(function, precision, compiler, folder, name="mine", frames=FRAMES):
    """The outputs by the emulator, which C and the device give too."""
    made = exported(function, precision, name, frames)
    wanted = {key: values[:, 0] for key, values in made.run(frames).items()}
    for key, values in in_c(made, compiler, folder, frames).items():
        np.testing.assert_allclose(values, wanted[key], rtol=1e-6 * (precision == "float32"))
    engine = cnnum.Engine(precision=precision)
    options = {} if precision == "float32" else {"like": frames[:, 0]}
    plan = engine.compile(cnnum.Program(function, name), SHAPE, channels=CHANNELS, **options)
    stream = plan.stream()
    # transients with steps keep the tolerances of a run, 1e-5 and 1e-4 of the state
    off = {"rtol": 1e-4, "atol": 1e-5} if precision == "float32" else {"rtol": 0.0}
    for number, frame in enumerate(frames[:, 0]):
        for key, values in stream.push(frame).items():
            np.testing.assert_allclose(values, wanted[key][number], **off, err_msg=key)
    return wanted


@pytest.mark.parametrize("precision", PRECISIONS)
def test_a_memory_that_is_an_output_or_stored_elsewhere_is_the_old_one(
    precision, compiler, tmp_path
):
    def function(frame):
        first, second = frame.memory("first"), frame.memory("second")
        first.store(frame.a * 2.0)
        second.store(first.value)
        third = frame.memory("third", scalar=True)
        third.store(frame.a.max())
        return {"old": first.value, "older": second.value, "number": third.value}

    found = everywhere(function, precision, compiler, tmp_path)
    a = FRAMES[:, 0, ..., 0]
    np.testing.assert_array_equal(found["old"][1:], 2.0 * a[:-1])
    np.testing.assert_array_equal(found["older"][2:], 2.0 * a[:-2])
    np.testing.assert_array_equal(found["number"][1:], a[:-1].max(axis=(1, 2)))
    assert not found["old"][0].any()
    assert not found["older"][:2].any()
    assert not found["number"][0]


@pytest.mark.parametrize("precision", PRECISIONS)
def test_branches_and_loops_of_one_round(precision, compiler, tmp_path):
    def function(frame):
        (branched,) = cnnum.branch(frame.a.max() > 0.9, lambda x: x - frame.b, frame.a)
        looped = cnnum.loop(lambda x: x * 0.5, frame.a, limit=1)
        return {"branched": branched, "looped": looped.value, "done": looped.finished}

    found = everywhere(function, precision, compiler, tmp_path)
    a, b = FRAMES[:, 0, ..., 0], FRAMES[:, 0, ..., 1]
    taken = a.max(axis=(1, 2), keepdims=True) > 0.9
    assert 0 < taken.sum() < len(a)
    np.testing.assert_array_equal(found["branched"], np.where(taken, a - b, a))
    np.testing.assert_array_equal(found["looped"], 0.5 * a)
    assert not found["done"].any()


@pytest.mark.parametrize("precision", ["q15", "q5.6"])
def test_nothing_is_compared_with_itself(precision):
    """GCC 13 warns of it (-Wtautological-compare), which `make` of an export makes an error."""

    def function(frame):
        done = cnnum.loop(lambda x: x * 0.5, frame.a, limit=1).finished
        return {"same": done.equals(done), "more": done > done, "field": frame.a >= frame.a}

    made = exported(function, precision)
    found = made.run(FRAMES)
    assert found["same"].all()
    assert found["field"].all()
    assert not found["more"].any()
    text = made.export(FRAMES).files["mine.c"]
    assert not re.findall(r"(\([^()]+\)|\w+) (?:==|>=?) \1\W", text)


@pytest.mark.parametrize("precision", PRECISIONS)
def test_outputs_whose_names_are_alike_in_c_are_two(precision, compiler, tmp_path):
    def function(frame):
        return {"a b": frame.a, "a_b": frame.b, "A_B": frame.a.max(), "é": frame.b.min()}

    found = everywhere(function, precision, compiler, tmp_path)
    np.testing.assert_array_equal(found["a b"], FRAMES[:, 0, ..., 0])
    np.testing.assert_array_equal(found["a_b"], FRAMES[:, 0, ..., 1])


def test_names_of_arrays_are_those_of_c_and_none_comes_twice():
    names = ["a b", "a_b", "A_B", "a-b", "ä", "a_b_2", "", "x" * 80]
    found = array_names("out", names)
    assert found["a_b"] == "out_a_b"
    assert len({one.lower() for one in found.values()}) == len(names)
    assert all(one.isascii() and one.isidentifier() for one in found.values())


@pytest.mark.parametrize("name", ["stream", "Vector", "3d", "stdint", "a b", "_x", "é", "int"])
def test_a_program_of_any_name_has_files_of_its_own(name, compiler, tmp_path):
    made = exported(lambda frame: {"a": frame.a * 2.0}, "q15", name)
    in_c(made, compiler, tmp_path)
    assert len({path.name.lower() for path in tmp_path.glob("*.c")}) == 3


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("roots", ["cube", "square", "both"])
def test_a_root_compiles_alone(roots, precision, compiler, tmp_path):
    def function(frame):
        found = {}
        if roots != "square":
            found["cube"] = frame.a ** (1 / 3)
        if roots != "cube":
            found["square"] = np.sqrt(frame.a)
        return found

    found = everywhere(function, precision, compiler, tmp_path)
    a = np.maximum(FRAMES[:, 0, ..., 0], 0.0)
    # a stored map of 8 bits up to 1.25: steps of 2^-6, and the root is rounded down
    step = {"q15": 2.0**-14, "q7": 2.0**-6, "q5.6": 2.0**-6, "float32": 1e-6}[precision]
    for name, power in (("cube", 1 / 3), ("square", 1 / 2)):
        if name in found:
            assert np.abs(found[name] - a**power).max() <= 2 * step


@pytest.mark.parametrize("precision", PRECISIONS)
def test_outputs_that_read_no_channel(precision, compiler, tmp_path):
    def function(frame):
        ramp = frame.constant(np.arange(12.0).reshape(SHAPE) / 8.0)
        return {"ramp": ramp, "age": frame.age, "one": frame.constant(1.0), "first": frame.first}

    found = everywhere(function, precision, compiler, tmp_path)
    np.testing.assert_array_equal(found["ramp"][5], np.arange(12.0).reshape(SHAPE) / 8.0)
    np.testing.assert_array_equal(found["age"], np.arange(12.0))
    batch = cnnum.Engine("reference", precision="q15").compile(
        cnnum.Program(lambda frame: {"one": frame.constant(1.0)}, "one"), SHAPE, channels=CHANNELS
    )
    np.testing.assert_array_equal(batch(np.zeros((5, *SHAPE, 2)))["one"], np.ones(5))


EXACT = {
    "uncoupled": cnnum.Template("u", [[0.0]], [[0.5]], 0.25),
    "fast and slow": cnnum.Template(
        "layers", np.zeros((2, 2, 1, 1)), np.full((2, 1, 1, 1), 0.5), 0.25, tau=[1.0, 4.0]
    ),
    "modes": cnnum.Template(
        "m", [[0, 0.1, 0], [0.1, 0.2, 0.1], [0, 0.1, 0]], [[0.5]], 0.25, output="linear",
        boundary="zero-flux",
    ),
    "rim": cnnum.Template(
        "r", [[0, 0.1, 0], [0.2, 0.2, 0.1], [0, 0.1, 0]], [[0.5]], 0.25, output="linear",
        boundary=-0.5,
    ),
}  # fmt: skip


@pytest.mark.parametrize("precision", ["float32", "q15", "q7"])
@pytest.mark.parametrize("kind", EXACT)
@pytest.mark.parametrize(("duration", "rests"), [(0.0, 0), (1.0, 0), (80.0, 1), ("settle", 1)])
def test_an_exact_transient_says_whether_it_rests(
    kind, duration, rests, precision, compiler, tmp_path
):
    def function(frame):
        spec = cnnum.RunSpec(duration=duration)
        run = cnnum.transient(EXACT[kind], input=frame.a, spec=spec)
        return {"settled": run.settled, "time": run.time}

    if (duration, precision) == (80.0, "float32"):
        found = everywhere(function, precision, compiler, tmp_path)
    else:
        made = exported(function, precision)
        found = {name: values[:, 0] for name, values in made.run(FRAMES).items()}
    np.testing.assert_array_equal(found["settled"], rests)


@pytest.mark.parametrize("precision", ["float32", "q15", "q7"])
@pytest.mark.parametrize("kind", [one for one in EXACT if one != "fast and slow"])
def test_an_exact_transient_moves_on_from_whole_numbers(kind, precision):
    """Whole numbers, as rows have, are held in steps of 1, and are not rounded."""

    def function(frame):
        run = cnnum.transient(
            EXACT[kind], input=frame.row, state=frame.row, spec=cnnum.RunSpec(duration=1.0)
        )
        return {"settled": run.settled, "read": frame.a}

    assert not exported(function, precision).run(FRAMES)["settled"].any()


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("duration", [1.0, "settle"])
def test_a_mask_holds_uncoupled_cells(duration, precision, compiler, tmp_path):
    def function(frame):
        template = cnnum.Template("u", [[0.0]], [[0.5]], 0.25)
        held = frame.b > 0.0
        kept = cnnum.transient(
            template, input=frame.a, state=frame.b, mask=held, spec=cnnum.RunSpec(duration)
        )
        empty = cnnum.transient(template, input=frame.a, mask=held, spec=cnnum.RunSpec(duration))
        return {"state": kept.states[0], "empty": empty.states[0]}

    found = everywhere(function, precision, compiler, tmp_path)
    a, b = FRAMES[:, 0, ..., 0], FRAMES[:, 0, ..., 1]
    rest = 0.5 * a + 0.25
    left = 0.0 if duration == "settle" else np.exp(-1.0)
    # half a step of the stored map, and weights of as many bits
    step = {"float32": 1e-6, "q15": 2.0**-13}.get(precision, 2.0**-5)
    for name, start in (("state", b), ("empty", 0.0)):
        wanted = np.where(b > 0.0, start, rest + left * (start - rest))
        assert np.abs(found[name] - wanted).max() <= step, name


@pytest.mark.parametrize("precision", ["q15", "q7", "q5.6", "q1.8", "q9", "float32"])
def test_any_bits_in_memory_and_in_inputs_overflow_nothing(precision, compiler, tmp_path):
    def function(frame):
        kept, flags = frame.memory("kept"), frame.memory("flags", logic=True)
        number = frame.memory("number", scalar=True)
        number.store(number.value * 0.5 + frame.a.sum())
        kept.store(kept.value * 0.75 + frame.a * frame.a - frame.b)
        lit = flags.latch(frame.a > 0.5, frame.b > 0.0)
        ages = frame.memory("ages").count(lit & ~flags.value)
        moved = cnnum.apply(
            cnnum.Template("n", [[0.0]], [[1.0, 2.0, -1.0]] * 3, boundary="periodic"), input=frame.a
        )
        return {
            "kept": kept.value + frame.a, "lit": lit.count(), "ages": ages - kept.value,
            "number": number.value - frame.b.max(), "moved": moved,
        }  # fmt: skip

    made = exported(function, precision)
    made.export(FRAMES).write(tmp_path)
    program = made.program
    (tmp_path / "bits.c").write_text(BITS)
    main = compiled(compiler, tmp_path, "mine", "bits.c", *SANITIZERS)
    done = subprocess.run([main, "2000"], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    if precision == "float32":
        return
    # the numbers of the emulator, to which any bits are given as the type of C holds them
    random = np.random.default_rng(3)
    state = cleared(program, 64)
    for one in program.of_kind("state"):
        state[one.name] = random.integers(*one.held, state[one.name].shape, endpoint=True)
    inputs = {
        one.name: random.integers(*one.held, (64, one.length), endpoint=True)
        for one in program.of_kind("input")
    }
    legal = {one.name: np.clip(inputs[one.name], *one.bounds) for one in program.of_kind("input")}
    first, second = (
        made.emulator().run(given, {k: v.copy() for k, v in state.items()}, first=False)
        for given in (inputs, legal)
    )
    for name, values in first.items():
        np.testing.assert_array_equal(values, second[name], name)


BITS = """#include "mine.h"
#include <stdlib.h>
#include <string.h>

static void fill(void *bytes, unsigned long size)
{
    for (unsigned long n = 0; n < size; ++n) {
        ((unsigned char *)bytes)[n] = (unsigned char)(rand() >> 7);
    }
}

int main(int count, char **words)
{
    static mine_memory memory;
    static mine_input input;
    static mine_output output;
    const int rounds = count > 1 ? atoi(words[1]) : 1;
    for (int n = 0; n < rounds; ++n) {
        fill(&memory, sizeof memory);
        fill(&input, sizeof input);
        mine_step(&memory, &input, &output);
    }
    return 0;
}
"""


def test_the_header_states_the_range_of_inputs():
    header = exported(lambda frame: {"a": frame.a}, "q5.6").export(FRAMES).files["mine.h"]
    assert "#define MINE_IN_A_LEAST (-2048)" in header
    assert "#define MINE_IN_A_LARGEST 2047" in header


def test_streams_beyond_float32_are_no_part_of_the_vector():
    """They gave a sentence about kernels, and a warning of NumPy's."""
    made = exported(lambda frame: {"cube": frame.a**3, "fine": frame.b}, "float32")
    streams = np.repeat(FRAMES, 3, axis=1)
    streams[3, [0, 2], ..., 0] = 1e20
    wanted = made.export(streams[:, 1:2]).files["vector.c"]
    assert made.export(streams).files["vector.c"] == wanted
    streams[5, 1, 0, 0, 0] = 1e20
    with pytest.raises(ArrayError, match=r"Output 'cube' is not finite in float32 in any stream"):
        made.export(streams)


@pytest.mark.parametrize("power", [10**400, -(10**400)])
def test_a_power_beyond_all_doubles_is_refused_in_one_sentence(power):
    for function in (lambda x: x**power, lambda x: power**x):
        with pytest.raises(ProgramError, match="raised to"):
            cnnum.Program(lambda frame, f=function: {"p": f(frame.a)}, "p").trace(SHAPE, CHANNELS)


@pytest.mark.parametrize("precision", ["float32", "q15", "q7"])
def test_a_rim_beyond_the_inputs_and_a_step_as_long_as_tau_are_held(precision, compiler, tmp_path):
    """A rim of 3 around inputs up to 1, a flag with a rim of −1, and a limited, uncoupled state."""

    def function(frame):
        right = [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]]
        rim = cnnum.Template("rim", [[0.0]], right, boundary=3.0, output="linear")
        flags = cnnum.Template("flags", [[0.0]], right, boundary=-1.0, output="linear")
        limited = cnnum.Template("limited", [[0.0]], [[0.5]], 0.125, output="full-range")
        settle = {"duration": "settle"}
        return {
            "rim": cnnum.apply(rim, input=frame.a, **settle),
            "flags": cnnum.apply(flags, input=frame.a > 0.0, **settle),
            "limited": cnnum.apply(limited, input=frame.a, mask=frame.b > 0.0, **settle),
        }

    found = everywhere(function, precision, compiler, tmp_path)
    a, b = FRAMES[:, 0, ..., 0], FRAMES[:, 0, ..., 1]
    moved = np.concatenate([a[..., 1:], np.full((len(a), 3, 1), 3.0)], axis=-1)
    np.testing.assert_array_equal(found["rim"], moved)
    up = np.concatenate([1.0 * (a[..., 1:] > 0.0), np.full((len(a), 3, 1), -1.0)], axis=-1)
    np.testing.assert_array_equal(found["flags"], up)
    step = {"float32": 1e-5, "q15": 2.0**-14, "q7": 2.0**-6}[precision]
    wanted = np.where(b > 0.0, 0.0, 0.5 * a + 0.125)
    assert np.abs(found["limited"] - wanted).max() <= step


@pytest.mark.parametrize("precision", PRECISIONS)
def test_the_place_of_the_largest_number_is_in_the_array(precision, compiler, tmp_path):
    """A largest number that is rounded otherwise than the map is found in no cell of it."""

    def function(frame):
        row, column = np.sqrt(frame.a * frame.a + frame.b * frame.b).argmax()
        return {"row": row, "column": column}

    found = everywhere(function, precision, compiler, tmp_path)
    size = np.hypot(FRAMES[:, 0, ..., 0], FRAMES[:, 0, ..., 1])
    rows, columns = (found[name].astype(int) for name in ("row", "column"))
    at = size[np.arange(len(size)), rows, columns]
    # the two largest may be the same in a word of 8 bits
    assert np.abs(at - size.max(axis=(1, 2))).max() <= {"q15": 2.0**-13}.get(precision, 2.0**-5)


def test_a_loop_in_a_body_may_begin_with_fields_from_outside():
    def function(frame):
        def body(x):
            def inner(z):
                return z * 0.5 + x

            (grown,) = cnnum.branch(frame.first, inner, frame.a)
            return cnnum.where(frame.b > 0.0, grown, x)

        run = cnnum.loop(body, frame.a, limit=1)
        return {"a": cnnum.where(run.finished, run.value, 0.0 - run.value)}

    plan = cnnum.Engine("reference").compile(cnnum.Program(function, "p"), SHAPE, channels=CHANNELS)
    a, b = FRAMES[0, 0, ..., 0], FRAMES[0, 0, ..., 1]
    np.testing.assert_array_equal(plan(FRAMES[0, 0])["a"], -np.where(b > 0.0, 1.5 * a, a))


@pytest.mark.parametrize("what", ["memory", "loop"])
def test_logic_values_stay_logic(what):
    """An array of flags holds 0 and 1, and no other number is lost in it in silence."""

    def function(frame):
        flags = frame.a > 0.0
        if what == "memory":
            frame.memory(logic=True).store(frame.a)
            return {"a": frame.a}
        return {"a": cnnum.loop(lambda x: x + frame.a, flags, limit=2).value}

    with pytest.raises(ProgramError, match="logic value"):
        cnnum.Program(function, "p").trace(SHAPE, CHANNELS)


def doubled(limit):
    """Doubles a until its largest number is 1 at least: by a limit of 2, not from below 1/4."""

    def function(frame):
        def grown(x):
            return x + x

        memory = frame.memory("m", scalar=True)
        run = cnnum.loop(grown, frame.a, limit=limit, until=lambda x: x.max() >= 1.0)
        memory.store(memory.value + run.value.max())
        return {"a": run.value, "sum": memory.value}

    return function


POWERS = np.array([0.0, 1.0, 2.0] * 4 + [4.0])
STARTS = np.zeros((len(POWERS), 1, *SHAPE, 2))
STARTS[..., 0] = 2.0 ** -POWERS[:, np.newaxis, np.newaxis, np.newaxis]
"""The last one begins at 1/16."""


@pytest.mark.parametrize("precision", PRECISIONS)
def test_a_loop_at_its_limit_is_refused_or_said(precision, compiler, tmp_path):
    """2⁻⁴ takes four doublings of two: an error on engines, and an answer of the compiled C."""
    made = exported(doubled(2), precision, frames=STARTS)
    assert made.program.may_not_finish
    made.export(STARTS).write(tmp_path)
    assert "uint8_t unfinished; /* whether a loop" in (tmp_path / "mine.h").read_text()
    loaded = cnnum.load_export(tmp_path)
    found = loaded.run(STARTS[:-1, 0])
    assert found["a"].max(axis=(1, 2)).tolist() == [2.0, 1.0, 1.0] * 4
    assert found.keys() == {"a", "sum"}
    with pytest.raises(MethodError, match=r"in 1 of 13 frames \(the first is frame 12\)"):
        loaded.run(STARTS[:, 0])
    # the test vector has the frame, and fails for a program that never says so
    vector = compiled(compiler, tmp_path, "mine", "vector.c", *SANITIZERS)
    assert subprocess.run([vector], check=False).returncode == 0
    source = tmp_path / "mine.c"
    text = source.read_text()
    assert text.count("out->unfinished = ") == 1
    source.write_text(
        re.sub("out->unfinished = [^;]*;", "(void)missed; out->unfinished = 0;", text)
    )
    vector = compiled(compiler, tmp_path, "mine", "vector.c")
    assert subprocess.run([vector], check=False).returncode == 1


@pytest.mark.parametrize("name", ["opencl", "reference"])
def test_engines_in_whole_numbers_refuse_a_loop_at_its_limit(name):
    engine = cnnum.Engine(name, precision="q15")
    short, long = (
        engine.compile(cnnum.Program(doubled(limit), "p"), SHAPE, channels=CHANNELS, like=STARTS)
        for limit in (2, 4)
    )
    with pytest.raises(MethodError, match="raise the loop's limit"):
        short(STARTS[:, 0])
    stream = short.stream()
    assert stream.push(STARTS[0, 0])["sum"] == 0.0
    with pytest.raises(MethodError):
        stream.push(STARTS[-1, 0])
    # the stream goes on
    assert stream.push(STARTS[1, 0])["a"].max() == 1.0
    assert long(STARTS[:, 0])["a"].max(axis=(1, 2)).tolist() == [2.0, 1.0, 1.0] * 4 + [1.0]


def test_a_branch_and_a_loop_that_is_asked_have_no_such_answer():
    def function(frame):
        (a,) = cnnum.branch(frame.first, lambda x: x * 0.5, frame.a)
        run = cnnum.loop(lambda x: x * 0.5, a, limit=1)
        return {"a": cnnum.where(run.finished, run.value, a)}

    assert not exported(function, "q15").program.may_not_finish


def test_a_loop_within_a_loop_counts_where_its_frame_goes_on():
    """The inner one comes to its limit in the first frame alone; the outer one runs once."""

    def function(frame):
        def outer(x):
            inner = cnnum.loop(lambda z: z * 0.5, x, limit=2, until=lambda z: z.max() < 0.5)
            return inner.value

        return {"a": cnnum.branch(frame.b.max() > 0.0, outer, frame.a)[0]}

    frames = np.zeros((3, 1, *SHAPE, 2))
    frames[:, 0, ..., 0] = np.array([4.0, 4.0, 1.0])[:, np.newaxis, np.newaxis]
    frames[:, 0, ..., 1] = np.array([1.0, -1.0, 1.0])[:, np.newaxis, np.newaxis]
    made = exported(function, "q15", frames=frames)
    state, said = cleared(made.program, 1), []
    for number, frame in enumerate(frames):
        answer = made.emulator().run(made.inputs(frame), state, first=number == 0)
        said.append(int(answer["unfinished"].item()))
    assert said == [1, 0, 0]
