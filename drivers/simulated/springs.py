"""Friction between a sphere and the cover, with its whole history, and the tractions it leaves.

A sphere on an elastic half-space is the same as a row of independent springs (the method of
dimensionality reduction): one at each distance s from the centre. Each has a shear deflection u(s)
and a twist F(s) of its own, which slip at limits of their own. Under a force that only grows this
is Cattaneo and Mindlin's solution, under a torque Lubkin's, exactly. Under any other history it is
Jäger's. The tractions on the surface follow by Abel's transform::

    q(ρ) = -(1/π) ∫ G* u'(s) / √(s² - ρ²) ds,    τ(ρ) = -(4Gρ/π) ∫ F'(s) / √(s² - ρ²) ds

from ρ to a, and the limits are those whose transform is friction times Hertz's pressure::

    u_lim(s) = μ E*/G* (a² - s²)/R,              F_lim(s) = μ p₀/(2G) (K(k) - E(k)), k² = 1 - s²/a²

Where shear and twist act together each spring keeps (u/u_lim)² + (F/F_lim)² ≤ 1. Each limit is
exact alone; the mixture is a model: friction turns towards the sliding direction as it should. But
in sliding and turning at once force and torque may be off by a third of their limits.

References
----------
Popov & Heß, Method of Dimensionality Reduction in Contact Mechanics and Friction (2015);
Jäger, Arch. Appl. Mech. 65 (1995) 478; Lubkin, J. Appl. Mech. 18 (1951) 183.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cnnum.arrays import Floats
from cnnum.drivers.simulated.settings import Command
from cnnum.tactile.contact import contact_modulus, hertz
from cnnum.tactile.grid import Grid

ROUNDS = 9
"""Of the means: they agree to all digits from ratios of 1e-9 on, and springs stand closer to 1."""


@dataclass(frozen=True, slots=True)
class Pair:
    """A rigid sphere and an elastic cover.

    Attributes
    ----------
    radius : float, m
    youngs_modulus : float, Pa
    poisson : float
    friction : float
    """

    radius: float
    youngs_modulus: float
    friction: float
    poisson: float = 0.5

    @property
    def normal_modulus(self) -> float:
        """E* = E / (1 - ν²), Pa."""
        return float(contact_modulus(self.youngs_modulus, self.poisson))

    @property
    def shear_modulus(self) -> float:
        """G, Pa."""
        return self.youngs_modulus / (2 * (1 + self.poisson))

    @property
    def tangential_modulus(self) -> float:
        """G* = 4G / (2 - ν), Pa."""
        return 4 * self.shear_modulus / (2 - self.poisson)

    def contact_radius(self, load: float) -> float:
        """Return the contact's radius under a load (N), m."""
        return float(hertz(load, self.radius, self.normal_modulus).contact_radius)


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """The contact at one scan.

    Attributes
    ----------
    load : float, N
    contact_radius, stick_radius : float, m
    shear : (2, springs) float, m
        Deflection along x and y.
    twist : (springs,) float, rad
        Empty under a flat face, whose springs turn by moving.
    position : (2,) float, m
        Centre of the contact on the cover.
    slipped : (2,) float, m
        How far the body slid over the cover since the scan before.
    angle : float, rad
        How far it has turned on the cover, where that changes what it touches.
    facing : State or None
        The contact under the other finger, in that one's axes.
    """

    load: float
    contact_radius: float
    stick_radius: float
    shear: Floats
    twist: Floats
    position: Floats
    slipped: Floats
    angle: float = 0.0
    facing: "State | None" = None


