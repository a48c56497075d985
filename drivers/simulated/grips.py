"""Grips drawn by seed: a sphere that is pressed on a simulated array, then pulled or turned.

The numbers of a scene come from its seed, the pull from a shape over time, and the taxels may have
gains, creep, cross-talk and faults of their own. Programs are exported and scored on such scenes.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from math import cos, sin

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from cnnum.arrays import Floats, Shape
from cnnum.drivers.simulated.array import SimulatedArray
from cnnum.drivers.simulated.settings import Command, Phase, Settings, commands
from cnnum.drivers.simulated.springs import State
from cnnum.frame import Truth, truth_columns
from cnnum.tactile.contact import (
    Hertz,
    contact_modulus,
    hertz,
    shear_compliance,
    sliding_torque,
    tangential_displacement,
    torsion_slip,
)

Flags = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """Frames of one array, with the truth of each.

    Attributes
    ----------
    family : str
        The group of its score: a family of scenes, or an object.
    name : str
        For people.
    rate : float, Hz
        Frames a second.
    frames : (frames, rows, cols, 3) float32
        Shear x, shear y, normal.
    slips : (frames,) float
        1 where the object slips, 0 where it does not, NaN where that is not known.
    scored : (frames,) bool
        Frames in which a report counts.
    early : (frames,) bool
        Frames before a slip in which a report is no false one.
    slid : (frames,) float, m
        Sliding from the start of the trial on.
    sense : (frames,) int
        Sense of a slipping twist, +1 or −1; otherwise 0.
    direction : float, rad
        Direction of the slip; NaN without one or where it is not known.
    rows : (frames,) int
        Row of the log that each frame came from.
    setting : mapping
        Facts of the array for a program, as its parameters.
    turning, speed : (frames,) float, degrees/s and m/s, optional
        How fast the object turns and a mark on it moves, where a camera has seen it; NaN where it
        has not.
    """

    family: str
    name: str
    rate: float
    frames: NDArray[np.float32]
    slips: Floats
    scored: Flags
    early: Flags
    slid: Floats
    sense: NDArray[np.int64]
    direction: float
    rows: NDArray[np.int64]
    setting: Mapping[str, float | bool] = field(default_factory=dict[str, "float | bool"])
    turning: Floats | None = None
    speed: Floats | None = None

    @property
    def shape(self) -> Shape:
        """Rows and columns."""
        return (int(self.frames.shape[1]), int(self.frames.shape[2]))

    @property
    def seconds(self) -> float:
        """How long reports counted, s."""
        return float(self.scored.sum()) / self.rate

    @property
    def slides(self) -> bool:
        """Whether the object slips at any time that counts."""
        return bool((self.scored & (self.slips > 0)).any())

    @property
    def onset(self) -> int:
        """First frame of the first slip; the number of frames without one."""
        return first(self.scored & (self.slips > 0))


def first(flags: Flags) -> int:
    """Return the place of the first flag that is set; the number of flags without one."""
    return int(np.argmax(flags)) if flags.any() else len(flags)


def runs(flags: Flags) -> list[tuple[int, int]]:
    """Return where flags are set in a row: the first place, and the one after the last."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


POISSON = 0.5
"""Of the cover: rubber keeps its volume."""

LOOSE_TORQUE = 0.89734
"""Share of the sliding torque at which the stick radius is half the contact radius: the root of
Lubkin's c/a = 1/2, to which the tests hold it."""


