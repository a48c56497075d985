"""The tractions that a sphere leaves on the surface: pressed, pulled, twisted, or all at once.

Shear under a tangential force and a torque at once: no closed form, two approximations.

Below sliding, the tractions of the force alone and of the torque alone are scaled and added. Cell
by cell they are cut to friction times pressure. The scales are those with which the cut field still
carries both loads. Sliding as a whole turns about a pole, and friction points along the motion
everywhere. That is exact for rigid sliding, up to the cells' midpoints.
"""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from cnnum.tactile import checks
from cnnum.tactile.checks import Array
from cnnum.tactile.contact.cells import inverse_average, root_average, swirl_average, twist_average
from cnnum.tactile.contact.normal import hertz
from cnnum.tactile.contact.torsion import TorsionSlip, sliding_torque, torsion_slip
from cnnum.tactile.grid import Grid, make_grid

# The scales converge linearly, slowest next to sliding: there 60 iterations leave less than 1 %.
_ROUNDS = 60
_CLOSE = 1e-9


def partial_shear(pulled: Array, twisted: Array, limit: Array, arm: Array) -> Array:
    """Return the scaled sum of two shear maps, cut to a limit.

    Parameters
    ----------
    pulled, twisted : (rows, cols, 2) float, Pa
        Shear under the force alone and under the torque alone.
    limit : (rows, cols) float, Pa
        Friction times pressure.
    arm : (rows, cols, 2) float, m
        (-y, x) of each cell from the contact's centre.

    Returns
    -------
    (rows, cols, 2) float, Pa
        Shear that carries both loads to about 1e-9, unless they are next to sliding.
    """
    direction = pulled.sum(axis=(0, 1))
    force, torque = float((pulled * direction).sum()), float((twisted * arm).sum())
    more_pull = more_twist = 1.0
    shear = limited(pulled + twisted, limit)
    for _ in range(_ROUNDS):
        pull = force / float((shear * direction).sum())
        twist = torque / float((shear * arm).sum())
        if max(abs(pull - 1), abs(twist - 1)) < _CLOSE:
            break
        more_pull, more_twist = more_pull * pull, more_twist * twist
        shear = limited(more_pull * pulled + more_twist * twisted, limit)
    return shear


def sliding_shear(direction: Array, ratio: float, limit: Array, arm: Array, size: float) -> Array:
    """Return the shear of a contact that slides and turns as a whole.

    Parameters
    ----------
    direction : (2,) float
        Unit vector of the tangential force.
    ratio : float, m
        Torque over force; its sign is the torque's.
    limit, arm
        As in `partial_shear`.
    size : float, m
        Contact radius, the scale of the pole's distance.

    Returns
    -------
    (rows, cols, 2) float, Pa
        Shear of size `limit` along the motion about the pole whose loads have that ratio.
    """

    def shear(log_speed: float) -> Array:
        motion = size * math.exp(log_speed) * direction + math.copysign(1.0, ratio) * arm
        speed = np.hypot(motion[..., 0], motion[..., 1])
        return motion * (limit / np.where(speed > 0, speed, 1.0))[..., None]

    def excess(log_speed: float) -> float:
        now = shear(log_speed)
        return abs(float((now * arm).sum())) - abs(ratio) * abs(float((now @ direction).sum()))

    low, high = -12.0, 12.0
    if excess(low) <= 0:
        return shear(low)
    if excess(high) >= 0:
        return shear(high)
    from scipy.optimize import brentq

    return shear(float(brentq(excess, low, high, xtol=1e-12)))


def limited(shear: Array, limit: Array) -> Array:
    """Return the shear map with each vector cut to the size `limit`, its direction kept."""
    size = np.hypot(shear[..., 0], shear[..., 1])
    over = size > limit
    factor = np.where(over, limit / np.where(over, size, 1.0), 1.0)
    return np.asarray(shear * factor[..., None])


Regime = Literal["none", "stick", "partial", "sliding"]


@dataclass(frozen=True, slots=True)
class ContactState:
    """Radii, pressure and regime of the contact of a sphere.

    Parameters
    ----------
    contact_radius : float, m
        Radius a of the contact, 0 without load.
    stick_radius : float, m
        Radius c of the stick zone. Under force and torque together, it is the smaller of the radii
        for each alone, an upper bound.
    peak_pressure : float, Pa
        Pressure at the centre.
    regime : str
        "none" (no load), "stick" (neither force nor torque, or unlimited friction), "partial",
        or "sliding".
    """

    contact_radius: float
    stick_radius: float
    peak_pressure: float
    regime: Regime


