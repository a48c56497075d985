"""Every tactile program on 4×4×3, 8×8×3 and 16×16×3, in a batch with its mirror image.

The same thing is put in the middle of each array. The program's outputs may differ by the noise,
which is drawn anew. They may differ by the part that a small array cuts off, and by nothing else. A
scene that is turned over, left for right, must be reported turned over.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from cnnum.arrays import Floats
from cnnum.programs.library import get_program, program_names
from cnnum.tactile.bump_loads import bump_readings
from cnnum.tactile.halfspace import SurfaceToDepth
from cnnum.tactile.indenters import Disc, Touch, frame_under, readings

SIZES = (4, 8, 16)
REST = 20
NOISE = 1e-3
DEPTH = 0.5
MIRROR = np.array([-1.0, 1.0, 1.0])
"""Of shear along x, shear along y and normal load when left is taken for right."""


@dataclass(frozen=True)
class Same:
    """An output that is the same on every array, and the room for differences."""

    name: str
    within: float
    turns: bool = False  # changes its sign with left and right


@dataclass(frozen=True)
class Scene:
    """Frames by the array's side, and the wanted outputs of the last of them."""

    frames: Callable[[int], Floats]
    same: tuple[Same, ...]
    parameters: dict[str, object]
    middle: bool = False  # compare the middle 2×2 of maps


def after_rest(seen: list[Floats]) -> Floats:
    """Rest, then frames of a scene, with noise."""
    seen_all = np.stack(seen)
    size = NOISE * np.abs(seen_all).max()
    frames = size * np.random.default_rng(seen_all.shape[1]).normal(
        size=(REST + len(seen), *seen_all.shape[1:])
    )
    frames[REST:] += seen_all
    return frames


def pulled(cells: int) -> Floats:
    """A sphere that is held, pulled until it slips, and slides on."""
    pulls = [0.0] * 12 + list(np.linspace(0.0, 0.7, 22)) + [0.7] * 4
    touches = [Touch(1.3, (0.2, -0.1), pull, 0.6) for pull in pulls]
    return after_rest([readings(touch, cells, DEPTH, "strain") for touch in touches])


def disc(cells: int) -> Floats:
    load = np.zeros((cells, cells, 3))
    load[..., 2] = -frame_under(Disc(1.4, (0.1, 0.1)), (cells, cells), DEPTH, "strain")
    return after_rest([load] * 3)


def bumps(cells: int) -> Floats:
    own, at = np.zeros((cells, cells, 3)), cells // 2
    own[at - 1, at - 1], own[at, at] = (0.2, 0.1, 1.0), (0.1, -0.2, 0.8)
    return after_rest([bump_readings(own, "strain", 7.5, 1.0)] * 3)


