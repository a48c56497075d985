"""The ladder of methods: its errors fall as its rungs promise."""

import numpy as np
import pytest

import cnnum
from cnnum.report import measure_work_precision
from cnnum.report.work_precision import Rung


@pytest.fixture(scope="module")
def points() -> dict[Rung, float]:
    ladder = (
        Rung("propagator"),
        *(Rung("euler", dt=dt) for dt in (0.1, 0.05)),
        *(Rung("rk4", dt=dt) for dt in (0.1, 0.05)),
        Rung("bogacki-shampine", rtol=1e-3),
        Rung("euler", dt=5.0),
    )
    found = measure_work_precision(
        cnnum.get_template("tactile_diffusion"),
        [cnnum.Engine("opencl", precision="float64")],
        ladder=ladder,
        batch=5,
        repeats=2,
        shape=(6, 6),
    )
    assert all(p.pictures >= 5 and p.seconds > 0 and p.spread >= 0 for p in found)
    assert {(p.case, p.engine, p.precision) for p in found} == {
        ("tactile_diffusion", "opencl", "float64")
    }
    return {Rung(p.method, p.tolerance, p.step): p.error for p in found}


def test_a_step_beyond_the_bound_is_left_out(points: dict[Rung, float]) -> None:
    assert Rung("euler", dt=5.0) not in points
    assert len(points) == 6


@pytest.mark.parametrize(("method", "order"), [("euler", 1), ("rk4", 4)])
def test_halving_the_step_gains_its_order(
    points: dict[Rung, float], method: str, order: int
) -> None:
    coarse, fine = points[Rung(method, dt=0.1)], points[Rung(method, dt=0.05)]
    # at these steps the next term of the expansion still changes the slope by a tenth or two
    assert np.log2(coarse / fine) == pytest.approx(order, abs=0.35)


def test_the_propagator_is_exact(points: dict[Rung, float]) -> None:
    # the reference run is within 1e-10 of the truth
    assert points[Rung("propagator")] < 1e-9


def test_an_adaptive_rung_keeps_its_tolerance_about(points: dict[Rung, float]) -> None:
    # 1e-3 bounds the error of one step; a few steps add up, and none is far from it
    assert 1e-6 < points[Rung("bogacki-shampine", rtol=1e-3)] < 2e-2
