"""What is slow is not rest; what shakes, or stands beside a stuck bridge, is no slip or twist."""

import numpy as np
import pytest

from cnnum.drivers.simulated.script import Phase
from cnnum.lab.scoring.generated.scripts import held_case, slip_case
from cnnum.lab.scoring.generated.simulate import Simulator
from cnnum.templates.tactile.slip import slip
from cnnum.templates.tactile.twist import twist

HELD = (Phase("hold", 0.3), Phase("press", 0.2, load=0.3), Phase("hold", 0.3))


def first(flag):
    return int(np.flatnonzero(flag > 0)[0])


@pytest.mark.parametrize("sense", [1, -1])
def test_a_slow_twist_at_many_frames_a_second_is_no_rest(fast, run, simulate, sense):
    """0.05 rad/s at 500 frames a second: within 32 frames the torque grows by less than its noise.

    Bumps under a thin cover feel little of it. Long after all slips the rate is still told as it
    was while the torque grew.
    """
    script = (*HELD, Phase("twist", 1.6, angle=sense * 0.08), Phase("relax", 0.1))
    options = {"cover": "bumps-fem", "thickness": 0.7e-3, "radius": 37e-3, "friction": 0.53}
    strain, truth = simulate(script=script, seed=71, rate=500.0, start=(0.4e-3, 0.2e-3), **options)
    known = {"rate": 500.0, "depth": 0.7 / 1.5, "cover": "bumps-fem"}
    got = run(fast, twist.bind(**known), strain, ["twist", "twist_sense", "twist_rate"])
    assert truth["twist_slip"].any()
    found = first(got["twist"])
    # when half the contact radius slips, as the truth has it
    assert 0.35 <= truth["stick_radius"][found] / truth["contact_radius"][found] <= 0.65
    assert got["twist_sense"][found] == sense
    held = np.flatnonzero((got["twist"] > 0) & (truth["twist_rate"] != 0.0))
    # the whole torque is 20 standard deviations of its noise: 6 to 13 % low in three such streams
    assert np.median(got["twist_rate"][held]) == pytest.approx(sense * 0.05, rel=0.2)


def test_a_contact_beside_a_stuck_bridge_is_no_twist(fast, run, simulate):
    """A bridge that sticks before the first touch reads as a contact; the real one comes aside."""
    script = (Phase("hold", 0.5), Phase("press", 0.35, load=1.0), Phase("hold", 0.3))
    for seed in (62, 63):
        strain, truth = simulate(script=script, seed=seed, rate=200.0, friction=0.93)
        stuck = strain.copy()
        noise = np.diff(strain[:30], axis=0).std() / np.sqrt(2.0)
        stuck[40:, 7, 3] += 30.0 * noise * np.array([2.0, 0.3, -1.0])
        got = run(fast, twist.bind(rate=200.0), stuck, ["twist"])
        assert not truth["twist"].any()
        assert not got["twist"].any()


def told(case):
    """Return what a program is told of an array."""
    settings = case.settings
    depth = settings.thickness / settings.pitch
    return {"depth": depth, "cover": settings.cover, "bump": settings.bump_radius / settings.pitch}


@pytest.mark.parametrize(
    ("case", "until"),
    [(held_case(41019), 320), (held_case(41367), 1430), (held_case(42235), None)],
    ids=["comes from the rim", "comes from aside", "one taxel"],
)
def test_a_centre_that_moves_makes_no_torque(fast, run, case, until):
    """Tuning seeds: beside a stuck bridge an object comes or goes, and the centre with it."""
    seen = Simulator()(case)
    program = twist.bind(rate=case.settings.rate, **told(case))
    got = run(fast, program, seen.strain[:until], ["twist"])
    assert not seen.truth["twist"].any()
    assert not got["twist"].any()


@pytest.mark.parametrize("seed", [7010, 40541])
def test_a_pull_that_is_let_go_is_no_twist(fast, run, seed):
    """Tuning seeds: few taxels read a falling force as a growing torque, too."""
    case = slip_case(seed)
    seen = Simulator()(case)
    program = twist.bind(rate=case.settings.rate, **told(case))
    turned = run(fast, program, seen.strain, ["twist"])["twist"]
    begins = np.flatnonzero(np.diff(turned, prepend=0.0) > 0)
    assert (np.abs(seen.truth["torque"][begins]) > 0.0).all()
    assert len(begins) == seen.truth["twist"].any()


def test_a_light_weight_that_stops_is_not_about_to_slip(fast, run):
    """A tuning seed: a weight comes within eight frames, and needs a friction of 0.1 only."""
    case = held_case(42254)
    seen = Simulator()(case)
    got = run(fast, slip.bind(reads="strain", **told(case)), seen.strain[:300], ["incipient_slip"])
    assert not got["incipient_slip"].any()


def test_a_weight_that_is_shaken_does_not_slip(fast, run, simulate):
    """Pulled to a third of what friction holds, then shaken: where taxels sample a contact
    coarsely, its growing and shrinking looks like moving.
    """
    for seed in (64, 65, 66):
        script = (
            *HELD,
            Phase("grip", 0.1, load=1.6),
            Phase("hold", 0.2),
            Phase("pull", 0.1, speed=0.35e-3, direction=2.1),
            Phase("vibrate", 0.6, frequency=14.0, amplitude=0.25),
        )
        options = {"cover": "bumps-fem", "thickness": 0.7e-3, "radius": 17e-3, "friction": 0.77}
        strain, truth = simulate(
            script=script, seed=seed, rate=500.0, start=(0.29e-3, -0.47e-3), **options
        )
        assert not truth["slip"].any()
        assert not run(fast, slip, strain, ["gross_slip"])["gross_slip"].any()


@pytest.mark.parametrize("aside", [-0.6, 0.6])
def test_a_weight_that_rolls_aside_seldom_slips(fast, run, simulate, aside):
    """A weight comes within four frames, and the object rolls 34° off it: what slips goes along.

    By the way along the force alone all six were taken for slip.
    """
    script = (
        Phase("hold", 0.3),
        Phase("press", 0.3, load=0.83),
        Phase("hold", 0.3),
        Phase("pull", 0.016, speed=2.0e-3, direction=0.7),
        Phase("roll", 0.25, speed=0.9e-3, direction=0.7 + aside),
    )
    wrong = 0
    for seed in range(67, 73):
        strain, truth = simulate(script=script, seed=seed, rate=200.0, radius=35e-3, friction=0.9)
        assert not truth["slip"].any()
        wrong += bool(run(fast, slip, strain, ["gross_slip"])["gross_slip"].any())
    # one in six each way; noise makes a way of few frames seem to go straight
    assert wrong <= 2
