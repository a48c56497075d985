"""Steps at the stability bound of arrays with a delay, against dense roots and runs."""

import math

import numpy as np
import pytest

import cnnum
from cnnum.errors import MethodError
from cnnum.integrators.stability import METHODS, stability_bound
from cnnum.templating.checks.analytic.courses import by_steps
from cnnum.templating.couplings import DelayedCoupling
from cnnum.templating.template import Template

WITH_DELAYS = ("euler", "heun")
SMOOTHING = np.array([[0.1, 0.2, 0.1], [0.2, -1.2, 0.2], [0.1, 0.2, 0.1]])


def late(kernel, delay):
    kernel = np.atleast_2d(np.asarray(kernel, dtype=float))
    return DelayedCoupling(delay, kernel[np.newaxis, np.newaxis], np.zeros((1, 0, 1, 1)))


def lone(now, seen, delay, output="linear"):
    """Cells on their own: x' = now·x + seen·x(t − delay)."""
    return Template("late", [[now + 1.0]], output=output, delayed=late(seen, delay))


def largest_root(method, now, seen, delay, count):
    """The largest growth of a mode in each of `count` steps a delay, by its polynomial's roots."""
    step = delay / count
    if method == "euler":
        kept, before, after = 1.0 + step * now, step * seen, 0.0
    else:
        kept = 1.0 + step * now + (step * now) ** 2 / 2.0
        before, after = step * seen / 2.0 * (1.0 + step * now), step * seen / 2.0
    polynomial = np.zeros(count + 2)
    polynomial[0] = 1.0
    polynomial[1] -= kept
    polynomial[-2] -= after
    polynomial[-1] -= before
    return float(np.abs(np.roots(polynomial)).max())


@pytest.mark.one_in(3)
@pytest.mark.parametrize("method", WITH_DELAYS)
def test_the_bound_is_where_the_roots_of_a_mode_leave_the_unit_circle(method):
    rng, known = np.random.default_rng(1), 0
    for _ in range(60):
        now, seen, delay = 3.0 * rng.normal() - 1.0, 3.0 * rng.normal(), rng.uniform(0.1, 3.0)
        bound = stability_bound(lone(now, seen, delay), (3, 3), method)
        roots = [largest_root(method, now, seen, delay, count) for count in range(1, 25)]
        # of a mode that grows by itself, steps keep what decays without the delay
        if largest_root("heun", now, seen, delay, 150) > 1.0 + 1e-6:
            assert not bound.exact
            assert now > 0.0 or min(bound.step, delay) * -now <= 2.0 + 1e-9
            continue
        assert bound.exact
        outside = [count for count, root in enumerate(roots, 1) if root > 1.0 + 1e-8]
        if outside == [*range(1, 25)]:
            assert bound.step < delay / 24
        elif not outside:
            assert math.isinf(bound.step)
        else:
            known += 1
            assert delay / bound.step == pytest.approx(max(outside) + 1)
    assert known > 10


@pytest.mark.parametrize("name", ["reference", "numba"])
def test_a_step_that_its_delay_makes_unstable_is_refused_and_marked(name):
    """x' = −x − 3 x(t − ½) decays by itself; Euler's steps of ½ make 1e3 of it."""
    engine, template = cnnum.Engine(name), lone(-1.0, -3.0, 0.5)
    start = np.full((4, 4), 0.5)
    with pytest.raises(MethodError, match=r"dt=0\.5 is outside the stability bound 0\.1667"):
        engine.run(template, state=start, method="euler", dt=0.5, duration=20.0)
    forced = engine.run(template, state=start, method="euler", dt=0.5, duration=20.0, force=True)
    assert np.abs(forced.state).max() > 100.0
    assert np.all(np.isinf(forced.error))
    assert not np.any(forced.settled)
    truth = 0.5 * float(by_steps(np.array(-1.0), np.array(-3.0), 0.5, 4.0))
    auto = engine.run(template, state=start, duration=4.0)
    # Heun's error is h² |σ|³ / 12 of a mode a time constant: σ = −0.35 + 3.5 i, 0.9 % in steps of
    # 0.05, over 4 of them, of a state that has fallen to ½ e^{−1.4}
    assert np.abs(auto.state - truth).max() < 4 * 0.009 * 0.12


@pytest.mark.parametrize("boundary", [0.0, "zero-flux", "periodic"])
@pytest.mark.parametrize(("method", "now", "delay"), [("euler", 0.3, 0.4), ("heun", 3.0, 1.0)])
def test_no_mode_of_an_array_that_decays_grows_in_steps_at_its_bound(method, now, delay, boundary):
    seen = late(2.6 * SMOOTHING, delay)
    template = Template(
        "late waves", now * SMOOTHING, boundary=boundary, output="linear", delayed=seen
    )
    bound = stability_bound(template, (6, 7), method)
    assert bound.exact
    assert 0.0 < bound.step < delay
    start = np.random.default_rng(2).uniform(-1.0, 1.0, (6, 7))
    engine = cnnum.Engine("reference")

    def left(step, **options):
        found = engine.run(template, state=start, method=method, dt=step, duration=60.0, **options)
        return float(np.abs(found.state).max())

    longer = delay / (round(delay / bound.step) - 1)
    assert left(bound.step) < 1.0
    with pytest.raises(MethodError, match="outside the stability bound"):
        left(longer)
    assert left(longer, force=True) > 10.0


@pytest.mark.parametrize("method", WITH_DELAYS)
def test_an_array_that_saturates_comes_to_rest_in_steps_at_its_bound(method):
    """It is a contraction by its row sums, whatever cells saturate: 1 > 0.3 + 0.6."""
    kernel = np.array([[0.1, -0.3, 0.1], [0.0, 0.0, 0.0], [0.05, 0.0, 0.05]])
    template = Template("late contraction", 0.5 * kernel, boundary=0.0, delayed=late(kernel, 2.0))
    bound = stability_bound(template, (5, 5), method)
    assert not bound.exact
    assert bound.step > 0.5
    start = np.random.default_rng(3).uniform(-3.0, 3.0, (5, 5))
    step = min(bound.step, 2.0)
    found = cnnum.Engine("reference").run(
        template, state=start, method=method, dt=step, duration=100.0
    )
    assert np.abs(found.state).max() < 1e-4


def test_methods_that_keep_no_outputs_between_steps_have_none():
    template = lone(-1.0, 0.5, 1.0)
    for method in METHODS:
        assert (stability_bound(template, (3, 3), method).step > 0.0) == (method in WITH_DELAYS)


def test_where_inputs_alone_are_late_the_bound_is_the_arrays_own():
    delayed = DelayedCoupling(1.0, np.zeros((1, 1, 1, 1)), np.ones((1, 1, 1, 1)))
    template = Template("late input", [[0.0]], [[1.0]], output="linear", delayed=delayed)
    assert stability_bound(template, (3, 3), "euler").step == pytest.approx(2.0)


def test_many_modes_are_looked_at_on_a_grid():
    """4,096 modes on two cosines: the bound is a small array's, whose are among them."""

    def of(shape):
        delayed = late(2.6 * SMOOTHING, 0.4)
        template = Template(
            "late waves", 0.3 * SMOOTHING, boundary="periodic", output="linear", delayed=delayed
        )
        return stability_bound(template, shape, "euler")

    assert of((8, 8)).exact
    assert not of((64, 64)).exact
    assert of((64, 64)).step == pytest.approx(of((8, 8)).step)
