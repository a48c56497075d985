"""From a driver's frame to a program's channels: work that no frame changes is done once."""

import numpy as np
import pytest

from cnnum.errors import ArrayError, PhysicsError
from cnnum.frame import FORCE_AXES, Frame
from cnnum.scenes.conversion import AsRead, ByCalibration
from cnnum.tactile.taxel import SIDES, Calibration
from cnnum.tactile.taxel.readout import Heat

RNG = np.random.default_rng(5)
UNIFORM = Calibration(2e-3, offsets=RNG.normal(0, 0.1, 4))
OWN = Calibration(
    2e-3,
    offsets=RNG.normal(0, 0.1, (3, 4, 4)),
    cross=np.eye(3) + RNG.normal(0, 0.05, (3, 4, 3, 3)),
    drift=RNG.normal(0, 1e-4, (3, 4, 4)),
    heat=Heat(0.01, 100.0),
)


def frame(values, channels=SIDES, time=12.0):
    return Frame(values, tuple(channels), "V", 0, time)


@pytest.mark.parametrize("calibration", [UNIFORM, OWN], ids=["uniform", "own"])
@pytest.mark.parametrize(
    "wanted", [FORCE_AXES, ("normal",), ("shear_x",), ("shear_y", "shear_x"), ()]
)
def test_reader_is_the_calibration(calibration, wanted):
    volts = RNG.normal(0, 1, (3, 4, 4))
    got = ByCalibration(calibration).reader(wanted)(frame(volts))
    want = calibration.to_strain(volts, wanted, time=12.0)
    assert got.shape == (3, 4, len(wanted))
    # the same sums in another order: a few roundings of numbers below 1e-2
    np.testing.assert_allclose(got, want, rtol=0, atol=1e-16)


def test_frames_do_not_share_what_was_read():
    read = ByCalibration(UNIFORM).reader(("normal",))
    first = read(frame(np.ones((3, 4, 4))))
    copy = first.copy()
    read(frame(np.full((3, 4, 4), 2.0)))
    np.testing.assert_array_equal(first, copy)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("wanted", [("normal",), ("shear_x",)])
@pytest.mark.parametrize(
    ("conversion", "channels"),
    [(ByCalibration(UNIFORM), SIDES), (AsRead(FORCE_AXES), FORCE_AXES)],
    ids=["calibrated", "as read"],
)
def test_what_is_not_finite_is_refused(conversion, channels, wanted, bad):
    values = np.ones((3, 4, len(channels)))
    read = conversion.reader(wanted)
    read(frame(values, channels))
    values[1, 2, 2] = bad
    with pytest.raises(ArrayError, match="finite"):
        read(frame(values, channels))


def test_large_numbers_are_not_taken_for_infinite():
    """Their squares are."""
    values = np.full((3, 4, 3), 1e200)
    np.testing.assert_array_equal(
        AsRead(FORCE_AXES).reader(FORCE_AXES)(frame(values, FORCE_AXES)), values
    )


def test_frames_that_a_calibration_cannot_read_are_refused():
    read = ByCalibration(UNIFORM).reader(("normal",))
    with pytest.raises(ArrayError, match="bridges"):
        read(frame(np.ones((3, 4, 3)), FORCE_AXES))
    with pytest.raises(PhysicsError, match="negative"):
        read(frame(np.ones((3, 4, 4)), time=-1.0))


def test_as_read_picks_channels():
    values = RNG.normal(0, 1, (3, 4, 3))
    got = AsRead(FORCE_AXES).reader(("normal", "shear_x"))(frame(values, FORCE_AXES))
    np.testing.assert_array_equal(got, values[..., [2, 0]])
