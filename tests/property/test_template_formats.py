"""Files of other programs: a written template comes back."""

import tempfile
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from cnnum.errors import CnnumError
from cnnum.templating.couplings import DelayedCoupling, NonlinearCoupling
from cnnum.templating.files import load_template, save_template
from cnnum.templating.functions import Table
from cnnum.templating.template import Template

NUMBERS = st.floats(-20.0, 20.0, allow_nan=False).map(lambda v: round(v, 4) + 0.0)
KERNELS = st.lists(st.lists(NUMBERS, min_size=3, max_size=3), min_size=3, max_size=3)
PLACES = st.lists(st.integers(-30, 30), min_size=1, max_size=5, unique=True).map(sorted)


@st.composite
def tables(draw):
    points = tuple((0.1 * v, draw(NUMBERS)) for v in draw(PLACES))
    return Table(draw(st.sampled_from(["constant", "linear"])), points)


@st.composite
def couplings(draw):
    marks = draw(st.lists(st.booleans(), min_size=9, max_size=9).filter(any))
    neighbour, centre = draw(
        st.sampled_from([("y", "y"), ("u", "u"), ("y", None), ("u", None), ("u", "x"), ("x", "x")])
    )
    weights = np.array(marks, dtype=float).reshape(3, 3)
    factor = draw(st.booleans()) if (neighbour, centre) == ("x", "x") else False
    return NonlinearCoupling(weights, draw(tables()), neighbour, centre, times_argument=factor)


@st.composite
def kernels(draw, to, source):
    numbers = draw(st.lists(NUMBERS, min_size=9 * to * source, max_size=9 * to * source))
    return np.reshape(numbers, (to, source, 3, 3))


@st.composite
def layered(draw):
    """Templates of several layers and inputs, some of them delayed."""
    layers, inputs = draw(st.integers(1, 3)), draw(st.integers(1, 2))
    pair = (layers, layers), (layers, inputs)
    late = DelayedCoupling(draw(st.integers(1, 9)), *(draw(kernels(*size)) for size in pair))
    delayed = draw(st.sampled_from([None, late if late.A.any() or late.B.any() else None]))
    bias = draw(st.lists(NUMBERS, min_size=layers, max_size=layers))
    control, feedback = draw(kernels(*pair[1])), draw(kernels(*pair[0]))
    return Template("mine", feedback, control, bias, initial=0.0, delayed=delayed)


@st.composite
def templates(draw, plain=False):
    nonlinear = [] if plain else draw(st.lists(couplings(), max_size=2))
    return Template(
        "mine",
        draw(KERNELS),
        draw(KERNELS),
        draw(NUMBERS),
        boundary=draw(st.sampled_from(["zero-flux", -1.0, 0.0, 1.0])),
        initial=draw(st.sampled_from(["input", 0.0, -1.0])),
        nonlinear=nonlinear,
    )


def through(template, suffix):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"mine{suffix}"
        save_template(template, path)
        return load_template(path)


@given(templates())
@settings(max_examples=60, deadline=None)
def test_tem_keeps_every_number(template):
    back = through(template, ".tem")
    for part in ("A", "B", "z"):
        np.testing.assert_array_equal(getattr(back, part), getattr(template, part))
    assert (back.boundary, back.initial) == (template.boundary, template.initial)
    assert parts_of(back) == parts_of(template)


def parts_of(template):
    """Return every cell of the nonlinear couplings with its function, in any order."""
    return sorted(
        (
            *(*map(int, place), c.weights[tuple(place)]),
            str((c.neighbour, c.centre, c.times_argument, c.reversed_sign)),
            *(c.function.interpolation, c.function.points),
        )
        for c in template.nonlinear
        for place in np.argwhere(c.weights)
    )


@given(layered())
@settings(max_examples=40, deadline=None)
def test_tem_keeps_layers_inputs_and_delays(template):
    back = through(template, ".tem")
    for part in ("A", "B", "z"):
        np.testing.assert_array_equal(getattr(back, part), getattr(template, part))
    assert (back.delayed is None) == (template.delayed is None)
    if template.delayed is not None:
        assert back.delayed.delay == template.delayed.delay
        np.testing.assert_array_equal(back.delayed.A, template.delayed.A)
        np.testing.assert_array_equal(back.delayed.B, template.delayed.B)


@given(couplings(), KERNELS, NUMBERS)
@settings(max_examples=40, deadline=None)
def test_matcnn_keeps_every_function(coupling, feedback, factor):
    centre = coupling.centre or coupling.neighbour
    weights = factor * coupling.weights
    tabled = replace(coupling, centre=centre, weights=weights, reversed_sign=True)
    template = Template("mine", feedback, np.zeros((3, 3)), nonlinear=[tabled])
    back = through(template, ".m")
    np.testing.assert_array_equal(back.A, template.A)
    assert parts_of(back) == parts_of(template)


@given(templates(plain=True))
@settings(max_examples=40, deadline=None)
def test_cnnsim_and_matcnn_keep_every_weight(template):
    for suffix in (".cnnsim", ".m"):
        back = through(template, suffix)
        for part in ("A", "B", "z"):
            np.testing.assert_array_equal(getattr(back, part), getattr(template, part))
    assert through(template, ".cnnsim").boundary == template.boundary


PIECES = [
    *("FEEDBACK", "CONTROL FROM 1", "NONLIN_D", "x-u#", "NONLIN_CONTROL", "NRLAYERS 2"),
    *("LAYER 1", "NEIGHBORHOOD 0", "DELAY 3", "DELAYED_CONTROL", "CURRENT", "a 0 1 -1 0"),
    *("a- a0 d", "NEW", "0 0 0 0 1 0 0 0 0", "1", "-.5", "nan", "1e400", ")", "MINE_A = [1];"),
    *("%Setting: IniState:P", "MINE_Dd = [1 1 1]", "MINE_Bb = [1]", "MINE_d = [0 1 0 0 12];"),
    *("MINE_b = [nan nan];", "[1 2", "C ZeroFlux", "A", "Z 1", "\x1a", "\n"),
]


@given(st.lists(st.one_of(st.sampled_from(PIECES), st.text(max_size=6)), max_size=12))
@settings(max_examples=50, deadline=None)
def test_any_text_is_a_template_or_an_error_of_ours(pieces):
    for suffix in (".tem", ".m", ".cnnsim"):
        for between in (" ", "\n"):
            with tempfile.TemporaryDirectory() as folder:
                path = Path(folder) / f"mine{suffix}"
                path.write_text(between.join(pieces), encoding="utf-8")
                with suppress(CnnumError):
                    assert load_template(path).layers >= 1