@dataclass(frozen=True, slots=True)
class Bounds:
    """A sphere under a load on a cover.

    Attributes
    ----------
    radius : float, m
    load : float, N
    friction : float
    youngs_modulus : float, Pa
    """

    radius: float
    load: float
    friction: float
    youngs_modulus: float

    @property
    def contact(self) -> Hertz:
        """Its contact."""
        modulus = contact_modulus(self.youngs_modulus, POISSON)
        return hertz(self.load, self.radius, modulus)

    @property
    def shear_modulus(self) -> float:
        """G, Pa."""
        return self.youngs_modulus / (2.0 * (1.0 + POISSON))

    def travel(self, share: float = 1.0) -> float:
        """Return how far the sphere moves until the force is a share of μP, m (Mindlin)."""
        limit = self.friction * self.load
        compliance = shear_compliance(self.youngs_modulus, POISSON)
        moved = tangential_displacement(
            self.contact, self.load, share * limit, self.friction, compliance
        )
        return float(moved)

    def turn(self, share: float = LOOSE_TORQUE) -> float:
        """Return the angle at which the torque is a share of the sliding one, rad (Lubkin)."""
        a = float(self.contact.contact_radius)
        torque = share * float(sliding_torque(self.load, a, self.friction))
        return torsion_slip(self.load, a, torque, self.friction).twist(self.shear_modulus)


def load_of(contact_radius: float, radius: float, youngs_modulus: float) -> float:
    """Return the load (N) under which a sphere makes a contact of that radius (Hertz)."""
    modulus = float(contact_modulus(youngs_modulus, POISSON))
    return 4.0 * modulus * contact_radius**3 / (3.0 * radius)


YOUNGS_MODULUS = 0.87e6
"""Pa, of all covers: strain is dimensionless, so another one only changes the load."""

RATES = (60.0, 100.0, 200.0, 500.0)
THICKNESSES = (0.7e-3, 1.0e-3, 1.4e-3)
PITCH = 1.5e-3
FRICTION = (0.3, 1.0)
RADIUS = (15e-3, 40e-3)
CONTACT = (1.6e-3, 2.8e-3)
SPEED = (0.3e-3, 3e-3)
NOISE = (2e-3, 3e-3)
"""Hz, m, m, none, m (sphere), m (contact radius), m/s, V (Table 3.II)."""

REST, PRESS, HOLD = 0.5, 0.4, 0.4
"""s without contact, of pressing, and of holding, before anything else."""


@dataclass(frozen=True, slots=True)
class Array:
    """The fixed parts of a family's array.

    Attributes
    ----------
    shape : (rows, cols)
    cover : str
        As in the settings of the simulated array.
    rate : float, optional
        Hz; drawn unless given.
    radius : float, optional
        m, of the sphere; drawn unless given.
    contact : float, optional
        m, radius of the contact; drawn unless given.
    """

    shape: tuple[int, int] = (8, 8)
    cover: str = "flat"
    rate: float | None = None
    radius: float | None = None
    contact: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Draw:
    """One scene's numbers.

    Attributes
    ----------
    rng : numpy.random.Generator
        For the numbers that only some scenes need.
    seed : int
    rate : float, Hz
    thickness, start : m
    noise : float, V
    speed : float, m/s
    direction : float, rad
    bounds : Bounds
        Bounds of the grip.
    """

    rng: np.random.Generator
    seed: int
    rate: float
    thickness: float
    start: tuple[float, float]
    noise: float
    speed: float
    direction: float
    bounds: Bounds

    @classmethod
    def of(cls, family: str, seed: int, array: Array) -> "Draw":
        """Return the numbers of a family's scene; the same seed gives the same ones."""
        rng = np.random.default_rng([seed, *family.encode()])
        rate, thickness = float(rng.choice(RATES)), float(rng.choice(THICKNESSES))
        radius, contact = _log(rng, *RADIUS), float(rng.uniform(*CONTACT))
        radius, contact = array.radius or radius, array.contact or contact
        load = load_of(contact, radius, YOUNGS_MODULUS)
        return cls(
            rng=rng,
            seed=seed,
            rate=array.rate or rate,
            thickness=thickness if array.cover == "flat" else 1.0e-3,
            start=(float(rng.uniform(-0.5e-3, 0.5e-3)), float(rng.uniform(-0.5e-3, 0.5e-3))),
            noise=float(rng.uniform(*NOISE)),
            speed=_log(rng, *SPEED),
            direction=float(rng.uniform(-np.pi, np.pi)),
            bounds=Bounds(radius, load, float(rng.uniform(*FRICTION)), YOUNGS_MODULUS),
        )

    def uniform(self, low: float, high: float) -> float:
        """Return a number between two."""
        return float(self.rng.uniform(low, high))

    def log(self, low: float, high: float) -> float:
        """Return a number between two, every octave as likely."""
        return _log(self.rng, low, high)

    def sign(self) -> int:
        """Return −1 or 1."""
        return 1 if self.rng.random() < 0.5 else -1

    def scans(self, seconds: float) -> int:
        """Return the frames in a time, at least one."""
        return max(1, round(seconds * self.rate))


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    return float(low * (high / low) ** rng.random())