class Springs:
    """The springs of one pair, at fixed distances from the centre.

    Parameters
    ----------
    pair : Pair
    reach : float, m
        Distance of the last spring; contacts must stay inside.
    count : int
        Number of springs: the stick radius is known to ``reach / (count - 1)``.
    """

    def __init__(self, pair: Pair, reach: float, count: int = 257) -> None:
        self.pair = pair
        self.s: Floats = np.linspace(0.0, reach, count)
        self.spacing = reach / (count - 1)

    def rest(self, position: tuple[float, float]) -> State:
        """Return the state in which nothing touches."""
        zero = np.zeros(self.s.size)
        where = np.array(position, dtype=np.float64)
        return State(0.0, 0.0, 0.0, np.stack([zero, zero]), zero, where, np.zeros(2))

    def step(self, before: State, command: Command) -> State:
        """Return the state after one command."""
        a = self.pair.contact_radius(command.load)
        if a == 0.0:
            return self.rest((float(before.position[0]), float(before.position[1])))
        inside = self.s < a
        shear, twist = self._moved(before, command, a)
        rest_shear, rest_twist = self._limits(command, a)
        use = np.hypot(np.hypot(*shear) / rest_shear, twist / rest_twist)
        keep = np.where(inside, 1 / np.maximum(use, 1.0), 0.0)
        slipped = (1 - keep[0]) * shear[:, 0]
        return State(
            load=command.load,
            contact_radius=a,
            stick_radius=self._stick_radius(use, a),
            shear=keep * shear,
            twist=keep * twist,
            position=before.position + slipped + np.array(command.roll),
            slipped=slipped,
        )

    def reach(self, state: State) -> float:
        """Return how far the contact reaches from its middle, m."""
        return state.contact_radius

    def force(self, state: State) -> Floats:
        """Return the shear force of the sphere on the cover, (2,) N."""
        line = self.pair.tangential_modulus * state.shear
        return np.asarray(2 * np.trapezoid(line, self.s, axis=1))

    def torque(self, state: State) -> float:
        """Return the torque of the sphere on the cover, N m: 16 G ∫ s² F ds."""
        return float(16 * self.pair.shear_modulus * np.trapezoid(self.s**2 * state.twist, self.s))

    def _moved(self, before: State, command: Command, a: float) -> tuple[Floats, Floats]:
        """Return the deflections if nothing slipped."""
        rolled = np.exp(-np.hypot(*command.roll) / a)
        push, turn = self._given(before, command, a)
        move = np.array(command.move) + push
        shear = rolled * before.shear + move[:, None]
        return shear, rolled * before.twist + command.turn + turn

    def _given(self, before: State, command: Command, a: float) -> tuple[Floats, float]:
        """Return how the sphere moves back when the hand gives way, as far as it would spring."""
        if command.give == 0.0:
            return np.zeros(2), 0.0
        push = self.force(before) / (2 * self.pair.tangential_modulus * a)
        turn = 3 * self.torque(before) / (16 * self.pair.shear_modulus * a**3)
        return -command.give * push, -command.give * turn

    def _limits(self, command: Command, a: float) -> tuple[Floats, Floats]:
        """Return the deflections at which each spring slips; tiny, not 0, outside the contact."""
        pair, friction = self.pair, self.pair.friction * command.friction
        ratio = np.minimum(np.maximum(self.s, self.spacing / 4) / a, 1.0)
        stiffness = pair.normal_modulus / pair.tangential_modulus
        shear = friction * stiffness * a * a * (1 - ratio**2) / pair.radius
        peak = 1.5 * command.load / (np.pi * a * a)
        twist = friction * peak / (2 * pair.shear_modulus) * _k_less_e(ratio)
        tiny = np.finfo(np.float64).tiny
        return np.maximum(shear, tiny), np.maximum(twist, tiny)

    def _stick_radius(self, use: Floats, a: float) -> float:
        """Return where the sticking disc ends: the first spring at its limit."""
        first = int(np.argmax((use >= 1 - 1e-9) | (self.s >= a)))
        if self.s[first] >= a and use[max(first - 1, 0)] < 1 - 1e-9:
            return a
        return max(0.0, float(self.s[first]) - self.spacing / 2)


def _k_less_e(ratio: Floats) -> Floats:
    """Return K(k) - E(k) for k² = 1 - ratio², by the arithmetic-geometric mean.

    Abramowitz and Stegun (1964), 17.6.3 and 17.6.4. SciPy's take longer to import than a scene to
    begin.
    """
    mean, root = np.ones_like(ratio), ratio
    total, weight = (1 - ratio * ratio) / 2, 0.5
    for _ in range(ROUNDS):
        mean, root, half = (mean + root) / 2, np.sqrt(mean * root), (mean - root) / 2
        weight *= 2
        total = total + weight * half * half
    return np.asarray(np.pi / (2 * mean) * total, dtype=np.float64)


SUBCELLS = 3
"""Points a side in which a cell's traction is averaged."""


@dataclass(frozen=True, slots=True)
class Window:
    """The cells that some contacts reach: everywhere else there is no traction."""

    rows: slice
    cols: slice


