"""How well the rate of a twist can be known.

`python -m cnnum.lab.bench.programs.twist_bound [COUNT]` prints it.

The Cramér–Rao bound, from the simulation's own strain and noise. The scene is worked out again with
the sphere, the load, the place, the friction and the pull each a little different, and with the
twist a little faster. How far the rate can be told from all the others, over all taxels and frames,
is the least error that an unbiased estimator can have. It is told more than a program is: when
every phase begins, that speeds and loads are constant, which taxels are broken, and that nothing
drifts. What it is not told are the offsets, and the eight quantities. Tuning seeds only.
"""

import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import erf, sqrt

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.drivers.simulated.array import SimulatedArray
from cnnum.drivers.simulated.script import Phase
from cnnum.drivers.simulated.settings import Settings
from cnnum.lab.scoring.generated.case import SCORING, Case
from cnnum.lab.scoring.generated.scripts import slip_case
from cnnum.lab.scoring.judge import RATE_SHARE
from cnnum.lab.scoring.play import spans_of
from cnnum.tactile.taxel import Readout

STEP = 0.01
"""Share, or rad, or pitches, by which a quantity is changed to see what it does."""

PROBE = 8
"""Readings by which a broken taxel is told from a sound one."""


@dataclass(frozen=True, slots=True)
class Bound:
    """The least error of a twist's rate.

    Attributes
    ----------
    seed : int
    cover : str
    shape : (rows, cols)
    frames : int
        That the twist lasts.
    error : float
        Standard deviation over the rate, from all frames up to the twist's end.
    early : float
        The same, from those up to the one in which half the contact radius slips.
    """

    seed: int
    cover: str
    shape: tuple[int, int]
    frames: int
    error: float
    early: float


def chance(error: float) -> float:
    """Return how likely a normal error of that standard deviation is to be within 10 %."""
    return erf(RATE_SHARE / (sqrt(2.0) * error))


def bound_of(case: Case) -> Bound:
    """Return the bound of a case with a twist.

    Raises
    ------
    PhysicsError
        If the contact leaves the array.
    """
    settings = case.settings
    plain = SimulatedArray(settings)
    span = next(s for s in spans_of(settings.script, settings.rate) if s.kind == "twist")
    truths = [truth for _, truth in plain.scans()]
    loose = [n for n in range(span.first, span.after) if truths[n]["twist_slip"]]
    base = _strain(plain, span.after)
    slopes = np.stack(
        [
            (_strain(SimulatedArray(other, plain.influence), span.after) - base) / STEP
            for other in _others(settings)
        ]
    )
    slopes *= np.where(_broken(case)[..., None], 0.0, 1.0 / _noise(settings, plain))
    ends = span.after, min(loose, default=span.after - 1) + 1
    error, early = (least_error(slopes[:, :end]) for end in ends)
    return Bound(case.seed, settings.cover, settings.shape, span.after - span.first, error, early)


def least_error(slopes: Floats) -> float:
    """Return the bound for the first of some quantities, offsets unknown, too.

    Parameters
    ----------
    slopes : (quantities, frames, ...) float
        What each quantity does to the readings, in standard deviations of their noise.
    """
    free = (slopes - slopes.mean(axis=1, keepdims=True)).reshape(len(slopes), -1)
    inverse: Floats = np.asarray(np.linalg.inv(free @ free.T), dtype=np.float64)
    return sqrt(float(inverse[0, 0]))


def bounds(seeds: Iterable[int]) -> Iterator[Bound]:
    """Yield the bounds of the tuning scenes that twist until half the contact radius slips."""
    for seed in seeds:
        case = slip_case(seed)
        if seed < SCORING and "twist" in case.kind:
            yield bound_of(case)


def _others(settings: Settings) -> Iterator[Settings]:
    """Yield the scene with each quantity changed, the twist's rate first."""
    more = 1.0 + STEP

    def script(change: Callable[[Phase], Phase]) -> Settings:
        return replace(settings, script=tuple(change(phase) for phase in settings.script))

    yield script(lambda phase: replace(phase, angle=phase.angle * more))
    yield script(lambda phase: replace(phase, load=phase.load * more))
    yield replace(settings, radius=settings.radius * more)
    yield replace(settings, friction=settings.friction * more)
    x, y = settings.start
    yield replace(settings, start=(x + STEP * settings.pitch, y))
    yield replace(settings, start=(x, y + STEP * settings.pitch))
    if any(phase.kind == "pull" for phase in settings.script):
        yield script(lambda phase: replace(phase, speed=phase.speed * more))
        yield script(_turned_aside)


def _turned_aside(phase: Phase) -> Phase:
    return replace(phase, direction=phase.direction + STEP) if phase.speed else phase


def _strain(array: SimulatedArray, frames: int) -> Floats:
    """Return the strain of the first frames without noise, (frames, rows, cols, 3)."""
    states = [state for state, _ in array.scans()][:frames]
    parts = [array.strain(states[n : n + 32]) for n in range(0, frames, 32)]
    return np.concatenate(parts)


def _noise(settings: Settings, array: SimulatedArray) -> Floats:
    """Return the noise of strain, RMS, of the three axes; what rounding adds is in it."""
    step = Readout(bits=settings.bits or None).step
    shear, normal = array.calibration.strain_noise(sqrt(settings.noise**2 + step**2 / 12.0))
    return np.array([shear, shear, normal])


def _broken(case: Case) -> NDArray[np.bool_]:
    """Return the taxels that are dead or stuck or noisy, (rows, cols)."""
    faults, readout = case.faults, Readout(noise=case.settings.noise, bits=None)
    volts = np.full((PROBE, *case.settings.shape, 4), 0.1)
    read = replace(faults, drift=0.0).apply(volts, np.zeros(PROBE), readout)
    return np.asarray((read != volts).any(axis=(0, 3)))


def main(count: int) -> None:
    """Print the bounds of the first seeds' twists, and what share of them can be within 10 %."""
    found = list(bounds(range(count)))
    for one in sorted(found, key=lambda one: -one.error):
        rows, cols = one.shape
        print(
            f"{one.seed:5} {one.cover:9} {rows}×{cols} {one.frames:5} frames: "
            f"{one.error:7.2%} at the end, {one.early:7.2%} at c = a/2"
        )
    for cover in ("flat", "bumpy", "bumps-fem"):
        some = [one for one in found if one.cover == cover]
        if some:
            late, soon = (sum(map(chance, errors)) for errors in _errors(some))
            print(f"{cover}: {late:.1f} of {len(some)} within 10 %, {soon:.1f} at c = a/2")


def _errors(some: Sequence[Bound]) -> tuple[list[float], list[float]]:
    return [one.error for one in some], [one.early for one in some]


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 300)
