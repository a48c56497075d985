"""Work out the tables that ship with the package anew.

The shipped file comes from::

    from cnnum.tactile.cover.fem.generate import regenerate
    regenerate("bump.npz", force=True)
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from cnnum.errors import RecordingError
from cnnum.safety.files import written
from cnnum.tactile.checks import Array
from cnnum.tactile.cover.bump import DEPTHS, STRETCH
from cnnum.tactile.cover.fem.geometry import Shape
from cnnum.tactile.cover.fem.plate import PlaneBump, make_bodies, make_plane_bump

DEEP = 200.0
"""Bump radii to the sides and the bottom of the block that stands for a half-space."""

MARGIN = 12.0
"""Depths of surface beyond the bump, of a layer on a rigid base."""


def regenerate(
    path: str | Path | None = None,
    *,
    fineness: int = 8,
    depths: Sequence[float] = DEPTHS,
    growth: float = 1.05,
    plane_fineness: int = 16,
    force: bool = False,
) -> dict[str, Array]:
    """Compute the influence of a bump, and the figures of the plane one.

    Needs the extra "fem" and, as fine as shipped, some minutes.

    Parameters
    ----------
    path : str or Path, optional
        Where to write the tables to, as .npz in single precision.
    fineness, plane_fineness : int
        Cells along an eighth of the circle; a multiple of eight has a node at the rim of the patch.
    depths : sequence of float, bump radii
        Depths of the taxels below the surface.
    growth : float
        Growth factor of cells away from the bump.
    force : bool
        Whether an existing file is replaced.

    Returns
    -------
    dict of arrays
        As `cnnum.tactile.cover.bump.BumpTables` and `cnnum.tactile.cover.bump.PlaneFigures`
        name them.

    Raises
    ------
    MissingExtraError
        If scikit-fem is not installed.
    RecordingError
        If there is such a file, or it cannot be written.
    """
    deep, levers = _deep(fineness, depths, growth)
    layers = [_layer(fineness, depth, growth) for depth in depths]
    tables = {
        "depths": np.asarray(depths, dtype=np.float64),
        "lever": np.asarray(levers),
        "half_space": deep,
        "rigid_base": np.stack(layers),
        **plane_tables(make_plane_bump(plane_fineness)),
    }
    if path is not None:
        _write(Path(path), tables, force=force)
    return tables


def _deep(fineness: int, depths: Sequence[float], growth: float) -> tuple[Array, float]:
    bodies = make_bodies(Shape(DEEP, DEEP, growth=growth), fineness)
    profiles = [bodies.profiles(depth, STRETCH * (1 + depth)) for depth in depths]
    return np.stack(profiles), bodies.lever


def _layer(fineness: int, depth: float, growth: float) -> Array:
    shape = Shape(2.0 + MARGIN * (1 + depth), depth, growth=growth)
    bodies = make_bodies(shape, fineness)
    return bodies.profiles(depth, STRETCH * (1 + depth))


def plane_tables(bump: PlaneBump) -> dict[str, Array]:
    """Return the data of Fig. 6.9–6.12 and 6.14, lengths in bump radii, stress in moduli."""
    pressed, dragged = bump.solutions()
    x = np.linspace(-4.0, 4.0, 81)
    z = np.linspace(0.0, 5.0, 51)
    line = np.stack([x, np.ones_like(x)], axis=-1)
    axis = np.stack([np.zeros_like(z), z], axis=-1)
    field = np.stack([part.reshape(-1) for part in np.meshgrid(x, z)], axis=-1)
    both = (pressed, dragged)
    sheet = np.stack([bump.displacement(s, field) for s in both])
    return {
        "plane_x": x,
        "plane_z": z,
        "plane_field": sheet.reshape(2, 2, z.size, x.size),
        "plane_axis": np.stack([bump.displacement(s, axis) for s in both]),
        "plane_line": np.stack([bump.displacement(s, line) for s in both]),
        "plane_stress": np.stack([bump.stress(s, line) for s in both]),
        "plane_strain": np.stack([bump.strain(s, line) for s in both]),
        "plane_force": np.array([bump.working.force, 0.25 * bump.drag.stiffness]),
        "plane_indentation": np.array([c.indentation for c in bump.contacts]),
        "plane_growth": _growth(bump),
    }


def _growth(bump: PlaneBump) -> Array:
    """Return u_x, u_z at (0, 1), and u_z at ±1.3, over the indentation: (steps, 4)."""
    places = np.array([[0.0, 1.0], [-1.3, 1.0], [1.3, 1.0]])
    rows = [bump.displacement(contact.solution, places) for contact in bump.contacts]
    return np.stack([[ux[0], uz[0], uz[1], uz[2]] for ux, uz in rows])


def _write(path: Path, tables: Mapping[str, Array], *, force: bool) -> None:
    small = {name: table.astype(np.float32) for name, table in tables.items()}
    with written(path, error=RecordingError, force=force) as file:
        np.savez_compressed(file, allow_pickle=False, **small)
