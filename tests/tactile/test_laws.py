"""The laws that slip and twist follow, against the closed forms of contact mechanics."""

import numpy as np
import pytest

from cnnum.engine import Engine
from cnnum.frame import FORCE_AXES
from cnnum.graph.nodes import Graph
from cnnum.programs import program
from cnnum.programs.machine import FrameFields
from cnnum.tactile.contact import (
    contact_modulus,
    hertz,
    shear_compliance,
    sliding_torque,
    tangential_displacement,
    torsion_slip,
)
from cnnum.templates.tactile.contact_mechanics.growth_laws import TWIST, pull_law
from cnnum.templates.tactile.contact_mechanics.time_hypotheses import hypotheses

LOAD, FRICTION, MODULUS = 1.3, 0.7, 0.9e6
SHAPE = (10, 10)


def law_on_machine(law, x):
    """Return load and stick radius of a law at 100 values of x, as a program gives them."""

    @program
    def told(frame):
        at = frame.channel("normal")
        return {"load": law.load(at), "sticks": law.sticks(at)}

    frame = np.zeros((*SHAPE, 3))
    frame[..., 2] = x.reshape(SHAPE)
    out = Engine("reference").compile(told, SHAPE)(frame)
    return np.ravel(out["load"]), np.ravel(out["sticks"])


def contact():
    return hertz(LOAD, 0.02, contact_modulus(MODULUS, 0.5))


def test_a_pull_is_mindlins():
    """Exactly, but for what taxels read of it: displacement is x of that of gross slip."""
    compliance = shear_compliance(MODULUS, 0.5)
    share = np.linspace(0.0, 1.0, 100)
    moved = tangential_displacement(contact(), LOAD, share * FRICTION * LOAD, FRICTION, compliance)
    load, sticks = law_on_machine(pull_law(0.0), moved / moved[-1])
    np.testing.assert_allclose(load, share, atol=1e-12)
    # c/a = (1 − Q/μP)^(1/3); next to slip the cube root makes 1e-5 of rounding
    np.testing.assert_allclose(sticks, np.cbrt(1.0 - share), atol=2e-5)


def test_a_twist_is_lubkins():
    """Within what the fits state: 2.1e-4 of the torque, 7.4e-4 of the contact radius."""
    a = float(contact().contact_radius)
    whole = float(sliding_torque(LOAD, a, FRICTION))
    share = np.linspace(0.01, 0.995, 100)
    states = [torsion_slip(LOAD, a, float(s) * whole, FRICTION) for s in share]
    angle = np.array([state.twist(MODULUS / 3.0) for state in states])
    stick = np.array([state.stick_radius / a for state in states])
    x = angle / np.interp(-0.5, -stick, angle)  # half the contact radius sticks at x = 1
    load, sticks = law_on_machine(TWIST, x)
    np.testing.assert_allclose(load, share, atol=5e-4)  # 2.1e-4, and x to the interpolation's 1e-4
    np.testing.assert_allclose(sticks, stick, atol=1.2e-3)


@pytest.mark.parametrize("shape", [(4, 4), (8, 8), (16, 16), (3, 5)])
@pytest.mark.parametrize("law", [pull_law(), TWIST], ids=["pull", "twist"])
def test_hypotheses_cover_their_range(shape, law):
    tried = hypotheses(FrameFields(Graph(shape), FORCE_AXES), law.times)
    times, apart = (each.node.operation.values.ravel() for each in (tried.times, tried.apart))
    assert tried.times.maps == -(-law.times.count // (shape[0] * shape[1]))
    assert times[0] == 2.0
    assert law.times.count <= len(times) < law.times.count + shape[0] * shape[1]
    assert times[law.times.count - 1] > 1400.0
    # each is as far from the next as it says, no further than a share, or a step
    np.testing.assert_allclose(np.diff(times), (times * apart)[:-1], rtol=1e-9)
    assert np.all(apart <= law.times.share)
    assert np.all(times * apart <= law.times.step * (1.0 + 1e-12))
