"""Templates with nonlinear or delayed couplings, gains or discrete time, against the reference.

It shares no code with the lowering, and takes the same steps of Euler.
"""

import shutil

import numpy as np
import pytest

import cnnum
from cnnum.embedded.formats import NoFormats, precision_named
from cnnum.embedded.lowering.builder import solvers_for
from cnnum.embedded.lowering.schedules import lower
from cnnum.embedded.making import make
from cnnum.errors import NotSupportedError
from cnnum.graph.schedule import schedule
from cnnum.templating.functions import PairFunction
from cnnum.templating.network import jumps

SHAPE, CHANNELS, TIME = (5, 6), ("a", "b", "c"), 0.5

LIBRARY = {name: cnnum.get_template(name) for name in cnnum.template_names()}

NONLINEAR = [
    name
    for name, template in LIBRARY.items()
    if template.nonlinear or template.output.discrete or template.delayed or template.gains
]


def program(name, method="auto"):
    template = LIBRARY[name]

    def function(frame):
        maps, spec = [frame.a, frame.b, frame.c], cnnum.RunSpec(duration=TIME, method=method)
        if template.inputs:
            given = {"input": maps[: template.inputs]}
            if any(one.centre == "x" for one in template.nonlinear):
                # a state that begins at its input begins on a jump of the table
                given["state"] = (2 * maps[::-1])[: template.layers]
        elif template.initial == "input":
            given = {"input": maps[: template.layers]}
        else:
            given = {"state": (2 * maps)[: template.layers]}
        return {
            f"state_{n}": one
            for n, one in enumerate(cnnum.transient(template, spec=spec, **given).states)
        }

    return cnnum.Program(function, name)


def exported(name, precision):
    frames = np.random.default_rng(1).uniform(-1.0, 1.0, (3, 2, *SHAPE, 3))
    planned = schedule(program(name).trace(SHAPE, CHANNELS), CHANNELS, None)
    return make(name, planned, precision_named(precision), frames), frames


def test_there_are_as_many_as_the_page_says():
    assert (len(NONLINEAR), len(LIBRARY)) == (53, 266)


@pytest.mark.one_in(20)
@pytest.mark.parametrize("name", LIBRARY)
def test_every_template_has_a_form(name):
    template = LIBRARY[name]
    channels = tuple(f"c{n}" for n in range(max(template.inputs, template.layers)))

    def function(frame):
        maps = [getattr(frame, channel) for channel in channels]
        needs_input = template.inputs or template.initial == "input"
        role, count = ("input", template.inputs) if needs_input else ("state", template.layers)
        return {
            "x": cnnum.transient(template, **{role: maps[: count or template.layers]}).states[0]
        }

    planned = schedule(cnnum.Program(function, name).trace(SHAPE, channels), channels, None)
    reals = precision_named("float32")
    assert lower(name, planned, solvers_for(planned), NoFormats(reals)).of_kind("output")


@pytest.mark.one_in(6)
@pytest.mark.parametrize("name", NONLINEAR)
def test_they_are_those_of_the_reference(name):
    found = {}
    for precision in ("float32", "q15"):
        made, frames = exported(name, precision)
        found[precision] = made.run(frames)
    plan = cnnum.Engine("reference").compile(program(name, "euler"), SHAPE, channels=CHANNELS)
    wanted = plan(frames)
    # where rates jump, a rounding lets the jump come a step earlier or later
    apart = {"float32": 1e-5, "q15": 3e-3}
    jump = 0.05 if jumps(LIBRARY[name]) or LIBRARY[name].output.discrete else 0.0
    for key, values in wanted.items():
        size = max(1.0, np.abs(values).max())
        for precision, off in apart.items():
            worst = np.abs(found[precision][key] - values).max() / size
            assert worst <= off + jump, (key, precision, worst)


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
@pytest.mark.parametrize("name", ["MATCNN_ANISO", "MAX", "LIFE", "PARITY", "ECHO", "FADING"])
def test_the_c_has_the_same_bits(name, tmp_path):
    made, frames = exported(name, "q15")
    made.export(frames[:, 0]).write(tmp_path)
    shown = 1.5 * frames[:, :1]
    given = cnnum.load_export(tmp_path).run(shown[:, 0])
    for key, values in made.run(shown).items():
        np.testing.assert_array_equal(given[key], values[:, 0])


