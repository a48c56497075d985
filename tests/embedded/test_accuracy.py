"""Programs in whole numbers against the same in double precision on the reference engine."""

import numpy as np
import pytest

import cnnum
from tests.embedded.conftest import SHORT, made, streams


@pytest.fixture(scope="module")
def reference():
    frames, found = streams((8, 8)), {}
    for name in ("slip", "twist"):
        engine = cnnum.Engine("reference")
        plan = engine.compile(cnnum.get_program(name).bind(**SHORT), (8, 8))
        stream = plan.stream((frames.shape[1],))
        answers = [stream.push(frame) for frame in frames]
        found[name] = {key: np.array([one[key] for one in answers]) for key in answers[0]}
    return found


# measured: 6e-4 of the largest strength in q15; a word of 7 bits sees little of a pattern's change
@pytest.mark.parametrize(("precision", "off"), [("q15", 2e-3), ("q7", 1.0)])
@pytest.mark.parametrize("name", ["slip", "twist"])
def test_strengths_are_near(name, precision, off, reference):
    output = f"{name}_strength"
    found, wanted = made(name, precision).run(streams((8, 8)))[output], reference[name][output]
    assert np.abs(wanted).max() > 0.05
    assert np.abs(found - wanted).max() <= off * np.abs(wanted).max()


def test_flags_are_the_same_in_q15(reference):
    for name, flag in (("slip", "gross_slip"), ("twist", "twist")):
        wanted = reference[name][flag]
        assert wanted.any()
        np.testing.assert_array_equal(made(name, "q15").run(streams((8, 8)))[flag], wanted)


def test_float32_is_the_same_program(reference):
    found = made("slip", "float32").run(streams((8, 8)))["slip_strength"]
    # single precision, and one product through the modes of the array
    np.testing.assert_allclose(found, reference["slip"]["slip_strength"], atol=1e-4)
