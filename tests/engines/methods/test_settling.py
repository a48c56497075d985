"""Runs to equilibrium come to rest, and say so; those that cannot, say that."""

import importlib
import time
from contextlib import suppress

import numpy as np
import pytest
from scipy.optimize import brentq

import cnnum
from cnnum.templating.template import Template

WILD = Template("wild", [[0.0, 0.0, 9e15], [0.0, 2.0, 0.0], [0.0, 0.0, 0.0]])
WILD_START = np.random.default_rng(0).uniform(-1.0, 1.0, (16, 16))

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


@pytest.mark.parametrize("label", NAMES)
def test_masked_cells_rest_at_their_exact_start(engines, label):
    """Their start is not a number of single precision, and their neighbours rest by it."""
    template = Template(
        "held",
        [[0.0, 0.0, 0.0], [0.0, 0.9, 0.4], [0.0, 0.0, 0.0]],
        output="tanh",
        duration="settle",
    )
    start, mask = np.array([[0.3, 0.1, -0.7]]), np.array([[False, True, True]])
    result = engines[label].run(template, state=start, mask=mask)
    assert result.state[mask].tolist() == start[mask].tolist()
    # x = 0.9 tanh(x) + 0.4 tanh(0.1)
    rest = 0.0
    for _ in range(2000):
        rest = 0.9 * np.tanh(rest) + 0.4 * np.tanh(0.1)
    assert abs(result.state[0, 0] - rest) <= result.error < 1e-3


@pytest.mark.one_in(2)
@pytest.mark.parametrize("name", ["numba", "opencl"])
def test_a_weight_beyond_all_reason_takes_no_minute(name):
    """One of 9e15 on 16×16: nothing is claimed of its rest, after a budget of steps."""
    began, known = time.process_time(), np.inf
    with suppress(cnnum.CnnumError):
        known = cnnum.Engine(name).run(WILD, state=WILD_START, duration="settle").error
    assert np.isinf(known) or known < 1e12  # a part of states of 9e15
    assert time.process_time() - began < 30.0


def test_the_reference_gives_up_such_a_weight(monkeypatch):
    """It factored matrices for ten minutes; the whole budget is half a minute."""
    module = importlib.import_module("cnnum.engines.reference.solve")
    assert module.MOST_WORK <= 3e8
    monkeypatch.setattr(module, "MOST_WORK", 2e7)
    with pytest.raises(cnnum.errors.MethodError, match=r"^The reference solver gives up after"):
        cnnum.Engine("reference").run(WILD, state=WILD_START, duration="settle")


@pytest.mark.one_in(2)
@pytest.mark.parametrize("label", NAMES)
def test_a_start_beside_a_saddle_is_proven_to_leave_it(engines, label):
    """The tolerance of x' = −x + 2 tanh(x) holds both sides of 0; a finer run tells them apart."""
    template = Template("beside", [[2.0]], output="tanh", duration="settle")
    starts = np.array([-1e-6, 1e-12]).reshape(2, 1, 1)
    result = engines[label].run(template, state=starts)
    truth = np.sign(starts) * brentq(lambda x: x - 2.0 * np.tanh(x), 1.0, 2.0, xtol=1e-15)
    assert result.certified.tolist() == ["proven"] * 2
    assert result.stability.tolist() == ["stable"] * 2
    # the truth itself is known to 1e-15, times 3 where 2 tanh is solved for
    assert (np.abs(result.state - truth)[:, 0, 0] <= result.error + 4e-15).all()
    assert (result.error <= 1e-5 + 1e-4 * 2.0).all()
