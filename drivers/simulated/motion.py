"""From the phases of a script to load and movement at every scan."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import cos, pi, sin

from cnnum.drivers.simulated.script import Phase


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
