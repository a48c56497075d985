"""What `cnnum tune` gains on foreign skins: `python docs/figures/tuning.py`.

Minutes of one's own are drawn on two skins: the bristles and the fingertip of 24 electrodes of
`cnnum score`, which share nothing.
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
from cnnum.lab.scoring.families import fingertip as tips
from cnnum.programs.fields import maximum, square, where
from cnnum.programs.reports import report
from cnnum.report.read_outs import draw_tuned
from cnnum.templates.tactile.shared.rest import Clock

RATE, SECONDS = tips.RATE, tips.SECONDS
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


def fingertip(seed: int, *, events: bool) -> Minute:
    """Return a minute of a fingertip of 24 electrodes."""
    values, spans = tips.minute(seed, events=events)
    spans = [span for span in spans if span[1] < SECONDS - 0.5]
    return cnnum.Recording(values[..., None], rate=RATE, unit="count", channels=("normal",)), spans


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
        touch: Floats = np.concatenate([loads, leaves, air]) / np.abs(loads).max()
        if events and (moving := np.flatnonzero((trial.slips != 0) | (trial.sense != 0))).size:
            spans.append(((count + moving[0]) / RATE, (count + moving[-1]) / RATE))
        parts.append(np.asarray(touch * gains + 0.005 * rng.standard_normal(touch.shape)))
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
    arguments = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
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
