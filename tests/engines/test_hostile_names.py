"""A user's text never becomes code: it is refused in one sentence, or stays out of kernels."""

import re
from dataclasses import replace

import numpy as np
import pytest

import cnnum
from cnnum.errors import ArrayError, CnnumError, ProgramError, TemplateError
from cnnum.scenes.scene_file import SceneSpec, read_scene
from cnnum.templating.boundary import Boundary
from cnnum.templating.couplings import Gain, NonlinearCoupling
from cnnum.templating.functions import OutputFunction, Table, output_function

HOSTILE = [
    "evil\n#include <evil>\n",
    "evil */ int evil; /*",
    "evil\\\nint evil;",
    "evil??/\nint evil;",
    "evil'",
    'evil"); evil("',
    "#include <evil>",
    "evil; }",
    "evil\x1b[2J\u2028",
]
ENGINES = ["opencl", "numba", "reference"]
B = [[0.0, 1.0, 0.0], [1.0, 2.0, 1.0], [0.0, 1.0, 0.0]]


def template(name="t", **parts):
    return cnnum.Template(name, [[0.5]], B, 0.1, duration=1.0, **parts)


def program(shown, **parts):
    def function(frame):
        return {"out": cnnum.apply(template(**parts), input=frame.normal) + frame.shear_x}

    return cnnum.Program(function, shown)


@pytest.fixture(scope="module", params=ENGINES)
def engine(request):
    return cnnum.Engine(request.param)


def returned(name):
    return cnnum.Program(lambda frame: {name: frame.normal}, "p").trace((4, 4))


def remembered(name):
    def function(frame):
        memory = frame.memory(name)
        memory.store(frame.normal)
        return {"out": memory.value}

    return cnnum.Program(function, "p").trace((4, 4))


@pytest.mark.parametrize("name", [*HOSTILE, "", "a" * 81, 3, None])
@pytest.mark.parametrize(
    ("give", "error"),
    [
        (lambda name: template(name), TemplateError),
        (lambda name: replace(template(), name=name), TemplateError),
        (lambda name: OutputFunction(name, np.tanh, "tanh(x)"), TemplateError),
        (lambda name: program(name), ProgramError),
        (returned, ProgramError),
        (lambda name: program("p").trace((4, 4), channels=["normal", name]), ProgramError),
        (lambda name: SceneSpec(name, ("slip",), "simulated"), CnnumError),
        (lambda name: SceneSpec("s", (name,), "simulated"), CnnumError),
        (lambda name: SceneSpec("s", ("slip",), name), CnnumError),
        (lambda name: SceneSpec("s", ("slip",), "simulated", program=name), CnnumError),
        # no name at all is the fastest engine
        (lambda name: SceneSpec("s", ("slip",), "simulated", engine=name or "\n"), CnnumError),
        (lambda name: (name and remembered(name)) or remembered("\n"), ProgramError),
    ],
)
def test_names_are_one_line_of_plain_signs(give, error, name):
    with pytest.raises(error, match="letters, digits and signs") as raised:
        give(name)
    assert isinstance(raised.value, ValueError)
    assert str(raised.value).isprintable()


def test_names_of_the_house_pass():
    for name in cnnum.template_names():
        assert cnnum.get_template(name).name == name
    assert template("shift -1 down, 2 right").name == "shift -1 down, 2 right"
    assert template("elastic block, ν = 0.49 (8 slabs)").name.endswith("(8 slabs)")


@pytest.mark.parametrize("name", HOSTILE)
def test_even_a_name_that_nothing_checked_stays_out_of_kernels(name):
    """The kernel's text is the same but for a comment, in which the name can end nothing."""
    plain, hostile = template("t"), template("t")
    object.__setattr__(hostile, "name", name)
    engine = cnnum.Engine("opencl")
    for shape in ((4, 4), (300, 300)):  # one kernel, and parts of one
        texts = [
            engine.compile(
                cnnum.Program(lambda f, t=each: {"out": cnnum.apply(t, input=f.normal)}, "p"), shape
            ).source
            for each in (plain, hostile)
        ]
        without = [re.sub(r" *//[^\n]*", "", text) for text in texts]
        assert without[0] == without[1]
        assert "evil" not in without[1]
        comments = [line.strip() for line in texts[1].splitlines() if "evil" in line]
        assert all(re.fullmatch(r"// [A-Za-z0-9 _.,:+*=-]*", line) for line in comments)


