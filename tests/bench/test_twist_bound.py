"""The bound of a twist's rate: its noise, and what must make it larger or smaller."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from cnnum.drivers.simulated.array import SimulatedArray
from cnnum.drivers.simulated.script import Phase
from cnnum.drivers.simulated.settings import Settings
from cnnum.lab.bench.programs.twist_bound import bound_of, bounds, chance, least_error
from cnnum.lab.scoring.generated.case import SCORING, Case
from cnnum.lab.scoring.generated.faults import Faults

SCRIPT = (
    Phase("hold", 0.2),
    Phase("press", 0.2, load=0.5),
    Phase("hold", 0.2),
    Phase("twist", 0.3, angle=0.2),
)
SETTINGS = Settings(shape=(4, 4), rate=60.0, start=(1e-4, 2e-4), bits=0, script=SCRIPT)


def case(faults=None, **options):
    return Case("slip", 1, "twist", replace(SETTINGS, **options), faults or Faults())


def test_error_is_as_large_as_the_noise():
    """Nothing else is in it, once the converter does not round: exact."""
    once, twice = (bound_of(case(noise=noise)) for noise in (2e-3, 4e-3))
    assert twice.error == pytest.approx(2.0 * once.error, rel=1e-6)
    assert twice.early == pytest.approx(2.0 * once.early, rel=1e-6)


def test_error_is_that_of_least_squares_on_noisy_frames():
    """The rate alone unknown, but for offsets: 160 draws' scatter is known to 5.6 %, thrice that
    is allowed. Whatever else is unknown can only make it larger.
    """
    settings = replace(SETTINGS, noise=2.5e-3)
    faster = tuple(replace(phase, angle=1.01 * phase.angle) for phase in SCRIPT)
    clean, fast = (
        np.concatenate([array.strain([state]) for state, _ in array.scans()])
        for array in (SimulatedArray(settings), SimulatedArray(replace(settings, script=faster)))
    )
    array = SimulatedArray(settings)
    shear, normal = array.calibration.strain_noise(settings.noise)
    slope = (fast - clean) / 0.01 / [shear, shear, normal]
    free = slope - slope.mean(axis=0)
    found = []
    for _ in range(160):
        noise = array.calibration.to_strain(array.read(clean).volts) - clean
        found.append((free * noise / [shear, shear, normal]).sum() / (free**2).sum())
    alone = least_error(slope[None])
    assert np.std(found) == pytest.approx(alone, rel=0.17)
    assert bound_of(case(noise=2.5e-3)).error > alone


def test_less_to_go_by_makes_it_larger():
    whole = bound_of(case())
    assert whole.error < whole.early
    assert bound_of(case(Faults(seed=3, dead=2))).error > whole.error
    assert bound_of(case(Faults(seed=3, noisy=2))).error > whole.error
    pulled = (*SCRIPT[:3], Phase("pull", 0.1, speed=1e-3), Phase("relax", 0.2), SCRIPT[3])
    assert 0.0 < bound_of(case(script=pulled)).error < 1.0


def test_chance_is_that_of_a_normal_error():
    assert chance(0.05) == pytest.approx(norm.cdf(2.0) - norm.cdf(-2.0), abs=1e-12)


def test_scoring_seeds_are_left_alone():
    assert not list(bounds(range(SCORING, SCORING + 40)))
