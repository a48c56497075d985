"""Bodies with a flat face, and a textured one on bumps: pressure, friction and traction.

A rigid flat face touches the same points at every load. Its pressure is Boussinesq's, which sinks
all of it evenly, so each point carries a fixed share w of the load. By Ciavarella's and Jäger's
principle the shear of a pull is spread as the pressure is, and all of the face slides at once:
every point has a spring of stiffness k w and slips at μ P w. A turn slips from the rim inwards. Of
a round face the traction of a turn that sticks is Reissner's and Sagoci's, τ ∝ ρ/√(a² − ρ²), and
the factor `TURNS` gives their stiffness, 16 G a³/3; of other faces the spread is a model.

A textured face on a bumpy cover touches every bump below it on its own. Each is Hertz's contact
of the bump's radius with a relief, height · cos(2πs/period) across the ridges, that is long against
the contact. The face is rigid, so all bumps have one approach, less the relief's height there. The
force of a bump that slides leans by the slope of the relief: T/N = tan(atan μ + atan slope), as in
`cnnum.tactile.texture_materials`.

References
----------
Johnson, Contact Mechanics (1985), 3.4 and 3.9; Ciavarella, Int. J. Solids Struct. 35 (1998) 2349;
Jäger, Arch. Appl. Mech. 65 (1995) 478.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil, cos, inf, pi, sin
from typing import TYPE_CHECKING, Any

import numpy as np

from cnnum.arrays import Floats
from cnnum.drivers.simulated.cover import CELLS, Layout
from cnnum.drivers.simulated.settings import Command, Settings
from cnnum.drivers.simulated.springs import Pair, State, Window
from cnnum.tactile.grid import Grid

if TYPE_CHECKING:
    from cnnum.tactile.flat_punches import Outline

TURNS = 1.5
"""Stiffness of a turn over that of springs alike, of a round face."""

FINE, MERGED = 30, 3
"""Cells to a pitch on which a face's pressure is solved, and how many along each side are taken
together: points are half as wide as the cells of the surface, and shared out among them."""


@dataclass(frozen=True, slots=True, eq=False)
class Touched:
    """The points of a contact at one scan.

    Attributes
    ----------
    x, y : (points,) float, m
        On the cover, from the middle of the array.
    load : (points,) float, N
    stiffness : (points,) float, N/m
    """

    x: Floats
    y: Floats
    load: Floats
    stiffness: Floats


class FlatFace:
    """A rigid flat face: which points it touches, and what each carries.

    Parameters
    ----------
    options : Settings
    """

    def __init__(self, options: Settings) -> None:
        from cnnum.tactile.flat_punches import punch_pressure

        self.pair = Pair(options.radius, options.youngs_modulus, options.friction)
        outline, reach = outline_of(options)
        side = 2 * ceil(reach) + 1
        fine = punch_pressure(outline, side, FINE)
        area = float((fine > 0).sum()) * (options.pitch / FINE) ** 2
        count = side * FINE // MERGED
        pressure = fine.reshape(count, MERGED, count, MERGED).sum(axis=(1, 3))
        rows, cols = np.nonzero(pressure)
        self.step_size = options.pitch / FINE * MERGED
        middle = (count - 1) / 2
        self._x, self._y = ((at - middle) * self.step_size for at in (cols, rows))
        self._share = pressure[rows, cols] / pressure.sum()
        self.point_area = area / rows.size
        self._stiffness = 2 * self.pair.tangential_modulus * (area / pi) ** 0.5
        self.reach = float(np.hypot(self._x, self._y).max()) + self.step_size
        self._placed: tuple[tuple[float, float, float], Floats, Floats] | None = None

    def touched(self, load: float, position: Floats, angle: float) -> Touched:
        """Return the points under a load (N), at a place on the cover and an angle (rad)."""
        x, y = self._at((float(position[0]), float(position[1]), angle))
        return Touched(x, y, load * self._share, self._stiffness * self._share)

    def _at(self, place: tuple[float, float, float]) -> tuple[Floats, Floats]:
        """Return the points' places; those of the last call are kept, as most scans ask again."""
        if self._placed is None or self._placed[0] != place:
            turn, side = cos(place[2]), sin(place[2])
            x = place[0] + turn * self._x - side * self._y
            y = place[1] + side * self._x + turn * self._y
            self._placed = (place, x, y)
        return self._placed[1:]

    def lean(self, at: Touched, position: Floats, way: Floats) -> Floats:
        """Return the slope of the face along the way of each point: a flat one has none."""
        return np.zeros(at.x.size)


