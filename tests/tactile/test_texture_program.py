"""The texture program against the closed forms over a whole recording."""

import numpy as np
import pytest

import cnnum
from cnnum.drivers.simulated.settings import Phase
from cnnum.errors import PhysicsError, ProgramError, UnknownNameError
from cnnum.tactile.bump_loads import shear_over_normal
from cnnum.tactile.texture import texture as whole_recording
from cnnum.tactile.texture_materials import FOUR, Stroke, rub
from cnnum.templates.tactile.localize import PITCH
from cnnum.templates.tactile.texture import APART, texture

RATE = 1 / APART
"""Frames per second at which every frame is a sample."""


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
    got = run(engine, texture.bind(rate=RATE, push=1.0, window=window, ratio=0.5), frames)
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
    got = run(fast, texture.bind(rate=RATE, push=1.0, window=8), frames)
    # noise of 1e-5 in loads above 0.5
    np.testing.assert_allclose(got["texture_friction"][-1], 0.5, atol=1e-3)
    assert got["texture_roughness"][-1].max() < 0.1


def test_the_dissertations_window(fast, run):
    """T = 128, as in 6.5: two memories a frame and taxel."""
    frames = rubbed((4, 4), frames=140)
    got = run(fast, texture.bind(rate=RATE, push=1.0, ratio=0.5), frames, ["texture_friction"])
    true = whole_recording(frames[20:], window=128)
    np.testing.assert_allclose(
        got["texture_friction"][-1], true.friction[-1] / 0.5, rtol=0.03, atol=0.02
    )


def below_bumps(patch, friction, poisson=0.49):
    """Readings below a rubbed bump and its neighbours, by finite elements of their own.

    Another mesh, another Poisson ratio and another block than those of the shipped tables. The bump
    of row 1 and column 2 is touched alone. Its surface moves once around.
    """
    pytest.importorskip("skfem")
    from cnnum.tactile.cover.fem.geometry import Shape
    from cnnum.tactile.cover.fem.plate import make_bodies

    bodies = make_bodies(Shape(60.0, 60.0, growth=1.2), 8, poisson=poisson, patch=patch)
    rows, cols = np.meshgrid(np.arange(4), np.arange(4), indexing="ij")
    x, y = PITCH * (cols - 2.0), PITCH * (rows - 1.0)
    away = np.hypot(x, y)
    pushed = bodies.profiles(1.0, away.reshape(-1)).reshape(7, 4, 4)
    cos, sin = np.where(away > 0, x, 1.0) / np.where(away > 0, away, 1.0), y / np.maximum(away, 1.0)
    shear = 1.0 + poisson  # Eε over σ
    by_z = np.stack([shear * pushed[1] * cos, shear * pushed[1] * sin, pushed[2]], axis=-1)
    along, across = pushed[4], pushed[5]
    by_x = np.stack(
        [
            shear * (along * cos**2 - across * sin**2),
            shear * (along + across) * cos * sin,
            pushed[6] * cos,
        ],
        axis=-1,
    )
    by_y = np.stack(
        [
            shear * (along + across) * cos * sin,
            shear * (along * sin**2 - across * cos**2),
            pushed[6] * sin,
        ],
        axis=-1,
    )
    frames = 1e-5 * np.random.default_rng(2).normal(size=(60, 4, 4, 3))
    way = np.linspace(0.0, 2.0 * np.pi, 40)[:, None, None, None]
    frames[20:] += by_z + friction * (np.cos(way) * by_x + np.sin(way) * by_y)
    return frames


@pytest.mark.parametrize(
    ("patch", "read"),
    [
        (np.sin(5 * np.pi / 32), 0.6),  # that of a bump pressed by a quarter of its radius
        (np.sin(4 * np.pi / 32), 0.6 * 0.44 / 0.333),  # a lighter touch: reads too much
        (np.sin(6 * np.pi / 32), 0.6 * 0.216 / 0.333),  # a harder one: too little
    ],
)
def test_friction_below_a_bump_is_that_of_finite_elements(fast, run, patch, read):
    frames = below_bumps(patch, 0.6)
    got = run(fast, texture.bind(rate=RATE, window=8, taxels="strain"), frames)
    # of ν = 0.49 instead of 0.5, of a coarser mesh, and unmixed to 2 %
    touched = np.zeros((4, 4), dtype=bool)
    touched[1, 2] = True
    assert ((got["texture_friction"][-1] > 0.0) == touched).all()
    assert got["friction"][-1] == pytest.approx(read, rel=0.02)
    if read == 0.6:  # "about two", of equal displacements, is not the ratio of equal forces
        alike = run(fast, texture.bind(rate=RATE, window=8, ratio=0.5), frames)
        assert alike["texture_friction"][-1][touched] == pytest.approx(0.4, abs=0.02)