CREEP_TIME = 2.0
"""s, of the cover's creep: 5 %/s at first is a tenth in the end."""

HEAVY = 3
"""Degrees of freedom of the noise that is not Gaussian."""


@dataclass(frozen=True, slots=True)
class Skin:
    """Faults of an array.

    Attributes
    ----------
    creep : float, 1/s
        Share by which a constant strain grows at first.
    hysteresis : float
        Width of a taxel's loop, as a share of the largest strain.
    gains : float
        Largest share by which a channel's gain is off; each draws its own.
    crosstalk : float
        Share of a taxel's signal that comes from its four neighbours.
    shear : float
        Gain of the shear channels, against that of the normal ones.
    limit : float
        Where channels saturate, as a share of the largest strain.
    dead : int
        Taxels that read 0.
    heavy : bool
        Whether as much noise again comes with rare large jumps (Student's t).
    """

    creep: float = 0.0
    hysteresis: float = 0.0
    gains: float = 0.0
    crosstalk: float = 0.0
    shear: float = 1.0
    limit: float = 1.0
    dead: int = 0
    heavy: bool = False

    def read(self, array: SimulatedArray, strain: Floats, rng: np.random.Generator) -> Floats:
        """Return the strain as taxels read it.

        Parameters
        ----------
        array : SimulatedArray
            Its bridges, noise and converter.
        strain : (frames, rows, cols, 3) float
            True strain.
        rng : numpy.random.Generator
        """
        strain = creeping(strain, self.creep, array.rate) if self.creep else strain
        strain = loops(strain, self.hysteresis) if self.hysteresis else strain
        strain = strain * np.array([self.shear, self.shear, 1.0])
        strain = strain * rng.uniform(1 - self.gains, 1 + self.gains, strain.shape[1:])
        if self.limit < 1.0:
            most = self.limit * np.abs(strain).max()
            strain = np.clip(strain, -most, most)
        times = np.arange(len(strain)) / array.rate
        read = array.calibration.to_strain(array.read(strain).volts, time=times)
        return self._disturbed(mixed(read, self.crosstalk), rng)

    def _disturbed(self, read: Floats, rng: np.random.Generator) -> Floats:
        if self.heavy:
            noise = np.std(np.diff(read[:10], axis=0)) / 2**0.5
            # a variance of one, as Student's t has f/(f − 2)
            jumps = rng.standard_t(HEAVY, read.shape) * ((HEAVY - 2) / HEAVY) ** 0.5
            read = read + noise * jumps
        for taxel in rng.permutation(read.shape[1] * read.shape[2])[: self.dead]:
            read[:, taxel // read.shape[2], taxel % read.shape[2]] = 0.0
        return read


def creeping(strain: Floats, share: float, rate: float) -> Floats:
    """Return strain that creeps: a constant one grows by a share a second at first."""
    keep = float(np.exp(-1.0 / (rate * CREEP_TIME)))
    lags = lfilter([1.0 - keep], [1.0, -keep], strain, axis=0)
    return np.asarray(strain + share * CREEP_TIME * lags)


def loops(strain: Floats, width: float) -> Floats:
    """Return strain with play: it follows only when half the loop's width is used up."""
    half = 0.5 * width * np.abs(strain).max()
    made, last = np.empty_like(strain), strain[0]
    for n, now in enumerate(strain):
        last = np.clip(last, now - half, now + half)
        made[n] = last
    return made


def mixed(read: Floats, share: float) -> Floats:
    """Return signals with a share from the four neighbours each; rims repeat."""
    wide = np.pad(read, ((0, 0), (1, 1), (1, 1), (0, 0)), mode="edge")
    around = wide[:, 2:, 1:-1] + wide[:, :-2, 1:-1] + wide[:, 1:-1, 2:] + wide[:, 1:-1, :-2]
    return np.asarray((1.0 - share) * read + share * around / 4.0)


CHUNK = 64
"""Frames worked out at once."""


class Arrays:
    """Makes simulated arrays; those with one cover share its influence."""

    def __init__(self) -> None:
        self._influences: dict[tuple[object, ...], Floats] = {}

    def made(
        self, draw: Draw, array: Array, script: tuple[Phase, ...] | None = None
    ) -> SimulatedArray:
        """Return the array of a scene; a script begins with a touch unless given."""
        settings = Settings(
            seed=draw.seed,
            shape=array.shape,
            rate=draw.rate,
            pitch=PITCH,
            cover=array.cover,  # type: ignore[arg-type]
            thickness=draw.thickness,
            youngs_modulus=YOUNGS_MODULUS,
            friction=draw.bounds.friction,
            radius=draw.bounds.radius,
            start=draw.start,
            noise=draw.noise,
            script=touch(draw) if script is None else script,
        )
        key = (array.shape, array.cover, draw.thickness)
        made = SimulatedArray(settings, self._influences.get(key))
        self._influences[key] = made.influence
        return made


def touch(draw: Draw) -> tuple[Phase, ...]:
    """Return how a scene begins: nothing, a press, and a hold."""
    return Phase("hold", REST), Phase("press", PRESS, load=draw.bounds.load), Phase("hold", HOLD)


def strain_of(array: SimulatedArray, states: Sequence[State]) -> Floats:
    """Return the strain under contacts, (states, rows, cols, 3)."""
    starts = range(0, len(states), CHUNK)
    return np.concatenate([array.strain(list(states[n : n + CHUNK])) for n in starts])


FADES = 1e-3
"""v₀, m/s."""

STEP = 1e-4
"""s, at most: a fiftieth of the quickest swing of 0.05 kg on a contact of 10 kN/m is 3e-4 s."""


@dataclass(frozen=True, slots=True)
class Drawn:
    """An object that a hand draws over a skin.

    Attributes
    ----------
    mass : float, kg
    stiffness : float, N/m
        Stiffness of the hand.
    speed : float, m/s
        Speed of the hand.
    limit : float, N
        Static friction force.
    travel : float, m
        How far the contact gives at that force.
    kinetic : float
        Share of friction that is left at high speeds.
    damping : float
        Share of the critical one, of the mass on the hand.
    """

    mass: float
    stiffness: float
    speed: float
    limit: float
    travel: float
    kinetic: float
    damping: float = 0.1

    def friction(self, speed: float) -> float:
        """Return the share of the static friction that holds at a sliding speed."""
        return self.kinetic + (1.0 - self.kinetic) / (1.0 + abs(speed) / FADES)


def stick_slip(hand: Drawn, times: Floats) -> tuple[Floats, Floats]:
    """Return the way of the object (m) and its share of static friction at some times (s)."""
    steps = max(1, int(np.ceil(times[0] / STEP)))
    dt = float(times[0]) / steps
    drag = 2.0 * hand.damping * (hand.stiffness * hand.mass) ** 0.5
    ways, shares = np.empty(len(times)), np.empty(len(times))
    way = speed = slid = 0.0
    share = 1.0
    for n in range(len(times) * steps):
        pulls = hand.stiffness * (hand.speed * n * dt - way) + drag * (hand.speed - speed)
        speed += dt / hand.mass * (pulls - _held(hand, way - slid, share))
        way += dt * speed
        slides = max(0.0, way - slid - share * hand.travel)
        slid, share = slid + slides, hand.friction(slides / dt)
        ways[n // steps], shares[n // steps] = way, share
    return ways, shares


def _held(hand: Drawn, stretch: float, share: float) -> float:
    """Return the force of the contact (Mindlin), N."""
    use = min(max(abs(stretch) / (share * hand.travel), 0.0), 1.0)
    force = share * hand.limit * (1.0 - (1.0 - use) ** 1.5)
    return float(force) if stretch >= 0 else -float(force)


SLIDE = (0.5e-3, 1.2e-3)
"""m of sliding at least and at most."""

TREMOR, TREMBLES, SWINGS = (6.0, 12.0), 0.03e-3, 0.04
"""Hz; m; share of the load."""


@dataclass(frozen=True, slots=True, eq=False)
class Pull:
    """A pull, frame by frame.

    Attributes
    ----------
    way : (frames,) float, m
        How far the object has been moved.
    load, friction : (frames,) float
        As shares of those of the grip.
    """

    way: Floats
    load: Floats
    friction: Floats


Pulling = Callable[[Draw, float], Pull]
"""From the numbers of a scene, and the way (m) at which gross slip begins."""


def power(exponent: float) -> Pulling:
    """Return pulls whose way grows as a power of time; 1 is a constant speed."""

    def pull(draw: Draw, travel: float) -> Pull:
        return plain(_whole(draw, travel) * _time(draw, travel) ** exponent)

    return pull


def force_ramp(draw: Draw, travel: float) -> Pull:
    """Return a pull whose force grows evenly up to friction, then a slide at 2 mm/s (Mindlin)."""
    lasts = draw.scans(draw.uniform(0.5, 2.0))
    force = np.arange(1, lasts + 1) / lasts
    grows = travel * (1.0 - (1.0 - np.minimum(force, 0.999)) ** (2 / 3))
    slide = 2e-3 * np.arange(1, draw.scans(SLIDE[1] / 2e-3) + 1) / draw.rate
    return plain(np.concatenate([grows, travel + slide]).astype(np.float64))


def tremor(draw: Draw, travel: float) -> Pull:
    """Return a pull at a constant speed by a hand that trembles along it and in its grip."""
    way = _whole(draw, travel) * _time(draw, travel)
    move, grip = shaken(draw, len(way))
    return Pull(way + TREMBLES * move, 1.0 + SWINGS * grip, np.ones(len(way)))


def weakening(draw: Draw, travel: float) -> Pull:
    """Return a pull through a springy hand, with friction that falls with the sliding speed."""
    bounds = draw.bounds
    hand = Drawn(
        mass=draw.uniform(0.05, 0.2),
        stiffness=draw.uniform(1000.0, 3000.0),
        speed=draw.speed,
        limit=bounds.friction * bounds.load,
        travel=travel,
        kinetic=draw.uniform(0.6, 0.8),
    )
    # the hand's spring stretches before the object moves
    seconds = (_whole(draw, travel) + hand.limit / hand.stiffness) / draw.speed
    way, friction = stick_slip(hand, np.arange(1, draw.scans(seconds) + 1) / draw.rate)
    return Pull(way, np.ones(len(way)), friction)


def part(low: float, high: float) -> Pulling:
    """Return pulls that stop at a share of friction's limit, then hold on."""

    def pull(draw: Draw, travel: float) -> Pull:
        way = travel * (1.0 - (1.0 - draw.uniform(low, high)) ** (2 / 3))
        rises = draw.scans(way / draw.speed)
        held = np.full(draw.scans(1.0), way)
        return plain(np.concatenate([way * np.arange(1, rises + 1) / rises, held]))

    return pull


def plain(way: Floats) -> Pull:
    """Return a pull under an even load and friction."""
    return Pull(way, np.ones(len(way)), np.ones(len(way)))


def shaken(draw: Draw, frames: int) -> tuple[Floats, Floats]:
    """Return two unit swings of a hand's tremor."""
    time = np.arange(frames) / draw.rate
    move, grip = (2 * np.pi * draw.uniform(*TREMOR) * time for _ in range(2))
    return np.sin(move), np.sin(grip)


def _whole(draw: Draw, travel: float) -> float:
    return travel + min(max(0.5 * draw.speed, SLIDE[0]), SLIDE[1])


def _time(draw: Draw, travel: float) -> Floats:
    """Return time as a share of the pull."""
    lasts = max(3, draw.scans(_whole(draw, travel) / draw.speed))
    return np.asarray(np.arange(1, lasts + 1) / lasts)


Make = Callable[[Arrays, str, int], Trial]
"""From the name of a family and a seed to its scene."""

TWIST_RATE, TWIST_TIME = (0.1, 1.0), 2.5
"""rad/s, and s at most."""

SETTLED = 0.45
"""s at the start in which nothing counts: programs take their rest there."""

PLAIN, WHOLE = Array(), Skin()
SHAKEN = Skin(gains=0.2, creep=0.05, hysteresis=0.05, crosstalk=0.05)
"""An array, taxels without faults, and taxels as real ones are."""


def pulled(pulling: Pulling, array: Array = PLAIN, skin: Skin = WHOLE) -> Make:
    """Return scenes in which a sphere is pressed on and pulled."""

    def make(arrays: Arrays, family: str, seed: int) -> Trial:
        draw = Draw.of(family, seed, array)
        pull = pulling(draw, draw.bounds.travel())
        return played(arrays, draw, array, skin, family, list(_pulls(draw, pull)))

    return make


def twisted(array: Array = PLAIN, skin: Skin = WHOLE) -> Make:
    """Return scenes in which a sphere is pressed on and turned until it slips in circles."""

    def make(arrays: Arrays, family: str, seed: int) -> Trial:
        draw = Draw.of(family, seed, array)
        angle = draw.bounds.turn(LOOSE_TORQUE) * draw.uniform(1.4, 2.5)
        frames = draw.scans(min(angle / draw.log(*TWIST_RATE), TWIST_TIME))
        turn = draw.sign() * angle / frames
        hand = [Command(load=draw.bounds.load, turn=turn)] * frames
        return played(arrays, draw, array, skin, family, hand)

    return make


def played(
    arrays: Arrays,
    draw: Draw,
    array: Array,
    skin: Skin,
    family: str,
    hand: Sequence[Command],
) -> Trial:
    """Return a touch, and the hand's movement after it, as a trial."""
    made = arrays.made(draw, array)
    before = commands(touch(draw), draw.rate)
    return trial_of(made, draw, skin, family, list(made.follow([*before, *hand])))


def trial_of(
    array: SimulatedArray,
    draw: Draw,
    skin: Skin,
    family: str,
    moments: Sequence[tuple[State, Truth]],
) -> Trial:
    """Return contacts with their truth as a trial."""
    strain = strain_of(array, [state for state, _ in moments])
    truth = truth_columns([truth for _, truth in moments])
    slips, count = truth["slip"], len(moments)
    steps = np.array([float(np.hypot(*state.slipped)) for state, _ in moments])
    turns = np.sign(truth["twist_rate"]) * truth["twist_slip"]
    first = int(np.argmax(slips > 0))
    return Trial(
        family=family,
        name=f"{family} {draw.seed}",
        rate=draw.rate,
        frames=skin.read(array, strain, draw.rng).astype(np.float32),
        slips=slips,
        scored=np.arange(count) >= SETTLED * draw.rate,
        early=truth["incipient"] > 0,
        slid=np.cumsum(steps * (slips > 0)),
        sense=turns.astype(np.int64),
        direction=float(truth["slip_direction"][first]) if slips.any() else float("nan"),
        rows=np.arange(count),
        setting={"rate": draw.rate},
    )


def _pulls(draw: Draw, pull: Pull) -> Iterator[Command]:
    along = (cos(draw.direction), sin(draw.direction))
    moves: Floats = np.diff(pull.way, prepend=0.0)
    for move, load, friction in zip(moves, pull.load, pull.friction, strict=True):
        yield Command(
            load=draw.bounds.load * float(load),
            move=(float(move) * along[0], float(move) * along[1]),
            friction=float(friction),
        )
