"""The grasp code: all 65,536 codes, and motions from tractions that the code knows nothing of."""

import numpy as np
import pytest

from cnnum.errors import ProgramError
from cnnum.templates.tactile.grasp_code import MOTIONS, grasp_code

NAMES = [f"grasp_{name}" for name in MOTIONS]


def held(shear, noise=1e-3, seed=0):
    """Rest, then two fingers (..., rows, 2 columns) that press 1 and are sheared."""
    frames = noise * np.random.default_rng(seed).normal(size=(21, *shear.shape[:-1], 3))
    frames[18:, ..., 2] += 1.0
    frames[18:, ..., :2] += shear
    return frames


def rigid(shape, motion):
    """Shear of both fingers under a motion of the object between them, in each finger's axes.

    `motion` takes x, y (first finger's axes, from the middle) and the side (±1). It returns the
    motion of the object's surface there.
    """
    rows, cols = shape[0], shape[1] // 2
    y = np.arange(rows)[:, None] - (rows - 1) / 2
    x = np.arange(cols)[None, :] - (cols - 1) / 2
    x, y = np.broadcast_arrays(x, y)
    first = np.stack(np.broadcast_arrays(*motion(x, y, 1.0)), axis=-1)
    second = np.stack(np.broadcast_arrays(*motion(-x, y, -1.0)), axis=-1)
    second = second * [-1.0, 1.0]  # the facing finger's x runs the other way
    return 0.3 * np.concatenate([first, second], axis=1)


def slip(angle):
    return lambda x, y, side: (np.cos(angle) + 0 * x, np.sin(angle) + 0 * x)


def tilt(angle):
    return lambda x, y, side: (side * np.cos(angle) + 0 * x, side * np.sin(angle) + 0 * x)


def twist(sense):
    return lambda x, y, side: (-sense * y, sense * x)


def squeeze(sense):
    return lambda x, y, side: (sense * x, sense * y)


ANGLES = np.linspace(-3.0, 3.0, 9)
SCENES = [
    *(("grasp_slip", slip(a), a, 0) for a in ANGLES),
    *(("grasp_tilt", tilt(a), a, 0) for a in ANGLES),
    *(("grasp_twist", twist(s), None, s) for s in (-1, 1)),
    *(("grasp_squeeze", squeeze(s), None, s) for s in (-1, 1)),
]


@pytest.mark.one_in(3)
@pytest.mark.parametrize("shape", [(2, 4), (4, 4), (8, 8), (16, 16)])
def test_motions_are_distinguished(engine, run, shape):
    if engine.name == "reference" and shape == (16, 16):
        pytest.skip("the slow engine needs no fourth shape")
    shear = np.stack([rigid(shape, scene[1]) for scene in SCENES])
    got = run(engine, grasp_code.bind(push=1.0), held(shear))
    assert got["code_known"][-1].all()
    assert not got["code_known"][:18].any()
    flags = np.stack([got[name][-1] for name in NAMES])
    assert (flags.sum(axis=0) == 1).all()
    for number, (name, _, angle, sense) in enumerate(SCENES):
        assert got[name][-1, number] == 1, (name, angle, sense)
        assert got["grasp_sense"][-1, number] == sense
        if angle is not None:
            way = np.arctan2(got["grasp_y"][-1, number], got["grasp_x"][-1, number])
            off = np.angle(np.exp(1j * (way - angle)))
            # one bit a component knows the quadrant: 45° off at most
            assert abs(off) <= np.pi / 4 + 1e-3


def test_all_codes_are_read(fast, run):
    """2¹⁶ grasps side by side: every code is that of its shears, and has at most one meaning."""
    codes = np.arange(1 << 16)
    bits = codes[:, None] >> np.arange(16) & 1
    signs = (2.0 * bits - 1.0).reshape(-1, 2, 2, 2, 2)  # finger, row, column, axis
    shear = 0.3 * np.concatenate([signs[:, 0], signs[:, 1]], axis=2)
    got = run(fast, grasp_code.bind(push=1.0), held(shear).astype(np.float32))
    np.testing.assert_array_equal(got["grasp_code"][-1], codes)
    assert got["code_known"][-1].all()
    flags = np.stack([got[name][-1] for name in NAMES])
    assert flags.sum(axis=0).max() == 1
    # turning every sign turns every direction, and keeps the motion
    np.testing.assert_array_equal(flags, flags[:, ::-1])
    for name in ("grasp_x", "grasp_y", "grasp_sense"):
        np.testing.assert_allclose(got[name][-1], -got[name][-1][::-1], atol=1e-6)
    # by chance 7 of 8 bits agree in 18 of 256 codes an axis, for four axes; a few twists besides
    assert 0.24 < flags.any(axis=0).mean() < 0.3


def test_noise_and_one_finger_have_no_code(fast, run):
    shear = rigid((4, 4), slip(0.3))
    frames = held(shear)
    frames[18:, :, 2:] -= np.array([0, 0, 1.0])  # the second finger lets go
    frames[18:, :, 2:, :2] -= shear[:, 2:]
    got = run(fast, grasp_code.bind(push=1.0), frames)
    assert not got["code_known"].any()
    assert not np.stack([got[name] for name in NAMES]).any()


def test_frames_that_are_no_two_fingers_are_refused():
    with pytest.raises(ProgramError, match="does not divide into 2×4 equal blocks"):
        grasp_code.trace((3, 4))
