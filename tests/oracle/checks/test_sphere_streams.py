"""Streams of closed forms against the simulated array, whose springs solve friction another way."""

import numpy as np
import pytest

from cnnum.drivers.simulated.array import SimulatedOptions
from cnnum.drivers.simulated.settings import Phase, Settings
from cnnum.tactile.contact import contact_modulus
from cnnum.templating.checks.tactile.sphere_streams import (
    BEGIN,
    DEPTH,
    HOLD,
    PRESS,
    REST,
    Sphere,
    pulled,
    turned,
)

SHAPE, FRAMES, TIME = (8, 8), 50, 37.3
SPHERE = Sphere(radius=1.4, friction=0.6, centre=(0.2, -0.3))
RATE, PITCH = 200.0, Settings().pitch


def simulated(phase):
    """Strain at the taxels under a touch and a phase, (frames, rows, cols, 3)."""
    load = SPHERE.load * float(contact_modulus(Settings().youngs_modulus)) * PITCH**2
    touch = (
        Phase("hold", REST / RATE),
        Phase("press", PRESS / RATE, load=load),
        Phase("hold", HOLD / RATE),
    )
    options = SimulatedOptions(
        shape=SHAPE,
        rate=RATE,
        thickness=DEPTH * PITCH,
        friction=SPHERE.friction,
        radius=SPHERE.size * PITCH,
        start=(SPHERE.centre[0] * PITCH, SPHERE.centre[1] * PITCH),
        script=(*touch, phase),
    )
    with options.open() as array:
        states, truth = zip(*array.scans(), strict=True)
        return array.strain(list(states)), truth


def test_a_pull_is_the_springs():
    """Within 0.5 % of the largest strain: their cells average the traction in nine points."""
    speed = SPHERE.way() * PITCH / TIME * RATE
    phase = Phase("pull", FRAMES / RATE, speed=speed, direction=0.7)
    strain, truth = simulated(phase)
    got = pulled(SHAPE, SPHERE, TIME, 0.7, FRAMES)
    assert np.abs(got - strain).max() <= 0.005 * np.abs(strain).max()
    gross = next(frame for frame, true in enumerate(truth) if true["slip"] > 0)
    assert gross == pytest.approx(BEGIN + np.ceil(TIME) - 1, abs=1)


@pytest.mark.parametrize("sense", [1, -1])
def test_a_turn_is_the_springs(sense):
    angle = sense * SPHERE.turn(0.5) * FRAMES / TIME
    strain, truth = simulated(Phase("twist", FRAMES / RATE, angle=angle))
    got = turned(SHAPE, SPHERE, TIME, sense, FRAMES)
    shear = np.abs(strain[BEGIN:, ..., :2] - strain[BEGIN - 1, ..., :2]).max()
    assert shear > 0.05 * np.abs(strain).max()
    assert np.abs(got - strain).max() <= 0.005 * np.abs(strain).max()
    loose = next(frame for frame, true in enumerate(truth) if true["twist_slip"] > 0)
    assert loose == pytest.approx(BEGIN + np.ceil(TIME) - 1, abs=1)
