"""Mistakes of a first hour: each is one sentence, on the command line with exit code 2."""

import math
import subprocess
import sys

import numpy as np
import pytest

import cnnum

HOLE = cnnum.get_template("HOLE")
CENTRE = [[0, 0, 0], [0, 1, 0], [0, 0, 0]]
RING = -np.ones((16, 16))
RING[4:12, 4:12] = 1.0
RING[6:10, 6:10] = -1.0
LEVELS = np.where(RING > 0, 0, 255)


def run(**maps):
    return lambda: cnnum.Engine("numba").run(HOLE, **maps)


def template(**parts):
    return lambda: cnnum.Template(**{"name": "mine", "A": CENTRE, **parts})


def compiled(program, shape=(8, 8), **options):
    return lambda: cnnum.Engine("numba").compile(program, shape, **options)


def bound(**parameters):
    return lambda: cnnum.get_program("tactile").bind(**parameters)


def touched(frame):
    return {"contact": (frame.normal > 0.1).any()}


IN_PYTHON = {
    "bool picture": (run(input=RING > 0), "'input' of template 'HOLE' .* array of bool"),
    "uint8 picture": (run(input=LEVELS.astype(np.uint8)), "array of uint8: use cnnum.as_picture"),
    "0-255 picture": (run(input=LEVELS.astype(float)), "whole numbers of 0 to 255"),
    "0-255 state": (
        lambda: cnnum.Engine("numba").run("THRES", state=LEVELS.astype(float)),
        "'state' .* whole numbers of 0 to 255",
    ),
    "ragged A": (template(A=[[0, 1], [1]]), "A of template 'mine'.* rows of different lengths"),
    "ragged input": (run(input=[[0, 1], [1]]), "'input' .* rows of different lengths .1 to 2."),
    "A=None": (template(A=None), "A of template 'mine'.* got None"),
    "boundary=None": (template(boundary=None), "'zero-flux' or 'periodic', got None"),
    "boundary a list": (template(boundary=[1, 2]), "'zero-flux' or 'periodic', got"),
    "unknown template": (
        lambda: cnnum.Engine("numba").run("EDG", input=RING),
        "Unknown template 'EDG'.* did you mean 'EDGE'",
    ),
    "no template": (
        lambda: cnnum.Engine("numba").run(3, input=RING),
        "the name of one, got int",
    ),
    "no @cnnum.program": (compiled(touched), "decorate the function with @cnnum.program"),
    "np.sin of a field": (
        compiled(cnnum.Program(lambda frame: {"a": np.sin(frame.normal)}, "waves")),
        "NumPy's 'sin' does not accept a field",
    ),
    "np.mean of a field": (
        compiled(cnnum.Program(lambda frame: {"a": np.mean(frame.normal)}, "mean")),
        "NumPy's 'mean' does not accept a field .* the field's own sum, mean, max",
    ),
    "sum(field)": (
        compiled(cnnum.Program(lambda frame: {"a": sum(frame.normal)}, "total")),
        "a field has no values yet: use its own sum, mean",
    ),
    "max(field, 0)": (
        compiled(cnnum.Program(lambda frame: {"a": max(frame.normal, 0)}, "most")),
        "has no values yet: use cnnum.where",
    ),
    "field[0]": (
        compiled(cnnum.Program(lambda frame: {"a": frame.normal[0]}, "first")),
        "use cnnum.where to pick cells",
    ),
    "math.sqrt(field)": (
        compiled(cnnum.Program(lambda frame: {"a": math.sqrt(frame.normal)}, "root")),
        "use NumPy's functions in place of those of 'math'",
    ),
    "int(field)": (
        compiled(cnnum.Program(lambda frame: {"a": frame.normal * int(frame.normal)}, "whole")),
        "a comparison in place of a whole number",
    ),
    "no dict": (
        compiled(cnnum.Program(lambda frame: frame.normal, "bare")),
        "must return a dict of named fields, got Field",
    ),
    "a program called on an array": (
        lambda: cnnum.program(touched)(np.zeros((8, 8, 3))),
        "build plan = engine.compile.touched, shape=.rows, cols.. and call plan.frame.",
    ),
    "needs a text": (
        compiled(cnnum.program(touched), needs="contact"),
        r"as in \['contact'\], got a single string",
    ),
    "minus one frame": (
        lambda: cnnum.load_scene("contact", engine=cnnum.Engine("numba")).collect(frames=-1),
        "'frames' must be a whole number of at least 1, got -1",
    ),
    "one time": (run(input=RING, at=1.0), "'at' must be 1 to .* got 1[.]$"),
    "shape=8": (compiled(cnnum.program(touched), 8), r"rows and columns, as in \(8, 8\), got 8"),
    "shape='8x8'": (compiled(cnnum.program(touched), "8x8"), "got '8x8'"),
    "shape of halves": (compiled(cnnum.program(touched), (8.5, 8)), "two positive whole numbers"),
    "unknown output": (
        compiled(cnnum.program(touched), needs=["contct"]),
        "Unknown output 'contct' .did you mean 'contact'",
    ),
    "length without pitch": (bound(depth="1 mm"), "give 'pitch', .* as in pitch = '1.5 mm'"),
    "depth of no length": (bound(depth="1 kg", pitch=1e-3), "'m', 'cm', 'mm', 'um', as in '1 mm'"),
    "depth in metres": (bound(depth=1e-3), "counts pitches .* 0.02 to 50, got 0.001; for a length"),
    "push=0": (bound(push=0), "−1 where a push lowers the values, or .1"),
    "rate=-1": (bound(rate=-1), "frames a second .* got -1"),
    "unit=-5": (bound(unit=-5), "newtons.* got -5"),
    "scene of a dict": (lambda: cnnum.load_scene({"needs": []}), "got dict"),
}


