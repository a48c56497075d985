"""Runs to equilibrium come to rest, and say so; those that cannot, say that."""

import numpy as np
import pytest

import cnnum
from cnnum.templating.template import Template

NAMES = ("opencl-float32", "opencl-float64", "numba-float32", "numba-float64")


@pytest.mark.parametrize("label", NAMES)
@pytest.mark.parametrize("name", ["HOLE", "CCD_HOR", "CCD_VERT", "SHADOW"])
def test_propagating_templates_come_to_rest_on_every_picture(engines, label, name):
    """Steps at the stability bound made about one picture in a hundred bounce for ever."""
    pictures = np.where(np.random.default_rng(0).random((200, 8, 8)) < 0.5, 1.0, -1.0)
    result = engines[label].run(cnnum.get_template(name), input=pictures, duration="settle")
    assert result.settled.all()
    # nothing travels further than around the array: 64 cells, a few time constants each
    assert result.time.max() < 300


@pytest.mark.parametrize("label", NAMES)
def test_what_never_rests_is_reported(engines, label):
    """Two cells that chase each other: x' = −x + 2 f(x) ∓ 2 f(y), a limit cycle."""
    one, other = np.zeros((3, 3)), np.zeros((3, 3))
    one[1, 1], other[1, 1] = 2.0, 2.0
    template = Template("chase", [[one, -other], [other, one]], initial=0.1, duration="settle")
    start = np.stack([np.full((2, 2), 0.3), np.full((2, 2), -0.2)])
    result = engines[label].run(template, state=start)
    assert not result.settled
    assert result.time == pytest.approx(1000.0)  # the limit of a run to equilibrium


@pytest.mark.parametrize("label", NAMES)
@pytest.mark.parametrize("duration", [0.0, 5e-324, 1e-40, 1e-20])
def test_no_time_is_no_change(engines, label, duration):
    """Durations that a device would flush to 0 end at once, where they start."""
    template = Template("any", [[0.9]], z=0.3, duration=duration)
    result = engines[label].run(template, state=np.full((2, 3), 0.25))
    assert np.abs(result.state - 0.25).max() <= 1e-7
    assert result.time <= 1e-20 * (1 + 1e-6)