class Tractions:
    """Maps of surface traction, for many scans at once.

    Parameters
    ----------
    springs : Springs
    grid : Grid
        Cells of the surface.
    """

    def __init__(self, springs: Springs, grid: Grid) -> None:
        self._springs = springs
        self._grid = grid
        self._rho, self._transform = abel(springs.s)

    def window(self, states: Sequence[State]) -> Window:
        """Return the cells within reach of the contacts."""
        centres = np.array([s.position for s in states])
        reach = np.array([s.contact_radius for s in states])
        return Window(
            _span(centres[:, 1], reach, self._grid.y_edges),
            _span(centres[:, 0], reach, self._grid.x_edges),
        )

    def __call__(self, states: Sequence[State], window: Window) -> Floats:
        """Return (states, rows, cols, 3) float, Pa: q_x, q_y and the pressure, cell averages."""
        rows = _points(self._grid.y[window.rows], self._grid.dy)
        cols = _points(self._grid.x[window.cols], self._grid.dx)
        centres = np.array([s.position for s in states])
        y = rows[None, :, None] - centres[:, 1, None, None]
        x = cols[None, None, :] - centres[:, 0, None, None]
        points = self._at(states, x, y)
        count, high, wide, _ = points.shape
        cells = (count, high // SUBCELLS, SUBCELLS, wide // SUBCELLS, SUBCELLS, 3)
        return self._balanced(states, points.reshape(cells).mean(axis=(2, 4)))

    def _at(self, states: Sequence[State], x: Floats, y: Floats) -> Floats:
        """Return the tractions at points relative to the contacts' centres."""
        rho = np.hypot(x, y)
        shear, twist = self._profiles(states)
        # the circumferential traction is τ/ρ times (-y, x): no direction is lost at the centre
        q_x, q_y, spin = (self._look_up(table, rho) for table in (*shear, twist))
        return np.stack([q_x - spin * y, q_y + spin * x, self._pressure(states, rho)], axis=-1)

    def _profiles(self, states: Sequence[State]) -> tuple[Floats, Floats]:
        """Return q_x, q_y (2, states, ρ), Pa, and τ/ρ (states, ρ), Pa/m."""
        pair = self._springs.pair
        shear = np.stack([s.shear for s in states], axis=1)
        twist = np.stack([s.twist for s in states])
        return (
            pair.tangential_modulus * shear @ self._transform,
            4 * pair.shear_modulus * twist @ self._transform,
        )

    def _look_up(self, table: Floats, rho: Floats) -> Floats:
        """Interpolate each state's profile linearly in ρ."""
        place = rho / self._springs.spacing - 0.5
        left = np.clip(place.astype(np.intp), 0, table.shape[1] - 2)
        share = np.clip(place - left, 0.0, 1.0)
        flat = left.reshape(len(table), -1)
        low = np.take_along_axis(table, flat, 1).reshape(rho.shape)
        high = np.take_along_axis(table, flat + 1, 1).reshape(rho.shape)
        return np.asarray(low + share * (high - low))

    def _pressure(self, states: Sequence[State], rho: Floats) -> Floats:
        pair = self._springs.pair
        loads = np.array([s.load for s in states])[:, None, None]
        return hertz(loads, pair.radius, pair.normal_modulus).pressure(rho)

    def _balanced(self, states: Sequence[State], cells: Floats) -> Floats:
        """Scale each map so that its pressure adds up to the load in spite of the cells."""
        total = cells[..., 2].sum(axis=(1, 2)) * self._grid.cell_area
        loads = np.array([s.load for s in states])
        scale = np.divide(loads, total, out=np.ones_like(loads), where=total > 0)
        return np.asarray(cells * scale[:, None, None, None])


def abel(s: Floats) -> tuple[Floats, Floats]:
    """Return the points ρ and the matrix of f ↦ -(1/π) ∫ f'(s) / √(s² - ρ²) ds from ρ on.

    f is linear between the springs, so every piece is a difference of inverse hyperbolic cosines.
    The points lie midway between the springs.

    Parameters
    ----------
    s : (n,) float
        Distances of the springs, from 0, equally spaced.

    Returns
    -------
    rho : (n - 1,) float
    matrix : (n, n - 1) float
        To be multiplied from the right.
    """
    rho = (s[1:] + s[:-1]) / 2
    ends: Floats = np.asarray(np.arccosh(np.maximum(s[:, None] / rho, 1.0)), dtype=np.float64)
    pieces: Floats = (ends[1:] - ends[:-1]) / (np.pi * (s[1] - s[0]))
    matrix = np.zeros((s.size, rho.size))
    matrix[:-1] += pieces
    matrix[1:] -= pieces
    return rho, matrix


def _span(centres: Floats, reach: Floats, edges: Floats) -> slice:
    """Return the cells between the outermost rims, at least one."""
    low = int((edges <= np.min(centres - reach)).sum()) - 1
    high = int((edges < np.max(centres + reach)).sum())
    low = min(max(low, 0), edges.size - 2)
    return slice(low, max(high, low + 1))


def _points(middles: Floats, size: float) -> Floats:
    offsets = ((np.arange(SUBCELLS) + 0.5) / SUBCELLS - 0.5) * size
    return np.asarray((middles[:, None] + offsets).reshape(-1))