@dataclass(frozen=True, slots=True)
class _Load:
    """The checked loads of one sphere."""

    normal: float
    tangential: tuple[float, float]
    torque: float
    friction: float
    centre: tuple[float, float]

    @property
    def pull(self) -> float:
        return math.hypot(*self.tangential)

    @property
    def direction(self) -> Array:
        return np.asarray(self.tangential) / self.pull


def sphere_traction(
    shape: tuple[int, int],
    spacing: float | tuple[float, float],
    *,
    load: float,
    sphere_radius: float,
    modulus: float,
    friction: float,
    centre: tuple[float, float] = (0.0, 0.0),
    tangential: tuple[float, float] = (0.0, 0.0),
    torque: float = 0.0,
) -> tuple[Array, ContactState]:
    """Return the tractions of a sphere on the cells of a map, and the state of its contact.

    Force and torque are assumed to have grown together from zero under a constant normal load.
    Under a force alone, the cells hold the exact averages of the Cattaneo-Mindlin traction; under a
    torque alone, those of the Lubkin traction. *Under both, the result is an approximation*: the
    two tractions are scaled, added and limited to friction times pressure cell by cell, such that
    both loads are carried. If the contact slides, friction points along a rotation about the pole
    that gives the ratio of the loads.

    Parameters
    ----------
    shape : (rows, cols) int
        Cells of the map; columns run along x and rows along y, with the origin in the middle.
    spacing : float or (dy, dx) float, m
        Size of a cell.
    load : float, N
        Normal load P, 0 or more.
    sphere_radius : float, m
        Radius R of the sphere.
    modulus : float, Pa
        Contact modulus E*, see `contact_modulus`.
    friction : float
        Coefficient of friction μ; 0 for a slippery sphere, infinity for one that cannot slip.
    centre : (x, y) float, m
        Where the sphere touches; parts outside the map are left out.
    tangential : (Q_x, Q_y) float, N
        Tangential force on the surface; from μP on, the contact slides and carries μP.
    torque : float, N m
        Torque on the surface about z, turning x towards y; from 3πμPa/16 on, the contact slides and
        carries this torque.

    Returns
    -------
    traction : (rows, cols, 3) float, Pa
        Cell averages of (q_x, q_y, p).
    state : ContactState
        Radii and regime.

    Raises
    ------
    PhysicsError
        If the load or friction is negative, a radius, modulus or spacing is not positive, or a
        number other than the friction is not finite.
    ArrayError
        If the shape, centre or force has the wrong number of entries.

    References
    ----------
    Johnson, Contact Mechanics, 4.2, 7.2; Lubkin (1951).
    """
    grid = make_grid(shape, spacing)
    loads = _checked(load, tangential, torque, friction, centre)
    contact = hertz(loads.normal, sphere_radius, modulus)
    a, peak = float(contact.contact_radius), float(contact.peak_pressure)
    if a == 0:
        return np.zeros((*grid.shape, 3)), ContactState(0.0, 0.0, 0.0, "none")
    pressure = peak / a * root_average(grid, loads.centre, a)
    state = _state(loads, a, peak)
    return np.concatenate(
        [_shear(grid, loads, state, pressure), pressure[..., None]], axis=-1
    ), state


def _state(loads: _Load, a: float, peak: float) -> ContactState:
    if math.isinf(loads.friction) or (loads.pull == 0 and loads.torque == 0):
        return ContactState(a, a, peak, "stick")
    if loads.friction == 0:
        return ContactState(a, 0.0, peak, "sliding")
    pull, twist = _shares(loads, a)
    # the pair that slides lies close to this ellipse (Howe & Cutkosky 1996)
    if math.hypot(pull, twist) >= 1:
        return ContactState(a, 0.0, peak, "sliding")
    c = min(a * (1 - pull) ** (1 / 3), _twisted(loads, a).stick_radius)
    return ContactState(a, c, peak, "partial")


