"""The texture program against the closed forms over a whole recording."""

import numpy as np
import pytest

from cnnum.errors import ProgramError
from cnnum.tactile.texture import texture as whole_recording
from cnnum.tactile.texture_materials import FOUR, Stroke, rub
from cnnum.templates.tactile.texture import texture


def rubbed(shape, batch=(), frames=60, seed=0):
    """Rest, then readings of a taxel with a bump on four materials, one after the other."""
    rng = np.random.default_rng(seed)
    still = 2.5e-3 * rng.normal(size=(20, *batch, *shape, 3))
    cells = int(np.prod((*batch, *shape)))
    strokes = [rub(FOUR[n % 4], Stroke(frames=frames), rng) for n in range(cells)]
    moving = np.stack(strokes, axis=1).reshape(frames, *batch, *shape, 3)
    return np.concatenate([still, moving])


@pytest.mark.parametrize(("shape", "batch"), [((8, 8), ()), ((4, 4), (3,)), ((16, 16), ())])
def test_texture_is_the_closed_form(engine, run, shape, batch):
    if engine.name == "reference" and shape != (4, 4):
        pytest.skip("one shape is enough for the slow engine")
    frames, window = rubbed(shape, batch), 16
    got = run(engine, texture.bind(push=1.0, window=window, ratio=0.5), frames)
    # the last frames of the window are all in contact, rest is known to a quarter of the noise
    true = whole_recording(frames[20:], window=window)
    assert (got["texture_frames"][-1] == window + 1).all()
    # rest is 20 frames of 2.5 mV, 0.6 mV, of normal signals from 0.1 V: 1 % of friction
    np.testing.assert_allclose(
        got["texture_friction"][-1], true.friction[-1] / 0.5, rtol=0.03, atol=0.02
    )
    np.testing.assert_allclose(got["texture_roughness"][-1], true.roughness[-1], rtol=0.06, atol=1)
    assert got["friction"][-1] == pytest.approx(
        got["texture_friction"][-1].mean(axis=(-2, -1)), rel=1e-5
    )
    assert not got["texture_known"][:18].any()
    assert got["texture_known"][-1].all()


def test_a_constant_ratio_has_no_roughness(fast, run):
    rng = np.random.default_rng(1)
    frames = 1e-5 * rng.normal(size=(60, 4, 4, 3))
    load = 1.0 + 0.5 * np.sin(np.arange(40))
    frames[20:, ..., 2] += load[:, None, None]
    frames[20:, ..., 0] += 0.3 * load[:, None, None]
    frames[20:, ..., 1] -= 0.4 * load[:, None, None]
    got = run(fast, texture.bind(push=1.0, window=8), frames)
    # noise of 1e-5 in loads above 0.5
    np.testing.assert_allclose(got["texture_friction"][-1], 0.5, atol=1e-3)
    assert got["texture_roughness"][-1].max() < 0.1


def test_the_dissertations_window(fast, run):
    """T = 128, as in 6.5: two memories a frame and taxel."""
    frames = rubbed((4, 4), frames=140)
    got = run(fast, texture.bind(push=1.0, ratio=0.5), frames, ["texture_friction"])
    true = whole_recording(frames[20:], window=128)
    np.testing.assert_allclose(
        got["texture_friction"][-1], true.friction[-1] / 0.5, rtol=0.03, atol=0.02
    )


def test_wrong_parameters_are_refused():
    with pytest.raises(ProgramError, match="window"):
        texture.bind(window=0).trace((4, 4))
