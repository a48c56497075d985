"""A third mechanics: a fingertip of 24 electrodes below a fluid, each of which reads one number.

Nothing here is shared with the simulated array or the bristles. An object with a coarse face is
pressed, held under a load that swings and a pull that sticks, slides or turns, and is let go.
"""

import numpy as np

from cnnum.arrays import Floats
from cnnum.drivers.simulated.grips import SETTLED, Arrays, Trial

RATE, SECONDS = 100.0, 60.0
"""Hz; s of a scene."""

ROWS, COLUMNS, PITCH = 6, 4, 2.0
"""Electrodes, mm apart."""

NEAR = 0.2
"""s around an event whose truth is not known: its begin and end are not sharp."""

Spans = list[tuple[float, float]]
"""Begin and end of each slip or turn, s."""


class Fingertip:
    """A drawn fingertip and the face of an object, which is read at a pose and a load."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.gains = rng.uniform(0.7, 1.3, (ROWS, COLUMNS))
        self.wide = rng.uniform(3.0, 4.5)  # mm, of the contact
        self.coarse = rng.uniform(0.3, 0.6)
        self.waves = rng.normal(size=(12, 2)) * 2.0 * np.pi / 8.0  # 1/mm: details of some 8 mm
        self.phases = rng.uniform(0.0, 2.0 * np.pi, 12)
        y, x = np.mgrid[:ROWS, :COLUMNS]
        self.x, self.y = (x - (COLUMNS - 1) / 2) * PITCH, (y - (ROWS - 1) / 2) * PITCH

    def read(self, load: float, x: float, y: float, angle: float, pull: Floats) -> Floats:
        """Return what the electrodes read: thinner fluid under a load, pushed ahead by a pull."""
        c, s = np.cos(angle), np.sin(angle)
        u, v = c * self.x + s * self.y - x, c * self.y - s * self.x - y
        face = sum(
            np.cos(a * u + b * v + p) for (a, b), p in zip(self.waves, self.phases, strict=True)
        )
        near = np.exp(-(self.x**2 + self.y**2) / (2.0 * self.wide**2))
        bulge = (pull[0] * self.x + pull[1] * self.y) / self.wide
        pressed = near * (1.0 + self.coarse * face / 12.0**0.5 + 0.3 * bulge)
        return np.asarray(200.0 * load**0.7 * self.gains * pressed)


def minute(seed: int, *, events: bool) -> tuple[Floats, Spans]:
    """Return counts of a minute of touches, (frames, rows, cols), and when it slips or turns."""
    rng = np.random.default_rng([seed, 24])
    tip, frames, spans = Fingertip(rng), list[Floats](), Spans()
    rests = rng.uniform(1800.0, 2200.0, (ROWS, COLUMNS))

    def scan(load: float, x: float, y: float, angle: float, pull: Floats) -> None:
        raw = rests + tip.read(load, x, y, angle, pull) + rng.normal(0.0, 1.0, rests.shape)
        frames.append(np.round(raw))

    none = np.zeros(2)
    while len(frames) < SECONDS * RATE:
        x, y, angle = rng.uniform(-20.0, 20.0, 3)
        load, way = rng.uniform(0.3, 2.0), rng.uniform(-np.pi, np.pi)
        to = np.array([np.cos(way), np.sin(way)])
        for _ in range(60):
            scan(0.0, x, y, angle, none)
        for share in np.linspace(0.0, 1.0, int(rng.uniform(20, 60))):
            scan(share * load, x, y, angle, none)
        swing, speed = rng.uniform(0.05, 0.3), rng.uniform(0.5, 3.0)
        held = rng.uniform(0.2, 0.7)
        for t in np.arange(int(rng.uniform(100, 250))) / RATE:  # sticks: it gives by 0.2 mm at most
            pull = held * to * 0.5 * (1.0 - np.cos(2.0 * np.pi * 0.5 * t))
            moves = 0.3 * pull
            scan(load * (1.0 + swing * np.sin(2.0 * np.pi * speed * t)), x + moves[0],
                 y + moves[1], angle, pull)  # fmt: skip
        if events:
            begin = len(frames) / RATE
            count = int(rng.uniform(30, 80))
            if rng.random() < 0.5:
                step = rng.uniform(3.0, 15.0) / RATE * to
                for n in range(count):
                    scan(load, x + n * step[0], y + n * step[1], angle, to)
                x, y = x + count * step[0], y + count * step[1]
            else:
                turn = rng.choice([-1.0, 1.0]) * np.deg2rad(rng.uniform(20.0, 60.0)) / RATE
                for n in range(count):
                    scan(load, x, y, angle + n * turn, none)
                angle += count * turn
            spans.append((begin, len(frames) / RATE))
        for share in np.linspace(1.0, 0.0, int(rng.uniform(20, 60))):
            scan(share * load, x, y, angle, none)
    return np.stack(frames[: int(SECONDS * RATE)]), spans


def scene(_: Arrays, family: str, seed: int) -> Trial:
    """Return a minute with slips and turns, both as slips; its shear channels read nothing."""
    values, spans = minute(seed, events=True)
    slips, time = np.zeros(len(values)), np.arange(len(values)) / RATE
    for begin, end in spans:
        slips[(time >= begin - NEAR) & (time < end + NEAR)] = np.nan
    for begin, end in spans:
        slips[(time >= begin) & (time < end)] = 1.0
    frames = np.zeros((*values.shape, 3), dtype=np.float32)
    frames[..., 2] = values
    none = np.zeros(len(values), dtype=bool)
    return Trial(
        family=family, name=f"{family} {seed}", rate=RATE, frames=frames, slips=slips,
        scored=time >= SETTLED, early=none, slid=np.zeros(len(values)),
        sense=np.zeros(len(values), dtype=np.int64), direction=float("nan"),
        rows=np.arange(len(values)), setting={"rate": RATE, "push": 1.0},
    )  # fmt: skip