class TexturedFace:
    """A rigid face with a relief, as wide as the array, on a cover with a bump at every taxel.

    Parameters
    ----------
    options : Settings
    layout : Layout
    """

    def __init__(self, options: Settings, layout: Layout) -> None:
        self.pair = Pair(options.bump_radius, options.youngs_modulus, options.friction)
        wave, turn = 2 * pi / options.period, options.angle
        self._height, self._wave = options.relief, (wave * cos(turn), wave * sin(turn))
        x, y = np.meshgrid(layout.taxels.x, layout.taxels.y)
        self._x, self._y = x.reshape(-1), y.reshape(-1)
        self.step_size = options.pitch / CELLS  # one cell of the surface gives its bump the load
        self.point_area = options.pitch**2
        self.reach = -inf  # it overhangs: bumps are touched wherever it is

    def touched(self, load: float, position: Floats, angle: float) -> Touched:
        """Return the bumps under a load (N): the approach is found by bisection."""
        relief = self._relief(position)
        unit = 4 / 3 * self.pair.normal_modulus * self.pair.radius**0.5

        def forces(approach: float) -> Floats:
            return np.asarray(unit * np.maximum(approach + relief, 0.0) ** 1.5)

        low, high = -self._height, self._height + (load / unit) ** (2 / 3)
        for _ in range(60):
            middle = (low + high) / 2
            low, high = (middle, high) if forces(middle).sum() < load else (low, middle)
        approach = np.maximum(high + relief, 0.0)
        radius = np.sqrt(self.pair.radius * approach)
        stiffness = 2 * self.pair.tangential_modulus * radius
        return Touched(self._x, self._y, forces(high), stiffness)

    def lean(self, at: Touched, position: Floats, way: Floats) -> Floats:
        """Return the slope of the relief below each bump, along its way (2, bumps)."""
        length = np.maximum(np.hypot(*way), np.finfo(np.float64).tiny)
        along = self._wave[0] * way[0] + self._wave[1] * way[1]
        # the surface that comes next is the one behind the way of the face
        return np.asarray(self._height * np.sin(self._phase(position)) * along / length)

    def _relief(self, position: Floats) -> Floats:
        return np.asarray(self._height * np.cos(self._phase(position)))

    def _phase(self, position: Floats) -> Floats:
        x, y = self._x - position[0], self._y - position[1]
        return np.asarray(self._wave[0] * x + self._wave[1] * y)


Face = FlatFace | TexturedFace


class Brush:
    """Friction of a face: every point has a spring that slips at its own limit.

    It does for faces what `Springs` does for a sphere.

    Parameters
    ----------
    face : Face
    """

    def __init__(self, face: Face) -> None:
        self.face, self.pair = face, face.pair

    def rest(self, position: tuple[float, float], angle: float = 0.0) -> State:
        """Return the state in which nothing touches."""
        where, none = np.array(position, dtype=np.float64), np.zeros((2, 0))
        return State(0.0, 0.0, 0.0, none, np.zeros(0), where, np.zeros(2), angle)

    def step(self, before: State, command: Command) -> State:
        """Return the state after one command."""
        place = before.position
        if command.load == 0.0:
            return self.rest((float(place[0]), float(place[1])), before.angle)
        at = self.face.touched(command.load, place, before.angle)
        held = before.shear if before.shear.size else np.zeros((2, at.x.size))
        arm = np.stack([place[1] - at.y, at.x - place[0]])
        moved = held + np.array(command.move)[:, None] + TURNS * command.turn * arm
        moved = moved - command.give * _rigid(held, arm, at.stiffness)
        friction = self.pair.friction * command.friction
        tilt = np.arctan(friction) + np.arctan(self.face.lean(at, place, moved))
        limit = np.tan(np.minimum(tilt, 1.5)) * at.load
        force = at.stiffness * np.hypot(*moved)
        use = np.divide(force, limit, out=np.ones_like(force), where=limit > 0.0)
        keep = np.where(limit > 0.0, 1 / np.maximum(use, 1.0), 0.0)
        slip, sticks = (1 - keep) * moved, (use < 1 - 1e-9) & (limit > 0.0)
        slipped, turned = _motion(slip, arm, at.load)
        radius = float((at.load > 0).sum() * self.face.point_area / pi) ** 0.5
        return State(
            load=command.load,
            contact_radius=radius,
            stick_radius=radius * float((at.load * sticks).sum() / at.load.sum()) ** 0.5,
            shear=keep * moved,
            twist=np.zeros(0),
            position=place + slipped,
            slipped=slipped,
            angle=before.angle + turned / TURNS,
        )

    def forces(self, state: State) -> tuple[Touched, Floats]:
        """Return the points of a state, and the force on each, (3, points) N: x, y, normal."""
        # where it was pressed: the slide of the last scan comes after it
        at = self.face.touched(state.load, state.position - state.slipped, state.angle)
        if not state.shear.size:
            return at, np.stack([np.zeros_like(at.load), np.zeros_like(at.load), at.load])
        return at, np.stack([*(at.stiffness * state.shear), at.load])

    def reach(self, _: State) -> float:
        """Return how far the contact reaches from its middle, m."""
        return self.face.reach

    def force(self, state: State) -> Floats:
        """Return the shear force of the body on the cover, (2,) N."""
        return np.asarray(self.forces(state)[1][:2].sum(axis=1))

    def torque(self, state: State) -> float:
        """Return the torque of the body on the cover, N m."""
        at, force = self.forces(state)
        x, y = at.x - state.position[0], at.y - state.position[1]
        return float((x * force[1] - y * force[0]).sum())


