"""Incipient slip by Cattaneo and Mindlin's law, and silence where the law does not hold."""

import numpy as np
import pytest

from cnnum.drivers.simulated.settings import Phase
from cnnum.errors import ProgramError
from cnnum.tactile.indenters import Disc, Touch, frame_under, readings
from cnnum.templates.tactile.contact_mechanics.mindlin_slip import mindlin_slip

DEPTH, FRICTION, RATE = 2.0 / 3.0, 0.6, 50.0
REST, HELD = 24, 16
"""Frames of rest, and of a press before a pull as long."""

SCRIPT = (
    Phase("hold", 0.45),
    Phase("press", 0.3, load=1.4),
    Phase("hold", 0.2),
    Phase("pull", 0.8, speed=0.8e-3, direction=0.5),
    Phase("relax", 0.5),
)


def last(fast, run, load, **parameters):
    """The outputs for a load that came after rest, its pull later and slowly."""
    frames = REST + 2 * HELD
    noise = 1e-3 * np.abs(load).max() * np.random.default_rng(3).normal(size=(frames, 8, 8, 3))
    pull = np.clip((np.arange(frames) - REST - HELD) / HELD, 0.0, 1.0)[:, None, None, None]
    noise[REST:, ..., 2:] += load[..., 2:]
    noise[REST:, ..., :2] += (pull * load[..., :2])[REST:]
    stated = {"friction": FRICTION, "depth": DEPTH, "rate": RATE, **parameters}
    return {
        name: value[-1] for name, value in run(fast, mindlin_slip.bind(**stated), noise).items()
    }


@pytest.mark.parametrize("radius", [2.0, 2.6])
@pytest.mark.parametrize("used", [0.0, 0.5, 0.8])
def test_stick_radius_is_that_of_the_closed_form(fast, run, radius, used):
    touch = Touch(radius, (0.2, -0.1), used * FRICTION, 0.7, FRICTION)
    got = last(fast, run, readings(touch, 8, DEPTH, "strain"))
    assert got["mindlin_holds"] == 1.0
    # the used friction is known to 8 %, the more of c/a the nearer to slip
    assert got["stick_share"] == pytest.approx((1.0 - used) ** (1 / 3), abs=0.07)
    assert got["slip_strength"] == pytest.approx(1.0 - got["stick_share"])
    assert got["incipient_slip"] == 0.0


@pytest.mark.parametrize("radius", [1.4, 1.8, 2.2, 2.6])
@pytest.mark.parametrize("centre", [(0.0, 0.0), (0.3, -0.2), (0.5, 0.5)])
def test_nothing_is_said_of_a_flat_punch(fast, run, radius, centre):
    # a sphere's shear under a punch's pressure: the pull alone would be incipient slip
    load = readings(Touch(1.8, centre, 0.99 * FRICTION, 0.7, FRICTION), 8, DEPTH, "strain")
    load[..., 2] = -frame_under(Disc(radius, centre, "punch"), (8, 8), DEPTH, "strain")
    got = last(fast, run, load)
    assert (got["mindlin_holds"], got["incipient_slip"], got["stick_share"]) == (0.0, 0.0, 1.0)


def test_a_sphere_under_the_same_pull_is_reported(fast, run):
    load = readings(Touch(2.0, (0.2, -0.1), 0.99 * FRICTION, 0.7, FRICTION), 8, DEPTH, "strain")
    assert last(fast, run, load)["incipient_slip"] == 1.0


def test_a_contact_on_few_taxels_is_not_reported(fast, run):
    load = readings(Touch(1.2, (0.3, -0.2), 0.99 * FRICTION, 0.7, FRICTION), 8, DEPTH, "strain")
    assert last(fast, run, load)["mindlin_holds"] == 0.0


def pulled(fast, run, simulate, stated=1.0, **options):
    strain, truth = simulate(
        script=SCRIPT, radius=32e-3, start=(-0.6e-3, -0.4e-3), seed=2, **options
    )
    depth = options.get("thickness", 1e-3) / 1.5e-3 * stated
    return run(fast, mindlin_slip.bind(friction=FRICTION, depth=depth), strain[..., :3]), truth


def test_incipient_slip_comes_before_gross_slip(fast, run, simulate):
    got, truth = pulled(fast, run, simulate)
    first = int(np.argmax(got["incipient_slip"] > 0))
    assert got["incipient_slip"][first] > 0
    assert first < np.argmax(truth["slip"] > 0)
    assert truth["stick_radius"][first] / truth["contact_radius"][first] == pytest.approx(
        0.5, abs=0.1
    )


@pytest.mark.parametrize("thickness", [1e-3, 2e-3])
def test_nothing_is_said_on_a_thin_layer(fast, run, simulate, thickness):
    got, truth = pulled(fast, run, simulate, cover="layer", thickness=thickness)
    assert truth["incipient"].any()
    assert not got["mindlin_holds"].any()
    assert not got["incipient_slip"].any()


@pytest.mark.parametrize("stated", [0.7, 1.5])
def test_a_wrong_depth_is_seen_in_a_pull_or_in_a_slide(fast, run, simulate, stated):
    got, _ = pulled(fast, run, simulate, stated)
    assert not got["incipient_slip"].any()
    assert not got["mindlin_holds"][-20:].any()  # after the slide


def test_friction_must_be_positive(fast, run):
    with pytest.raises(ProgramError, match="friction"):
        run(fast, mindlin_slip.bind(friction=0.0), np.zeros((1, 8, 8, 3)))
