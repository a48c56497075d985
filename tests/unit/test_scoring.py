"""Generated scenes: drawn by seed alone, true to their kind, with the faults that they say."""

import numpy as np
import pytest

from cnnum.drivers.simulated.array import SimulatedArray
from cnnum.drivers.simulated.motion import total_scans
from cnnum.drivers.simulated.script import Phase
from cnnum.drivers.simulated.settings import Settings
from cnnum.lab.scoring.generated.bounds import LOOSE_TORQUE, Bounds, load_of
from cnnum.lab.scoring.generated.case import SCORING, seed_set
from cnnum.lab.scoring.generated.draw import YOUNGS_MODULUS
from cnnum.lab.scoring.generated.faults import Faults
from cnnum.lab.scoring.generated.scripts import HELD_FOR, held_case, slip_case
from cnnum.lab.scoring.generated.simulate import Simulator
from cnnum.report.record import truth_columns
from cnnum.tactile.contact import sliding_torque, torsion_slip
from cnnum.tactile.taxel import Readout

NO_INFLUENCE = np.empty(0)  # what a contact does on the surface needs no taxels


def truth_of(settings):
    array = SimulatedArray(settings, NO_INFLUENCE)
    return truth_columns([truth for _, truth in array.scans()])


def test_loose_torque_is_where_half_the_radius_sticks():
    torque = LOOSE_TORQUE * float(sliding_torque(1.0, 2e-3, 0.5))
    stick = torsion_slip(1.0, 2e-3, torque, 0.5).stick_radius
    assert stick == pytest.approx(1e-3, rel=1e-4)  # five digits are given


def test_travel_and_turn_are_what_the_simulation_needs():
    """The generator uses Mindlin and Lubkin, the simulation a row of springs."""
    bounds = Bounds(25e-3, load_of(2e-3, 25e-3, YOUNGS_MODULUS), 0.6, YOUNGS_MODULUS)
    lead = (Phase("hold", 0.1), Phase("press", 0.1, load=bounds.load))
    common = {"rate": 1000.0, "youngs_modulus": YOUNGS_MODULUS, "start": (0.0, 0.0)}
    pull = Phase("pull", 1.0, speed=1.2 * bounds.travel())
    truth = truth_of(Settings(script=(*lead, pull), **common))
    assert truth["contact_radius"][200] == pytest.approx(2e-3, rel=1e-6)
    # 1.2 times the way in 1000 scans: it slips after 1/1.2 of them, to the 257 springs' resolution
    assert int(np.argmax(truth["slip"] > 0)) - 200 == pytest.approx(1000 / 1.2, abs=5)
    twist = Phase("twist", 1.0, angle=1.5 * bounds.turn())
    truth = truth_of(Settings(script=(*lead, twist), **common))
    assert int(np.argmax(truth["twist_slip"] > 0)) - 200 == pytest.approx(1000 / 1.5, abs=5)


def test_a_seed_gives_the_same_scene_and_each_suite_its_own():
    assert slip_case(5) == slip_case(5)
    assert slip_case(5) != slip_case(6)
    assert slip_case(5).settings.script != held_case(5).settings.script
    assert (seed_set(SCORING - 1), seed_set(SCORING)) == ("tuning", "scoring")


