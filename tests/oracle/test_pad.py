"""Pads: (6.1) turned by 45°, and a tangential load on a half-space."""

import numpy as np
import pytest

from cnnum.errors import ArrayError, UnknownNameError
from cnnum.tactile import halfspace
from cnnum.tactile.pad import Pad


def test_nine_by_nine_gives_four_by_four() -> None:
    pad = Pad.regular((9, 9))
    assert pad.bumps == (4, 4)
    assert pad.used.sum() == 64
    assert pad.to_three_axial(np.zeros((5, 7, 9, 9))).shape == (5, 7, 4, 4, 3)


def test_components_are_6_1_turned_by_45_degrees() -> None:
    s1, s2, s3, s4 = 0.3, 1.1, -0.4, 2.0
    frame = np.array([[s3, s4], [s1, s2]])  # S1, S2 at +y: the larger row
    x_turned, y_turned = s4 - s1, s2 - s3  # (6.1), along (1, −1) and (1, 1)
    angle = np.pi / 4.0
    expected = [
        np.cos(angle) * x_turned + np.sin(angle) * y_turned,
        -np.sin(angle) * x_turned + np.cos(angle) * y_turned,
        0.5 * (s1 + s2 + s3 + s4),
    ]
    found = Pad.regular((2, 2)).to_three_axial(frame)[0, 0]
    np.testing.assert_allclose(found, expected, rtol=1e-14)


def test_a_uniform_load_has_no_shear() -> None:
    found = Pad.regular((9, 9)).to_three_axial(np.full((9, 9), 3.0))
    # To rounding; the T_y that is printed in (6.2) would give −4.2.
    np.testing.assert_allclose(found[..., :2], 0.0, atol=1e-14)
    np.testing.assert_allclose(found[..., 2], 6.0, rtol=1e-15)


@pytest.mark.parametrize("angle", np.linspace(0.0, 2.0 * np.pi, 7))
def test_a_tangential_load_is_read_along_its_direction(angle: float) -> None:
    spacing, depth = 1.5e-3, 0.5e-3
    pad = Pad.regular((4, 4))
    x = (np.arange(4) - 0.5) * spacing  # the load is over the first bump's centre
    y = x[:, np.newaxis]
    force = [0.3 * np.cos(angle), 0.3 * np.sin(angle), 1.0]
    pressure = -halfspace.stress(x, y, depth, force)[..., 2, 2]
    shear_x, shear_y, normal = pad.to_three_axial(pressure)[0, 0]
    # The four taxels lie symmetric about the load: direction and decoupling are exact.
    np.testing.assert_allclose(
        np.array([shear_x, shear_y]) / np.hypot(shear_x, shear_y),
        [np.cos(angle), np.sin(angle)],
        atol=1e-12,
    )
    alone = -halfspace.stress(x, y, depth, [0.0, 0.0, 1.0])[..., 2, 2]
    assert normal == pytest.approx(pad.to_three_axial(alone)[0, 0, 2], rel=1e-12)


def test_wanted_channels_and_gains() -> None:
    frame = np.random.default_rng(1).normal(size=(6, 9, 9))
    pad = Pad.regular((9, 9), shear_gain=4.0, normal_gain=2.0)
    plain = Pad.regular((9, 9)).to_three_axial(frame)
    found = pad.to_three_axial(frame, ("normal", "shear_y"))
    np.testing.assert_allclose(found[..., 0], 2.0 * plain[..., 2], rtol=1e-14)
    np.testing.assert_allclose(found[..., 1], 4.0 * plain[..., 1], rtol=1e-14)


def test_any_layout_of_bumps() -> None:
    frame = np.random.default_rng(2).normal(size=(9, 12))
    regular = Pad.regular((9, 12), pitch=3, origin=(1, 0))
    assert regular.bumps == (3, 4)
    row, col = np.meshgrid(1 + 3 * np.arange(3), 3 * np.arange(4), indexing="ij")
    centres = np.stack([col + 0.5, row + 0.5], axis=-1) * 1.5e-3
    placed = Pad.from_centres((9, 12), centres, spacing=1.5e-3)
    np.testing.assert_array_equal(placed.corners, regular.corners)
    listed = Pad.from_centres((9, 12), centres.reshape(-1, 2)[::-1], spacing=1.5e-3)
    np.testing.assert_array_equal(
        listed.to_three_axial(frame)[0, ::-1], regular.to_three_axial(frame).reshape(-1, 3)
    )


def test_what_does_not_fit_is_refused() -> None:
    with pytest.raises(ArrayError, match="outside"):
        Pad.from_centres((4, 4), [[3.5, 0.5]], spacing=1.0)
    with pytest.raises(ArrayError, match="No bump"):
        Pad.regular((1, 9))
    with pytest.raises(ArrayError, match="corners"):
        Pad((4, 4), np.zeros((2, 4, 2), dtype=np.intp))
    with pytest.raises(ArrayError, match="shape"):
        Pad.regular((4, 4)).to_three_axial(np.zeros((4, 5)))
    with pytest.raises(UnknownNameError, match="twist"):
        Pad.regular((4, 4)).to_three_axial(np.zeros((4, 4)), ("twist",))