class FaceTractions:
    """Maps of surface traction under a face, for many scans at once.

    Parameters
    ----------
    brush : Brush
    grid : Grid
        Cells of the surface.
    """

    def __init__(self, brush: Brush, grid: Grid) -> None:
        self._brush, self._grid = brush, grid
        self._spread: tuple[Floats, Floats, Any] | None = None

    def window(self, states: Sequence[State]) -> Window:
        """Return all cells: faces are wide."""
        return Window(slice(0, self._grid.rows), slice(0, self._grid.cols))

    def __call__(self, states: Sequence[State], window: Window) -> Floats:
        """Return (states, rows, cols, 3) float, Pa: q_x, q_y and the pressure, cell averages."""
        return np.stack([self._one(state) for state in states])

    def _one(self, state: State) -> Floats:
        if state.load == 0.0:
            return np.zeros((*self._grid.shape, 3))
        at, force = self._brush.forces(state)
        whole: Floats = self._onto_cells(at.x, at.y) @ force.T
        return whole.reshape(*self._grid.shape, 3) / self._grid.cell_area

    def _onto_cells(self, x: Floats, y: Floats) -> Any:
        """Return the sparse matrix (cells, points) of the share of each point in each cell."""
        if self._spread is None or self._spread[0] is not x or self._spread[1] is not y:
            from scipy.sparse import csr_array

            grid, size = self._grid, self._brush.face.step_size
            points, shape = np.arange(x.size), (grid.rows * grid.cols, x.size)
            rows, cols = _overlap(y, size, grid.y_edges), _overlap(x, size, grid.x_edges)
            parts = [
                (high * wide, row * grid.cols + col) for row, high in rows for col, wide in cols
            ]
            share = np.concatenate([part for part, _ in parts])
            cell = np.concatenate([forces for _, forces in parts])
            self._spread = (x, y, csr_array((share, (cell, np.tile(points, 4))), shape=shape))
        return self._spread[2]


def _overlap(at: Floats, size: float, edges: Floats) -> list[tuple[np.ndarray, Floats]]:
    """Return the two cells along an axis that a point's own square lies in, and its shares."""
    first = np.clip(np.searchsorted(edges, at - size / 2 + 1e-12) - 1, 0, edges.size - 2)
    share = np.clip((edges[first + 1] - at + size / 2) / size, 0.0, 1.0)
    return [(first, share), (np.minimum(first + 1, edges.size - 2), 1 - share)]


def _motion(move: Floats, arm: Floats, weight: Floats) -> tuple[Floats, float]:
    """Return the shift and the turn about the middle that come nearest to moves of points."""
    whole = max(float(weight.sum()), np.finfo(np.float64).tiny)
    middle = (weight * arm).sum(axis=1) / whole
    shift = (weight * move).sum(axis=1) / whole
    off = arm - middle[:, None]
    power = float((weight * (off * off).sum(axis=0)).sum())
    turn = float((weight * (off * (move - shift[:, None])).sum(axis=0)).sum())
    turn = turn / power if power > 0 else 0.0
    return shift - turn * middle, turn


def _rigid(held: Floats, arm: Floats, stiffness: Floats) -> Floats:
    """Return the part of the springs' deflections that a rigid move would undo."""
    shift, turn = _motion(held, arm, stiffness)
    return shift[:, None] + turn * arm


def outline_of(options: Settings) -> tuple["Outline", float]:
    """Return the outline of a flat face in pitches, and how far it reaches from its middle."""
    from cnnum.tactile.flat_punches import Joined
    from cnnum.tactile.indenters import Disc, Rectangle, Ring

    wide, long = options.width / options.pitch, options.length / options.pitch
    match options.body:
        case "punch":
            return Disc(wide / 2), wide / 2
        case "bar":
            return Rectangle(wide, long, options.angle), (wide**2 + long**2) ** 0.5 / 2
        case "ring":
            return Ring(wide / 4, wide / 2), wide / 2
        case _:
            x, y = long / 2 * cos(options.angle), long / 2 * sin(options.angle)
            return Joined((Disc(wide / 2, (x, y)), Disc(wide / 2, (-x, -y)))), (long + wide) / 2


def mirrored(command: Command) -> Command:
    """Return the movement of the facing finger's contact, in that finger's own axes.

    Its x runs against the first one's, so an object that moves along x, or turns, does the
    opposite there. In a tilt the object turns about an axis across the fingers and moves opposite
    ways under them.
    """
    (x, y), (roll_x, roll_y) = command.move, command.roll
    side = -1.0 if command.tilts else 1.0
    move, roll = (-side * x, side * y), (-roll_x, roll_y)
    return replace(command, move=move, roll=roll, turn=-command.turn)
