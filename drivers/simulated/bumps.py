"""The bumpy cover, by the coefficients of finite elements: same taxels and cells as `cover`."""

import numpy as np

from cnnum.arrays import Floats
from cnnum.drivers.simulated.cover import MARGIN, Layout
from cnnum.tactile.cover import BumpCover
from cnnum.tactile.grid import make_grid


def bumpy_influence(
    layout: Layout, thickness: float, youngs_modulus: float, bump_radius: float
) -> Floats:
    """Return the strain at each taxel under a unit traction on each cell of a bumpy cover.

    Only bumps are touched, and each takes the whole load of its pitch square on its top. A drag
    acts above the bump's foot, so it also tips the bump: its front edge presses down and its rear
    edge lifts. On the axis below, that moment shears the layer against the drag, and from 0.63 bump
    radii on it outweighs the drag's own shear, which fades as the fourth power of the depth. The
    sign of ε_xz under a bump is therefore the opposite of the sign under a flat cover.

    Parameters
    ----------
    layout : Layout
    thickness : float, m
        Depth of the taxels below the foot of the bumps: 0.5 to 5 bump radii.
    youngs_modulus : float, Pa
        Young's modulus of an incompressible cover.
    bump_radius : float, m

    The shape is that of `flat_influence`.

    Raises
    ------
    PhysicsError
        If the thickness is none that the coefficients hold.
    """
    cover = BumpCover(thickness, youngs_modulus, bump_radius)
    taxels, surface = layout.taxels, layout.surface
    bumps = make_grid([n + 2 * MARGIN for n in layout.shape], layout.pitch)
    at_taxels = np.stack(np.meshgrid(taxels.x, taxels.y), axis=-1)
    at_bumps = np.stack(np.meshgrid(bumps.x, bumps.y), axis=-1).reshape(-1, 2)
    away = at_taxels[:, :, None, None] - at_bumps[:, None]
    force = np.eye(3) * surface.cell_area
    strain = cover.strain([0.0, 0.0], away, force)
    cells = strain[:, :, layout.nearest().reshape(-1)]
    return np.asarray(cells.reshape(*layout.shape, *surface.shape, 3, 3))