def test_a_function_of_two_cells_has_no_form():
    function = PairFunction("product", lambda c, n: c * n, "c * n", 2.0)
    coupling = cnnum.NonlinearCoupling(np.full((3, 3), 0.1), function, "y", "y")
    template = cnnum.Template("pairs", [[0.0]], nonlinear=(coupling,))
    own = cnnum.Program(lambda frame: {"y": cnnum.apply(template, state=frame.a, duration=1)}, "p")
    with pytest.raises(NotSupportedError, match="'product' of two cells"):
        cnnum.export(own, like=np.ones((3, *SHAPE, 3)), channels=CHANNELS)


def timed(seed):
    """A template with a delay, gains or both; its run may have a last step that is shorter."""
    rng = np.random.default_rng(seed)
    layers, inputs = int(rng.integers(1, 3)), int(rng.integers(1, 3))
    kinds = {0: ("delay",), 1: ("gain",), 2: ("delay", "gain")}[seed % 3]
    boundary = [0.0, 0.5, "zero-flux", "periodic"][int(rng.integers(4))]

    def weights(*sizes):
        return 0.2 * rng.uniform(-1.0, 1.0, (*sizes, 3, 3)) * (rng.random((*sizes, 3, 3)) < 0.6)

    def gain(to):
        places = np.sort(rng.uniform(0.0, 1.5, 3))
        points = tuple(zip(places.tolist(), rng.uniform(0.0, 2.0, 3).tolist(), strict=True))
        return cnnum.Gain(
            to, int(rng.integers(layers)), cnnum.Table(["constant", "linear"][to], points)
        )

    delay = cnnum.DelayedCoupling(
        float(rng.uniform(0.1, 1.2)), weights(layers, layers), weights(layers, inputs)
    )
    template = cnnum.Template(
        f"timed_{seed}",
        weights(layers, layers),
        weights(layers, inputs),
        rng.uniform(-0.1, 0.1, layers),
        tau=rng.uniform(0.8, 1.5, layers),
        boundary=boundary,
        output=["standard", "full-range", "linear"][int(rng.integers(3))],
        delayed=delay if "delay" in kinds else None,
        gains=tuple(gain(to) for to in range(layers)) if "gain" in kinds else (),
    )
    spec = cnnum.RunSpec(duration=float(rng.uniform(0.5, 2.0)), method="euler")
    before = bool(rng.integers(2)) and "delay" in kinds

    def function(frame):
        maps = [frame.a, frame.b, frame.c]
        given = {"input": maps[:inputs], "state": [0.5 * m for m in maps[::-1][:layers]]}
        if before:
            given["previous"] = [-m for m in maps[:inputs]]
        run = cnnum.transient(template, spec=spec, **given)
        return {f"state_{n}": one for n, one in enumerate(run.states)} | {"time": run.time}

    return cnnum.Program(function, template.name)


@pytest.mark.one_in(3)
@pytest.mark.parametrize("seed", range(12))
def test_delays_and_gains_are_those_of_the_reference(seed):
    """It keeps the history by itself, and has no rings and no tables of gains."""
    program = timed(seed)
    frames = np.random.default_rng(seed).uniform(-1.0, 1.0, (2, 2, *SHAPE, 3))
    planned = schedule(program.trace(SHAPE, CHANNELS), CHANNELS, None)
    wanted = cnnum.Engine("reference").compile(program, SHAPE, channels=CHANNELS)(frames)
    # 3e-3 is a hundred roundings of a state in 16 bits
    for precision, bound in (("float32", 1e-5), ("q15", 3e-3)):
        found = make(program.name, planned, precision_named(precision), frames).run(frames)
        for key, values in wanted.items():
            size = max(1.0, np.abs(values).max())
            assert np.abs(found[key] - values).max() <= bound * size, (key, precision)


def test_a_run_to_rest_with_a_delay_is_one_sentence():
    spec, echo = cnnum.RunSpec(duration="settle"), LIBRARY["ECHO"]
    program = cnnum.Program(
        lambda frame: {"a": cnnum.transient(echo, input=frame.a, spec=spec).states[0]}, "rest"
    )
    with pytest.raises(NotSupportedError, match=r"'ECHO' has a delay .* duration"):
        cnnum.export(program, like=np.ones((3, 4, 4, 3)), channels=CHANNELS)
