"""Bodies with a sharp outline and smooth ones, by families, and readings of taxels under a cover.

The constants of `edges` were chosen on square and round punches and lying cylinders. Their covers
were 0.3 and 0.5 pitches thick.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from cnnum.arrays import Floats
from cnnum.tactile.flat_punches import FINER, Joined, Outline, punch_pressure, read_below, triangle
from cnnum.tactile.indenters import Disc, Reads, Rectangle, Ring, Touch, frame_under, readings

Frames = Callable[[int, float, Reads], Floats]
"""Cells of a side, cover in pitches, measured quantity: to frames (bodies, cells, cells)."""

BEYOND = 4
"""Pitches of skin on each side of the array that a lying cylinder touches, too."""

FRICTION, FINE = 0.7, 15


@dataclass(frozen=True, slots=True)
class Bodies:
    """Bodies of one family, drawn for an array.

    Attributes
    ----------
    outlines : tuple
        Shape with a signed distance, pitches from the middle; none of smooth bodies.
    frames : callable
    """

    outlines: tuple[Outline, ...]
    frames: Frames


Family = Callable[[np.random.Generator, int, int], Bodies]
"""Draws a number of bodies for a square array."""


def _flat(
    body: Callable[[np.random.Generator, float], Outline],
    rng: np.random.Generator,
    cells: int,
    count: int,
) -> Bodies:
    """Return rigid flat punches."""
    drawn = tuple(body(rng, cells / 8) for _ in range(count))
    pressures = [punch_pressure(outline, cells) for outline in drawn]
    return Bodies(drawn, lambda side, depth, reads: read_below(pressures, side, depth, reads))


def _uniform(
    body: Callable[[np.random.Generator, float], Rectangle | Disc],
    rng: np.random.Generator,
    cells: int,
    count: int,
) -> Bodies:
    """Return uniform loads."""
    drawn = tuple(body(rng, cells / 8) for _ in range(count))
    return Bodies(drawn, partial(_seen, drawn))


def _seen(bodies: Sequence[Rectangle | Disc], cells: int, depth: float, reads: Reads) -> Floats:
    return np.stack([frame_under(body, (cells, cells), depth, reads) for body in bodies])


def _at(rng: np.random.Generator) -> tuple[float, float]:
    x, y = rng.uniform(-0.5, 0.5, 2)
    return float(x), float(y)


def _square(rng: np.random.Generator, size: float, turned: bool = False) -> Rectangle:
    side, angle = size * float(rng.uniform(2.5, 4.5)), float(rng.uniform(0.0, np.pi))
    return Rectangle(side, side, angle if turned else 0.0, _at(rng))


def _round(rng: np.random.Generator, size: float) -> Disc:
    return Disc(size * float(rng.uniform(1.4, 2.8)), _at(rng))


def _ring(rng: np.random.Generator, size: float) -> Ring:
    outer, wide = size * float(rng.uniform(2.5, 2.9)), size * float(rng.uniform(1.2, 1.8))
    return Ring(outer - wide, outer, _at(rng))


def _bar(rng: np.random.Generator, size: float) -> Rectangle:
    wide, long = size * float(rng.uniform(1.4, 2.0)), size * float(rng.uniform(4.0, 6.0))
    return Rectangle(wide, long, float(rng.uniform(0.0, np.pi)), _at(rng))


def _triangle(rng: np.random.Generator, size: float) -> Outline:
    return triangle(size * float(rng.uniform(3.5, 5.0)), float(rng.uniform(0.0, np.pi)), _at(rng))


def _two(rng: np.random.Generator, size: float) -> Joined:
    radii, gap = size * rng.uniform(1.2, 1.5, 2), size * float(rng.uniform(1.0, 1.5))
    angle = float(rng.uniform(0.0, 2.0 * np.pi))
    x, y = 0.5 * (radii.sum() + gap) * np.array([np.cos(angle), np.sin(angle)])
    return Joined((Disc(float(radii[0]), (x, y)), Disc(float(radii[1]), (-x, -y))))


def _spheres(
    radii: tuple[float, float], rng: np.random.Generator, cells: int, count: int
) -> Bodies:
    """Return spheres of contact radii in pitches, on an array of eight; larger ones on larger."""
    sizes = rng.uniform(*radii, count) * cells / 8
    drawn = [Disc(float(size), _at(rng), "hertz") for size in sizes]
    return Bodies((), partial(_seen, drawn))


def _pairs(rng: np.random.Generator, cells: int, count: int) -> Bodies:
    """Return two spheres side by side, the second's pressure 0.5 to 1 of the first's."""
    drawn: list[tuple[tuple[Disc, Disc], float]] = []
    for _ in range(count):
        radii, gap = rng.uniform(1.5, 1.9, 2) * cells / 8, float(rng.uniform(0.5, 1.0))
        angle = float(rng.uniform(0.0, 2.0 * np.pi))
        x, y = 0.5 * (radii.sum() + gap) * np.array([np.cos(angle), np.sin(angle)])
        both = (Disc(float(radii[0]), (x, y), "hertz"), Disc(float(radii[1]), (-x, -y), "hertz"))
        drawn.append((both, float(rng.uniform(0.5, 1.0))))

    def frames(side: int, depth: float, reads: Reads) -> Floats:
        first, second = (_seen([both[k] for both, _ in drawn], side, depth, reads) for k in (0, 1))
        return first + np.array([share for _, share in drawn])[:, None, None] * second

    return Bodies((), frames)


def _pulled(rng: np.random.Generator, cells: int, count: int) -> Bodies:
    """Return spheres that are pulled by up to all that friction holds."""
    drawn = [
        Touch(
            float(rng.uniform(1.6, 3.0)) * cells / 8,
            _at(rng),
            float(rng.uniform(0.3, 0.999)) * FRICTION,
            float(rng.uniform(0.0, 2.0 * np.pi)),
            FRICTION,
        )
        for _ in range(count)
    ]

    def frames(side: int, depth: float, reads: Reads) -> Floats:
        return np.stack([-readings(load, side, depth, reads, FINE)[..., 2] for load in drawn])

    return Bodies((), frames)


def _lying(rng: np.random.Generator, cells: int, count: int) -> Bodies:
    """Return cylinders that lie across all of the array, in any direction (Hertz's line)."""
    side = cells + 2 * BEYOND
    axis = (np.arange(side * FINER) + 0.5) / FINER - side / 2
    x, y = np.meshgrid(axis, axis)
    pressures: list[Floats] = []
    for angle, off, half in zip(
        rng.uniform(0.0, np.pi, count),
        rng.uniform(-0.5, 0.5, count),
        rng.uniform(1.0, 3.2, count) * cells / 8,
        strict=True,
    ):
        across = (np.cos(angle) * x + np.sin(angle) * y - off) / half
        pressures.append(np.sqrt(np.maximum(1.0 - across * across, 0.0)))

    def frames(taxels: int, depth: float, reads: Reads) -> Floats:
        inner = slice(BEYOND, BEYOND + taxels)
        return read_below(pressures, side, depth, reads)[:, inner, inner]

    return Bodies((), frames)


SHARP: dict[str, Family] = {
    "square punch": partial(_flat, _square),
    "round punch": partial(_flat, _round),
    "square punch, turned": partial(_flat, partial(_square, turned=True)),
    "ring": partial(_flat, _ring),
    "bar": partial(_flat, _bar),
    "triangle": partial(_flat, _triangle),
    "two punches": partial(_flat, _two),
    "uniform disc": partial(_uniform, _round),
    "uniform square, turned": partial(_uniform, partial(_square, turned=True)),
}
"""Rigid flat punches, but for the uniform loads; sizes for eight cells a side, larger on larger."""

SMOOTH: dict[str, Family] = {
    "lying cylinder, 1 to 3.2 pitches to each side": _lying,
    "sphere, contact radius 0.6 to 1.4": partial(_spheres, (0.6, 1.4)),
    "sphere, 1.4 to 2": partial(_spheres, (1.4, 2.0)),
    "sphere, 2 to 3.6": partial(_spheres, (2.0, 3.6)),
    "two spheres, 1.5 to 1.9": _pairs,
    "pulled sphere, 1.6 to 3": _pulled,
}

CHOSEN_ON = ("square punch", "round punch", "lying cylinder, 1 to 3.2 pitches to each side")
