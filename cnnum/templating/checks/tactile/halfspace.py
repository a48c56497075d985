"""Closed forms of the half-space programs: cosine transform, direct solve, least squares."""

import numpy as np

from cnnum.arrays import Floats, Shape
from cnnum.tactile import halfspace
from cnnum.templating.checks.program_records import Outputs, ProgramCase, ProgramForm
from cnnum.templating.checks.tactile.lattice_cover import block_displacement, cover_stress, on_plane

PITCH, THICKNESS, MODULUS, NOISE, LIKELY = 1.5e-3, 1.0e-3, 0.87e6, 1e-3, 3e3
AXES = ("xz", "yz", "zz")
POISSON, SLABS = 0.45, 6

SLABS_ABOVE = 12
"""Of the stack that is held to 1e-5. With 8, the program's own, slabs alone leave 1.5e-5. That
holds in single precision as in double, and at any tolerance of its end. With 12 they leave 5e-6."""

REACH = 5
"""Cells over which a load is felt, where it is to be found."""


def _named(prefix: str, maps: Floats) -> dict[str, Floats]:
    return {f"{prefix}_{axis}": maps[..., n] for n, axis in enumerate(AXES)}


def _load(rng: np.random.Generator, shape: Shape) -> Floats:
    return rng.normal(size=(*shape, 3))


def _stress_case(rng: np.random.Generator, shape: Shape) -> ProgramCase:
    load = _load(rng, shape)
    return ProgramCase(load[None], _named("stress", cover_stress(load, THICKNESS / PITCH)))


def _layers_case(rng: np.random.Generator, shape: Shape) -> ProgramCase:
    case = _stress_case(rng, shape)
    return ProgramCase(case.frames, case.expected, {"layers": SLABS_ABOVE})


def _strain_case(rng: np.random.Generator, shape: Shape) -> ProgramCase:
    """Shear strain is 3σ/2E, which E = 1.5 makes the stress itself."""
    load = _load(rng, shape)
    stress = cover_stress(load, THICKNESS / PITCH)
    wanted = _named("strain", stress)
    del wanted["strain_zz"]
    return ProgramCase(load[None], wanted, {"youngs_modulus": 1.5})


def _block_case(rng: np.random.Generator, shape: Shape) -> ProgramCase:
    load = _load(rng, shape)
    found = on_plane(block_displacement(load, SLABS, 1.0, POISSON), 2)
    names = ("displacement_x", "displacement_y", "displacement_z")
    options = {
        "thickness": 2.0e-3,
        "pitch": 1.0e-3,
        "slabs": SLABS,
        "match": False,
        "poisson": POISSON,
        "youngs_modulus": 2e-3 * (1 + POISSON),
    }
    return ProgramCase(load[None], {n: found[..., k] for k, n in enumerate(names)}, options)


def _inverse_case(rng: np.random.Generator, shape: Shape) -> ProgramCase:
    """Loads on all cells that any taxel feels, by a dense solve."""
    strain = rng.normal(0.0, 30 * NOISE, (*shape, 3))
    cover = _felt(shape) * (LIKELY / NOISE)
    loads = cover.T @ np.linalg.solve(
        cover @ cover.T + np.eye(len(cover)), strain.ravel() * (LIKELY / NOISE)
    )
    rows, cols = shape
    found = loads.reshape(rows + 2 * REACH, cols + 2 * REACH, 3)[REACH:-REACH, REACH:-REACH]
    names = ("load_x", "load_y", "load_normal")
    options = {"noise": NOISE, "likely": LIKELY, "reach": REACH, "drag": 1.0, "rounds": 0}
    return ProgramCase(strain[None], {n: found[..., k] for k, n in enumerate(names)}, options)


def _felt(shape: Shape) -> Floats:
    """Return (strains, loads), 1/Pa: of loads up to `REACH` cells away along both axes, or none."""
    taxels, cells = (
        np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 2).astype(np.float64)
        for axes in (map(np.arange, shape), [np.arange(-REACH, n + REACH) for n in shape])
    )
    down, right = np.moveaxis(taxels[:, None] - cells, -1, 0)
    near = np.maximum(np.abs(down), np.abs(right)) <= REACH
    felt = [
        halfspace.rectangle_strain(
            PITCH * right, PITCH * down, THICKNESS, load,
            size=(PITCH, PITCH), youngs_modulus=MODULUS,
        )[..., 2, :] * near[..., None]
        for load in np.eye(3)
    ]  # fmt: skip
    return np.asarray(np.stack(felt, -1).transpose(0, 2, 1, 3).reshape(3 * len(taxels), -1))


def _share(case: ProgramCase, outputs: Outputs) -> float:
    """Return the largest error, as a share of the largest value."""
    largest = max(float(np.abs(map_).max()) for map_ in case.expected.values())
    return max(float(np.abs(outputs[n] - w).max()) for n, w in case.expected.items()) / largest


STRESS = tuple(f"stress_{axis}" for axis in AXES)

FORMS = (
    ProgramForm(
        "cover-transform", "halfspace_stress", STRESS, _stress_case, _share, 1e-5,
        "1e-6 of every wave, and roundings in single precision",
        "stress under white noise, by cosine transform",
    ),
    ProgramForm(
        "cover-transform", "halfspace_strain", ("strain_xz", "strain_yz"), _strain_case, _share,
        1e-5, "1e-6 of every wave, and roundings in single precision",
        "shear strain under white noise, by cosine transform",
    ),
    ProgramForm(
        "cover-transform", "halfspace_layers", STRESS, _layers_case, _share, 1e-5,
        "slabs of a twelfth of the depth leave up to 8e-6, in white noise on 4×4 to 16×16 cells",
        "stress under white noise, by cosine transform",
        too_slow=("numba", "reference"),
        left_out="without modes its layers relax, which takes minutes or leaves 3e-4",
    ),
    ProgramForm(
        "elastic-block", "halfspace_equilibrium",
        ("displacement_x", "displacement_y", "displacement_z"), _block_case, _share, 1e-5,
        "roundings in single precision of sums over all cells",
        "displacement of a block, by a direct solve of its energy",
        too_slow=("reference",),
        left_out="takes minutes to settle such a block",
    ),
    ProgramForm(
        "least-squares", "surface_load", ("load_x", "load_y", "load_normal"), _inverse_case,
        _share, 1e-4, "roundings in single precision, times the inverse's gain",
        "Tikhonov's loads, by a dense solve",
    ),
)  # fmt: skip