@pytest.mark.parametrize("name", IN_PYTHON)
def test_one_sentence_in_python(name):
    call, said = IN_PYTHON[name]
    with pytest.raises(cnnum.CnnumError, match=said) as caught:
        call()
    assert "\n" not in str(caught.value)
    assert str(caught.value).endswith((".", "?"))


def test_a_refused_picture_runs_as_one():
    """The sentence proposes a call that gives the right answer: 64 black cells of 256."""
    engine = cnnum.Engine("numba")
    for pixels in (RING > 0, LEVELS.astype(np.uint8)):
        result = engine.run(HOLE, input=cnnum.as_picture(pixels))
        assert (result.output > 0).sum() == 64


def test_grey_levels_are_refused_on_every_run():
    """The quick way of a second run looks as well."""
    engine, outline = cnnum.Engine("numba"), cnnum.get_template("EDGE")
    for _ in range(3):
        engine.run(outline, input=RING)
    with pytest.raises(cnnum.CnnumError, match="whole numbers of 0 to 255"):
        engine.run(outline, input=LEVELS.astype(float))


def test_counts_are_no_picture_of_a_linear_template():
    counts = np.full((4, 4), 200.0)
    smooth = cnnum.Engine("numba").run("smooth", input=counts)
    assert smooth.output == pytest.approx(counts, rel=1e-3)  # its tolerance is 1e-4


def test_a_name_is_a_template():
    engine = cnnum.Engine("numba")
    by_name, by_template = (engine.run(t, input=RING) for t in ("HOLE", HOLE))
    assert np.array_equal(by_name.output, by_template.output)


def test_units_are_those_of_the_numbers():
    program = cnnum.get_program("tactile")
    in_units = dict(program.bind(depth="1 mm", pitch="1.5 mm", rate="0.1 kHz").parameters)
    assert in_units == {"depth": pytest.approx(2 / 3), "rate": pytest.approx(100.0)}
    thick = dict(cnnum.get_program("surface_load").bind(thickness="1mm", pitch=1e-3).parameters)
    assert thick == {"thickness": pytest.approx(1e-3), "pitch": 1e-3}


ON_THE_COMMAND_LINE = {
    "depth as a length": ("program.parameters.depth=1 stone", "'m', 'cm', 'mm', 'um'"),
    "depth in metres": ("program.parameters.depth=1e-3", "counts pitches of the array"),
    "push=0": ("program.parameters.push=0", "−1 where a push lowers the values"),
    "push=100": ("program.parameters.push=100", "−1 where a push lowers the values"),
    "rate=-1": ("program.parameters.rate=-1", "frames a second"),
    "unit=-5": ("program.parameters.unit=-5", "newtons"),
    "unknown parameter": ("program.parameters.dept=1", "(did you mean 'depth'?)"),
    "unknown want": ('needs=["slipp"]', "did you mean 'slip'"),
    "unknown want, events": ('needs=["wash"]', "'contact', 'slip', 'twist', 'edge'"),
}


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("templates", "show", "HOLE", "--input", "ring.png"), "as in --transient HOLE.html"),
        (("run", "demo", "--trace-frame", 3), "requires --trace FILE.html"),
        (("run", "demo", "--trace", "trace.pdf"), "expected FILE.html, got 'trace.pdf'"),
    ],
)
def test_an_option_that_would_do_nothing_is_refused(call, arguments, said):
    done = call(*arguments)
    assert (done.exit_code, done.stdout) == (2, "")
    assert said in done.stderr


@pytest.mark.parametrize("name", ON_THE_COMMAND_LINE)
def test_one_sentence_on_the_command_line(call, name):
    setting, said = ON_THE_COMMAND_LINE[name]
    result = call("plan", "demo", "--engine", "numba", "--set", setting)
    assert (result.exit_code, result.stdout) == (2, "")
    assert said in result.stderr
    assert result.stderr.startswith("cnnum: ")
    assert result.stderr.count("\n") == 1


def test_a_depth_in_millimetres_is_that_in_pitches(call, records):
    """The simulated array knows its pitch of 1.5 mm."""
    plans = [
        records(call("plan", "demo", "--engine", "numba", "--set", setting, "--json").stdout)[0]
        for setting in ("program.parameters.depth=1.5 mm", "program.parameters.depth=1")
    ]
    assert plans[0] == plans[1]


def test_a_folder_of_trials_lists_them(call, tmp_path):
    for name in ("first", "second"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "xela_sensor1.csv").write_text("")
    result = call("replay", tmp_path, "--scene", "uskin_grasp")
    assert (result.exit_code, result.stdout) == (2, "")
    assert "a folder of 2 trial(s), not one: name one of them ('first', 'second')" in result.stderr


def test_no_traceback_of_a_script(tmp_path):
    """A sentence is the last line that a script's user reads."""
    script = tmp_path / "first.py"
    script.write_text("import cnnum\ncnnum.Template(name='mine', A=None)\n")
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=60)
    assert done.stderr.splitlines()[-1].startswith("cnnum.errors.ArrayError: A of template")
