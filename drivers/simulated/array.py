"""The driver of the simulated array, and the ground truth of its scans."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import islice
from math import atan2, hypot

import numpy as np

from cnnum.arrays import Floats, Shape
from cnnum.drivers.driver import Closing, Counters
from cnnum.drivers.simulated.bodies import Brush, FaceTractions, FlatFace, TexturedFace, mirrored
from cnnum.drivers.simulated.cover import FARTHEST, Creeping, Layout, influence_of
from cnnum.drivers.simulated.settings import Command, Settings, commands, largest_load, total_scans
from cnnum.drivers.simulated.springs import Pair, Springs, State, Tractions
from cnnum.errors import PhysicsError
from cnnum.frame import Frame, Quality, Truth
from cnnum.tactile.cover import BumpCover, FlatCover, LayerCover
from cnnum.tactile.grid import Grid
from cnnum.tactile.taxel import SIDES, Calibration, Coupling, Reading, Readout, Taxel

INCIPIENT = 0.5
"""Slip is called incipient when the stick radius is below this share of the contact radius; of a
force that only grows that is Q > 7/8 μP."""

SLIP_SPEED = 0.1e-3
"""m/s: below it a movement over the cover is creep, not slip."""

SLIP_SHARE = 0.5
"""Share of μP that the shear force has at least in gross slip. Sliding alone has all of it. A
turning or vanishing contact that lets a locked-in deflection go moves with less."""


def truth_of(
    springs: Springs | Brush, state: State, turned: float, turn: float, rate: float
) -> Truth:
    """Return the ground truth of a scan.

    Parameters
    ----------
    springs : Springs or Brush
    state : State
    turned : float, rad
        How far the sphere has turned about the normal since it touched.
    turn : float, rad
        Rotation since the previous scan.
    rate : float, Hz

    Returns
    -------
    Truth
        "contact", "incipient" (the stick radius is below half the contact's under a shear force,
        and nothing slides yet), "slip" (gross slip over the cover), "twist_slip" (the same stick
        radius under a torque, while turning): 0 or 1; "contact_radius", "stick_radius", "x", "y"
        (m); "slip_speed" (m/s), "slip_direction" (rad, 0 without slip); "twist" (rad),
        "twist_rate" (rad/s); "normal_force", "shear_x", "shear_y" (N), "torque" (N m); "friction"
        of the pair. Radii of flat faces are those of circles with the area that touches and that
        sticks. Of two fingers the other one's are "other_shear_x", "other_shear_y" and
        "other_torque", in its own axes.
    """
    shear_x, shear_y = springs.force(state).tolist()
    torque = springs.torque(state)
    a, c = state.contact_radius, state.stick_radius
    speed = hypot(*state.slipped.tolist()) * rate
    force = hypot(shear_x, shear_y)
    slips = speed > SLIP_SPEED and force > SLIP_SHARE * springs.pair.friction * state.load
    loose = a > 0 and c < INCIPIENT * a
    sheared = force * a > abs(torque)
    other: dict[str, float] = {}
    if state.facing is not None:
        along, across = springs.force(state.facing).tolist()
        other = {"other_shear_x": along, "other_shear_y": across}
        other["other_torque"] = springs.torque(state.facing)
    return Truth(
        {
            "contact": float(a > 0),
            "contact_radius": a,
            "stick_radius": c,
            "incipient": float(loose and sheared and not slips),
            "slip": float(slips),
            "slip_speed": speed if slips else 0.0,
            "slip_direction": atan2(state.slipped[1], state.slipped[0]) if slips else 0.0,
            "twist": turned,
            "twist_rate": turn * rate,
            "twist_slip": float(loose and not sheared and turn != 0.0),
            "normal_force": state.load,
            "shear_x": shear_x,
            "shear_y": shear_y,
            "torque": torque,
            "x": float(state.position[0]),
            "y": float(state.position[1]),
            "friction": springs.pair.friction,
            **other,
        }
    )


CHUNK = 32
"""Scans worked out at once."""

WIDEST = 0.3
"""Contact radius over the sphere's from which Hertz's theory is left."""


class SimulatedArray(Closing):
    """Frames with four bridge voltages per taxel, each with its ground truth.

    Attributes
    ----------
    calibration : Calibration
        The exact conversion of voltages to strain at the taxels.
    cover : FlatCover, LayerCover or BumpCover
        The cover over the taxels.
    bumps : BumpCover or None
        The cover, if it has bumps.
    total_frames : int
        Number of scans in the whole script.
    surface : Grid
        Cells of the cover that tractions act on.
    influence : (rows, cols, surface rows, surface cols, load, component) float, 1/Pa
        Strain at each taxel under a unit traction on each cell. It is costly to compute for large
        arrays, so it can be passed to another array with the same taxels and cover.

    Raises
    ------
    PhysicsError
        If the contact becomes too wide for the sphere.
    """

    def __init__(self, options: Settings, influence: Floats | None = None) -> None:
        self._options = options
        self.shape: Shape = options.taxels
        self.pads: int = options.fingers
        self.channels = SIDES
        self.unit = "V"
        self.rate = options.rate
        self.pitch = options.pitch
        self.cover = _cover(options)
        self.bumps = self.cover if isinstance(self.cover, BumpCover) else None
        layout = Layout(options.shape, options.pitch)
        self._springs: Springs | Brush = _contact(options, layout)
        self._lay(layout, influence)
        self._creeping = Creeping(options)
        self._rng = np.random.default_rng(options.seed)
        self._taxel = _taxel(options, self._rng)
        self._noise = self._rng.bit_generator.state
        self.calibration: Calibration = self._taxel.calibration(options.depth)
        self._calibration_id = self.calibration.identity
        self.total_frames = total_scans(options.script, options.rate)
        self._counters = Counters()
        self._closed = False

    def _lay(self, layout: Layout, influence: Floats | None = None) -> None:
        """Take a surface, and work out what its cells do to the taxels unless that is given."""
        self._layout = layout
        self.surface: Grid = layout.surface
        springs = self._springs
        self._tractions: Tractions | FaceTractions = (
            Tractions(springs, layout.surface)
            if isinstance(springs, Springs)
            else FaceTractions(springs, layout.surface)
        )
        given = influence_of(self._options, layout) if influence is None else influence
        self.influence: Floats = given

    @property
    def counters(self) -> Counters:
        """The counts so far."""
        return self._counters

    def close(self) -> None:
        """End the frames."""
        self._closed = True

    def frames(self) -> Iterator[Frame]:
        """Yield the scans of the script; a second call starts again, with the same noise.

        Raises
        ------
        PhysicsError
            If a contact reaches more than six pitches beyond the array.
        """
        self._rng.bit_generator.state = self._noise
        self._counters, self._closed = Counters(), False
        scans = self.scans()
        first, memory = 0, self._creeping.rest()
        while chunk := list(islice(scans, CHUNK)):
            elastic = self.strain([state for state, _ in chunk])
            strain, memory = self._creeping(memory, elastic)
            reading = self.read(strain)
            for n, (_, truth) in enumerate(chunk):
                if self._closed:
                    return
                yield self._frame(first + n, reading, n, truth)
            first += len(chunk)

    def scans(self) -> Iterator[tuple[State, Truth]]:
        """Yield the contact and the ground truth at every scan, without the array's readings."""
        yield from self.follow(commands(self._options.script, self.rate))

    def follow(self, hand: Iterable[Command]) -> Iterator[tuple[State, Truth]]:
        """Yield the contact and the ground truth for a moving hand, one command per scan."""
        x, y = self._options.start
        state, turned = self._springs.rest((x, y)), 0.0
        facing = self._springs.rest((-x, y)) if self._options.fingers == 2 else None
        for command in hand:
            state = self._springs.step(state, command)
            if facing is not None:
                facing = self._springs.step(facing, mirrored(command))
                state = replace(state, facing=facing)
            turn = command.turn if state.load > 0 else 0.0
            turned = turned + turn if state.load > 0 else 0.0
            yield state, truth_of(self._springs, state, turned, turn, self.rate)

    def strain(self, states: list[State]) -> Floats:
        """Return ε_xz, ε_yz, ε_zz at the taxels before they creep, (states, rows, cols, 3).

        Two fingers lie side by side in the columns.

        Raises
        ------
        PhysicsError
            If a contact reaches more than six pitches beyond the array.
        """
        facing = [state.facing for state in states if state.facing is not None]
        if facing:
            alone = [replace(state, facing=None) for state in states]
            return np.concatenate([self.strain(alone), self.strain(facing)], axis=2)
        self._make_room(states)
        window = self._tractions.window(states)
        traction = self._tractions(states, window)
        influence = self.influence[:, :, window.rows, window.cols]
        return np.tensordot(traction, influence, axes=([1, 2, 3], [2, 3, 4]))

    def read(self, strain: Floats) -> Reading:
        """Return the voltages of strain at the taxels, with noise if there is any."""
        rng = self._rng if self._options.noise > 0 else None
        return self._taxel.read(strain, rng=rng)

    def _frame(self, number: int, reading: Reading, place: int, truth: Truth) -> Frame:
        self._counters = replace(self._counters, frames=self._counters.frames + 1)
        saturated = reading.saturated[place].any(axis=-1)
        at_end = bool(saturated.any())
        return Frame(
            values=reading.volts[place],
            channels=self.channels,
            unit=self.unit,
            sequence=number,
            time=number / self.rate,
            quality=Quality.SATURATED if at_end else Quality.GOOD,
            truth=truth,
            calibration=self._calibration_id,
            saturated=saturated if at_end else None,
        )

    def _make_room(self, states: list[State]) -> None:
        """Widen the surface under contacts that reach beyond it, but not without end."""
        for state in states:
            if state.load == 0.0:
                continue
            reach = self._springs.reach(state)
            sides = self.pitch / 2 * np.array(self._layout.shape[::-1])
            beyond = float((np.abs(state.position) + reach - sides).max())
            if self._layout.margin * self.pitch < beyond <= FARTHEST * self.pitch:
                self._lay(replace(self._layout, margin=FARTHEST))
            elif beyond > FARTHEST * self.pitch:
                x, y = state.position * 1e3
                wide, high = (sides + FARTHEST * self.pitch) * 1e3
                raise PhysicsError(
                    f"The contact has left the array: radius {reach * 1e3:.2f} mm "
                    f"around ({x:.2f}, {y:.2f}) mm, expected within ±{wide:.2f} and "
                    f"±{high:.2f} mm; pull or roll less far, or start elsewhere."
                )