def test_the_ratio_of_a_bump_is_below_that_of_equal_displacements():
    assert shear_over_normal("strain", 1.0) == pytest.approx(1 / 3, abs=0.002)
    assert shear_over_normal("stress", 1.0) == pytest.approx(0.194, abs=0.002)
    ratios = [shear_over_normal("strain", depth) for depth in (1.5, 2.0, 3.0, 4.0, 5.0)]
    assert (np.diff(ratios) < 0.0).all()
    with pytest.raises(PhysicsError, match="bump radii"):
        shear_over_normal("strain", 0.1)


SCENE = """
name = "rubbed"
needs = ["friction", "texture_known"]
[program]
name = "texture"
parameters = {{window = 16}}
[array]
driver = "simulated"
shape = [4, 4]
friction = {friction}
cover = "bumpy"
bump_radius = 0.2e-3
thickness = 0.2e-3
noise = 0.0
script = [
    {{kind = "hold", duration = 0.3}},
    {{kind = "press", duration = 0.2, load = 0.05}},
    {{kind = "pull", duration = 1.0, speed = 2e-3, direction = 0.5}},
]
"""


@pytest.mark.parametrize("friction", [0.3, 0.6])
def test_a_scene_takes_the_ratio_from_the_arrays_bumps(tmp_path, friction):
    (tmp_path / "rubbed.toml").write_text(SCENE.format(friction=friction))
    with cnnum.load_scene(tmp_path / "rubbed.toml") as scene:
        last = list(scene.results())[-1]
    # 12 bits of the converter, and bumps unmixed to 2 %
    assert last.outputs["friction"] == pytest.approx(friction, rel=0.03)


@pytest.mark.one_in(4)  # 15 ms are 1.5 frames at 100 Hz; the fastest takes ten times as long
@pytest.mark.parametrize("rate", [100.0, 50.0, 1000.0, 200.0])
def test_a_whole_window_reads_the_friction_at_every_rate_and_the_release_changes_nothing(
    fast, simulate, rate
):
    """Drawn frictions and presses; a window lasts as long at each, and ends where sliding does."""
    rng, window = np.random.default_rng(round(rate)), 32
    plan = fast.compile(texture.bind(rate=rate, window=window, taxels="strain"), (8, 8))
    for press in rng.uniform(0.05, 0.8, 3):
        friction = float(rng.uniform(0.2, 1.0))
        strain, truth = simulate(
            rate=rate, cover="bumpy", bump_radius=0.2e-3, thickness=0.2e-3, body="textured",
            friction=friction, noise=1e-3,
            script=(Phase("hold", 0.3), Phase("press", press, load=2.0),
                    Phase("pull", 0.9, 0.0, 4e-3, 0.5), Phase("release", 0.2), Phase("hold", 0.1)),
        )  # fmt: skip
        stream = plan.stream(rate=rate)
        rows = [stream.push(frame) for frame in strain]
        read, rubs = (
            np.array([row[name] for row in rows]) for name in ("friction", "texture_rubs")
        )
        slides = np.flatnonzero(truth["slip"])
        whole = np.flatnonzero(rubs)
        # ends of the window that reach into the rest by a twentieth of the ratio: 1 %; noise, and
        # bumps unmixed to 2 %
        np.testing.assert_allclose(read[whole], friction, rtol=0.03)
        begins = (whole[0] - slides[0]) / rate
        assert 0.015 * window * (1 - 1 / 8) < begins < 0.015 * window + 0.1
        lifts = np.flatnonzero(np.diff(truth["normal_force"]) < -1e-6)[0]
        np.testing.assert_allclose(read[lifts:], friction, rtol=0.03)


def test_wrong_parameters_are_refused():
    with pytest.raises(ProgramError, match="window"):
        texture.bind(rate=RATE, window=0).trace((4, 4))
    with pytest.raises(UnknownNameError, match="taxels"):
        texture.bind(taxels="bump").trace((4, 4))
    with pytest.raises(PhysicsError, match="bump radii"):
        texture.bind(taxels="strain", bump_depth=9.0).trace((4, 4))
