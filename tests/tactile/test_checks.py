"""Arguments of closed forms that do not fit each other: one sentence that names them."""

import numpy as np
import pytest

from cnnum.errors import ArrayError, CalibrationError, CnnumError, PhysicsError
from cnnum.tactile import contact, cover, halfspace, inverse
from cnnum.tactile.checks import broadcasting
from cnnum.tactile.inverse.moments import shear_and_normal
from cnnum.tactile.taxel.calibration import identity_of

TWO, THREE, PLACES = np.full((2, 2), 1e-3), np.full(3, 1e-3), np.zeros((4, 2))
FORCES = np.ones((2, 3))


@pytest.mark.parametrize(
    ("call", "names"),
    [
        (lambda: contact.hertz(TWO, THREE, 1.0), r"'load' \(2, 2\), 'sphere_radius' \(3,\)"),
        (lambda: contact.stuck_twist(TWO, radius=THREE, shear_modulus=1.0), "'radius'"),
        (lambda: cover.layer_waves(TWO, THREE, thickness=1.0), "'k'"),
        (lambda: halfspace.low_pass(TWO, THREE), "'depth'"),
        (lambda: halfspace.stress(TWO, THREE, 1e-3, force=FORCES[0]), "'x'"),
        (lambda: halfspace.circle_axis_stress(THREE, FORCES, radius=1.0), "'traction'"),
        (lambda: inverse.resolution_limit(TWO, THREE + 9.0), "'depth'"),
    ],
)
def test_shapes_that_do_not_broadcast_are_named(call, names):
    with pytest.raises(ArrayError, match=f"Expected shapes that broadcast, got .*{names}"):
        call()


def test_other_errors_of_a_form_stay():
    @broadcasting
    def root(x: float) -> float:
        return [][0] if x else float("none")

    with pytest.raises(ValueError, match="none"):
        root(0.0)
    with pytest.raises(IndexError):
        root(1.0)


def test_a_rectangle_has_two_sides():
    with pytest.raises(ArrayError, match="two sides of one rectangle"):
        halfspace.rectangle_stress(0.0, 0.0, 1e-3, size=TWO, traction=FORCES[0])


@pytest.mark.parametrize("noise", [TWO, np.zeros(0), (1.0, 2.0, 3.0), "x", None, -1.0, np.nan])
def test_noise_is_one_number_or_two(noise):
    with pytest.raises(PhysicsError, match="'noise'"):
        shear_and_normal(noise)


def test_noise_of_both_components():
    assert shear_and_normal(2.0) == (2.0, 2.0)
    assert shear_and_normal((1.0, 2.0)) == (1.0, 2.0)


def test_half_a_character_has_no_identity():
    with pytest.raises(CalibrationError, match="lone surrogate"):
        identity_of("\ud800")
    assert issubclass(CalibrationError, CnnumError)