def test_the_suite_is_as_wide_as_it_says():
    cases = [slip_case(SCORING + n) for n in range(300)]
    settings = [case.settings for case in cases]
    assert {s.shape for s in settings} == {(4, 4), (8, 8), (16, 16)}
    assert {s.rate for s in settings} == {60.0, 100.0, 200.0, 500.0, 1000.0}
    assert {s.cover for s in settings} == {"flat", "bumpy", "bumps-fem"}
    assert {case.kind for case in cases} == {"pull", "twist", "pull and twist", "part"}
    assert {case.faults.name for case in cases} == {"none", "dead", "stuck", "noisy", "drift"}
    assert all(2e-3 <= s.noise <= 3e-3 for s in settings)  # Table 3.II
    directions = [p.direction for s in settings for p in s.script if p.kind == "pull"]
    senses = [np.sign(p.angle) for s in settings for p in s.script if p.kind == "twist"]
    # all quadrants, both senses: 150 draws leave one of four out once in 10¹⁸
    assert len({int(d // (np.pi / 2)) for d in directions}) == 4
    assert set(senses) == {-1.0, 1.0}


def test_a_hundred_held_scenes_are_ten_minutes():
    for seed in range(20):
        settings = held_case(seed).settings
        # phases are whole scans, so a scene is off by half a scan a phase at most
        scans, phases = total_scans(settings.script, settings.rate), len(settings.script)
        assert scans / settings.rate == pytest.approx(HELD_FOR, abs=0.5 * phases / settings.rate)


@pytest.mark.parametrize("seed", range(12))
def test_scenes_are_true_to_their_kind(seed):
    case = slip_case(seed)
    truth = truth_of(case.settings)
    before = slice(0, total_scans(case.settings.script[:-2], case.settings.rate))  # the release
    slides, turns = truth["slip"][before].any(), truth["twist_slip"][before].any()
    assert slides == ("pull" in case.kind)
    assert turns == ("twist" in case.kind)
    if case.kind == "part":
        assert not truth["incipient"][before].any()


@pytest.mark.parametrize("seed", range(6))
def test_nothing_slips_in_a_held_scene_until_it_is_lifted(seed):
    case = held_case(seed)
    truth = truth_of(case.settings)
    starts = np.cumsum([0, *(total_scans((p,), case.settings.rate) for p in case.settings.script)])
    lifted = np.zeros(starts[-1], dtype=bool)
    for phase, first, after in zip(case.settings.script, starts, starts[1:], strict=False):
        lifted[first:after] = phase.kind == "release"
    for name in ("slip", "incipient", "twist_slip"):
        assert not (truth[name] > 0)[~lifted].any(), name


READOUT = Readout(gain=1.0, noise=2e-3, bits=12)
TIMES = np.arange(400) / 100.0


def volts():
    rng = np.random.default_rng(0)
    return READOUT.read(0.3 + rng.normal(0, 2e-3, (400, 8, 8, 4)))[0]


def test_no_fault_changes_nothing():
    clean = volts()
    assert Faults().apply(clean, TIMES, READOUT) is clean


@pytest.mark.parametrize("begins", [0.0, 2.0])
def test_dead_and_stuck_and_noisy_taxels(begins):
    clean = volts()
    faults = Faults(seed=3, dead=2, stuck=3, noisy=1, begins=begins)
    broken = faults.apply(clean, TIMES, READOUT)
    late = begins <= TIMES
    np.testing.assert_array_equal(broken[~late], clean[~late])
    assert (broken[late] == 0).all(axis=(0, 3)).sum() == 2
    still = (broken[late] == broken[late][:1]).all(axis=0)
    assert still.sum() == 2 * 4 + 3
    wide = broken[late].std(axis=0) > 5 * READOUT.noise
    assert wide.sum() == 4
    assert broken[late][:, wide].std() == pytest.approx(10 * READOUT.noise, rel=0.1)


def test_drift_goes_as_far_as_it_says():
    clean = volts()
    faults = Faults(drift=10e-3, drift_time=1.0, drift_spread=0.2)
    rise = (faults.apply(clean, TIMES, READOUT) - clean)[-20:].mean(axis=0)
    expected = 10e-3 * (1 - np.exp(-3.9))
    # mean over 256 bridges, each 20 % off: to 3 %; the spread of 256 numbers to 10 %
    assert rise.mean() == pytest.approx(expected, rel=0.04)
    assert rise.std() == pytest.approx(0.2 * expected, rel=0.15)


def test_one_geometry_shares_its_influence_and_gives_the_same_frames():
    simulate = Simulator()
    cases = [case for case in map(slip_case, range(40)) if case.settings.shape == (4, 4)]
    one = next(case for case in cases if case.settings.rate <= 100.0)
    first = simulate(one).strain
    np.testing.assert_array_equal(simulate(one).strain, first)
    np.testing.assert_array_equal(Simulator()(one).strain, first)
