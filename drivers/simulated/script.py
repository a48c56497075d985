"""The hand's movements, phase by phase: load and displacement at every scan."""

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
    """One thing that the hand does for a while.

    Attributes
    ----------
    kind : str
        "press": the sphere comes down at a constant speed until `load` is reached;
        "hold": nothing moves;
        "pull": it is dragged sideways at `speed` towards `direction`;
        "tilt": the object between two fingers turns about an axis across them, so that it is
        dragged at `speed` towards `direction` under the first one, and the opposite way in space
        under the other;
        "relax": the hand gives way until neither shear nor torque is left;
        "twist": it turns about the normal by `angle`, at a constant rate;
        "grip": the load changes to `load`, linearly;
        "roll": it rolls without slip, the contact moving at `speed` towards `direction`;
        "vibrate": the load swings by `amplitude` (a share of it) at `frequency`;
        "release": it goes up at a constant speed until nothing touches.
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
            f"seconds above 0, from {LEAST:g} up and below {MOST:g}",
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