def held(cells: int) -> Floats:
    """Two fingers side by side that an object slips between."""
    load = np.zeros((cells, cells, 3))
    load[..., 0] = np.where(np.arange(cells) < cells // 2, 0.3, -0.3)
    load[..., 1], load[..., 2] = 0.1, 1.0
    return after_rest([load] * 3)


def rubbed(cells: int) -> Floats:
    """A friction of a half, that wavers."""
    wave = 0.5 + 0.05 * np.sin(0.9 * np.arange(40.0))
    return after_rest([np.full((cells, cells, 3), 1.0) * [0.6 * w, 0.8 * w, 1.0] for w in wave])


def slid(cells: int) -> Floats:
    """A narrow patch that is pressed, pulled and moved on along the pull."""
    frames, place = np.arange(70), np.arange(cells) - (cells - 1) / 2
    pressed, pull = np.clip((frames - 20) / 10, 0, 1), 0.5 * np.clip((frames - 45) / 10, 0, 1)
    gone = 0.05 * np.maximum(frames - 55, 0)
    right = place - 0.8 * gone[:, None, None] + 0.3
    down = place[:, None] + 0.6 * gone[:, None, None] - 0.2
    load = pressed[:, None, None] * np.exp(-(right**2 + down**2) / (2 * 0.9**2))
    pull = pull[:, None, None] * load
    noise = np.random.default_rng(cells).normal(0.0, 1e-5, (70, cells, cells, 3))
    return -np.stack([0.8 * pull, -0.6 * pull, load], axis=-1) + noise


def moved(cells: int) -> Floats:
    """A patch of 0.9 cells that comes down and moves across the middle, cells/s: 2 and −1."""
    frames, place = np.arange(70), np.arange(cells) - (cells - 1) / 2
    pressed, gone = np.clip((frames - 22) / 10, 0, 1), (frames - 55)[:, None, None] / 50.0
    right, down = place - 2.0 * gone, place[:, None] + gone
    load = pressed[:, None, None] * np.exp(-(right**2 + down**2) / (2 * 0.9**2))
    noise = np.random.default_rng(cells).normal(0.0, 1e-5, (70, cells, cells, 3))
    return np.stack([0.0 * load, 0.0 * load, load], axis=-1) + noise


def block(cells: int) -> Floats:
    """Tractions on the middle 2×2 cells, Pa."""
    load, at = np.zeros((1, cells, cells, 3)), cells // 2
    load[:, at - 1 : at + 1, at - 1 : at + 1] = 300.0, -200.0, 1000.0
    return load


def strained(cells: int) -> Floats:
    """Strain under that block's pressure."""
    cover = SurfaceToDepth((cells, cells), 1.5e-3, 1e-3, youngs_modulus=0.87e6)
    return cover(block(cells) * [0.0, 0.0, 1.0])


PLACE = (Same("contact_row", 0.15), Same("contact_column", 0.15, turns=True))
LOADS = (
    # sums of noise, and on 4×4 a third of the shear inferred: 10 % of a load of 1
    Same("load_normal", 0.1),
    Same("load_x", 0.1, turns=True),
    Same("load_y", 0.1),
    Same("contact", 0.0),
)
SLIP = (
    Same("gross_slip", 0.0),
    Same("slip_x", 0.01, turns=True),
    Same("slip_y", 0.01),
)
# 4×4 cells cut off the rim of the patch
TWIST = (
    Same("twist", 0.0),
    Same("twist_row", 0.1),
    Same("twist_column", 0.1, turns=True),
)
STRESSES = tuple(
    # the block is half as wide as the 4×4 array, and the surface beyond the rim differs:
    # mirrored, periodic or free, a tenth of the largest stress of 1 kPa
    Same(name, 130.0, turns=name.endswith("xz"))
    for name in ("stress_xz", "stress_yz", "stress_zz")
)

SCENES = {
    "active_contour": Scene(
        disc,
        (
            Same("contour_holds", 0.0),
            Same("contour_row", 0.3),
            Same("contour_column", 0.3, turns=True),
        ),
        {"rate": 20.0},
    ),
    "contact": Scene(pulled, (*PLACE, *LOADS), {}),
    # outlines on 4×4 taxels lie at the rim of the array, where no edge is seen
    "edges": Scene(
        disc, (Same("edge_load", 0.15), Same("surround_inhibition", 0.02)), {}, middle=True
    ),
    "edge_enhancement": Scene(
        disc,
        # an array of 4×4 mirrors the disc's own rim, of which it sees a part
        (Same("edge_enhanced", 0.15),),
        {},
        middle=True,
    ),
    "grasp_code": Scene(
        held,
        (Same("code_known", 0.0), Same("grasp_slip", 0.0), Same("grasp_y", 0.02)),
        {"push": 1.0},
    ),
    "halfspace_equilibrium": Scene(
        block, STRESSES, {"poisson": 0.3, "layers": 1, "slabs": 3, "tolerance": 1e-3}, middle=True
    ),
    "halfspace_layers": Scene(block, STRESSES, {}, middle=True),
    "halfspace_stress": Scene(block, STRESSES, {}, middle=True),
    "halfspace_strain": Scene(
        block,
        # the same in strain, 3σ/2E
        tuple(
            Same(name, 2.2e-4, turns=name.endswith("xz"))
            for name in ("strain_xz", "strain_yz", "strain_zz")
        ),
        {},
        middle=True,
    ),
    "localize": Scene(
        bumps,
        # four standard deviations of the noise, and 3 bumps to each side: 2 %
        (Same("bump_count", 0.0), Same("bump_patches", 0.0), Same("bump_load_normal", 0.03)),
        {"push": 1.0},
        middle=True,
    ),
    "motion_direction": Scene(
        # a small array misses what is around a narrow patch, which is taken off
        moved,
        (Same("motion_x", 0.15, turns=True), Same("drifts", 0.0)),
        {"rate": 50.0},
    ),
    "on_off": Scene(
        # on a small array the rim mirrors the patch, and its surround with it
        moved,
        (Same("on_row", 0.6), Same("on_column", 0.6, turns=True), Same("goes", 0.0)),
        {"rate": 50.0, "push": 1.0},
    ),
    "receptors": Scene(
        pulled,
        # the sums miss what small arrays cut off: a third of the shear on 4×4
        (Same("sa1_active", 0.0), Same("sa1_row", 0.3), Same("sa1_column", 0.3, turns=True)),
        {"rate": 20.0},
    ),
    "slip": Scene(slid, SLIP, {"rate": 50.0}),
    "surface_load": Scene(
        strained,
        # a pressure of 1 kPa comes back on a ground that the array's size decides
        (Same("load_normal", 120.0), Same("load_x", 75.0, turns=True)),
        {"reach": 3, "tolerance": 1e-3, "noise": 1e-3},
        middle=True,
    ),
    # all that it shares with the others is tested with them
    "tactile": Scene(pulled, (*PLACE, Same("contact", 0.0)), {}),
    "tactile_flow": Scene(
        moved,
        # the patch of 0.9 cells has narrow slopes, and 4×4 cells cut off its rim
        (Same("flow_x", 0.4, turns=True), Same("flow_y", 0.4)),
        {"rate": 50.0, "push": 1.0},
    ),
    "texture": Scene(
        rubbed,
        (Same("friction", 0.01), Same("texture_known", 0.0)),
        {"push": 1.0, "window": 16, "rate": 60.0},
    ),
    "twist": Scene(slid, TWIST, {"rate": 50.0}),
}


def last(plan, frames, batch):
    stream, outputs = plan.stream(batch, rate=plan.rate or 200.0), {}
    for frame in frames:
        outputs = stream.push(frame)
    return outputs


def seen_from_middle(scene: Scene, same: Same, cells: int, value: Floats) -> Floats:
    """A place from the array's middle; the middle of a map; anything else as it is."""
    if same.name.endswith(("_row", "_column")):
        return value - (cells - 1) / 2
    if scene.middle and value.ndim > 1:
        at = slice(cells // 2 - 1, cells // 2 + 1)
        return value[..., at, at]
    return value.min(axis=(-2, -1)) if value.ndim > 1 else value


def test_every_program_has_a_scene():
    assert set(SCENES) == set(program_names("tactile"))


@pytest.mark.one_in(2)
@pytest.mark.parametrize("name", SCENES)
def test_sizes_and_mirror_images_agree(fast, name):
    scene = SCENES[name]
    program = get_program(name).bind(**scene.parameters)
    needs = [same.name for same in scene.same]
    said: dict[str, list[Floats]] = {same.name: [] for same in scene.same}
    for cells in SIZES:
        frames = scene.frames(cells)
        both = np.stack([frames, frames[:, :, ::-1] * MIRROR], axis=1)
        plan = fast.compile(program, (cells, cells), needs)
        got = last(plan, both, (2,))
        for same in scene.same:
            value = seen_from_middle(scene, same, cells, np.asarray(got[same.name]))
            assert np.isfinite(value).all()
            said[same.name].append(value)
            turned = value[1][..., ::-1] if value.ndim > 1 else value[1]
            # rounding of float32, after steps of differing order: a hundredth of the room
            room = max(0.02 * same.within, 1e-6)
            np.testing.assert_allclose(turned, -value[0] if same.turns else value[0], atol=room)
        if cells == SIZES[0]:
            alone = last(plan, both[:, 1], ())
            for same in scene.same:
                np.testing.assert_allclose(
                    alone[same.name],
                    got[same.name][1],
                    rtol=1e-4,
                    atol=max(1e-6, 1e-3 * same.within),
                )
    for same in scene.same:
        small, *larger = (value[0] for value in said[same.name])
        for value in larger:
            assert np.abs(value - small).max() <= same.within, (same.name, small, value)
    assert any(np.abs(values[0]).max() > 0.0 for values in said.values())
