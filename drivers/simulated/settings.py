"""The options of the simulated array, and the hand's movements phase by phase."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import cos, isfinite, pi, sin
from typing import Literal, cast

from cnnum.drivers.options import require
from cnnum.errors import name_error

Kind = Literal[
    "press", "hold", "pull", "tilt", "relax", "twist", "grip", "roll", "vibrate", "release"
]

NEEDS: dict[Kind, tuple[str, ...]] = {
    "press": ("load",),
    "hold": (),
    "pull": ("speed",),
    "tilt": ("speed",),
    "relax": (),
    "twist": ("angle",),
    "grip": ("load",),
    "roll": ("speed",),
    "vibrate": ("frequency", "amplitude"),
    "release": (),
}
"""The amounts that a kind of phase cannot do without."""

LEAST, MOST = 1e-9, 1e6
"""Smallest amount but 0, and largest: beyond them the squares of loads and radii overflow."""


@dataclass(frozen=True, slots=True)
class Phase:
    """One movement of the hand.

    Attributes
    ----------
    kind : str
        "press": the sphere moves down at a constant speed until `load` is reached;
        "hold": nothing moves;
        "pull": it is dragged sideways at `speed` towards `direction`;
        "tilt": the object between two fingers turns about an axis across them, so that it is
        dragged at `speed` towards `direction` under the first one, and in the opposite direction
        under the other;
        "relax": the hand yields until neither shear nor torque is left;
        "twist": it turns about the normal by `angle`, at a constant rate;
        "grip": the load changes to `load`, linearly;
        "roll": it rolls without slip, the contact moving at `speed` towards `direction`;
        "vibrate": the load swings by `amplitude` (a share of it) at `frequency`;
        "release": it moves up at a constant speed until nothing touches.
    duration : float, s
    load : float, N
    speed : float, m/s
    direction : float, rad
        On the array: 0 along x (columns), π/2 along y (rows, downwards).
    angle : float, rad
        Positive turns x towards y: clockwise, seen from above.
    frequency : float, Hz
    amplitude : float
    """

    kind: Kind
    duration: float
    load: float = 0.0
    speed: float = 0.0
    direction: float = 0.0
    angle: float = 0.0
    frequency: float = 0.0
    amplitude: float = 0.0

    def __post_init__(self) -> None:
        amounts = ("load", "speed", "direction", "angle", "frequency", "amplitude")
        for name in amounts:
            require(name, isfinite(getattr(self, name)), "a finite number", getattr(self, name))
        lasts = LEAST <= self.duration < MOST
        require(
            "duration",
            lasts,
            f"seconds, at least {LEAST:g} and below {MOST:g}",
            self.duration,
        )
        for name in ("load", "speed", "frequency", "amplitude"):
            value: float = getattr(self, name)
            fits = value == 0 or LEAST <= value < MOST
            require(name, fits, f"0 or more ({LEAST:g} if not 0) and below {MOST:g}", value)
        for name in ("direction", "angle"):
            value = getattr(self, name)
            require(name, abs(value) < MOST, f"within ±{MOST:g} rad", value)
        require("amplitude", self.amplitude < 1, "a share of the load below 1", self.amplitude)
        if not isinstance(cast(object, self.kind), str) or self.kind not in NEEDS:
            raise name_error("kind of phase", self.kind, NEEDS)
        used = NEEDS[self.kind]
        for name in used:
            value = getattr(self, name)
            require(name, value != 0, f"given for a '{self.kind}', and not 0", value)
        allowed = (*used, "direction") if "speed" in used else used
        for name in set(amounts) - set(allowed):
            value = getattr(self, name)
            require(name, value == 0, f"left out of a '{self.kind}'", value)


DEFAULT = (
    Phase("hold", 0.4),
    Phase("press", 0.6, load=1.0),
    Phase("hold", 0.6),
    Phase("pull", 2.4, speed=0.8e-3, direction=0.5),
    Phase("relax", 0.6),
    Phase("grip", 0.8, load=1.6),
    Phase("hold", 0.6),
    Phase("twist", 2.0, angle=0.6),
    Phase("relax", 0.6),
    Phase("hold", 0.4),
    Phase("release", 0.6),
    Phase("hold", 0.4),
)
"""Ten seconds: a touch, a pull that ends in gross slip, a firmer grip, a twist, a release."""


@dataclass(frozen=True, slots=True)
class Command:
    """The hand's movement from the scan before to this one.

    Attributes
    ----------
    load : float, N
        Normal load at this scan.
    move : (float, float), m
        The sphere's movement along x and y, dragging.
    roll : (float, float), m
        Its movement along x and y, rolling.
    turn : float, rad
        About the normal.
    give : float
        Share of the shear and the torque that the hand lets go.
    friction : float
        Share of the pair's friction that holds at this scan.
    tilts : bool
        Whether the object moves opposite ways under two fingers.
    """

    load: float
    move: tuple[float, float] = (0.0, 0.0)
    roll: tuple[float, float] = (0.0, 0.0)
    turn: float = 0.0
    give: float = 0.0
    friction: float = 1.0
    tilts: bool = False


RELAXED = 8.0
"""Time constants in a "relax": the rest at its end is e⁻⁸ = 0.03 %."""


def scans(phase: Phase, rate: float) -> int:
    """Return the number of scans in a phase."""
    return max(1, round(phase.duration * rate))


def commands(script: Sequence[Phase], rate: float) -> Iterator[Command]:
    """Yield the command of every scan of a script.

    Parameters
    ----------
    script : sequence of Phase
    rate : float, Hz
    """
    load = 0.0
    for phase in script:
        count = scans(phase, rate)
        step = _step(phase, count, rate)
        for n in range(1, count + 1):
            yield replace(step, load=_load(phase, load, n / count))
        load = _load(phase, load, 1.0)


def total_scans(script: Sequence[Phase], rate: float) -> int:
    """Return the number of scans of a whole script."""
    return sum(scans(phase, rate) for phase in script)


def largest_load(script: Sequence[Phase]) -> float:
    """Return the largest load that a script reaches, N; 0 if it never touches."""
    reached = load = 0.0
    for phase in script:
        load = _load(phase, load, 1.0)
        reached = max(reached, load * (1 + phase.amplitude))
    return reached


def _step(phase: Phase, count: int, rate: float) -> Command:
    """Return the movement at each scan of a phase; the load comes later."""
    way = phase.speed * phase.duration / count
    path = (way * cos(phase.direction), way * sin(phase.direction))
    return Command(
        load=0.0,
        move=path if phase.kind in ("pull", "tilt") else (0.0, 0.0),
        tilts=phase.kind == "tilt",
        roll=path if phase.kind == "roll" else (0.0, 0.0),
        turn=phase.angle / count,
        give=min(1.0, RELAXED / count) if phase.kind in ("relax", "release") else 0.0,
    )


def _load(phase: Phase, before: float, share: float) -> float:
    """Return the load after a share of a phase; a constant speed is a linear P^(2/3) (Hertz)."""
    if phase.kind == "vibrate":
        swing = phase.amplitude * sin(2 * pi * phase.frequency * phase.duration * share)
        return before * (1 + swing * (share < 1))
    if phase.kind == "grip":
        return before + share * (phase.load - before)
    if phase.kind in ("press", "release"):
        approach = (1 - share) * before ** (2 / 3) + share * phase.load ** (2 / 3)
        return float(approach**1.5)
    return before


THINNEST = 0.05
"""Thickness of a layer over the pitch, at least: a quarter of a cell of the surface."""

RANGES = {
    "pitch": (1e-6, 0.1),
    "thickness": (1e-6, 0.1),
    "radius": (1e-6, 10.0),
    "rate": (1e-3, 1e5),
    "youngs_modulus": (1.0, 1e12),
    "friction": (1e-6, 1e6),
    "gain": (1e-6, 1e12),
}
"""Least value and bound from above, in the units below: beyond any array, short of overflow."""

SIZES = {
    "punch": ("width",),
    "bar": ("width", "length", "angle"),
    "ring": ("width",),
    "two bodies": ("width", "length", "angle"),
    "textured": ("relief", "period", "angle"),
}
"""What each body with a face takes; a sphere takes its radius."""


@dataclass(frozen=True, slots=True)
class Settings:
    """Options of the driver "simulated": the array, its cover, the sphere and the hand.

    The default cover is 1 mm of the silicone in the dissertation's calculations, thick enough for
    taxels 1.5 mm apart to sense any contact between them, and thin enough to separate them.
    The default sphere (Ø 50 mm) makes a contact of 5 mm at 1 N, three to four taxels wide.

    Attributes
    ----------
    seed : int
        Seed of offsets and noise: the same seed gives the same frames, bit for bit.
    shape : (rows, cols)
    rate : float, Hz
    pitch : float, m
    cover : "flat", "bumpy" or "layer"
        "flat" is a half-space, "layer" a layer on a rigid base. "bumpy" has a hemisphere over every
        taxel, with a response from finite elements (`cnnum.tactile.cover.BumpCover`).
    thickness : float, m
        Thickness of the cover; with bumps, of the layer under them, 0.5 to 5 bump radii. A "layer"
        has at least a twentieth of the pitch.
    taxel_height : float, m
        Height of a "layer": how high above its base the strain is read, 50 µm as in
        `cnnum.tactile.cover.comparison`. On the base itself there is no normal strain.
    bump_radius : float, m
        At most half the pitch.
    youngs_modulus : float, Pa
        0.87 MPa is that of the dissertation's calculations; its final cover has 2.4 MPa.
    creep : float
        Share of the modulus that relaxes, below 1; 0 for an elastic cover. Only the strain creeps:
        the contact remains that of a cover with the modulus above, the instantaneous one.
    creep_time : float, s
        Time constant of the strain under a constant load.
    friction : float
    body : "sphere", "punch", "bar", "ring", "two bodies" or "textured"
        The body that touches: a sphere; a round flat punch; a flat bar; a flat ring whose inner
        diameter is half the outer one; two round punches on one handle; or, on bumps, a wide face
        with a relief.
    radius : float, m
        Radius of the sphere.
    width, length : float, m
        Sizes of flat faces: the width is the diameter of a punch, a ring, or each of two bodies, or
        one side of a bar; the length is the other side of the bar, or the distance between the
        centres of two bodies.
    angle : float, rad
        Angle from x to the width of a bar, to the line between two bodies, or to the direction s
        across the ridges of a textured face.
    relief, period : float, m
        Height profile of a textured face: relief · cos(2πs/period).
    fingers : 1 or 2
        Two fingers that face each other and hold the body between them, each with an array of
        `shape`. Their frames lie side by side; the second has its own axes, with x mirrored.
    start : (x, y), m
        Position where the body first touches; the origin is the centre of the array.
    noise : float, V
        RMS after the amplifier (Table 3.II: 2–3 mV); 0 for none.
    offset : float, V
        RMS of the bridges' offsets, after the amplifier.
    bits : int
        Bits of the converter; 0 for no rounding.
    gain : float
        Gain of the amplifier (Table 3.II: 50–60).
    reduction : float, optional
        Factor by which the reading of a point load above a taxel is smaller than on bare silicon.
        The default is 30 at 0.5 mm, as measured, and grows with the 1.45th power of the thickness,
        the power with which the measured amplitude falls (dissertation, 4.3.2 and 4.3.3). For a
        "layer", it is that of the half-space above the taxels, so that the same strain gives the
        same voltages.
    script : list of Phase
        The hand's movements.
    """

    seed: int = 0
    shape: tuple[int, int] = (8, 8)
    rate: float = 200.0
    pitch: float = 1.5e-3
    cover: Literal["flat", "bumpy", "layer"] = "flat"
    thickness: float = 1.0e-3
    taxel_height: float = 50e-6
    bump_radius: float = 0.6e-3
    youngs_modulus: float = 0.87e6
    creep: float = 0.0
    creep_time: float = 1.0
    friction: float = 0.6
    body: Literal["sphere", "punch", "bar", "ring", "two bodies", "textured"] = "sphere"
    radius: float = 25e-3
    width: float = 4.5e-3
    length: float = 7e-3
    angle: float = 0.0
    relief: float = 20e-6
    period: float = 2.4e-3
    fingers: Literal[1, 2] = 1
    start: tuple[float, float] = (-0.9e-3, -0.4e-3)
    noise: float = 2.5e-3
    offset: float = 50e-3
    bits: int = 12
    gain: float = 55.0
    reduction: float | None = None
    script: tuple[Phase, ...] = DEFAULT

    def __post_init__(self) -> None:
        require("seed", self.seed >= 0, "0 or more", self.seed)
        require("shape", all(1 <= n <= 64 for n in self.shape), "1 to 64 on each side", self.shape)
        for name, (least, most) in RANGES.items():
            value: float = getattr(self, name)
            fits = least <= value < most
            require(name, fits, f"at least {least:g} and below {most:g}", value)
        self._require_layer()
        require("creep", 0 <= self.creep < 1, "a share, 0 or more and below 1", self.creep)
        lasts = 0 < self.creep_time < 1e6
        require("creep_time", lasts, "seconds above 0, below 1e+06", self.creep_time)
        reduction = self.reduction
        fits = reduction is None or 1e-6 <= reduction < 1e12
        require("reduction", fits, "above 0, from 1e-06 up and below 1e+12", reduction)
        half = 0 < self.bump_radius <= self.pitch / 2
        require("bump_radius", half, "above 0, at most half the pitch", self.bump_radius)
        for name in ("noise", "offset"):
            value = getattr(self, name)
            require(name, 0 <= value < 1e3, "0 or more volts", value)
        require("bits", 0 <= self.bits <= 32, "1 to 32, or 0 for no rounding", self.bits)
        self._require_body()
        require("script", largest_load(self.script) > 0, "phases with a press", self.script)

    @property
    def depth(self) -> float:
        """Depth of the taxels below the flat surface, m."""
        return self.thickness - (self.taxel_height if self.cover == "layer" else 0.0)

    @property
    def loss(self) -> float:
        """The reduction, as given or by default from the depth."""
        return 30.0 * (self.depth / 0.5e-3) ** 1.45 if self.reduction is None else self.reduction

    @property
    def taxels(self) -> tuple[int, int]:
        """Rows and columns of a frame, in which fingers lie side by side."""
        return (self.shape[0], self.shape[1] * self.fingers)

    def _require_body(self) -> None:
        kinds = {phase.kind for phase in self.script}
        require("fingers", self.fingers in (1, 2), "1 or 2", self.fingers)
        paired = self.fingers == 2 or "tilt" not in kinds
        require("script", paired, "without a 'tilt' unless 'fingers' is 2", "tilt")
        rolls = self.body == "sphere" or "roll" not in kinds
        require("script", rolls, "without a 'roll': only a sphere rolls", "roll")
        on_bumps = self.body != "textured" or self.cover == "bumpy"
        require("cover", on_bumps, "'bumpy' under the body 'textured'", self.cover)
        for name in SIZES.get(self.body, ()):
            value: float = getattr(self, name)
            if name == "relief":
                require(name, 0 <= value < 0.01, "0 or more and below 0.01 m", value)
            elif name == "angle":
                require(name, abs(value) < 1e6, "within ±1e+06 rad", value)
            else:
                require(name, self.pitch / 5 <= value < 0.1, "a fifth of the pitch to 0.1 m", value)

    def _require_layer(self) -> None:
        if self.cover != "layer":
            return
        thick = self.thickness >= THINNEST * self.pitch
        require("thickness", thick, f"at least {THINNEST:g} pitches of a layer", self.thickness)
        inside = 0 < self.taxel_height < self.thickness
        require("taxel_height", inside, "above 0, below the thickness", self.taxel_height)