@dataclass(frozen=True, slots=True)
class SimulatedOptions(Settings):
    """Options of the driver "simulated", as listed in `Settings`."""

    def open(self) -> SimulatedArray:
        """Return the driver; its frames are computed as they are fetched.

        Raises
        ------
        PhysicsError
            If the contact becomes too wide for a sphere on a half-space.
        """
        return SimulatedArray(self)


def _contact(options: Settings, layout: Layout) -> Springs | Brush:
    if options.body == "sphere":
        return _springs(options)
    textured = options.body == "textured"
    return Brush(TexturedFace(options, layout) if textured else FlatFace(options))


def _springs(options: Settings) -> Springs:
    pair = Pair(options.radius, options.youngs_modulus, options.friction)
    widest = pair.contact_radius(largest_load(options.script))
    if widest > WIDEST * options.radius:
        raise PhysicsError(
            f"The contact's radius reaches {widest * 1e3:.2f} mm, expected at most {WIDEST:g} of "
            f"the sphere's {options.radius * 1e3:.2f} mm: lower 'load', or raise 'radius' or "
            "'youngs_modulus'."
        )
    return Springs(pair, reach=1.02 * widest)


def _cover(options: Settings) -> FlatCover | LayerCover | BumpCover:
    modulus = options.youngs_modulus
    if options.cover == "bumpy":
        return BumpCover(options.thickness, modulus, options.bump_radius, pitch=options.pitch)
    if options.cover == "layer":
        return LayerCover(options.thickness, modulus, taxel_depth=options.depth)
    return FlatCover(options.depth, modulus)


def _taxel(options: Settings, rng: np.random.Generator) -> Taxel:
    coupling = Coupling.nominal(
        depth=options.depth,
        youngs_modulus=options.youngs_modulus,
        reduction=options.loss,
    )
    readout = Readout(
        gain=options.gain,
        noise=options.noise,
        bits=options.bits or None,
        offsets=rng.normal(0.0, options.offset, (*options.taxels, 4)),
    )
    return Taxel(coupling, readout=readout)
