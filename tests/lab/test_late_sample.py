"""Random networks with a delay: that the sample says how well engines keep their tolerance."""

import numpy as np
import pytest

import cnnum
from cnnum.lab.stability.late_sample import judged, late_sample, report


@pytest.fixture(scope="module")
def networks():
    return list(late_sample(3, 2))


@pytest.mark.in_full("test_no_error_is_below_the_true_one")
def test_networks_keep_the_tolerance_and_their_stated_error(networks):
    engine = cnnum.Engine("numba", precision="float64")
    for known in networks:
        stated, true, part = judged(engine, known, 1e-4, 1e-5)
        assert np.all(part <= 1.0)
        assert np.all(stated >= true)
        assert np.all(known.truth.error < 1e-6)


def test_past_inputs_and_past_outputs_count(networks):
    for known in networks:
        maps = {**known.maps, "previous": known.maps["input"]}
        other = cnnum.Engine("numba").run(known.template, **maps)
        assert known.template.delayed.A.any()
        assert np.abs(other.state - known.truth.state).max() > 1e-3


def test_the_report_counts_what_is_beyond_the_tolerance():
    runs = [(np.array([1.0, 1.0]), np.array([0.5, 2.0]), np.array([0.4, 3.0]))]
    assert report("mine", runs) == (
        "mine: 2 frames, 50.0% off by more than the tolerance, by 3 times at most; 50.00% covered, "
        "1.2 times the true error in the median"
    )
