"""How often `body_fit` reports a sphere or a punch, under those and under other bodies.

`python -m cnnum.lab.bench.programs.body_errors` prints the table of `docs/programs/edges.md`:
bodies at drawn places on 8×8 taxels, under covers in strain and stress, with 1 % of noise.
"""

from collections.abc import Callable, Mapping

import numpy as np

from cnnum.arrays import Floats
from cnnum.engine import Engine
from cnnum.frame import FORCE_AXES
from cnnum.programs.library import get_program
from cnnum.tactile.indenters import (
    Disc,
    Indenter,
    Pressure,
    Reads,
    Rectangle,
    Ring,
    Several,
    frame_under,
)
from cnnum.templating.checks.program_run import RATE

COVERS: tuple[tuple[Reads, float], ...] = (
    ("strain", 0.3), ("strain", 0.5), ("strain", 1.0), ("stress", 0.75),
)  # fmt: skip
SHAPE, COUNT, SEED = (8, 8), 20, 11
PRESSURE, NOISE, REST, PRESSED = 0.02, 0.01, 20, 6
"""Mean pressure; noise over the peak; frames of rest, and under the body."""

OUTPUTS = ("sphere_fits", "flat_fits", "contact_radius", "sphere_radius")
MODULUS = 2.0

Draw = Callable[[np.random.Generator, tuple[float, float]], Indenter]


def _disc(pressure: Pressure, low: float, high: float) -> Draw:
    return lambda rng, centre: Disc(rng.uniform(low, high), centre, pressure)


def _pair(rng: np.random.Generator, centre: tuple[float, float]) -> Indenter:
    apart = rng.uniform(0.6, 1.6)
    places = [(centre[0] + side * apart, centre[1]) for side in (-1.0, 1.0)]
    return Several(tuple(Disc(1.5, place, "hertz") for place in places))


def _square(rng: np.random.Generator, centre: tuple[float, float]) -> Indenter:
    side = rng.uniform(3.0, 5.0)
    return Rectangle(side, side, rng.uniform(0.0, np.pi), centre)


BODIES: Mapping[str, Draw] = {
    "sphere, contact radius 1 to 1.9 pitches": _disc("hertz", 1.0, 1.9),
    "sphere, 2 to 3": _disc("hertz", 2.0, 3.0),
    "round punch, 1.7 to 3": _disc("punch", 1.7, 3.0),
    "uniform disc, 1.5 to 2": _disc("uniform", 1.5, 2.0),
    "uniform disc, 2 to 3": _disc("uniform", 2.0, 3.0),
    "uniform square": _square,
    "bar": lambda rng, c: Rectangle(
        rng.uniform(1.0, 2.0), rng.uniform(4.0, 6.0), rng.uniform(0.0, np.pi), c
    ),
    "ring": lambda rng, c: Ring(rng.uniform(0.8, 1.5), rng.uniform(2.2, 3.0), c),
    "two spheres": _pair,
}


def fitted(bodies: list[Indenter], reads: Reads, depth: float) -> dict[str, Floats]:
    """Return the last outputs under each body, side by side."""
    loads = np.stack([PRESSURE * frame_under(body, SHAPE, depth, reads) for body in bodies])
    rng = np.random.default_rng(SEED + 1)
    frames = rng.normal(size=(REST + PRESSED, len(bodies), *SHAPE, 3))
    frames *= NOISE * loads.max(axis=(1, 2))[:, None, None, None]
    frames[REST:, ..., 2] -= loads
    program = get_program("body_fit").bind(rate=RATE, depth=depth, reads=reads, modulus=MODULUS)
    plan = Engine().compile(program, SHAPE, OUTPUTS, channels=FORCE_AXES)
    columns = [FORCE_AXES.index(channel) for channel in plan.schedule.channels]
    stream = plan.stream((len(bodies),))
    said: Mapping[str, Floats] = {}
    for frame in frames:
        said = stream.push(np.ascontiguousarray(frame[..., columns]))
    return {name: np.array(said[name], dtype=np.float64) for name in OUTPUTS}


def main() -> None:
    """Print one row per kind of body, the shares of each cover in turn."""
    rng = np.random.default_rng(SEED)
    drawn = {name: [_drawn(rng, draw) for _ in range(COUNT)] for name, draw in BODIES.items()}
    flat = [body for some in drawn.values() for body in some]
    outputs = [fitted(flat, reads, depth) for reads, depth in COVERS]
    heads = " | ".join(f"{reads}, {depth:g}" for reads, depth in COVERS)
    print(f"| body: sphere / punch reported | {heads} | radius off | R off |")
    print("|---|---|---|---|---|---|---|")
    for place, (name, some) in enumerate(drawn.items()):
        own = slice(place * COUNT, (place + 1) * COUNT)
        print(f"| {name} | {' | '.join(_cells(some, [_cut(output, own) for output in outputs]))} |")


def _drawn(rng: np.random.Generator, draw: Draw) -> Indenter:
    x, y = rng.uniform(-0.5, 0.5, 2)
    return draw(rng, (float(x), float(y)))


def _cut(outputs: dict[str, Floats], own: slice) -> dict[str, Floats]:
    return {name: values[own] for name, values in outputs.items()}


def _cells(bodies: list[Indenter], outputs: list[dict[str, Floats]]) -> list[str]:
    shares = [
        f"{output['sphere_fits'].mean():.0%} / {output['flat_fits'].mean():.0%}"
        for output in outputs
    ]
    discs = [body for body in bodies if isinstance(body, Disc)]
    if not discs:
        return [*shares, "–", "–"]
    true = np.array([disc.radius for disc in discs])
    off, curved = list[float](), list[float]()
    for output in outputs:
        fitted = (output["sphere_fits"] + output["flat_fits"]) > 0
        off += (np.abs(output["contact_radius"] / true - 1.0))[fitted].tolist()
        round_one = 2.0 * true * MODULUS / (np.pi * 1.5 * PRESSURE)
        curved += (np.abs(output["sphere_radius"] / round_one - 1.0))[
            output["sphere_fits"] > 0
        ].tolist()
    right = discs[0].pressure != "uniform"
    return [
        *shares,
        *(f"{np.median(errors):.0%}" if errors and right else "–" for errors in (off, curved)),
    ]


if __name__ == "__main__":
    main()