@pytest.mark.parametrize(
    "text",
    [
        *HOSTILE,
        "x; evil(x)",
        "x // evil",
        "x /* evil",
        "x++",
        "x = ONE",
        "x, ONE",
        "x) + (x",
        "(x",
        "x[1]",
        "evil(x)",
        "ONE",
        "",
        3,
    ],
)
def test_output_functions_are_expressions_of_x(text):
    with pytest.raises(TemplateError, match="one expression of x"):
        OutputFunction("own", np.tanh, text)


def test_own_output_functions_run_and_differ_by_more_than_their_name(engine):
    def half(x):
        return 0.5 * x

    def twice(x):
        return 2.0 * x

    one = OutputFunction("own", half, "R(0.5) * x")
    other = OutputFunction("own", twice, "PICK(x >= x, R(2.0f) * x, ZERO)")
    u = np.full((4, 4), 0.25)
    runs = [engine.run(template(output=f), input=u) for f in (one, other)]
    np.testing.assert_allclose(runs[0].output, 0.5 * runs[0].state, rtol=1e-5)
    np.testing.assert_allclose(runs[1].output, 2.0 * runs[1].state, rtol=1e-5)


def test_own_output_functions_do_not_take_a_name_that_is_taken():
    with pytest.raises(TemplateError, match="There is already an output function 'standard'"):
        template(output=OutputFunction("standard", np.tanh, "tanh(x)"))
    standard = output_function("standard")
    copy = OutputFunction("standard", standard.numpy, standard.opencl)
    assert template(output=copy).digest == template().digest


TABLE = Table("linear", ((0.0, 0.0), (1.0, 1.0)))


@pytest.mark.parametrize("evil", [*HOSTILE, "0", 0.5, None])
@pytest.mark.parametrize(
    "give",
    [
        lambda evil: Boundary(0.0, evil, 0.0),
        lambda evil: Boundary(0.0, "constant", str(evil)),
        lambda evil: NonlinearCoupling([[1.0]], TABLE, evil or 1),
        lambda evil: NonlinearCoupling([[1.0]], TABLE, "u", to=evil),
        lambda evil: NonlinearCoupling([[1.0]], TABLE, "u", source=evil),
        lambda evil: NonlinearCoupling([[1.0]], TABLE, "u", "u", centre_source=evil),
        lambda evil: Gain(evil, 0, TABLE),
        lambda evil: Gain(0, evil, TABLE),
        lambda evil: Table(evil, TABLE.points),
        lambda evil: looped(evil),
        lambda evil: cnnum.Program(
            lambda f: {"a": f.memory(maps=evil).value.sum()}, "p"
        ).trace((4, 4)),
    ],
)  # fmt: skip
def test_places_and_counts_are_whole_numbers_and_words_are_known(give, evil):
    with pytest.raises(CnnumError) as raised:
        give(evil)
    assert str(raised.value).isprintable()


def looped(limit):
    def function(frame):
        return {"a": cnnum.loop(lambda v: v + 1.0, frame.normal, limit=limit).value}

    return cnnum.Program(function, "p").trace((4, 4))


@pytest.mark.parametrize("limit", [0, 2**31, True + 2.0])
def test_loops_have_a_limit_that_kernels_can_count(limit):
    with pytest.raises(ProgramError, match="limit must be a whole number"):
        looped(limit)
    assert looped(np.int64(2**31 - 1)).outputs


def test_numbers_beyond_the_precision_are_refused_in_one_sentence():
    engine = cnnum.Engine("opencl")
    huge = cnnum.Program(lambda frame: {"a": frame.normal * 1e300}, "huge")
    with pytest.raises(ArrayError, match=r"finite numbers in float32, got 1e\+300"):
        engine.compile(huge, (4, 4)).warm_up() or engine.compile(huge, (4, 4)).source
    with pytest.raises(ArrayError, match=r"finite numbers in float32, got -1e\+300"):
        engine.run(cnnum.Template("t", [[-1e300]], B, duration=1.0), input=np.ones((4, 4)))


