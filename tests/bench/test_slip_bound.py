"""The oracle of slip: its power against drawn readings, its distance against simulated frames."""

import numpy as np
import pytest

from cnnum.drivers.simulated.array import SimulatedArray
from cnnum.lab.bench.programs.slip_bound import FALSE, all_told, power, told
from cnnum.lab.scoring.generated.scripts import slip_case
from cnnum.report.verdicts import MAX_DELAY


@pytest.mark.parametrize("apart", [0.0, 1.0, 3.0])
def test_power_is_that_of_a_likelihood_ratio(apart):
    """Draws of the ratio itself: 200,000 of them know a share to 0.0011; four times that."""
    rng = np.random.default_rng(2)
    way = rng.normal(size=12)
    way *= apart / max(np.linalg.norm(way), 1e-30)
    stays, slips = rng.normal(size=(2, 200_000, 12))
    mark = np.quantile(stays @ way, 1.0 - FALSE)
    seen = ((slips + way) @ way > mark).mean() if apart else FALSE
    assert power(apart) == pytest.approx(seen, abs=4.5e-3)


def test_distance_is_that_of_the_frames_that_are_read():
    """With the noise as the array's own readings at rest have it, and with its own truth."""
    case = next(c for c in map(slip_case, range(200)) if c.kind == "pull" and not c.faults.drift)
    found = told(case)
    assert found is not None
    array = SimulatedArray(case.settings)
    frames = list(array.frames())
    strain = array.calibration.to_strain(np.stack([frame.values for frame in frames]))
    onset = next(n for n, frame in enumerate(frames) if frame.truth["slip"])
    rest = strain[: int(0.5 * case.settings.rate)]
    noise = np.diff(rest, axis=0).std(axis=(0, 1, 2)) / np.sqrt(2.0)
    moved = (strain[onset : onset + MAX_DELAY + 1] - strain[onset - 1]) / noise
    # noise adds one to every square, and as much again for the frame that is common to all
    read = (moved**2).sum() - 2.0 * moved.size
    # the noise is known from 30 frames or more of 16 taxels or more, to 5 % of a power at worst;
    # and the sum of squares scatters by the noise it holds
    spread = 0.05 * found.apart**2 + 4.0 * np.sqrt(2.0 * 4.0 * moved.size + 8.0 * found.apart**2)
    assert read == pytest.approx(found.apart**2, abs=spread)


def test_scoring_seeds_are_left_alone():
    assert not list(all_told(range(1_000_000, 1_000_003)))
