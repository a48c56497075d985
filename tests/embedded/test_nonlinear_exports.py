"""Templates with nonlinear couplings, and those of discrete time, against the reference engine.

It shares no code with the lowering, and takes the same steps of Euler.
"""

import shutil

import numpy as np
import pytest

import cnnum
from cnnum.embedded.formats import precision_named
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
    if (template.nonlinear or template.output.discrete)
    and template.delayed is None
    and not template.gains
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
    assert (len(NONLINEAR), len(LIBRARY)) == (45, 266)


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
@pytest.mark.parametrize("name", ["MATCNN_ANISO", "MAX", "LIFE", "PARITY"])
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
