"""Answers of programs that model the cover: the half-space, and its elastic lattice."""

from typing import Any

import numpy as np
import scipy.sparse
from scipy.fft import dctn, idctn
from scipy.sparse import linalg

from cnnum.arrays import Floats, Shape
from cnnum.tactile import halfspace
from cnnum.templating.checks.program_run import Outputs, ProgramCase, ProgramForm

sp: Any = scipy.sparse
"""Its types distinguish matrices that are one kind here."""

solve: Any = linalg.spsolve


def cover_stress(load: Floats, depth: float) -> Floats:
    """Return stress under an incompressible cover, by cosine transform.

    Parameters
    ----------
    load : (rows, cols, 3) float, Pa
        q_x, q_y and p, which go on mirrored beyond the rim.
    depth : float
        Cells.

    Returns
    -------
    (rows, cols, 3) float, Pa
        σ_xz, σ_yz, σ_zz, tension positive: five-point k, central differences.
    """
    rows, cols = (
        2 - 2 * np.cos(np.pi / n * np.arange(n, dtype=np.float64)) for n in load.shape[:2]
    )
    k = np.sqrt(rows[:, np.newaxis] + cols)
    fading = np.exp(-k * depth)
    over = fading / np.where(k > 0, k, np.inf)
    q = [load[..., 0], load[..., 1]]
    normal = _slope(_filtered(load[..., 2], fading), 1), _slope(_filtered(load[..., 2], fading), 0)
    potential, harmonic = [_filtered(u, over) for u in q], [_filtered(u, fading) for u in q]
    bent_x = _bend(potential[0], 1) + _slope(_slope(potential[1], 0), 1)
    bent_y = _bend(potential[1], 0) + _slope(_slope(potential[0], 1), 0)
    pushed = _slope(harmonic[0], 1) + _slope(harmonic[1], 0)
    low = _filtered(load[..., 2], (1 + k * depth) * fading)
    return np.stack(
        [
            depth * (normal[0] - bent_x) - harmonic[0],
            depth * (normal[1] - bent_y) - harmonic[1],
            depth * pushed - low,
        ],
        axis=-1,
    )


def _filtered(field: Floats, response: Floats) -> Floats:
    return np.asarray(idctn(dctn(field, norm="ortho") * response, norm="ortho"), dtype=np.float64)


def _slope(field: Floats, axis: int) -> Floats:
    padded = np.pad(field, [(1, 1) if a == axis else (0, 0) for a in range(2)], mode="edge")
    n = field.shape[axis]
    return np.asarray(
        (padded.take(range(2, n + 2), axis) - padded.take(range(n), axis)) / 2, dtype=np.float64
    )


def _bend(field: Floats, axis: int) -> Floats:
    padded = np.pad(field, [(1, 1) if a == axis else (0, 0) for a in range(2)], mode="edge")
    n = field.shape[axis]
    ends = padded.take(range(2, n + 2), axis) + padded.take(range(n), axis)
    return np.asarray(ends - 2 * field, dtype=np.float64)


