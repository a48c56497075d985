"""The cover on the lattice by cosine transform, and an elastic block by a direct solve."""

from typing import Any

import numpy as np
import scipy.sparse
from scipy.fft import dctn, idctn
from scipy.sparse import linalg

from cnnum.arrays import Floats

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
    found = solve(matrix.tocsc(), _push(load, slabs, slab))
    return np.asarray(found, dtype=np.float64).reshape(3, slabs, rows, cols)


def on_plane(displacement: Floats, plane: int) -> Floats:
    """Return (rows, cols, 3) displacement in the middle of the cells of a plane."""
    sides = [(displacement[a, plane - 1] + displacement[a, plane]) / 2 for a in range(2)]
    sides = [(each + np.roll(each, 1, 1 - a)) / 2 for a, each in enumerate(sides)]
    return np.stack([*sides, displacement[2, plane]], axis=-1)


def _ring(n: int) -> Any:
    return sp.diags([-np.ones(n), np.ones(n - 1), [1.0]], [0, 1, 1 - n]).tocsr()


def _push(load: Floats, slabs: int, slab: float) -> Floats:
    q = [(load[..., a] + np.roll(load[..., a], -1, 1 - a)) / 2 for a in range(2)]
    push = np.zeros((3, slabs, *load.shape[:2]))
    push[0, 0], push[1, 0] = q
    lifted = sum(each - np.roll(each, 1, 1 - a) for a, each in enumerate(q))
    push[2, 0] = load[..., 2] - slab / 2 * lifted
    return push.ravel()
