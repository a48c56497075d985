"""A template that was written reads back the same."""

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from cnnum.safety.values import SIGNS
from cnnum.templating.couplings import DelayedCoupling, Gain, NonlinearCoupling
from cnnum.templating.files import load_entry, save_template
from cnnum.templating.functions import OUTPUT_FUNCTIONS, Table
from cnnum.templating.template import Check, Template

NUMBERS = st.floats(allow_nan=False, allow_infinity=False)
TEXTS = st.text(st.characters(exclude_categories=["Cs"]), max_size=20)
NAMES = st.text(
    st.one_of(st.characters(categories=["L", "Nd"]), st.sampled_from(SIGNS)),
    min_size=1,
    max_size=20,
)
BOUNDARIES = st.one_of(NUMBERS, st.sampled_from(["zero-flux", "periodic"]))
CHECKS = st.builds(
    Check,
    TEXTS,
    st.dictionaries(
        TEXTS.filter(lambda key: key != "name"), st.one_of(NUMBERS, TEXTS), max_size=3
    ).map(lambda table: tuple(table.items())),
)


@st.composite
def tables(draw: Any) -> Table:
    places = sorted(draw(st.sets(NUMBERS, min_size=1, max_size=4)))
    points = tuple((place, draw(NUMBERS)) for place in places)
    return Table(draw(st.sampled_from(["constant", "linear"])), points)


@st.composite
def couplings(draw: Any, layers: int, inputs: int) -> NonlinearCoupling:
    counts = {"x": layers, "y": layers, **({"u": inputs} if inputs else {})}
    neighbour = draw(st.sampled_from(sorted(counts)))
    centre = draw(st.sampled_from([None, *sorted(counts)]))
    k = draw(st.sampled_from([1, 3]))
    return NonlinearCoupling(
        draw(arrays(np.float64, (k, k), elements=NUMBERS)),
        draw(tables()),
        neighbour,
        centre,
        times_argument=draw(st.booleans()),
        reversed_sign=draw(st.booleans()),
        to=draw(st.integers(0, layers - 1)),
        source=draw(st.integers(0, counts[neighbour] - 1)),
        centre_source=draw(st.integers(0, counts[centre] - 1)) if centre else 0,
    )


@st.composite
def delays(draw: Any, layers: int, inputs: int) -> DelayedCoupling:
    k = draw(st.sampled_from([1, 3]))
    return DelayedCoupling(
        draw(st.floats(1e-6, 1e6)),
        draw(arrays(np.float64, (layers, layers, k, k), elements=NUMBERS)),
        draw(arrays(np.float64, (layers, inputs, k, k), elements=NUMBERS))
        if inputs
        else np.zeros((layers, 0, 1, 1)),
    )


@st.composite
def templates(draw: Any) -> Template:
    layers = draw(st.integers(1, 3))
    inputs = draw(st.sampled_from([0, 1, layers]))
    sizes = st.sampled_from([1, 3, 5])
    k, m = draw(sizes), draw(sizes)
    per_layer = arrays(np.float64, layers, elements=NUMBERS)
    layer = st.integers(0, layers - 1)
    output = draw(st.sampled_from(sorted(OUTPUT_FUNCTIONS)))
    times = arrays(np.float64, layers, elements=st.floats(1e-9, 1e9))
    starts = st.floats(-1.0, 1.0) if OUTPUT_FUNCTIONS[output].limited else NUMBERS
    return Template(
        draw(NAMES),
        A=draw(arrays(np.float64, (layers, layers, k, k), elements=NUMBERS)),
        B=draw(arrays(np.float64, (layers, inputs, m, m), elements=NUMBERS)) if inputs else None,
        z=draw(per_layer),
        tau=1.0 if OUTPUT_FUNCTIONS[output].discrete else draw(times),
        boundary=draw(BOUNDARIES),
        input_boundary=draw(st.one_of(st.none(), BOUNDARIES)),
        initial=draw(st.one_of(starts, st.just("input")) if inputs in (0, layers) else starts),
        duration=draw(st.one_of(st.floats(0, 1e6), st.just("settle"))),
        output=output,
        nonlinear=draw(st.lists(couplings(layers, inputs), max_size=2)),
        delayed=draw(st.one_of(st.none(), delays(layers, inputs))),
        gains=draw(
            st.lists(
                st.builds(Gain, layer, layer, tables()),
                max_size=2,
                unique_by=lambda gain: (gain.to, gain.source),
            )
        ),
        description=draw(TEXTS),
        source=draw(TEXTS),
        check=draw(st.one_of(st.none(), CHECKS)),
    )


@given(templates(), st.lists(NAMES, max_size=3))
@settings(deadline=None, max_examples=80)
def test_load_of_save_is_the_same_template(template: Template, aliases: list[str]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "saved.toml"
        save_template(template, path, aliases=aliases)
        entry = load_entry(path)
    again = entry.template
    assert entry.aliases == tuple(aliases)
    for part in ("name", "description", "source", "check", "initial", "duration", "output"):
        assert getattr(again, part) == getattr(template, part)
    for part in ("boundary", "input_boundary"):
        assert getattr(again, part) == getattr(template, part)
    for part in ("A", "B", "z", "tau"):
        np.testing.assert_array_equal(getattr(again, part), getattr(template, part))
    assert again.gains == template.gains
    assert len(again.nonlinear) == len(template.nonlinear)
    for read, written in zip(again.nonlinear, template.nonlinear, strict=True):
        np.testing.assert_array_equal(read.weights, written.weights)
        assert read.physics[1:] == written.physics[1:]
    if again.delayed is None or template.delayed is None:
        assert again.delayed is template.delayed
    else:
        assert again.delayed.delay == template.delayed.delay
        np.testing.assert_array_equal(again.delayed.A, template.delayed.A)
        np.testing.assert_array_equal(again.delayed.B, template.delayed.B)
    assert again.digest == template.digest