def block_displacement(load: Floats, slabs: int, slab: float, poisson: float) -> Floats:
    """Return displacement of a staggered elastic block by a sparse direct solve of its energy.

    Parameters
    ----------
    load : (rows, cols, 3) float
        Tractions q_x, q_y, p on a torus.
    slabs : int
    slab : float
        Thickness, cells. The base is held.
    poisson : float

    Returns
    -------
    (3, slabs, rows, cols) float
        Displacement times the shear modulus, cells: u_x and u_y half a cell ahead in the middle
        of each slab, u_z on its upper plane.
    """
    rows, cols, _ = load.shape
    plane = rows * cols
    along = sp.kron(sp.identity(rows), _ring(cols)), sp.kron(_ring(rows), sp.identity(cols))
    zero, every = sp.csr_matrix((slabs * plane, slabs * plane)), sp.identity(slabs)
    down = sp.diags([-np.ones(slabs), np.ones(slabs - 1)], [0, 1]) / slab
    stretches = [
        sp.hstack([sp.kron(every, -along[0].T), zero, zero]),
        sp.hstack([zero, sp.kron(every, -along[1].T), zero]),
        sp.hstack([zero, zero, sp.kron(down, sp.identity(plane))]),
    ]
    volume = stretches[0] + stretches[1] + stretches[2]
    matrix = 2 * slab * sum(s.T @ s for s in stretches)
    matrix = matrix + slab * 2 * poisson / (1 - 2 * poisson) * volume.T @ volume
    turned = sp.hstack([sp.kron(every, along[1]), sp.kron(every, along[0]), zero])
    matrix = matrix + slab * turned.T @ turned
    inner = sp.diags([0.0] + [1.0] * (slabs - 1))
    rise = inner @ sp.diags([np.ones(slabs), -np.ones(slabs - 1)], [0, -1]) / slab
    last = sp.csr_matrix(([2.0 / slab], ([slabs - 1], [slabs - 1])), (slabs, slabs))
    for axis in range(2):
        parts, held = [zero, zero, sp.kron(inner, along[axis])], [zero, zero, zero]
        parts[axis] = sp.kron(rise, sp.identity(plane))
        held[axis] = sp.kron(last, sp.identity(plane))
        for form, share in ((sp.hstack(parts), slab), (sp.hstack(held), slab / 2)):
            matrix = matrix + share * form.T @ form
    result = solve(matrix.tocsc(), _push(load, slabs, slab))
    return np.asarray(result, dtype=np.float64).reshape(3, slabs, rows, cols)


def on_plane(displacement: Floats, plane: int) -> Floats:
    """Return (rows, cols, 3) displacement in the middle of the cells of a plane."""
    sides = [(displacement[a, plane - 1] + displacement[a, plane]) / 2 for a in range(2)]
    sides = [(side + np.roll(side, 1, 1 - a)) / 2 for a, side in enumerate(sides)]
    return np.stack([*sides, displacement[2, plane]], axis=-1)


def _ring(n: int) -> Any:
    return sp.diags([-np.ones(n), np.ones(n - 1), [1.0]], [0, 1, 1 - n]).tocsr()


def _push(load: Floats, slabs: int, slab: float) -> Floats:
    q = [(load[..., a] + np.roll(load[..., a], -1, 1 - a)) / 2 for a in range(2)]
    push = np.zeros((3, slabs, *load.shape[:2]))
    push[0, 0], push[1, 0] = q
    lifted = sum(component - np.roll(component, 1, 1 - a) for a, component in enumerate(q))
    push[2, 0] = load[..., 2] - slab / 2 * lifted
    return push.ravel()


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
    result = on_plane(block_displacement(load, SLABS, 1.0, POISSON), 2)
    names = ("displacement_x", "displacement_y", "displacement_z")
    options = {
        "thickness": 2.0e-3,
        "pitch": 1.0e-3,
        "slabs": SLABS,
        "match": False,
        "poisson": POISSON,
        "youngs_modulus": 2e-3 * (1 + POISSON),
    }
    return ProgramCase(load[None], {n: result[..., k] for k, n in enumerate(names)}, options)


def _inverse_case(rng: np.random.Generator, shape: Shape) -> ProgramCase:
    """Loads on all cells that any taxel feels, by a dense solve."""
    strain = rng.normal(0.0, 30 * NOISE, (*shape, 3))
    cover = _felt(shape) * (LIKELY / NOISE)
    loads = cover.T @ np.linalg.solve(
        cover @ cover.T + np.eye(len(cover)), strain.ravel() * (LIKELY / NOISE)
    )
    rows, cols = shape
    result = loads.reshape(rows + 2 * REACH, cols + 2 * REACH, 3)[REACH:-REACH, REACH:-REACH]
    names = ("load_x", "load_y", "load_normal")
    options = {"noise": NOISE, "likely": LIKELY, "reach": REACH, "drag": 1.0, "rounds": 0}
    return ProgramCase(strain[None], {n: result[..., k] for k, n in enumerate(names)}, options)


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
