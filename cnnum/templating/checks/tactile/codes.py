"""References of `localize`, `grasp_code` and `texture`."""

import numpy as np

from cnnum.arrays import Shape
from cnnum.tactile.bump_loads import bump_readings
from cnnum.tactile.texture import texture
from cnnum.templating.checks.program_records import Outputs, ProgramCase, ProgramForm
from cnnum.templating.checks.tactile.outlines import pressed

WINDOW, APART, RATE = 8, 0.015, 60.0
"""Samples of `texture`, s between them, and frames per second."""

PITCH, DEPTH = 7.5, 1.0


def _bumps(rng: np.random.Generator, shape: Shape) -> ProgramCase:
    """Draw eight patterns of touched bumps, each dragged by up to half of its load."""
    loads = rng.uniform(-0.3, 0.3, (8, *shape, 3))
    loads[..., 2] = rng.uniform(0.4, 1.0, (8, *shape))
    touched = rng.random((8, *shape)) < 0.3
    touched[:, 0, 0] = True
    loads *= touched[..., None]
    read = bump_readings(loads, "strain", PITCH, DEPTH)
    size = np.abs(read).max(axis=(1, 2, 3), keepdims=True)
    parameters = {"push": -1.0, "bump_pitch": PITCH, "bump_depth": DEPTH}
    return ProgramCase(pressed(read, rng), {"loads": loads / size, "size": size}, parameters)


def _misjudged(case: ProgramCase, outputs: Outputs) -> float:
    """Return the largest error of a normal load, as a share of the largest one."""
    true = case.expected["loads"][..., 2]
    if not np.array_equal(outputs["bump_contact"] > 0, true > 0):
        return np.inf
    return float(np.abs(outputs["bump_load_normal"] - true).max() / true.max())


def _grasps(rng: np.random.Generator, shape: Shape) -> ProgramCase:
    """Draw 256 codes; each bit is the sign of a quarter of a finger's shear."""
    rows, cols = shape[0] // 2, shape[1] // 4
    codes = rng.integers(0, 1 << 16, 256)
    signs = 2.0 * (codes[:, None] >> np.arange(16) & 1).reshape(-1, 2, 2, 2, 2) - 1.0
    quarters = np.concatenate([signs[:, 0], signs[:, 1]], axis=2)
    shear = np.repeat(np.repeat(quarters, rows, axis=1), cols, axis=2)
    loads = np.concatenate([0.3 * shear, np.ones((*shear.shape[:-1], 1))], axis=-1)
    loads = np.asarray(loads, dtype=np.float64)
    return ProgramCase(pressed(loads, rng), {"codes": codes.astype(np.float64)})


def _wrong_codes(case: ProgramCase, outputs: Outputs) -> float:
    right = (outputs["grasp_code"] == case.expected["codes"]) & (outputs["code_known"] > 0)
    return float(np.count_nonzero(~right))


def _rubbed(rng: np.random.Generator, shape: Shape) -> ProgramCase:
    """Draw a friction of its own for every taxel, that wavers by a tenth from frame to frame."""
    still = 1e-4 * rng.normal(size=(20, *shape, 3))
    load = rng.uniform(0.5, 1.0, (2 * WINDOW, *shape))
    ratio = rng.uniform(0.3, 0.9, shape) * rng.uniform(0.9, 1.1, load.shape)
    way = rng.uniform(0.0, 2 * np.pi, shape)
    parts = (ratio * load * np.cos(way), ratio * load * np.sin(way), load)
    frames = np.concatenate([still, np.stack(parts, axis=-1)])
    # of an array slower than a sample every 15 ms, the frames of the window's time count
    true = texture(frames[20:], window=round(WINDOW * APART * RATE))
    expected = {"friction": true.friction[-1], "roughness": true.roughness[-1]}
    return ProgramCase(frames, expected, {"push": 1.0, "window": WINDOW, "rate": RATE})


def _off_texture(case: ProgramCase, outputs: Outputs) -> float:
    friction = np.abs(outputs["texture_friction"] - case.expected["friction"]).max()
    roughness = np.abs(outputs["texture_roughness"] - case.expected["roughness"]).max()
    return float(max(friction, roughness / 100.0))


FORMS = (
    ProgramForm(
        name="bump-loads",
        program="localize",
        needs=("bump_contact", "bump_load_normal"),
        cases=_bumps,
        error=_misjudged,
        tolerance=0.03,
        tolerance_reason="the inverse is cut at three bumps (2 %), the noise adds four deviations",
        summary="loads of bumps, by the finite-element influence summed bump by bump",
    ),
    ProgramForm(
        name="all-bits",
        program="grasp_code",
        needs=("grasp_code", "code_known"),
        cases=_grasps,
        error=_wrong_codes,
        tolerance=0.0,
        tolerance_reason="a bit is right or wrong",
        summary="codes of shears drawn bit by bit",
    ),
    ProgramForm(
        name="friction-and-roughness",
        program="texture",
        needs=("texture_friction", "texture_roughness"),
        cases=_rubbed,
        error=_off_texture,
        tolerance=2e-3,
        tolerance_reason="rest is known to 2e-5 of loads above 0.5, and floats to 1e-7",
        summary="(6.3) and (6.4) over the whole recording",
    ),
)