FIELDS = {
    "name": 'name = "NAME"\n',
    "aliases": 'aliases = ["EVIL"]\n',
    "boundary": 'boundary = "EVIL"\n',
    "input_boundary": 'input_boundary = "EVIL"\n',
    "initial": 'initial = "EVIL"\n',
    "duration": 'duration = "EVIL"\n',
    "output": 'output = "EVIL"\n',
    "description": 'description = "EVIL"\n',
    "source": 'source = "EVIL"\n',
    "key": '"EVIL" = 1.0\n',
    "neighbour": '[[nonlinear]]\nneighbour = "EVIL"\nweights = [[1.0]]\nFUNCTION',
    "centre": '[[nonlinear]]\nneighbour = "u"\ncentre = "EVIL"\nweights = [[1.0]]\nFUNCTION',
    "interpolation": '[[gain]]\ninterpolation = "EVIL"\npoints = [[0, 1], [1, 2]]\n',
    "key of a table": '[[gain]]\n"EVIL" = 1\nFUNCTION',
    "check": '[check]\nname = "EVIL"\n"EVIL" = "EVIL"\n',
}
FREE = {"description", "source", "check"}
"""Words for people, which may be any."""


def quoted(text):
    escaped = (f"\\u{ord(s):04x}" if ord(s) < 32 or s in '"\\' else s for s in text)
    return "".join(escaped)


@pytest.mark.parametrize("evil", HOSTILE)
@pytest.mark.parametrize("field", FIELDS)
def test_template_files_bring_no_code(engine, tmp_path, field, evil):
    function = 'interpolation = "linear"\npoints = [[0, 1], [1, 2]]\n'
    name = "" if field == "name" else 'name = "t"\n'
    text = FIELDS[field].replace("NAME", "EVIL").replace("FUNCTION", function)
    path = tmp_path / "evil.toml"
    duration = "" if field == "duration" else "duration = 1.0\n"
    head = f"{name}{duration}A = [[0.5]]\nB = [[1.0]]\n"
    path.write_text(head + text.replace("EVIL", quoted(evil)), encoding="utf-8")
    if field not in FREE:
        with pytest.raises(TemplateError) as raised:
            cnnum.load_template(path)
        assert str(raised.value).isprintable()
        return
    loaded = cnnum.load_template(path)
    run = cnnum.Program(lambda frame: {"a": cnnum.apply(loaded, input=frame.normal)}, "p")
    assert "evil" not in engine.compile(run, (4, 4)).source


SCENE = """
name = "NAME"
needs = ["WANT"]
[array]
driver = "DRIVER"
"OPTION" = 3
[calibration]
use = "CALIBRATION"
[program]
name = "PROGRAM"
[program.parameters]
"PARAMETER" = 0.2
reads = "VALUE"
unit = "UNIT"
[engine]
name = "ENGINE"
device = "DEVICE"
precision = "PRECISION"
"""
GOOD = {
    "NAME": "s",
    "WANT": "contact_map",
    "DRIVER": "simulated",
    "OPTION": "seed",
    "CALIBRATION": "driver",
    "PROGRAM": "contact",
    "PARAMETER": "share",
    "ENGINE": "ENGINE",
    "PRECISION": "float32",
}


@pytest.mark.parametrize("evil", HOSTILE)
@pytest.mark.parametrize("key", [*GOOD, "DEVICE", "VALUE", "UNIT"])
@pytest.mark.parametrize("name", ["opencl", "numba"])
def test_scene_files_bring_no_code(tmp_path, name, key, evil):
    words = {**GOOD, "ENGINE": name, key: quoted(evil)}
    text = SCENE
    for word, value in words.items():
        text = text.replace(f'"{word}"', f'"{value}"')
    for line in ('device = "DEVICE"', 'reads = "VALUE"', 'unit = "UNIT"'):
        text = text.replace(f"{line}\n", "")
    path = tmp_path / "evil.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(CnnumError) as raised:
        cnnum.load_scene(path)
    assert str(raised.value).isprintable()


def test_a_scene_without_a_name_goes_by_its_file(tmp_path):
    path = tmp_path / "what's #1.toml"
    path.write_text('needs = ["contact"]\n[array]\ndriver = "simulated"\n')
    assert read_scene(path).name == "what_s _1"
