"""Reading what was written gives the same template."""

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from cnnum.outputs import OUTPUT_FUNCTIONS
from cnnum.template import Check, Template
from cnnum.template_files import load_entry, save_template

NUMBERS = st.floats(allow_nan=False, allow_infinity=False)
TEXTS = st.text(st.characters(exclude_categories=["Cs"]), max_size=20)
BOUNDARIES = st.one_of(NUMBERS, st.sampled_from(["zero-flux", "periodic"]))
CHECKS = st.builds(
    Check,
    TEXTS,
    st.dictionaries(
        TEXTS.filter(lambda key: key != "name"), st.one_of(NUMBERS, TEXTS), max_size=3
    ).map(lambda table: tuple(table.items())),
)


@st.composite
def templates(draw: Any) -> Template:
    layers = draw(st.integers(1, 3))
    inputs = draw(st.sampled_from([0, 1, layers]))
    sizes = st.sampled_from([1, 3, 5])
    k, m = draw(sizes), draw(sizes)
    per_layer = arrays(np.float64, layers, elements=NUMBERS)
    return Template(
        draw(TEXTS),
        A=draw(arrays(np.float64, (layers, layers, k, k), elements=NUMBERS)),
        B=draw(arrays(np.float64, (layers, inputs, m, m), elements=NUMBERS)) if inputs else None,
        z=draw(per_layer),
        tau=draw(arrays(np.float64, layers, elements=st.floats(1e-9, 1e9))),
        boundary=draw(BOUNDARIES),
        input_boundary=draw(st.one_of(st.none(), BOUNDARIES)),
        initial=draw(st.one_of(NUMBERS, st.just("input")) if inputs in (0, layers) else NUMBERS),
        duration=draw(st.one_of(st.floats(0, 1e6), st.just("settle"))),
        output=draw(st.sampled_from(sorted(OUTPUT_FUNCTIONS))),
        description=draw(TEXTS),
        source=draw(TEXTS),
        check=draw(st.one_of(st.none(), CHECKS)),
    )


@given(templates(), st.lists(TEXTS, max_size=3))
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
    assert again.digest == template.digest