def _shear(grid: Grid, loads: _Load, state: ContactState, pressure: Array) -> Array:
    if loads.friction == 0:
        return np.zeros((*grid.shape, 2))
    if math.isinf(loads.friction):
        return _stuck_shear(grid, loads, state.contact_radius)
    if loads.torque == 0:
        return _pulled_shear(grid, loads, state, pressure)
    if loads.pull == 0:
        return _twisted_shear(grid, loads, state)
    return _combined_shear(grid, loads, state, pressure)


def _stuck_shear(grid: Grid, loads: _Load, a: float) -> Array:
    pulled = inverse_average(grid, loads.centre, a)[..., None] * np.asarray(loads.tangential)
    twisted = loads.torque * twist_average(grid, loads.centre, a)
    return np.asarray(pulled / (2 * math.pi * a) + 3 / (4 * math.pi * a**3) * twisted)


def _pulled_shear(grid: Grid, loads: _Load, state: ContactState, pressure: Array) -> Array:
    if loads.pull == 0:
        return np.zeros((*grid.shape, 2))
    a = state.contact_radius
    c = a * (1 - _shares(loads, a)[0]) ** (1 / 3)
    stuck = state.peak_pressure / a * root_average(grid, loads.centre, c)
    return np.asarray(loads.friction * (pressure - stuck)[..., None] * loads.direction)


def _twisted_shear(grid: Grid, loads: _Load, state: ContactState) -> Array:
    slip = _twisted(loads, state.contact_radius)
    radii = (slip.contact_radius, slip.stick_radius)
    swirl = swirl_average(slip.potential, grid, loads.centre, radii)
    return np.asarray(math.copysign(1.0, loads.torque) * swirl)


def _combined_shear(grid: Grid, loads: _Load, state: ContactState, pressure: Array) -> Array:
    if not (pressure > 0).any():
        return np.zeros((*grid.shape, 2))
    # the loads are balanced over the whole contact, so the map must hold all of it
    a = state.contact_radius
    rows, cols = (
        _missing(loads.centre[1], a, grid.y_edges),
        _missing(loads.centre[0], a, grid.x_edges),
    )
    whole = Grid(grid.rows + 2 * rows, grid.cols + 2 * cols, grid.dy, grid.dx)
    shear = _balanced_shear(whole, loads, state)
    return shear[rows : rows + grid.rows, cols : cols + grid.cols]


def _balanced_shear(grid: Grid, loads: _Load, state: ContactState) -> Array:
    a = state.contact_radius
    pressure = state.peak_pressure / a * root_average(grid, loads.centre, a)
    limit = loads.friction * pressure
    x, y = np.broadcast_arrays(grid.x - loads.centre[0], grid.y[:, None] - loads.centre[1])
    arm = np.stack([-y, x], axis=-1)
    if state.regime == "sliding":
        return sliding_shear(loads.direction, loads.torque / loads.pull, limit, arm, a)
    pulled = _pulled_shear(grid, loads, state, pressure)
    return partial_shear(pulled, _twisted_shear(grid, loads, state), limit, arm)


def _missing(centre: float, a: float, edges: Array) -> int:
    """Return how many cells a side needs so that the contact lies inside."""
    beyond = abs(centre) + a - float(edges[-1])
    return max(0, math.ceil(beyond / float(edges[1] - edges[0])))


def _shares(loads: _Load, a: float) -> tuple[float, float]:
    """Return force and torque over the limits at which each slides alone, at most 1."""
    limit = float(sliding_torque(loads.normal, a, loads.friction))
    pull = loads.pull / (loads.friction * loads.normal)
    return min(pull, 1.0), min(abs(loads.torque) / limit, 1.0)


def _twisted(loads: _Load, a: float) -> TorsionSlip:
    return torsion_slip(loads.normal, a, abs(loads.torque), loads.friction)


def _checked(
    load: float,
    tangential: tuple[float, float],
    torque: float,
    friction: float,
    centre: tuple[float, float],
) -> _Load:
    q_x, q_y = checks.vector("tangential", tangential, 2)
    x, y = checks.vector("centre", centre, 2)
    grip = math.inf
    if friction != math.inf:
        grip = checks.scalar("friction", checks.not_negative("friction", friction))
    return _Load(
        normal=checks.scalar("load", checks.not_negative("load", load)),
        tangential=(float(q_x), float(q_y)),
        torque=checks.scalar("torque", checks.finite("torque", torque)),
        friction=grip,
        centre=(float(x), float(y)),
    )
