"""What `cnnum tune` gains on foreign skins: `python docs/figures/tuning.py`.

Minutes of one's own are drawn on two skins. The bristles are those of `cnnum score`. The fingertip
shares nothing with them: 24 electrodes below a fluid, each of which reads one number, under an
object with a coarse face that is pressed, pulled, slides and turns.
"""

import argparse
import sys
from collections.abc import Callable
from math import exp
from pathlib import Path
from time import perf_counter

import numpy as np

import cnnum
from cnnum.arrays import Floats
from cnnum.drivers.simulated.grips import Arrays
from cnnum.frame import FORCE_AXES
from cnnum.lab.scoring.families import bristles
from cnnum.programs.fields import maximum, square, where
from cnnum.programs.reports import report
from cnnum.report.read_outs import draw_tuned
from cnnum.templates.tactile.shared.rest import Clock

RATE, SECONDS = 100.0, 60.0
Minute = tuple[cnnum.Recording, list[tuple[float, float]]]
Moves = tuple[bristles.Moves, ...]
STILL: Moves = (bristles.part_pulled, bristles.oblique(1.0))


@cnnum.program
def pattern_change(
    frame: cnnum.FrameFields, *, rest: float = 0.4, look: float = 0.1, floor: float = 20.0,
    level: float = 1.0, hold_time: float = 0.1,
) -> dict[str, cnnum.Field]:  # fmt: skip
    """Change of the load's pattern, 1/s, which a load that only scales leaves at 0."""
    clock = Clock(frame, rest)
    load = clock.above_rest("normal", 1.0)
    old = frame.memory("load of late").mean(load, 1.0 - exp(-1.0 / (frame.rate * look)))
    noise = clock.noise(square(load).mean(), ("normal",)) * frame.shape[0] * frame.shape[1]
    whole, before = load.sum(), old.sum()
    held = ~clock.resting & (whole > floor * noise) & (before > floor * noise)
    moves = load / maximum(whole, noise) - old / maximum(before, noise)
    size = cnnum.sqrt(square(load).sum())
    change = where(held, cnnum.sqrt(square(moves).sum()) * whole / (look * size), 0.0)
    return {"changes": report(frame, change, level, hold_time * frame.rate), "change": change}


ROWS, COLUMNS, PITCH = 6, 4, 2.0
"""Electrodes of the fingertip, mm apart."""


class Fingertip:
    """A drawn fingertip and the face of an object, which is read at a pose and a load."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng
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


def fingertip(seed: int, *, events: bool) -> Minute:
    """Return a minute of touches: holds, swings of the load, pulls that stick, slips and twists."""
    rng = np.random.default_rng([seed, 24])
    tip, frames, spans = Fingertip(rng), list[Floats](), list[tuple[float, float]]()
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
    last = int(SECONDS * RATE)
    spans = [span for span in spans if span[1] < SECONDS - 0.5]
    values = np.stack(frames[:last])[..., None]
    return cnnum.Recording(values, rate=RATE, unit="count", channels=("normal",)), spans


def skin(seed: int, *, moves: Moves, events: bool) -> Minute:
    """Return a minute of bristles whose taxels have gains, read little shear, and are noisy."""
    rng, parts, spans = (
        np.random.default_rng([seed, 3]),
        list[Floats](),
        list[tuple[float, float]](),
    )
    gains = rng.uniform(0.8, 1.2, (bristles.TAXELS, bristles.TAXELS, 1)) * np.array([0.4, 0.4, 1.0])
    count, drawn = 0, 1000 * seed
    while count < SECONDS * RATE:
        drawn += 1
        if bristles.Brush.drawn("tune", drawn).rate != RATE:
            continue
        trial = bristles.scene(moves[len(parts) % len(moves)])(Arrays(), "tune", drawn)
        rest = trial.frames[: int(0.4 * RATE)].mean(axis=0)
        loads = trial.frames - rest
        air = np.zeros((int(0.6 * RATE), *rest.shape))
        leaves = loads[-1] * np.linspace(1.0, 0.0, int(0.3 * RATE))[:, None, None, None]
        touch = np.concatenate([loads, leaves, air]) / np.abs(loads).max()
        if events and (moving := np.flatnonzero((trial.slips != 0) | (trial.sense != 0))).size:
            spans.append(((count + moving[0]) / RATE, (count + moving[-1]) / RATE))
        parts.append(touch * gains + 0.005 * rng.standard_normal(touch.shape))
        count += len(touch)
    last = int(SECONDS * RATE)
    spans = [span for span in spans if span[1] < SECONDS - 0.5]
    values = np.concatenate(parts)[:last].astype(np.float32)
    return cnnum.Recording(values, rate=RATE, unit="strain", channels=FORCE_AXES), spans


OWN = f"{Path(__file__).resolve()}:pattern_change"

SKINS: dict[str, tuple[str, str, Callable[[int, bool], Minute]]] = {
    "bristles, slides": ("slip", "slip", lambda seed, events: skin(
        seed, moves=(bristles.slide, bristles.rocking) if events else STILL, events=events)),
    "bristles, pivots": ("twist", "twist", lambda seed, events: skin(
        seed, moves=(bristles.pivot,) if events else STILL, events=events)),
    "fingertip": ("tactile_flow", "flow", lambda seed, events: fingertip(seed, events=events)),
    "fingertip, own program": (OWN, "slip", lambda seed, events: fingertip(seed, events=events)),
}  # fmt: skip
"""Skins by name: scene, event, and a minute with or without events."""


def main() -> None:
    """Print a row a skin."""
    arguments = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    arguments.add_argument("--count", type=int, default=5, help="minutes of each kind")
    arguments.add_argument("--seed", type=int, default=0)
    arguments.add_argument("--skin", action="append", help="one of the skins; all by default")
    arguments.add_argument("--charts", help="folder for the pictures")
    given = arguments.parse_args()
    print("| skin | by | level, constants | found | false in ten minutes | at most | delay, s |")
    print("|---|---|---|---|---|---|---|")
    for name in given.skin or SKINS:
        scene, event, make = SKINS[name]
        minutes = [make(given.seed + n, on) for n in range(given.count) for on in (False, True)]
        labels = [
            cnnum.Label(str(n), *span) for n, (_, spans) in enumerate(minutes) for span in spans
        ]
        settings: dict[str, object] = {"program": {"name": scene, "parameters": {}}}
        if scene == "tactile_flow":
            settings["program.parameters"] = {"push": 1.0}
        if scene == OWN:
            settings["event"] = [{"kind": "slip", "flag": "changes", "strength": "change"}]
        begun = perf_counter()
        tuned = cnnum.tune(
            [recording for recording, _ in minutes], "contact", event=event, labels=labels,
            changes={**settings, "needs": [] if scene == OWN else [event]},
        )  # fmt: skip
        seconds = perf_counter() - begun
        changed = "".join(f", {key} {value:g}" for key, value in tuned.constants.items())
        rows = (
            ("shipped", f"{tuned.shipped_level:.3g}", tuned.shipped),
            ("tuned, left out", f"{tuned.level:.3g}{changed}", tuned.left_out),
        )
        for by, level, outcome in rows:
            assert outcome is not None
            print(
                f"| {name} | {by} | {level} | {outcome.found} of {outcome.events} "
                f"| {outcome.rate:.1f} | {outcome.bound:.1f} | {outcome.delay:.2f} |"
            )
        print(f"{name}: {len(minutes)} minutes in {seconds:.1f} s", file=sys.stderr)
        if given.charts:
            draw_tuned(Path(given.charts) / f"{name.replace(' ', '-')}.png", tuned, force=True)


if __name__ == "__main__":
    main()
